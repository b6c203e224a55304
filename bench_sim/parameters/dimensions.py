"""Converts the dimensions of a rig to parameters of its simulation, and back."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from bench_protocol.dimensions import ACROSS, LAGS, LOAD_CELLS, Dimensions, across, direction, lag, place
from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
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
#: Spacings that are alike to both sides, by parameter: the place of the left side.
_SPACINGS: Final = {"spring_half_spacing": "left.height", "actuator_half_spacing": "vertical_left"}
_SAME: Final = 1e-9
#: Position of each cell in `load_cell_x`, `load_cell_y` and `load_cell_height`, and its direction.
_UPRIGHT, _ACROSS = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
_CELLS: Final = {
    "load_cell.1": ((1, 1, 0), _UPRIGHT),
    "load_cell.2": ((1, -1, 0), _UPRIGHT),
    "load_cell.3": ((-1, 1, 0), _UPRIGHT),
    "load_cell.4": ((-1, -1, 0), _UPRIGHT),
    "load_cell.5": ((1, 0, 1), _ACROSS),
    "load_cell.6": ((-1, 0, 1), _ACROSS),
}
_LAGS: Final = tuple(name for name in LAGS if TABLE[name].kind is not Kind.FURTHER)
_OF_CELLS: Final = ("load_cell_x", "load_cell_y", "load_cell_height")


def dimensions_of(parameters: Parameters) -> dict[str, float]:
    """Return the dimensions (SI) of a rig with these parameters, by name. Effects of the set are not included.

    The lasers are at the springs. Load cells 1 to 4 are vertical at the corners, 5 and 6 are lateral, in front and
    behind.
    """

    def of(parameter: str, elements: slice = _ALL) -> float:
        return float(parameters.entries[parameter].value.flat[elements][0])

    def standing(name: str) -> float:
        spacing = next(parameter for parameter, one in _SPACINGS.items() if _kind(name) == _kind(one))
        return of(spacing) if name in _SPACINGS.values() else -of(spacing)

    lags = parameters.entries["sensor_lag"].value
    return {
        **{name: of(*where) for name, where in _PARAMETERS.items()},
        **{across(name): standing(name) for name in ACROSS},
        **_cells_of(*map(of, _OF_CELLS)),
        **{lag(name): float(lags[_sensor(name)]) for name in _LAGS},
    }


def built_as(parameters: Parameters, dimensions: Mapping[str, float]) -> Parameters:
    """Return the parameters of a rig with these ``dimensions`` (SI, by name). Other parameters do not change.

    Raises ParameterError for dimensions that the simulated bench cannot have. In the simulated bench the lasers are at
    the springs, and both sides are equal. Of the six load cells, four are vertical at the corners, and two are
    lateral, in front and behind.
    """
    if further := [cell for cell in LOAD_CELLS if cell not in _CELLS and place(cell)[0] in dimensions]:
        raise ParameterError(
            f"{', '.join(further)}: the simulated bench has only six load cells; remove the others"
        )
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
    if any(name in differ for cell in LOAD_CELLS for name in (*place(cell), *direction(cell))):
        changes |= _cells({**now, **dimensions})
    if late := {_sensor(name): differ[lag(name)] for name in _LAGS if lag(name) in differ}:
        changes["sensor_lag"] = late
    return parameters.with_values(**changes)


def described(parameters: Parameters, dimensions: Dimensions) -> Parameters:
    """Return the parameters of the rig with these dimensions (`built_as`)."""
    return built_as(parameters, {name: one.value for name, one in dimensions.known.items()})


def _spacings(dimensions: Mapping[str, float]) -> dict[str, float]:
    found: dict[str, float] = {}
    for parameter, left in _SPACINGS.items():
        kind = _kind(left)
        places = {abs(dimensions[across(one)]) for one in ACROSS if _kind(one) == kind}
        if parameter == "spring_half_spacing":
            places.add(dimensions["spring_half_spacing"])
        if max(places) - min(places) > _SAME:
            text = ", ".join(f"{one:g} m" for one in sorted(places))
            raise ParameterError(
                f"{parameter}: {text} from the middle; the simulated bench needs the same distance on "
                "both sides, and lasers at the springs"
            )
        found[parameter] = max(places)
    return found


def _cells_of(*spacings: float) -> dict[str, float]:
    """Return positions and directions of all load cells by name, for these values of `_OF_CELLS`."""
    found: dict[str, float] = {}
    for cell, (stands, points) in _CELLS.items():
        found |= {name: one * size for name, one, size in zip(place(cell), stands, spacings, strict=True)}
        found |= dict(zip(direction(cell), points, strict=True))
    return found


def _cells(dimensions: Mapping[str, float]) -> dict[str, float]:
    corner, across_ahead = LOAD_CELLS[0], LOAD_CELLS[4]
    x, y, _ = (abs(dimensions[name]) for name in place(corner))
    found = dict(zip(_OF_CELLS, (x, y, dimensions[place(across_ahead)[2]]), strict=True))
    wrong = [
        f"{name} = {dimensions[name]:g} instead of {value:g}"
        for name, value in _cells_of(*found.values()).items()
        if abs(dimensions[name] - value) > _SAME
    ]
    if wrong:
        raise ParameterError(
            f"{'; '.join(wrong)}: the simulated bench has four vertical load cells at the corners of a "
            "rectangle, and two lateral ones in front and behind"
        )
    return found


def _kind(where: str) -> str:
    return "height" if where.endswith("height") else where.partition("_")[0]


def _sensor(signal: str) -> Sensor:
    return Sensor[signal.replace(".", "_").upper()]
