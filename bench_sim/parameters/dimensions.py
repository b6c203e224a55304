"""Dimensions of a rig as parameters of its simulation, and the other way round."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from bench_protocol.dimensions import ACROSS, LAGS, Dimensions, across, lag
from bench_sim.model.layout import Sensor
from bench_sim.parameters import ParameterError, Parameters

_ALL, _VERTICAL, _LATERAL = slice(None), slice(0, 2), slice(2, 3)
#: By dimension: the parameter, and which elements of it.
_PARAMETERS: Final = {
    **{
        name: (name, _ALL)
        for name in (
            "bolster_mass",
            "gravity",
            "spring_half_spacing",
            "centre_height",
            "lateral_actuator_height",
            "accelerometer_height",
            "column_height",
            "load_cell_height",
            "actuator_frequency",
            "actuator_damping",
        )
    },
    "actuator_speed": ("actuator_speed_limit", _ALL),
    "stop_gap": ("bump_stop_travel", slice(0, 1)),
    "vertical_frame_stiffness": ("frame_stiffness", _VERTICAL),
    "vertical_frame_damping": ("frame_damping", _VERTICAL),
    "lateral_frame_stiffness": ("frame_stiffness", _LATERAL),
    "lateral_frame_damping": ("frame_damping", _LATERAL),
}
#: Spacings that are alike to both sides, by parameter: the places of the left side.
_SPACINGS: Final = {
    "spring_half_spacing": ("left.height",),
    "actuator_half_spacing": ("vertical_left",),
    "load_cell_y": ("load_cell.1", "load_cell.3"),
}
_LEFT: Final = tuple(place for places in _SPACINGS.values() for place in places)
_SAME: Final = 1e-9


def dimensions_of(parameters: Parameters) -> dict[str, float]:
    """Return the dimensions (SI) of a rig with these parameters, by name, without its effects, which nobody knows.

    The lasers stand at the springs, and load cells 1 and 3 on the left.
    """

    def of(parameter: str, elements: slice = _ALL) -> float:
        return float(parameters.entries[parameter].value.flat[elements][0])

    def place(name: str) -> float:
        spacing = next(
            parameter for parameter, places in _SPACINGS.items() if _kind(name) == _kind(places[0])
        )
        return of(spacing) if name in _LEFT else -of(spacing)

    lags = parameters.entries["sensor_lag"].value
    return {
        **{name: of(*where) for name, where in _PARAMETERS.items()},
        **{across(name): place(name) for name in ACROSS},
        **{lag(name): float(lags[_sensor(name)]) for name in LAGS},
    }


def built_as(parameters: Parameters, dimensions: Mapping[str, float]) -> Parameters:
    """Return the set of a rig with these ``dimensions`` (SI, by name); what they do not state stays as it is.

    ParameterError for dimensions that the simulated bench cannot have: lasers stand at the springs, and both sides are
    alike.
    """
    now, changes = dimensions_of(parameters), dict[str, Any]()
    differ = {
        name: value for name, value in dimensions.items() if name in now and abs(value - now[name]) > _SAME
    }
    for name in differ.keys() & _PARAMETERS.keys():
        parameter, elements = _PARAMETERS[name]
        values = changes.setdefault(parameter, np.array(parameters.entries[parameter].value))
        if name == "stop_gap":  # its force over travel begins elsewhere
            values += differ[name] - now[name]
        else:
            values.flat[elements] = differ[name]
    if any(name in differ for name in (*map(across, ACROSS), "spring_half_spacing")):
        changes |= _spacings({**now, **dimensions})
    if late := {_sensor(name): differ[lag(name)] for name in LAGS if lag(name) in differ}:
        changes["sensor_lag"] = late
    return parameters.with_values(**changes)


def described(parameters: Parameters, dimensions: Dimensions) -> Parameters:
    """Return the set of the rig that a file of dimensions describes, as `built_as`."""
    return built_as(parameters, {name: one.value for name, one in dimensions.known.items()})


def _spacings(dimensions: Mapping[str, float]) -> dict[str, float]:
    found: dict[str, float] = {}
    for parameter in _SPACINGS:
        kind = _kind(_SPACINGS[parameter][0])
        places = {abs(dimensions[across(one)]) for one in ACROSS if _kind(one) == kind}
        if parameter == "spring_half_spacing":
            places.add(dimensions["spring_half_spacing"])
        if max(places) - min(places) > _SAME:
            told = ", ".join(f"{one:g} m" for one in sorted(places))
            raise ParameterError(
                f"{parameter}: {told} from the middle; the simulated bench has both sides alike, and lasers at the "
                "springs"
            )
        found[parameter] = max(places)
    return found


def _kind(place: str) -> str:
    return "height" if place.endswith("height") else place.partition("_")[0]


def _sensor(signal: str) -> Sensor:
    return Sensor[signal.replace(".", "_").upper()]
