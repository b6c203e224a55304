"""Both air springs with their valves as an FMU: names, units, bounds and indices of inputs, outputs and parameters."""

from collections.abc import Iterator
from math import inf
from typing import Final

from astb.fmu.kernels.springs import OUTPUTS, ROWS, Gauge, advance, start
from astb.fmu.models.gas import ORDERS, defaults_of, places_of
from astb.fmu.unit import Code, Kind, Unit, Variable, offset, parameters_of
from bench_protocol.table import TABLE
from bench_protocol.words import SIDES
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.layout import INPUTS, STATES, Input
from bench_sim.model.quantities import MEMORY, PARAMETERS, PLANT_QUANTITIES
from bench_sim.parameters import Parameters

#: Parameters of the load on the springs and of the sensors; all others belong to the springs.
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
    *("support_softness", "force_latency", "displacement_latency"),
)
#: Parameters that add or remove states, or that affect only the start.
FIXED: Final = (
    *("emergency_spring", "wall_temperature_offset", "wall_heat_capacity", "pipe_length"),
    *("extra_branch_ratio", "extra_friction", "flow_inertance", "spring_half_spacing", "centre_height"),
)

MOTIONS: Final = (
    ("left.height", "m", "Height of the left spring over design height"),
    ("right.height", "m", "Height of the right spring over design height"),
    ("springs.lateral", "m", "Top plates against the feet of the springs, to the left"),
    ("left.height_speed", "m/s", "Speed of left.height, for extrapolation within a step"),
    ("right.height_speed", "m/s", "Speed of right.height, for extrapolation within a step"),
    ("springs.lateral_speed", "m/s", "Speed of springs.lateral, for extrapolation within a step"),
    ("left.height_acceleration", "m/s2", "Acceleration of left.height, for extrapolation within a step"),
    ("right.height_acceleration", "m/s2", "Acceleration of right.height, for extrapolation within a step"),
    (
        "springs.lateral_acceleration",
        "m/s2",
        "Acceleration of springs.lateral, for extrapolation within a step",
    ),
)
VALVES: Final = (
    ("supply.open", Input.SUPPLY, 1.0, 0.0, "Supply main valve: 1 open, 0 closed and vented"),
    ("left.leveling", Input.LEFT_LEVELING, 0.0, 0.0, "Leveling valve: 1 connected, 0 isolated"),
    ("right.leveling", Input.RIGHT_LEVELING, 0.0, 0.0, "Leveling valve: 1 connected, 0 isolated"),
    ("left.service_valve", Input.LEFT_SERVICE_VALVE, 0.0, -1.0, "Fills (to +1) or exhausts (to -1)"),
    ("right.service_valve", Input.RIGHT_SERVICE_VALVE, 0.0, -1.0, "Fills (to +1) or exhausts (to -1)"),
    ("air.left_reservoir", Input.LEFT_RESERVOIR_VALVE, 1.0, 0.0, ""),
    ("air.right_reservoir", Input.RIGHT_RESERVOIR_VALVE, 1.0, 0.0, ""),
    ("air.dpv", Input.DPV_CONNECTED, 1.0, 0.0, ""),
)
#: Each row stands for two outputs, left and right.
OF_SPRINGS: Final = (
    ("vertical_force", "N", Algebraic.VERTICAL_FORCE, "Upward force on the car body"),
    ("lateral_force", "N", Algebraic.LATERAL_FORCE, "Force to the left on the car body"),
    ("roll_moment", "N*m", Algebraic.ROLL_MOMENT, "Moment on the car body, left side up"),
)
_GAS: Final = (
    ("bellows_pressure", "Pa", Gauge.PRESSURE, ""),
    ("auxiliary_pressure", "Pa", Gauge.AUXILIARY_PRESSURE, ""),
    ("bellows_temperature", "K", Algebraic.TEMPERATURE, "Gas in the bellows"),
    ("auxiliary_temperature", "K", Algebraic.AUXILIARY_TEMPERATURE, "Gas in the auxiliary chamber"),
)
FLOWS: Final = (
    ("orifice_flow", "kg/s", Algebraic.ORIFICE_FLOW, "From bellows to auxiliary chamber"),
    (
        "leveling_flow",
        "kg/s",
        Algebraic.LEVELING_FLOW,
        "Into the auxiliary chamber through the leveling valve",
    ),
    ("service_flow", "kg/s", Algebraic.SERVICE_FLOW, "Into the auxiliary chamber through the service valve"),
)
CODE: Final = Code(
    "springs",
    start,
    advance,
    MEMORY,
    PARAMETERS,
    states=STATES,
    inputs=INPUTS,
    motions=len(MOTIONS),
    outputs=OUTPUTS,
    rows=ROWS,
    # The springs' part of the memory precedes that of actuators and sensors.
    remembered=offset(MEMORY, "mode"),
    checks="gas.c",
)


