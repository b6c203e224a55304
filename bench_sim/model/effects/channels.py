"""Which sensors an effect of the measuring chain concerns, as indices into the sensors' properties."""

from typing import Final

from bench_sim.model.layout import Sensor

VERTICAL_CELLS: Final = [Sensor.LOAD_CELL_1, Sensor.LOAD_CELL_2, Sensor.LOAD_CELL_3, Sensor.LOAD_CELL_4]
LATERAL_CELLS: Final = [Sensor.LOAD_CELL_5, Sensor.LOAD_CELL_6]
TRANSDUCERS: Final = [Sensor.VERTICAL_LEFT_FORCE, Sensor.VERTICAL_RIGHT_FORCE, Sensor.LATERAL_FORCE]
#: Load cells and the actuators' force transducers: one make of amplifier.
FORCES: Final = [*TRANSDUCERS, *VERTICAL_CELLS, *LATERAL_CELLS]
#: The four chambers.
PRESSURES: Final = [
    Sensor.LEFT_BELLOWS_PRESSURE,
    Sensor.RIGHT_BELLOWS_PRESSURE,
    Sensor.LEFT_AUXILIARY_PRESSURE,
    Sensor.RIGHT_AUXILIARY_PRESSURE,
]
#: By side: the two vertical load cells under a spring, and the transmitter of its bellows.
CELLS_BY_SIDE: Final = ([Sensor.LOAD_CELL_1, Sensor.LOAD_CELL_3], [Sensor.LOAD_CELL_2, Sensor.LOAD_CELL_4])
BELLOWS_BY_SIDE: Final = (Sensor.LEFT_BELLOWS_PRESSURE, Sensor.RIGHT_BELLOWS_PRESSURE)
