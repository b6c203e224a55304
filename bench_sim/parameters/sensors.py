"""The sensors' part of a parameter file: one table per kind of sensor, one entry per property of all sensors."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from bench_protocol.table import TABLE
from bench_protocol.table_signals import BY_GROUP
from bench_sim.model.layout import Sensor
from bench_sim.model.quantities import SENSOR_QUANTITIES, Quantity
from bench_sim.model.wiring import sensor_of
from bench_sim.parameters.loading import Entry, ParameterError, read_entry, require, unknown

#: kind of sensor in a parameter file -> (SI unit of its signal, the sensors of that kind)
SENSOR_KINDS: Final[Mapping[str, tuple[str, tuple[Sensor, ...]]]] = MappingProxyType(
    {
        str(group): (TABLE[names[0]].si, tuple(sensor_of(name) for name in names))
        for group, names in BY_GROUP.items()
    }
)

_RATES: Final = {"m": "m/s", "Pa": "Pa/s", "K": "K/s", "N": "N/s", "m/s2": "m/s3", "rad": "rad/s"}


def sensor_units(quantity: Quantity) -> dict[str, str]:
    """Return the SI unit of one property of each sensor, by the sensor's name in small letters."""
    return {
        member.name.lower(): {"signal": signal, "signal/s": _RATES[signal]}.get(quantity.unit, quantity.unit)
        for signal, members in SENSOR_KINDS.values()
        for member in members
    }


def read_sensors(tables: Mapping[str, Any]) -> dict[str, Entry]:
    """Gather the kinds of sensor into one entry per property, each with an element per sensor."""
    for kind in tables:
        if kind not in SENSOR_KINDS:
            raise ParameterError(unknown(kind, tuple(SENSOR_KINDS), "kind of sensor"))
    require(SENSOR_KINDS, tables, "kind of sensor")
    entries = {}
    for quantity in SENSOR_QUANTITIES:
        key = quantity.name.removeprefix("sensor_")
        value, low, high = (np.zeros(quantity.shape) for _ in range(3))
        units = sensor_units(quantity)
        for kind, (_, members) in SENSOR_KINDS.items():
            if key not in tables[kind]:
                raise ParameterError(f"sensor {kind} lacks {key}")
            one = read_entry(
                f"sensor.{kind}.{key}", tables[kind][key], Quantity(key, units[members[0].name.lower()])
            )
            places = list(members)
            value[places], low[places], high[places] = one.value, one.low, one.high
        elements = tuple((sensor.name.lower(), units[sensor.name.lower()]) for sensor in Sensor)
        entries[quantity.name] = Entry(
            value, low, high, "per sensor", 1.0, "assumed", "one entry per kind of sensor", elements
        )
    properties = {quantity.name.removeprefix("sensor_") for quantity in SENSOR_QUANTITIES}
    for kind, table in tables.items():
        for key in table:
            if key not in properties:
                raise ParameterError(unknown(f"sensor.{kind}.{key}", tuple(sorted(properties))))
    return entries
