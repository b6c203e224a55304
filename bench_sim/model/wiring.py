"""Which sensor of the measuring chain feeds which signal of the wires: both are numbered alike, as is checked here."""

from itertools import zip_longest

from bench_protocol.signals import Group, Signal
from bench_protocol.table import TABLE
from bench_protocol.table_signals import BY_GROUP, MEASUREMENTS
from bench_sim.model.layout import Sensor


def sensor_of(name: str) -> Sensor:
    """Return the sensor behind the measurement ``name``; ValueError for a signal that no sensor feeds."""
    return Sensor(TABLE.index[name])


def sensors_of(group: Group) -> list[Sensor]:
    """Return all sensors of one kind, in their order."""
    return [sensor_of(name) for name in BY_GROUP[group]]


def _check(measurement: Signal | None, sensor: Sensor | None) -> None:
    """ImportError, which states what is missing, unless ``sensor`` feeds ``measurement``."""
    wanted = measurement.name.replace(".", "_").upper() if measurement else ""
    if measurement and sensor is None:
        raise ImportError(
            f"the measuring chain has no sensor for {measurement.name} of the table: it needs {wanted} = {len(Sensor)} "
            "in Sensor (bench_sim/model/layout.py) and what it reads (bench_sim/model/sensors.py)"
        )
    if sensor is not None and not measurement:
        raise ImportError(
            f"no signal carries what Sensor.{sensor.name} reads: it needs a row at the end of MEASUREMENTS "
            "(bench_protocol/table_signals.py)"
        )
    if sensor is not None and sensor.name != wanted:
        raise ImportError(
            f"row {sensor.value} of MEASUREMENTS needs the sensor {wanted}, and sensor {sensor.value} is "
            f"{sensor.name}: both stand in one order; what is new comes last"
        )


for _measurement, _sensor in zip_longest(MEASUREMENTS, Sensor):
    _check(_measurement, _sensor)
assert TABLE.signals[: len(Sensor)] == MEASUREMENTS, "the measurements come first in the table"
