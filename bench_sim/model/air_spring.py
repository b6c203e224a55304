"""All terms of the air springs and their valves. The mass on the springs may be any: the bench adds a bolster with
actuators (`bench_sim.model.kernel`), the vehicle a car body (`bench_sim.model.car`).
"""

from typing import Any, Final

from bench_sim.model.compiled import compiled
from bench_sim.model.gas import heat_term
from bench_sim.model.layout import State
from bench_sim.model.rubber import creep_term, maxwell_term
from bench_sim.model.spring import spring_algebra, spring_term, work_term
from bench_sim.model.surface import gas_surface_term
from bench_sim.model.valves import (
    dpv_term,
    leak_term,
    leveling_term,
    lever_term,
    orifice_term,
    service_term,
    supply_term,
)

#: Number of states whose derivatives are sums of terms. The states of extra branches follow; each has one term only.
_SUMMED: Final = int(State.EXTRA_VERTICAL_DASHPOT)


@compiled
def air_spring(t: float, x: Any, mem: Any, u: Any, par: Any, dx: Any, out: Any) -> None:
    """Write the derivatives of gas, rubber, valves and springs to ``dx`` (STATES), and their algebraic variables to
    ``out``.

    The forces on the mass above the springs are summed in the derivatives of its speeds. The caller divides these sums
    by the mass. ``dx`` may have no elements for extra rubber branches that are not in use; then nothing is written for
    them.
    """
    for k in range(_SUMMED):
        dx[k] = 0.0
    spring_algebra(t, x, mem, par, out)
    # Flows and relaxation are first, because the speed and the work of the bellows depend on them.
    supply_term(t, x, u, par, dx)
    orifice_term(t, x, mem, u, par, out, dx)
    leveling_term(x, mem, u, par, out, dx)
    service_term(x, u, par, out, dx)
    dpv_term(mem, u, par, out, dx)
    leak_term(par, out, dx)
    heat_term(x, mem, par, out, dx)
    gas_surface_term(u, par, out, dx)
    maxwell_term(x, par, out, dx)
    creep_term(x, par, out, dx)
    work_term(par, out, dx)
    lever_term(x, par, out, dx)
    spring_term(par, out, dx)
