"""All terms of the air springs and their valves, for any mass on them.

The bench adds a bolster with actuators (`bench_sim.model.kernel`), the vehicle a car body (`bench_sim.model.car`).
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

#: States whose derivatives are sums of terms; those of the extra branches behind them have one term each.
_SUMMED: Final = int(State.EXTRA_VERTICAL_DASHPOT)


@compiled
def air_spring(t: float, x: Any, mem: Any, u: Any, par: Any, dx: Any, out: Any) -> None:
    """Write the derivatives of gas, rubber, valves and springs to ``dx`` (STATES), and their part of ``out``.

    The forces on the mass that the springs carry are summed in the derivatives of its speeds. The caller divides them
    by that mass. Extra branches that are not fitted have no elements in ``dx``, so nothing is written for them.
    """
    for k in range(_SUMMED):
        dx[k] = 0.0
    spring_algebra(t, x, mem, par, out)
    # Flows and relaxation first: the bellows' speed, and with it their work, follows from them.
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
