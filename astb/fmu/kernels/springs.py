"""The compiled functions of the FMU of both air springs with their valves, driven by displacements.

Within a communication step the displacements are extrapolated with the given speeds and accelerations.
"""

from enum import IntEnum
from typing import Any, Final

from bench_sim.model.air_spring import air_spring
from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.compiled import compiled, compiled_once
from bench_sim.model.layout import EXTRA_BRANCHES, SIDES, Input, State
from bench_sim.model.replay import Before, Gas, settle
from bench_sim.model.rest import settled_temperature
from bench_sim.model.runge_kutta import integrate, step_scheme
from bench_sim.model.spring import resting_gauge
from bench_sim.model.step_start import begin

#: Displacements of a motion; their speeds and accelerations follow them.
WAYS: Final = 3


@compiled
def gone_on(motion: Any, place: int, rate: int, since: float) -> float:
    """Return a displacement, extrapolated to ``since`` s after ``motion`` was set; with ``rate`` 1 its speed."""
    speed, acceleration = motion[place + WAYS], motion[place + 2 * WAYS]
    if rate == 1:
        return speed + since * acceleration
    return motion[place] + since * (speed + 0.5 * since * acceleration)


#: Working rows: four slopes and a state, pressures, temperatures, and rows of zeros for the memory of the rubber.
ROWS: Final = 7 + EXTRA_BRANCHES

#: Rounds in which gas and emergency spring agree after a jump: each leaves less than a tenth of the error.
_JUMP_ROUNDS: Final = 3


class Gauge(IntEnum):
    """Indices of the outputs after the algebraic quantities: gauge pressures (Pa), those of the chambers for left and
    right.
    """

    PRESSURE = ALGEBRAICS
    AUXILIARY_PRESSURE = ALGEBRAICS + 2
    SUPPLY = ALGEBRAICS + 4


OUTPUTS: Final = ALGEBRAICS + 5


@compiled
def stretch_springs(since: float, motion: Any, x: Any, par: Any) -> None:
    """Set the positions of the plates from ``motion``, extrapolated to ``since`` s after it was set.

    ``motion`` holds ζ left, ζ right, y, their speeds and their accelerations. The platform does not move, because the
    laws depend on differences only.
    """
    for k in range(2):
        left = gone_on(motion, 0, k, since)
        right = gone_on(motion, 1, k, since)
        roll = 0.5 * (left - right) / par.spring_half_spacing
        x[State.BOLSTER_LATERAL + 3 * k] = gone_on(motion, 2, k, since) - par.centre_height * roll
        x[State.BOLSTER_VERTICAL + 3 * k] = 0.5 * (left + right)
        x[State.BOLSTER_ROLL + 3 * k] = roll


@compiled_once
def driven_springs(ahead: float, x: Any, mem: Any, u: Any, par: Any, given: Any, dx: Any, out: Any) -> None:
    """The right-hand side for `bench_sim.model.runge_kutta`. ``given`` is the age of the motion (s), and the motion."""
    since, motion = given
    stretch_springs(since + ahead, motion, x, par)
    air_spring(mem.time + ahead, x, mem, u, par, dx, out)


@compiled
def write_gauge(x: Any, par: Any, out: Any) -> None:
    """Write the outputs after the algebraic quantities (`Gauge`)."""
    air = par.atmospheric_pressure
    for k in range(SIDES):
        out[Gauge.PRESSURE + k] = out[Algebraic.PRESSURE + k] - air
        out[Gauge.AUXILIARY_PRESSURE + k] = out[Algebraic.AUXILIARY_PRESSURE + k] - air
    out[Gauge.SUPPLY] = x[State.SUPPLY_LINE] - air


@compiled
def supply_open(u: Any, par: Any) -> float:
    """Return the absolute pressure (Pa) behind the main valve at the start of a simulation."""
    supply = par.sawtooth_high if par.supply_sawtooth > 0.0 else par.supply_pressure
    return u[Input.SUPPLY] * supply + par.atmospheric_pressure


@compiled
def _jump(x: Any, mem: Any, u: Any, par: Any, given: Any, work: Any, out: Any) -> None:
    """Add the work of a jump to the energy of the gas: a jump from the end of the last motion (``out``) to the new one.

    A jump takes no time, so there is no flow or heat: U V^(γ−1) is constant. Otherwise the gas would expand without
    work, and motion by jumps alone would have 1/γ of the stiffness.
    """
    begun = work[5]
    for i in range(SIDES):
        begun[i] = out[Algebraic.VOLUME + i]
        begun[SIDES + i] = x[State.BELLOWS_ENERGY + i]
    for _ in range(_JUMP_ROUNDS):  # the emergency spring yields to the new force of the gas
        driven_springs(0.0, x, mem, u, par, given, work[0], out)
        for i in range(SIDES):
            squeezed = begun[i] / out[Algebraic.VOLUME + i]
            x[State.BELLOWS_ENERGY + i] = begun[SIDES + i] * squeezed ** (par.heat_capacity_ratio - 1.0)


def advance(
    x: Any,
    memory: Any,
    u: Any,
    parameters: Any,
    motion: Any,
    since: float,
    dt: float,
    steps: int,
    work: Any,
    out: Any,
) -> None:
    """Advance by ``steps`` fixed steps of ``dt`` s, and write the outputs at their end into ``out`` (OUTPUTS).

    ``motion`` was set ``since`` s before the first step. ``work`` (ROWS, STATES) is the caller's working memory.
    """
    mem, par = memory[0], parameters[0]
    _jump(x, mem, u, par, (since, motion), work, out)
    scheme = step_scheme(par, dt)
    for k in range(steps):
        given = since + k * dt, motion
        begin(driven_springs, x, mem, u, par, given, work[0], out)
        integrate(driven_springs, dt, scheme, x, mem, u, par, given, work, out)
        mem.step += 1
    driven_springs(0.0, x, mem, u, par, (since + steps * dt, motion), work[0], out)
    write_gauge(x, par, out)


def start(x: Any, memory: Any, u: Any, parameters: Any, motion: Any, air: float, work: Any, out: Any) -> None:
    """Set the initial state at rest at the displacements of ``motion``, with the pressure for the preload at design
    height.

    ``air`` is the share of that pressure; with 0 the chambers have atmospheric pressure. ``x``, ``memory`` and ``work``
    must be zero.
    """
    mem, par = memory[0], parameters[0]
    T = settled_temperature(par)
    pressure, temperature, nothing = work[5], work[6], work[7]
    for i in range(SIDES):
        p = air * resting_gauge(par, i) + par.atmospheric_pressure
        pressure[i] = pressure[SIDES + i] = p
        temperature[i] = temperature[SIDES + i] = T
    x[State.SUPPLY_LINE] = supply_open(u, par)
    stretch_springs(0.0, motion, x, par)
    settle(x, mem, par, Gas(pressure, temperature), Before(nothing, work[7:]), out)
    driven_springs(0.0, x, mem, u, par, (0.0, motion), work[0], out)
    write_gauge(x, par, out)
