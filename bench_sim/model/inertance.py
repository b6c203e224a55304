"""The air in a short connection: its inertia holds the flow back behind what the orifice would pass at once.

    I dG/dt = Δp − Δp_loss(G) = R (G_s − G),   I = L/A_p,   Δp_loss(G_s) = Δp

G_s is the steady flow and R the secant of the loss between G and G_s. The flow is not a state but G = G_s − D, where
the missing flow D follows dD/dt = dG_s/dt − (R/I) D. From the start of a step (D₀, G_s0) to an instant h later it is
solved for a G_s that is linear in between,

    D = e^(−z) D₀ + (1 − e^(−z))/z · (G_s − G_s0),   z = h R/I

so that no step is too long for a small inertance: D → I/R · dG_s/dt, linear in I down to zero. The integrator sees a
missing flow that changes within a step and is remembered only at its start. The loss is that of the orifice:
``bench_sim.model.pipe`` has that of a long pipe beside it, at the price of shorter steps.
"""

from math import exp, expm1, sqrt
from typing import Any

from bench_sim.model.compiled import compiled, compiled_once
from bench_sim.model.orifice import nozzle_function
from bench_sim.model.pipe import expansion


@compiled_once
def loss_secant(
    steady: float, flow: float, p_b: float, T_b: float, p_a: float, T_a: float, area: float, par: Any
) -> float:
    """R in Pa·s/kg between ``flow`` and the ``steady`` flow of the present pressures; ``area`` is C_d A in m².

    Quadratic, Δp = k G|G|, on top of the slope that the orifice has in its laminar zone.
    """
    drop = p_b - p_a
    p_up = max(p_b, p_a)
    p_down = min(p_b, p_a)
    T_up = T_b if drop > 0.0 else T_a
    RT = par.gas_constant * T_up
    k = 0.5 * RT / (p_up * expansion(p_down / p_up, par.heat_capacity_ratio) * area * area)
    limit = par.laminar_limit
    laminar = sqrt(RT) * (1.0 - limit) / (area * nozzle_function(limit, par.heat_capacity_ratio))
    slope = laminar if steady == 0.0 else max(abs(drop / steady), laminar)
    if steady * flow >= 0.0:
        return slope + k * abs(flow)
    return (slope * abs(steady) + k * flow * flow) / (abs(steady) + abs(flow)) + laminar


@compiled
def held_back(ahead: float, missing: float, rise: float, rate: float) -> float:
    """D after ``ahead`` s: of ``missing`` kg/s at first, while the steady flow rises by ``rise``; ``rate`` is R/I."""
    z = rate * ahead
    ramp = -expm1(-z) / z if z > 1e-12 else 1.0
    return exp(-z) * missing + ramp * rise
