"""Both air springs with their valves, driven by how far they are stretched: the compiled functions inside of the FMU.

Within a communication step the displacements go on with the speeds and accelerations that were given with them.
"""

from typing import Any

from bench_sim.model.air_spring import air_spring
from bench_sim.model.compiled import compiled, compiled_once
from bench_sim.model.layout import SIDES, STATES, State
from bench_sim.model.replay import Before, Gas, settle
from bench_sim.model.rest import settled_temperature
from bench_sim.model.runge_kutta import integrate, step_scheme
from bench_sim.model.step_start import begin


@compiled
def stretch_springs(since: float, motion: Any, x: Any, par: Any) -> None:
    """Put the plates where the springs are as long as ``motion`` has them, ``since`` s after it was given.

    ``motion`` holds ζ left, ζ right, y, their speeds and their accelerations. The platform stays where it is: the laws
    see differences.
    """
    for k in range(2):
        left = _gone_on(motion, 0, k, since)
        right = _gone_on(motion, 1, k, since)
        roll = 0.5 * (left - right) / par.spring_half_spacing
        x[State.BOLSTER_LATERAL + 3 * k] = _gone_on(motion, 2, k, since) - par.centre_height * roll
        x[State.BOLSTER_VERTICAL + 3 * k] = 0.5 * (left + right)
        x[State.BOLSTER_ROLL + 3 * k] = roll


@compiled
def _gone_on(motion: Any, place: int, rate: int, since: float) -> float:
    """One displacement of ``motion`` or, where ``rate`` is 1, its speed."""
    speed, acceleration = motion[place + 3], motion[place + 6]
    if rate == 1:
        return speed + since * acceleration
    return motion[place] + since * (speed + 0.5 * since * acceleration)


@compiled_once
def driven_springs(ahead: float, x: Any, mem: Any, u: Any, par: Any, given: Any, dx: Any, out: Any) -> None:
    """The right-hand side (`bench_sim.model.runge_kutta`); ``given`` is how old the motion is, and the motion."""
    since, motion = given
    stretch_springs(since + ahead, motion, x, par)
    air_spring(mem.time + ahead, x, mem, u, par, dx, out)


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
    """Go on by ``steps`` fixed steps of ``dt`` s, and leave in ``out`` (`Algebraic`) what is at their end.

    ``motion`` was given ``since`` s before the first of them. ``work`` (5, STATES) is the caller's working memory.
    """
    mem, par = memory[0], parameters[0]
    scheme = step_scheme(par, dt)
    for k in range(steps):
        given = since + k * dt, motion
        begin(driven_springs, x, mem, u, par, given, work[0], out)
        integrate(driven_springs, dt, scheme, x, mem, u, par, given, work, out)
        mem.step += 1
    driven_springs(0.0, x, mem, u, par, (since + steps * dt, motion), work[0], out)


def start(
    x: Any,
    memory: Any,
    u: Any,
    parameters: Any,
    motion: Any,
    air: float,
    gas: Any,
    crept: Any,
    behind: Any,
    work: Any,
    out: Any,
) -> None:
    """Begin at rest where ``motion`` has the springs, with the pressure that carries their preload at design height.

    ``air`` is the share of that pressure: with 0 chambers hold air of the atmosphere.
    ``x`` and ``memory`` are zero; ``gas`` (2, 4) is working memory, ``crept`` and ``behind`` are those of `Before`.
    """
    mem, par = memory[0], parameters[0]
    T = settled_temperature(par)
    for i in range(SIDES):
        p = air * par.nominal_preload[i] / par.effective_area[i] + par.atmospheric_pressure
        gas[0, i] = gas[0, SIDES + i] = p
        gas[1, i] = gas[1, SIDES + i] = T
    for k in range(STATES):
        work[0, k] = 0.0
    supply = par.sawtooth_high if par.supply_sawtooth > 0.0 else par.supply_pressure
    x[State.SUPPLY_LINE] = u[0] * supply + par.atmospheric_pressure
    stretch_springs(0.0, motion, x, par)
    settle(x, mem, par, Gas(gas[0], gas[1]), Before(crept, behind), out)
    driven_springs(0.0, x, mem, u, par, (0.0, motion), work[0], out)
