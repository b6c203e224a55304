"""The connecting pipe between bellows and auxiliary chamber: a column of air in series with the orifice.

    dG/dt = (A_p/L_p) (p_b − p_a − Δp),   Δp = R T_u/p_u · (1/(2 ε² (C_d A)²) + f L_p/(2 A_p² D_p)) G|G|

G is the mass flow from the bellows, p_u and T_u are those of the upstream chamber. ε² (`expansion`) makes the steady
flow equal to that of the nozzle, including choking. Without ε² the flow from a full spring would be nearly twice the
choked flow. The column moves as one piece, which is valid well below the quarter-wave frequency of the pipe (57 Hz at
1.5 m). The air in the pipe (3 litres) and its kinetic energy (some joules) are neglected, so the chambers contain all
mass and energy.

At rest, G|G| has the slope 0, so a pipe needs no linear range. An orifice alone has an infinite slope there, because
its flow follows √Δp. The equation is stiff at high flow. The loss brings G to its balance at the rate

    λ = 2 (A_p/L_p) Δp/G = 2 (A_p/L_p) √(R T_u) (1−r)/(C_d A ψ(r)),   r = p_down/p_up

For a bellows moved by 10 mm at 25 Hz (1 − r = 0.12) the rate is 2300/s with an orifice of 13 mm and 3900/s with 10 mm.
For a full spring with an empty chamber it is 19000/s with 10 mm. For a closing valve it has no limit. The step of 1 ms
is therefore divided into parts (`pipe_steps`), so that the length of a part times ``PIPE_RATE`` is 2. The fourth-order
Runge-Kutta method is stable up to 2.78. Faster rates are limited to ``PIPE_RATE``: driving pressure and loss are
reduced by the same factor, so the balance stays the same. The inertia of a flow that settles in an eighth of a
millisecond is negligible.
"""

from math import ceil, pi, sqrt
from typing import Any, Final

from bench_sim.model.compiled import compiled, compiled_once
from bench_sim.model.orifice import nozzle_function

#: Largest rate at which the flow approaches its balance in the simulation, 1/s.
PIPE_RATE: Final = 8000.0
#: That rate times the length of a Runge-Kutta step.
_REACH: Final = 2.0


@compiled
def pipe_steps(par: Any, dt: float) -> int:
    """Return the number of equal Runge-Kutta steps in a step of ``dt`` s. It is 1 without a pipe."""
    if par.pipe_length[0] == 0.0 and par.pipe_length[1] == 0.0:
        return 1
    return ceil(PIPE_RATE * dt / _REACH - 1e-9)


@compiled
def expansion(r: float, kappa: float) -> float:
    """Return ε² = ψ²(r)/(2 (1−r)): the square of the nozzle's flow divided by the incompressible flow. It is 1 at r =
    1.

    Near r = 1, where numerator and denominator vanish, the series 1 − 3 (1−r)/(2κ) is used.
    """
    if r > 0.999:
        return 1.0 - 1.5 * (1.0 - r) / kappa
    psi = nozzle_function(r, kappa)
    return 0.5 * psi * psi / (1.0 - r)


@compiled_once
def pipe_acceleration(
    flow: float, p_b: float, T_b: float, p_a: float, T_a: float, area: float, side: int, par: Any
) -> float:
    """Return dG/dt in kg/s² of the ``flow`` G from the bellows (b) to the auxiliary chamber (a). ``area`` is C_d A in
    m².
    """
    drop = p_b - p_a
    if flow > 0.0 or (flow == 0.0 and drop > 0.0):
        p_up = p_b
        T_up = T_b
        r = p_a / p_b
    else:
        p_up = p_a
        T_up = T_a
        r = p_b / p_a
    # Air that flows on against the pressure does not expand.
    squeeze = expansion(min(r, 1.0), par.heat_capacity_ratio)
    length = par.pipe_length[side]
    diameter = par.pipe_diameter[side]
    bore = 0.25 * pi * diameter * diameter
    loss = 0.5 / (squeeze * area * area) + 0.5 * par.pipe_friction[side] * length / (bore * bore * diameter)
    resistance = par.gas_constant * T_up / p_up * loss
    inertance = length / bore + par.flow_inertance[side]
    rate = 2.0 * resistance / inertance * max(abs(flow), sqrt(abs(drop) / resistance))
    return (drop - resistance * flow * abs(flow)) / (inertance * max(rate / PIPE_RATE, 1.0))
