"""The whole bench as an FMU: springs, bolster, actuators and platform, without buses and measuring chain."""

import re
from collections.abc import Iterator
from typing import Final

from astb.fmu.kernels.bench import GIVEN, OUTPUTS, ROWS, Given, advance, start
from astb.fmu.models.gas import ORDERS, defaults_of, places_of
from astb.fmu.models.springs import FIXED, FLOWS, OF_SPRINGS, dpv_flow, of_sides, valves
from astb.fmu.unit import Code, Kind, Unit, Variable, offset, parameters_of
from bench_protocol.table import TABLE
from bench_protocol.table_signals import MEASUREMENTS
from bench_protocol.words import ACTUATORS, PLATFORM_AXES
from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.bench_rest import rest_forces
from bench_sim.model.layout import STATES, Input, Mode
from bench_sim.model.quantities import MEMORY, PARAMETERS, PLANT_QUANTITIES
from bench_sim.parameters import Parameters

#: Parameters of the measuring chain, which is not part of the FMU.
_ELSEWHERE: Final = ("pressure_", "force_latency", "displacement_latency", "load_cell_crosstalk")
_PLATFORM: Final = (Input.PLATFORM_VERTICAL, Input.PLATFORM_LATERAL, Input.PLATFORM_ROLL)
assert PLATFORM_AXES == ("vertical", "lateral", "roll") and list(_PLATFORM) == sorted(_PLATFORM)
CODE: Final = Code(
    "bench",
    start,
    advance,
    MEMORY,
    PARAMETERS,
    states=STATES,
    inputs=GIVEN,
    motions=0,
    outputs=OUTPUTS,
    rows=ROWS,
    # The sensors' part of the memory is last.
    remembered=offset(MEMORY, "sensor_output"),
    checks="gas.c",
)


def bench(parameters: Parameters) -> Unit:
    """Return the FMU of the bench with these parameters."""
    return Unit(
        CODE,
        f"{parameters.name} {parameters.load_case}",
        f"The test bench of {parameters.name} under {parameters.load_case}: springs, bolster, actuators, platform",
        (
            "Two air springs with their valves under a bolster that three servo-hydraulic actuators push, on a "
            "vibration platform. Units are SI; pressures are over the atmosphere, heights over design height, lateral "
            "positions to the left.",
            "The simulation begins at rest, under its preload or without air. The outputs are true values: lags, noise "
            "and resolution of the measuring chain are not included. Set-points are held over a communication step.",
        ),
        (*valves(), *_setpoints(parameters), *_outputs(), *_parameters(parameters)),
        defaults_of(parameters),
        places_of(shims=False),
        ORDERS,
    )


def _setpoints(parameters: Parameters) -> Iterator[Variable]:
    modes = ", ".join(f"{int(mode)} {mode.name.lower().replace('_', ' ')}" for mode in Mode)
    force = rest_forces(parameters.record)
    for j, name in enumerate(ACTUATORS):
        text = f"What the actuator does: {modes}"
        place = Input.VERTICAL_LEFT_MODE + j
        yield Variable(
            f"{name}.control",
            "1",
            Kind.INPUT,
            place,
            text,
            float(Mode.FORCE),
            0.0,
            float(max(Mode)),
            whole=True,
        )
    for j, name in enumerate(ACTUATORS):
        yield _setpoint(f"{name}.force_setpoint", Given.FORCE + j, float(force[j]))
    for j, name in enumerate(ACTUATORS):
        yield _setpoint(f"{name}.displacement_setpoint", Given.DISPLACEMENT + j, 0.0)
    for k, name in enumerate(PLATFORM_AXES):
        yield _setpoint(f"platform.{name}_setpoint", Given.PLATFORM + k, 0.0)


def _setpoint(name: str, place: int, begins: float) -> Variable:
    signal = TABLE[name]
    return Variable(name, signal.si, Kind.INPUT, place, signal.description, begins, signal.low, signal.high)


def structured(name: str) -> str:
    """Return the name of a signal in FMI's structured form: ``load_cell.1`` is ``load_cell[1]``."""
    return re.sub(r"\.(\d+)$", r"[\1]", name)


def _outputs() -> Iterator[Variable]:
    for place, one in enumerate(MEASUREMENTS):
        yield Variable(
            structured(one.name),
            one.si,
            Kind.OUTPUT,
            ALGEBRAICS + place,
            f"{one.description}; its true value",
        )
    yield from of_sides((*OF_SPRINGS, *FLOWS))
    yield dpv_flow()
    yield Variable(
        "lateral.stop_force", "N", Kind.OUTPUT, Algebraic.BUMP_STOP, "Bump stop on the bolster, to the left"
    )


def _parameters(parameters: Parameters) -> Iterator[Variable]:
    text = "1: the simulation begins at rest under preload; 0: without air, on the emergency springs"
    yield Variable("air.at_start", "1", Kind.BEGIN, 0, text, 1.0, 0.0, 1.0, whole=True)
    own = [one for one in PLANT_QUANTITIES if not one.name.startswith(_ELSEWHERE)]
    fixed = (*FIXED, "nominal_preload")
    yield from parameters_of(own, parameters.entries, parameters.record, PARAMETERS, fixed)
