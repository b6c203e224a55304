"""The inertia of the air in a short connection, which delays the flow through the orifice.

    I dG/dt = Δp − Δp_loss(G) = R (G_s − G),   I = L/A_p,   Δp_loss(G_s) = Δp

G_s is the steady flow and R the secant of the loss between G and G_s. The flow is not a state but G = G_s − D, where
the missing flow D follows dD/dt = dG_s/dt − (R/I) D. From the start of a step (D₀, G_s0) to an instant h later it is
solved for a linear G_s,

    D = e^(−z) D₀ + (1 − e^(−z))/z · (G_s − G_s0),   z = h R/I

so that no step is too long for a small inertance: D → I/R · dG_s/dt, linear in I down to zero. R is that of the present
steady flow and the flow at the start of the step. For an inertia of 1 m the error is 0.5 % at a step of 1 ms and 3 % at
2.5 ms. The loss is only that of the orifice; `bench_sim.model.pipe` adds that of a long pipe, with shorter steps.
"""

from math import exp, expm1
from typing import Any

from bench_sim.model.compiled import compiled, compiled_once
from bench_sim.model.orifice import mass_flow, nozzle_function


@compiled
def loss(flow: float, laminar: float, k: float) -> float:
    """Δp_loss in Pa: that of the orifice, quadratic with ``k``, or linear with ``laminar`` if that is larger."""
    return flow * max(laminar, k * abs(flow))


@compiled
def loss_secant(
    steady: float, flow: float, p_b: float, T_b: float, p_a: float, T_a: float, area: float, par: Any
) -> float:
    """R in Pa·s/kg between ``flow`` and the ``steady`` flow of the present pressures; ``area`` is C_d A in m²."""
    p_up = max(p_b, p_a)
    T_up = T_b if p_b > p_a else T_a
    # the orifice is linear up to this flow
    psi = nozzle_function(par.laminar_limit, par.heat_capacity_ratio)
    edge = mass_flow(area, p_up, T_up, par.gas_constant, psi)
    laminar = p_up * (1.0 - par.laminar_limit) / edge
    k = laminar / edge
    if abs(steady) > edge:
        k = abs(p_b - p_a) / (steady * steady)
    apart = steady - flow
    if abs(apart) < 1e-6 * edge:
        return max(laminar, 2.0 * k * abs(steady) if abs(steady) > edge else 0.0)
    return (loss(steady, laminar, k) - loss(flow, laminar, k)) / apart


@compiled
def held_back(ahead: float, missing: float, rise: float, rate: float) -> float:
    """D after ``ahead`` s, from ``missing`` kg/s at the start and a rise of the steady flow by ``rise``; ``rate`` is
    R/I.
    """
    z = rate * ahead
    ramp = -expm1(-z) / z if z > 1e-12 else 1.0
    return exp(-z) * missing + ramp * rise


@compiled_once
def missing_flow(
    ahead: float,
    noted_steady: float,
    noted_missing: float,
    steady: float,
    p_b: float,
    T_b: float,
    p_a: float,
    T_a: float,
    area: float,
    inertance: float,
    par: Any,
) -> float:
    """D in kg/s, ``ahead`` s after the start of a step with the noted flows; ``inertance`` in 1/m."""
    rate = loss_secant(steady, noted_steady - noted_missing, p_b, T_b, p_a, T_a, area, par) / inertance
    return held_back(ahead, noted_missing, steady - noted_steady, rate)
