"""Which sensors an effect of the measuring chain concerns, as indices into the sensors' properties."""

from typing import Final

from bench_protocol.signals import Group
from bench_sim.model.layout import Sensor
from bench_sim.model.wiring import sensors_of

VERTICAL_CELLS: Final = sensors_of(Group.VERTICAL_LOAD_CELL)
LATERAL_CELLS: Final = sensors_of(Group.LATERAL_LOAD_CELL)
TRANSDUCERS: Final = [*sensors_of(Group.VERTICAL_FORCE), *sensors_of(Group.LATERAL_FORCE)]
#: All load cells in their order, from number 1 on.
CELLS: Final = [*VERTICAL_CELLS, *LATERAL_CELLS]
#: Load cells and the actuators' force transducers: one make of amplifier.
FORCES: Final = [*TRANSDUCERS, *CELLS]
#: All that says where springs, pistons and platform are.
DISPLACEMENTS: Final = [
    *(Sensor.LEFT_HEIGHT, Sensor.RIGHT_HEIGHT),
    *(Sensor.VERTICAL_LEFT_DISPLACEMENT, Sensor.VERTICAL_RIGHT_DISPLACEMENT, Sensor.LATERAL_DISPLACEMENT),
    *(Sensor.PLATFORM_VERTICAL, Sensor.PLATFORM_LATERAL, Sensor.PLATFORM_ROLL),
]
#: The four chambers.
PRESSURES: Final = sensors_of(Group.PRESSURE)
#: By side: the two vertical load cells under a spring, and the transmitter of its bellows.
CELLS_BY_SIDE: Final = ([Sensor.LOAD_CELL_1, Sensor.LOAD_CELL_3], [Sensor.LOAD_CELL_2, Sensor.LOAD_CELL_4])
BELLOWS_BY_SIDE: Final = (Sensor.LEFT_BELLOWS_PRESSURE, Sensor.RIGHT_BELLOWS_PRESSURE)
