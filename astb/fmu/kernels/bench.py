"""The compiled functions of the FMU of the whole bench, without its measuring chain."""

from enum import IntEnum
from typing import Any, Final

from astb.fmu.kernels.springs import supply_open
from bench_sim.model import bench_rest
from bench_sim.model.actuator import command_actuators
from bench_sim.model.algebraic import ALGEBRAICS
from bench_sim.model.compiled import compiled, compiled_once
from bench_sim.model.kernel import evaluate
from bench_sim.model.layout import ACTUATORS, INPUTS, SENSORS, SIDES, Input, Mode, State
from bench_sim.model.runge_kutta import integrate, step_scheme
from bench_sim.model.sensors import true_values
from bench_sim.model.spring import resting_gauge
from bench_sim.model.step_start import begin

#: Working rows: four slopes and a state, and the inputs of the model.
ROWS: Final = 6
#: The algebraic quantities are followed by the readings of ideal sensors (`Sensor`).
OUTPUTS: Final = ALGEBRAICS + SENSORS


class Given(IntEnum):
    """Inputs of the FMU: valves and modes of actuators as in `Input`, then a set-point of each kind."""

    FORCE = Input.VERTICAL_LEFT_COMMAND  #: N, per actuator
    DISPLACEMENT = FORCE + ACTUATORS  #: m, per actuator
    PLATFORM = DISPLACEMENT + ACTUATORS  #: up, to the left, in roll


GIVEN: Final = Given.PLATFORM + 3
assert Input.PLATFORM_ROLL - Input.PLATFORM_VERTICAL == 2 and INPUTS == Input.PLATFORM_ROLL + 1

_rest_forces, _settle, _seated = (
    compiled(one) for one in (bench_rest.rest_forces, bench_rest.settle_bench, bench_rest.seated_height)
)


@compiled_once
def bench_slope(ahead: float, x: Any, mem: Any, u: Any, par: Any, given: Any, dx: Any, out: Any) -> None:
    """The right-hand side of the bench's equations, compiled once for all callers."""
    evaluate(ahead, x, mem, u, par, given, dx, out)


@compiled
def _command(given: Any, u: Any) -> None:
    """Write the model's inputs from those of the FMU, with the set-point for each actuator's mode."""
    for k in range(Input.VERTICAL_LEFT_COMMAND):
        u[k] = given[k]
    for j in range(ACTUATORS):
        mode = int(given[Input.VERTICAL_LEFT_MODE + j])
        command = 0.0
        if mode == Mode.FORCE:
            command = given[Given.FORCE + j]
        elif mode == Mode.DISPLACEMENT:
            command = given[Given.DISPLACEMENT + j]
        u[Input.VERTICAL_LEFT_COMMAND + j] = command
    for k in range(3):
        u[Input.PLATFORM_VERTICAL + k] = given[Given.PLATFORM + k]


@compiled
def _write_outputs(x: Any, mem: Any, u: Any, par: Any, dx: Any, out: Any) -> None:
    bench_slope(0.0, x, mem, u, par, (), dx, out)
    true_values(x, mem, par, out, out[ALGEBRAICS:])


def advance(
    x: Any,
    memory: Any,
    given: Any,
    parameters: Any,
    motion: Any,
    since: float,
    dt: float,
    steps: int,
    work: Any,
    out: Any,
) -> None:
    """Advance by ``steps`` fixed steps of ``dt`` s, and write the outputs at their end into ``out`` (OUTPUTS).

    ``motion`` and ``since`` are not used, because nothing is moved from outside. ``work`` (ROWS, STATES) is the
    caller's working memory.
    """
    mem, par, u = memory[0], parameters[0], work[5]
    _command(given, u)
    scheme = step_scheme(par, dt)
    for _ in range(steps):
        command_actuators(x, mem, u, par, dt)
        begin(bench_slope, x, mem, u, par, (), work[0], out)
        integrate(bench_slope, dt, scheme, x, mem, u, par, (), work, out)
        mem.step += 1
    _write_outputs(x, mem, u, par, work[0], out)


def start(
    x: Any, memory: Any, given: Any, parameters: Any, motion: Any, air: float, work: Any, out: Any
) -> None:
    """Set the initial state at rest: with ``air`` at design height under the preload, otherwise on the emergency
    springs.

    With air the actuators add the difference of preload and weight of the bolster; without air they are off. ``x``,
    ``memory`` and ``work`` must be zero.
    """
    mem, par, u = memory[0], parameters[0], work[5]
    _command(given, u)
    bellows, height, pressure = work[1], work[2], work[3]
    for i in range(SIDES):
        if air > 0.0:
            pressure[i] = resting_gauge(par, i) + par.atmospheric_pressure
        else:
            bellows[i], height[i] = _seated(par, i)
            pressure[i] = par.atmospheric_pressure
    if air > 0.0:
        force = _rest_forces(par)
        for j in range(ACTUATORS):
            mem.mode[j] = Mode.FORCE.value
            x[State.ACTUATOR + j] = force[j]
    _settle(x, mem, par, bellows, height, pressure, supply_open(u, par))
    _write_outputs(x, mem, u, par, work[0], out)
