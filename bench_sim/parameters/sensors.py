"""The sensors' part of a parameter file: one table per kind of sensor, one entry per property of all sensors."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from bench_sim.model.layout import Sensor
from bench_sim.model.quantities import SENSOR_QUANTITIES, Quantity
from bench_sim.parameters.loading import Entry, ParameterError, read_entry, require, unknown

#: kind of sensor in a parameter file -> (SI unit of its signal, the sensors of that kind)
SENSOR_KINDS: Final[Mapping[str, tuple[str, tuple[Sensor, ...]]]] = MappingProxyType(
    {
        "height": ("m", (Sensor.LEFT_HEIGHT, Sensor.RIGHT_HEIGHT)),
        "pressure": (
            "Pa",
            (
                Sensor.LEFT_BELLOWS_PRESSURE,
                Sensor.RIGHT_BELLOWS_PRESSURE,
                Sensor.LEFT_AUXILIARY_PRESSURE,
                Sensor.RIGHT_AUXILIARY_PRESSURE,
            ),
        ),
        "supply_pressure": ("Pa", (Sensor.SUPPLY_PRESSURE,)),
        "temperature": (
            "K",
            (
                Sensor.LEFT_BELLOWS_TEMPERATURE,
                Sensor.RIGHT_BELLOWS_TEMPERATURE,
                Sensor.LEFT_AUXILIARY_TEMPERATURE,
                Sensor.RIGHT_AUXILIARY_TEMPERATURE,
            ),
        ),
        "vertical_force": ("N", (Sensor.VERTICAL_LEFT_FORCE, Sensor.VERTICAL_RIGHT_FORCE)),
        "lateral_force": ("N", (Sensor.LATERAL_FORCE,)),
        "displacement": (
            "m",
            (
                Sensor.VERTICAL_LEFT_DISPLACEMENT,
                Sensor.VERTICAL_RIGHT_DISPLACEMENT,
                Sensor.LATERAL_DISPLACEMENT,
            ),
        ),
        "vertical_load_cell": (
            "N",
            (Sensor.LOAD_CELL_1, Sensor.LOAD_CELL_2, Sensor.LOAD_CELL_3, Sensor.LOAD_CELL_4),
        ),
        "lateral_load_cell": ("N", (Sensor.LOAD_CELL_5, Sensor.LOAD_CELL_6)),
        "acceleration": ("m/s2", (Sensor.LATERAL_ACCELERATION,)),
        "platform_displacement": ("m", (Sensor.PLATFORM_VERTICAL, Sensor.PLATFORM_LATERAL)),
        "platform_roll": ("rad", (Sensor.PLATFORM_ROLL,)),
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