def springs(parameters: Parameters) -> Unit:
    """Return the FMU of both springs with these parameters."""
    return Unit(
        CODE,
        f"{parameters.name} {parameters.load_case}",
        f"Both air springs of {parameters.name} under {parameters.load_case}, with their valves and supply",
        (
            "Two air springs with auxiliary chambers, orifices, leveling and service valves, differential pressure "
            "valve and supply. Inputs are their displacements; outputs are their forces on the car "
            "body. Units are SI; pressures are over the atmosphere, heights over design height, lateral positions to "
            "the left.",
            "The simulation begins at rest, with relaxed rubber and the pressure that carries the preload. Within a "
            "communication step, the displacements are extrapolated with the given speeds.",
        ),
        (*_motions(), *valves(), *_outputs(), *_parameters(parameters)),
        defaults_of(parameters),
        places_of(shims=True),
        ORDERS,
    )


def description_of(name: str, text: str = "") -> str:
    """Return ``text``, or the description of the signal table."""
    return text or TABLE[name].description


def _motions() -> Iterator[Variable]:
    high = TABLE["left.height"].high
    for place, (name, unit, text) in enumerate(MOTIONS):
        bound = high if unit == "m" else inf
        yield Variable(name, unit, Kind.MOTION, place, text, 0.0, -bound, bound)


def valves() -> Iterator[Variable]:
    """Yield the inputs for supply and valves."""
    for name, number, begins, low, text in VALVES:
        yield Variable(name, "1", Kind.INPUT, int(number), description_of(name, text), begins, low, 1.0)


def of_sides(rows: tuple[tuple[str, str, int, str], ...]) -> Iterator[Variable]:
    """Yield the outputs of both springs."""
    for name, unit, first, text in rows:
        for side, word in enumerate(SIDES):
            full = f"{word}.{name}"
            yield Variable(full, unit, Kind.OUTPUT, first + side, description_of(full, text))


def dpv_flow() -> Variable:
    """Return the output for the air flow between the springs."""
    return Variable("springs.dpv_flow", "kg/s", Kind.OUTPUT, Algebraic.DPV_FLOW, "From left to right")


def _outputs() -> Iterator[Variable]:
    yield from of_sides((*OF_SPRINGS, *_GAS, *FLOWS))
    yield dpv_flow()
    yield Variable("supply.pressure", "Pa", Kind.OUTPUT, Gauge.SUPPLY, description_of("supply.pressure"))


def _parameters(parameters: Parameters) -> Iterator[Variable]:
    text = "Pressure at the start, as a share of the pressure that carries the preload; 0: without air"
    yield Variable("air.at_start", "1", Kind.BEGIN, 0, text, 1.0, 0.0, 1.0)
    own = [one for one in PLANT_QUANTITIES if not one.name.startswith(_ELSEWHERE)]
    yield from parameters_of(own, parameters.entries, parameters.record, PARAMETERS, FIXED)
