"""The classical Runge-Kutta method of fourth order, for every system with air springs.

A system is a compiled right-hand side

    slope(ahead, x, mem, u, par, given, dx, out)

It writes dx/dt to ``dx`` and the algebraic variables to ``out`` (`Algebraic`), ``ahead`` s after the instant
``mem.time``. It never writes ``mem``. ``given`` is a tuple of further inputs of the system, such as a motion or the
wind. Prescribed states are not integrated; the function first writes them to ``x``. numba compiles each caller with
its own right-hand side, so the argument costs no time.
"""

from typing import Any, Final

from bench_sim.model.compiled import compiled, compiled_within
from bench_sim.model.layout import EXTRA_BRANCHES, EXTRA_DASHPOTS, TINY, State
from bench_sim.model.pipe import pipe_steps

#: Number of states that are always integrated, and of those with a pipe.
_ALWAYS: Final = int(State.PIPE_FLOW)
_WITH_PIPE: Final = int(State.EXTRA_VERTICAL_DASHPOT)


@compiled
def integrated_states(par: Any) -> int:
    """Return how many states are integrated with these parameters, from the first one on.

    The other states belong to parts that are not in use. No term may read or write them.
    """
    branches = 0
    while branches < EXTRA_BRANCHES and par.extra_branch_ratio[branches] != 0.0:
        branches += 1
    if branches > 0:
        return State.EXTRA_VERTICAL_DASHPOT + EXTRA_DASHPOTS * branches
    if par.pipe_length[0] > 0.0 or par.pipe_length[1] > 0.0:
        return _WITH_PIPE
    return _ALWAYS


@compiled
def step_scheme(par: Any, dt: float) -> tuple[int, int]:
    """Return the number of equal parts of a step of ``dt`` s, and the number of integrated states."""
    return pipe_steps(par, dt), integrated_states(par)


@compiled_within
def runge_kutta(
    slope: Any, h: float, states: int, x: Any, mem: Any, u: Any, par: Any, given: Any, work: Any, out: Any
) -> None:
    """Take one step of ``h`` s in place from the slope in ``work[0]``, and advance the time.

    ``work`` (5, STATES) is working memory for the four slopes and the state of a stage.
    """
    for stage in range(1, 4):
        ahead = h if stage == 3 else 0.5 * h
        for k in range(states):
            work[4, k] = x[k] + ahead * work[stage - 1, k]
        slope(ahead, work[4], mem, u, par, given, work[stage], out)
    for k in range(states):
        new = x[k] + h / 6.0 * (work[0, k] + 2.0 * (work[1, k] + work[2, k]) + work[3, k])
        x[k] = new if abs(new) > TINY else 0.0
    mem.time += h


@compiled_within
def integrate(
    slope: Any,
    dt: float,
    scheme: tuple[int, int],
    x: Any,
    mem: Any,
    u: Any,
    par: Any,
    given: Any,
    work: Any,
    out: Any,
) -> None:
    """Take a step of ``dt`` s in place from the slope in ``work[0]``. ``scheme`` (`step_scheme`) divides it into
    equal parts.
    """
    pieces, states = scheme
    for piece in range(pieces):
        if piece > 0:
            slope(0.0, x, mem, u, par, given, work[0], out)
        runge_kutta(slope, dt / pieces, states, x, mem, u, par, given, work, out)
