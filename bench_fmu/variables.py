"""The variables of the spring's FMU: names, units, bounds and places of its inputs, outputs and parameters."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from math import inf
from typing import Any, Final

import numpy as np

from bench_protocol.table import TABLE
from bench_protocol.words import SIDES
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.layout import Input, State
from bench_sim.model.quantities import PARAMETERS, PLANT_QUANTITIES
from bench_sim.parameters import Parameters


class Kind(IntEnum):
    """Where a variable stands in an instance of the FMU."""

    MOTION = 0  #: input: displacements and speeds
    VALVE = 1  #: input, in the order of the model's (`Input`)
    BEGIN = 2  #: parameter of the beginning
    FIXED = 3  #: parameter that stays once the FMU has begun
    TUNABLE = 4  #: parameter
    ALGEBRAIC = 5  #: output
    GAUGE = 6  #: output, over atmospheric pressure
    STATE = 7  #: output over atmospheric pressure, a state


@dataclass(frozen=True, slots=True)
class Variable:
    """One scalar; values are SI. What is calculated has no start."""

    name: str
    unit: str
    kind: Kind
    place: int
    description: str
    start: float | None = None
    low: float = -inf
    high: float = inf


#: Parameters of what stands on the springs and of what measures them; all others are the springs'.
_ELSEWHERE: Final = (
    *("bolster_", "bump_stop_", "actuator_", "frame_", "platform_", "load_cell_", "extra_stop_", "pressure_"),
    *(
        "gravity",
        "lateral_actuator_height",
        "accelerometer_height",
        "platen_mass",
        "seat_ahead",
        "load_ahead",
    ),
    *("support_softness", "force_latency"),
)
#: Parameters by which states come and go, or from which only the start follows.
_FIXED: Final = (
    *("emergency_spring", "wall_temperature_offset", "wall_heat_capacity", "pipe_length"),
    *("extra_branch_ratio", "extra_friction", "flow_inertance", "spring_half_spacing", "centre_height"),
)

MOTIONS: Final = (
    ("left.height", "m", "Height of the left spring over design height"),
    ("right.height", "m", "Height of the right spring over design height"),
    ("springs.lateral", "m", "Top plates against the feet of the springs, to the left"),
    ("left.height_speed", "m/s", "Speed of left.height, with which it goes on within a step"),
    ("right.height_speed", "m/s", "Speed of right.height, with which it goes on within a step"),
    ("springs.lateral_speed", "m/s", "Speed of springs.lateral, with which it goes on within a step"),
    ("left.height_acceleration", "m/s2", "With which left.height_speed goes on within a step"),
    ("right.height_acceleration", "m/s2", "With which right.height_speed goes on within a step"),
    ("springs.lateral_acceleration", "m/s2", "With which springs.lateral_speed goes on within a step"),
)
_VALVES: Final = (
    ("supply.open", Input.SUPPLY, 1.0, 0.0, "Supply main valve: 1 open, 0 closed and vented"),
    ("left.leveling", Input.LEFT_LEVELING, 0.0, 0.0, "Leveling valve: 1 connected, 0 isolated"),
    ("right.leveling", Input.RIGHT_LEVELING, 0.0, 0.0, "Leveling valve: 1 connected, 0 isolated"),
    ("left.service_valve", Input.LEFT_SERVICE_VALVE, 0.0, -1.0, "Fills (to +1) or exhausts (to -1)"),
    ("right.service_valve", Input.RIGHT_SERVICE_VALVE, 0.0, -1.0, "Fills (to +1) or exhausts (to -1)"),
    ("air.left_reservoir", Input.LEFT_RESERVOIR_VALVE, 1.0, 0.0, ""),
    ("air.right_reservoir", Input.RIGHT_RESERVOIR_VALVE, 1.0, 0.0, ""),
    ("air.dpv", Input.DPV_CONNECTED, 1.0, 0.0, ""),
)
#: Each stands for left and right.
_OUTPUTS: Final = (
    (
        "vertical_force",
        "N",
        Kind.ALGEBRAIC,
        Algebraic.VERTICAL_FORCE,
        "Force up on what stands on the spring",
    ),
    ("lateral_force", "N", Kind.ALGEBRAIC, Algebraic.LATERAL_FORCE, "Force to the left on it"),
    ("roll_moment", "N*m", Kind.ALGEBRAIC, Algebraic.ROLL_MOMENT, "Moment on it, left side up"),
    ("bellows_pressure", "Pa", Kind.GAUGE, Algebraic.PRESSURE, ""),
    ("auxiliary_pressure", "Pa", Kind.GAUGE, Algebraic.AUXILIARY_PRESSURE, ""),
    ("bellows_temperature", "K", Kind.ALGEBRAIC, Algebraic.TEMPERATURE, "Gas in the bellows"),
    ("auxiliary_temperature", "K", Kind.ALGEBRAIC, Algebraic.AUXILIARY_TEMPERATURE, "Gas in the auxiliary"),
    ("orifice_flow", "kg/s", Kind.ALGEBRAIC, Algebraic.ORIFICE_FLOW, "From bellows to auxiliary chamber"),
    ("leveling_flow", "kg/s", Kind.ALGEBRAIC, Algebraic.LEVELING_FLOW, "Into it through the leveling valve"),
    ("service_flow", "kg/s", Kind.ALGEBRAIC, Algebraic.SERVICE_FLOW, "Into it through the service valve"),
)


def variables(parameters: Parameters) -> tuple[Variable, ...]:
    """Return all variables of the springs with these parameters; the place in it is the value reference."""
    return (*_inputs(), *_outputs(), *_parameters(parameters))


def _told(name: str, text: str) -> str:
    """Return ``text``, or what the table of signals says."""
    return text or TABLE[name].description


def _inputs() -> Iterator[Variable]:
    high = TABLE["left.height"].high
    for place, (name, unit, text) in enumerate(MOTIONS):
        bound = high if unit == "m" else inf
        yield Variable(name, unit, Kind.MOTION, place, text, 0.0, -bound, bound)
    for name, number, start, low, text in _VALVES:
        yield Variable(name, "1", Kind.VALVE, int(number), _told(name, text), start, low, 1.0)


def _outputs() -> Iterator[Variable]:
    for name, unit, kind, first, text in _OUTPUTS:
        for side, word in enumerate(SIDES):
            full = f"{word}.{name}"
            yield Variable(full, unit, kind, first + side, _told(full, text))
    yield Variable("springs.dpv_flow", "kg/s", Kind.ALGEBRAIC, Algebraic.DPV_FLOW, "From left to right")
    yield Variable("supply.pressure", "Pa", Kind.STATE, State.SUPPLY_LINE, _told("supply.pressure", ""), None)


def _parameters(parameters: Parameters) -> Iterator[Variable]:
    text = "Share of the pressure that carries the preload with which it begins; 0: without air"
    yield Variable("air.at_start", "1", Kind.BEGIN, 0, text, 1.0, 0.0, 1.0)
    fields: Any = PARAMETERS.fields
    for quantity in PLANT_QUANTITIES:
        name = quantity.name
        if name.startswith(_ELSEWHERE):
            continue
        entry = parameters.entries[name]
        kind = Kind.FIXED if name in _FIXED else Kind.TUNABLE
        values = np.asarray(parameters.record[name], dtype=np.float64)
        first = fields[name][1] // 8
        said = f"{name.replace('_', ' ')}; {entry.provenance}: {entry.source}"
        for place, index in enumerate(np.ndindex(values.shape)):
            value, low, high = (float(one[index]) for one in (values, entry.low, entry.high))
            yield Variable(
                _scalar(name, values.shape, index),
                quantity.unit,
                kind,
                first + place,
                said,
                value,
                min(low, value),
                max(high, value),
            )


def _scalar(name: str, shape: tuple[int, ...], index: tuple[int, ...]) -> str:
    """Return the name of one element: of its side, or numbered from 1."""
    if not shape:
        return name
    if shape == (2,) and "_surface_" not in name:
        return f"{SIDES[index[0]]}.{name}"
    return f"{name}[{','.join(str(i + 1) for i in index)}]"
