"""The sensor of the measuring chain for each measured signal. The import checks that both lists agree."""

from itertools import zip_longest
from typing import Final

from bench_protocol.signals import Group, Signal
from bench_protocol.table import TABLE
from bench_protocol.table_signals import BY_GROUP, MEASUREMENTS
from bench_sim.model.layout import Sensor


def sensor_of(name: str) -> Sensor:
    """Return the sensor that measures the signal ``name``. Raises ValueError for a signal without a sensor."""
    return Sensor(TABLE.index[name])


def sensors_of(group: Group) -> list[Sensor]:
    """Return all sensors of one kind, in their order."""
    return [sensor_of(name) for name in BY_GROUP[group]]


def _check(measurement: Signal | None, sensor: Sensor | None) -> None:
    """Raise ImportError unless ``sensor`` belongs to ``measurement``. The message states the missing entry."""
    wanted = measurement.name.replace(".", "_").upper() if measurement else ""
    if measurement and sensor is None:
        raise ImportError(
            f"the measuring chain has no sensor for {measurement.name} of the table; add {wanted} = "
            f"{len(Sensor)} to Sensor (bench_sim/model/layout.py), and its reading "
            "(bench_sim/model/sensors.py)"
        )
    if sensor is not None and not measurement:
        raise ImportError(
            f"no signal carries what Sensor.{sensor.name} reads; add a row at the end of MEASUREMENTS "
            "(bench_protocol/table_signals.py)"
        )
    if sensor is not None and sensor.name != wanted:
        raise ImportError(
            f"row {sensor.value} of MEASUREMENTS needs the sensor {wanted}, and sensor {sensor.value} "
            f"is {sensor.name}; write both in the same order, with new ones at the end"
        )


for _measurement, _sensor in zip_longest(MEASUREMENTS, Sensor):
    _check(_measurement, _sensor)
assert TABLE.signals[: len(Sensor)] == MEASUREMENTS, "the measurements come first in the table"

# Sensors by kind, as indices into their properties.
VERTICAL_CELLS: Final = sensors_of(Group.VERTICAL_LOAD_CELL)
LATERAL_CELLS: Final = sensors_of(Group.LATERAL_LOAD_CELL)
TRANSDUCERS: Final = [*sensors_of(Group.VERTICAL_FORCE), *sensors_of(Group.LATERAL_FORCE)]
#: All load cells in their order, from number 1 on.
CELLS: Final = [*VERTICAL_CELLS, *LATERAL_CELLS]
#: Load cells and the actuators' force transducers: one make of amplifier.
FORCES: Final = [*TRANSDUCERS, *CELLS]
#: All readings of the positions of springs, pistons and platform.
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
