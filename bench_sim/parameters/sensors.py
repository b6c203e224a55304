"""The sensors in a parameter file. The file has one table per kind of sensor; the set has one entry per property."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from bench_protocol.table_groups import Group
from bench_protocol.table_signals import BY_GROUP
from bench_protocol.units import FACTORS, s
from bench_sim.model.layout import Sensor
from bench_sim.model.quantities import SENSOR_QUANTITIES, Quantity
from bench_sim.model.wiring import sensor_of
from bench_sim.parameters.loading import Entry, ParameterError, read_entry, unknown

#: kind of sensor in a parameter file -> (SI unit of its signal, the sensors of that kind)
SENSOR_KINDS: Final[Mapping[str, tuple[str, tuple[Sensor, ...]]]] = MappingProxyType(
    {
        str(group): (group.row.si, tuple(sensor_of(name) for name in names))
        for group, names in BY_GROUP.items()
    }
)

#: Largest lag, and farthest end of a range (SI), that a parameter file may give.
_LAG_MAX: Final = 10 * s
_FAR: Final = 1e7
_OF_RANGE: Final = "end of range"
_HEALTHY: Final = "healthy"


def _rate(si: str) -> str:
    """Return the SI unit of the drift of a signal with the unit ``si``."""
    return {"m/s": "m/s2", "m/s2": "m/s3"}.get(si, f"{si}/s")


def sensor_units(quantity: Quantity) -> dict[str, str]:
    """Return the SI unit of one property for each sensor, by the sensor's name in lower case."""
    return {
        member.name.lower(): {"signal": signal, "signal/s": _rate(signal)}.get(quantity.unit, quantity.unit)
        for signal, members in SENSOR_KINDS.values()
        for member in members
    }


def sensor_entries(group: Group) -> dict[str, Entry]:
    """Return the default properties of the simulated sensors of a group, from its row in the table of groups."""
    row = group.row
    of_converter = "16-bit converter over its range, rounded"
    drawn = "as designed; a rig as built draws it within the accuracy"
    rows: dict[str, tuple[float, float, float, str, str]] = {
        "gain": (0.0, -0.5, 0.5, "assumed", f"relative error; {_HEALTHY}"),
        "bias": (0.0, -row.bias_max, row.bias_max, "assumed", drawn),
        "accuracy": (row.accuracy, 0.0, row.bias_max, "assumed", row.source),
        "drift": (0.0, -row.bias_max / 10, row.bias_max / 10, "assumed", _HEALTHY),
        "lag": (row.lag, 0.0, _LAG_MAX, "assumed", row.source),
        "noise": (row.noise, 0.0, row.bias_max, row.noise_provenance, row.noise_source),
        "resolution": (row.resolution, 0.0, row.bias_max, "assumed", of_converter),
        "low": (row.reads[0], -_FAR, row.reads[1], "assumed", _OF_RANGE),
        "high": (row.reads[1], 0.0, _FAR, "assumed", _OF_RANGE),
    }
    entries = {}
    for quantity in SENSOR_QUANTITIES:
        key = quantity.name.removeprefix("sensor_")
        unit = {"signal": row.unit, "signal/s": _rate(row.si), "s": "ms"}.get(quantity.unit, quantity.unit)
        *numbers, provenance, source = rows[key]
        value, low, high = (np.array(number, dtype=np.float64) for number in numbers)
        entries[key] = Entry(value, low, high, unit, FACTORS.get(unit, 1.0), provenance, source)
    return entries


def read_sensors(tables: Mapping[str, Any]) -> dict[str, Entry]:
    """Return one entry for each sensor property, with an element for each sensor.

    Properties that are missing in ``tables`` are those of `sensor_entries`.
    """
    properties = {quantity.name.removeprefix("sensor_"): quantity for quantity in SENSOR_QUANTITIES}
    for kind, table in tables.items():
        if kind not in SENSOR_KINDS:
            raise ParameterError(unknown(kind, tuple(SENSOR_KINDS), "kind of sensor"))
        for key in table:
            if key not in properties:
                raise ParameterError(unknown(f"sensor.{kind}.{key}", tuple(sorted(properties))))
    rows = {str(group): sensor_entries(group) for group in Group}
    entries = {}
    for key, quantity in properties.items():
        value, low, high = (np.zeros(quantity.shape) for _ in range(3))
        units = sensor_units(quantity)
        for kind, (_, members) in SENSOR_KINDS.items():
            one = rows[kind][key]
            if key in tables.get(kind, {}):
                unit = units[members[0].name.lower()]
                one = read_entry(f"sensor.{kind}.{key}", tables[kind][key], Quantity(key, unit))
            places = list(members)
            value[places], low[places], high[places] = one.value, one.low, one.high
        elements = tuple((sensor.name.lower(), units[sensor.name.lower()]) for sensor in Sensor)
        entries[quantity.name] = Entry(
            value, low, high, "per sensor", 1.0, "assumed", "one entry per kind of sensor", elements
        )
    return entries
