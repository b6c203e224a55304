"""Fitted surfaces: smooth functions of two states of a spring, for errors that no named effect explains.

    s(a, b) = Σ_jk c_jk N_j(a) N_k(b)

The functions N are quadratic B-splines on uniform knots over the range of a coordinate, and constant outside of it. If
all coefficients are 1, the surface is 1 (partition of unity).
"""

from math import asinh
from typing import Any

from bench_sim.model.algebraic import Algebraic
from bench_sim.model.compiled import compiled, compiled_once
from bench_sim.model.gas import enthalpy_per_kelvin, transfer, upstream_enthalpy
from bench_sim.model.layout import Input, State


@compiled
def spline_weights(value: float, low: float, high: float, count: int) -> tuple[int, float, float, float]:
    """Return the index of the first of the three non-zero splines at ``value``, and the values of these three.
    ``count`` is the number of all splines between ``low`` and ``high``.
    """
    cells = count - 2
    s = min(max((value - low) / (high - low), 0.0), 1.0) * cells
    first = min(int(s), cells - 1)
    u = s - first
    return first, 0.5 * (1.0 - u) * (1.0 - u), 0.5 + u * (1.0 - u), 0.5 * u * u


@compiled_once
def surface(coefficients: Any, a: float, a_span: Any, b: float, b_low: float, b_high: float) -> float:
    """Return the value of the surface with ``coefficients`` (8, 4) at (a, b)."""
    j, v_0, v_1, v_2 = spline_weights(a, a_span[0], a_span[1], coefficients.shape[0])
    k, w_0, w_1, w_2 = spline_weights(b, b_low, b_high, coefficients.shape[1])
    return (
        v_0 * (w_0 * coefficients[j, k] + w_1 * coefficients[j, k + 1] + w_2 * coefficients[j, k + 2])
        + v_1
        * (w_0 * coefficients[j + 1, k] + w_1 * coefficients[j + 1, k + 1] + w_2 * coefficients[j + 1, k + 2])
        + v_2
        * (w_0 * coefficients[j + 2, k] + w_1 * coefficients[j + 2, k + 1] + w_2 * coefficients[j + 2, k + 2])
    )


@compiled
def force_surface(par: Any, displacement: float, speed: float) -> float:
    """Return the additional upward force of one spring in N, a function of its height and of asinh(v/v₀), with its
    speed v.
    """
    v_0 = par.force_surface_unit_speed
    return surface(
        par.force_surface,
        displacement,
        par.force_surface_displacement,
        asinh(speed / v_0),
        asinh(par.force_surface_speed[0] / v_0),
        asinh(par.force_surface_speed[1] / v_0),
    )


@compiled
def lateral_surface(par: Any, shear: float, speed: float, roll: float) -> float:
    """Return the additional force of one spring to the left in N: the sum of a function of shear and asinh(v/v₀), and
    one of roll and shear.
    """
    force = 0.0
    if par.shear_surface_shear[1] > par.shear_surface_shear[0]:
        v_0 = par.force_surface_unit_speed
        low, high = asinh(par.shear_surface_speed[0] / v_0), asinh(par.shear_surface_speed[1] / v_0)
        force += surface(par.shear_surface, shear, par.shear_surface_shear, asinh(speed / v_0), low, high)
    if par.roll_surface_roll[1] > par.roll_surface_roll[0]:
        low, high = par.roll_surface_shear[0], par.roll_surface_shear[1]
        force += surface(par.roll_surface, roll, par.roll_surface_roll, shear, low, high)
    return force


@compiled
def moment_surface(par: Any, shear: float, roll: float) -> float:
    """Return the additional roll moment of one spring in N·m, a function of roll and shear."""
    if par.moment_surface_roll[1] <= par.moment_surface_roll[0]:
        return 0.0
    low, high = par.moment_surface_shear[0], par.moment_surface_shear[1]
    return surface(par.moment_surface, roll, par.moment_surface_roll, shear, low, high)


@compiled
def surface_flow(par: Any, opening: float, p: float, p_a: float) -> float:
    """Return the additional flow in kg/s from a bellows to its chamber, a function of p_b − p_a and p_b."""
    if par.flow_surface_difference[1] <= par.flow_surface_difference[0]:
        return 0.0
    low, high = par.flow_surface_pressure[0], par.flow_surface_pressure[1]
    return opening * surface(par.flow_surface, p - p_a, par.flow_surface_difference, p, low, high)


@compiled
def surface_heat(par: Any, p: float, T: float) -> float:
    """Return the additional heat in W into a bellows, a function of p_b and T_b − T_amb."""
    if par.heat_surface_pressure[1] <= par.heat_surface_pressure[0]:
        return 0.0
    low, high = par.heat_surface_temperature[0], par.heat_surface_temperature[1]
    return surface(par.heat_surface, p, par.heat_surface_pressure, T - par.ambient_temperature, low, high)


@compiled
def gas_surface_term(u: Any, par: Any, out: Any, dx: Any) -> None:
    """Add the flow from each bellows to its auxiliary chamber and the heat into the bellows, from fitted surfaces."""
    c_p = enthalpy_per_kelvin(par)
    for i in range(2):
        p = out[Algebraic.PRESSURE + i]
        T = out[Algebraic.TEMPERATURE + i]
        T_a = out[Algebraic.AUXILIARY_TEMPERATURE + i]
        opening = min(max(u[Input.LEFT_RESERVOIR_VALVE + i], 0.0), 1.0)
        flow = surface_flow(par, opening, p, out[Algebraic.AUXILIARY_PRESSURE + i])
        if flow != 0.0:
            enthalpy = upstream_enthalpy(flow, T, T_a, c_p)
            transfer(dx, State.BELLOWS_MASS + i, State.AUXILIARY_MASS + i, flow, enthalpy)
            out[Algebraic.ORIFICE_FLOW + i] += flow
        heat = surface_heat(par, p, T)
        if heat != 0.0:
            dx[State.BELLOWS_ENERGY + i] += heat
            out[Algebraic.HEAT + i] += heat
