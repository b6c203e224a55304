"""Damping of the orifice between bellows and auxiliary chamber, linearised at a pressure ratio: equations (17) to (19).

The slope of the flow at a pressure difference of zero is infinite. So a user must choose a ratio r < 1 for the
linearisation. All results over r, including the rise and fall of the damping, depend on this choice. `finite_amplitude`
derives r from the motion instead.
"""

from math import pi

import numpy as np

from astb_studies.paper.closed_form.parameters import PaperParameters, Real


def critical_ratio(kappa: Real) -> Real:
    """r_c = (2/(κ+1))^{κ/(κ−1)}, 0.5283 for air: below it the flow is choked; literature."""
    return (2.0 / (kappa + 1.0)) ** (kappa / (kappa - 1.0))


def nozzle_function(r: Real, kappa: Real) -> Real:
    """(17) ψ(r) = √(2κ/(κ−1) (r^{2/κ} − r^{(κ+1)/κ})), constant below r_c; ``r`` = p₂/p₁ in 0 … 1; literature."""
    r = np.maximum(r, critical_ratio(kappa))
    q = r ** (1.0 / kappa)
    return np.sqrt(2.0 * kappa / (kappa - 1.0) * np.maximum(q * (q - r), 0.0))


def nozzle_slope(r: Real, kappa: Real) -> Real:
    """ψ′(r): 0 where choked, −∞ at r = 1; ``r`` in 0 … 1; derived."""
    choked = np.less_equal(r, critical_ratio(kappa))
    r = np.maximum(r, critical_ratio(kappa))
    q = r ** (1.0 / kappa)
    with np.errstate(divide="ignore"):
        slope = (2.0 * q * q / r - (kappa + 1.0) * q) / ((kappa - 1.0) * nozzle_function(r, kappa))
    return np.where(choked, 0.0, slope)


def mass_flow(p_up: Real, T_up: Real, p_down: Real, par: PaperParameters) -> Real:
    """(17) G = C_d A_o p₁/√(R T₁) ψ(p₂/p₁) in kg/s; Pa absolute and K; linear above the laminar limit; literature.

    For p_up ≥ p_down; with the pressures the other way round, swap them and the sign.
    """
    r, limit = p_down / p_up, par.laminar_limit
    psi = np.where(
        r > limit,
        nozzle_function(limit, par.heat_capacity_ratio) * (1.0 - r) / (1.0 - limit),
        nozzle_function(r, par.heat_capacity_ratio),
    )
    return _flow_area(par.orifice_diameter, par) * p_up / np.sqrt(par.gas_constant * T_up) * psi


def flow_resistance(r: Real, d: Real, par: PaperParameters) -> Real:
    """(18) R_f = √(R T)/(C_d A_o |ψ′(r)|) in Pa·s/kg: inverse slope of (17) at ``r``; ``d`` in m; infinite if choked.

    That one linearises "in the vicinity of an equilibrium point" is stated in the paper, the form is derived. It is the
    slope against the downstream pressure; against the upstream one it is |ψ′| r + ψ instead of |ψ′|, so that one R_f
    for the difference of both holds for r → 1 only (2 % off at 0.98, 13 % at 0.9).
    """
    kappa, limit = par.heat_capacity_ratio, par.laminar_limit
    slope = np.where(
        np.greater(r, limit), -nozzle_function(limit, kappa) / (1.0 - limit), nozzle_slope(r, kappa)
    )
    with np.errstate(divide="ignore"):
        return np.sqrt(par.gas_constant * par.gas_temperature) / (_flow_area(d, par) * np.abs(slope))


def time_constant(r: Real, d: Real, par: PaperParameters) -> Real:
    """τ = R_f C_a C_b/(C_a + C_b) in s: how fast bellows and auxiliary chamber level out; derived."""
    return flow_resistance(r, d, par) * par.series_capacity


def stiffness_step(p: Real, par: PaperParameters, area: Real | None = None) -> Real:
    """ΔK = n p A² (1/V_b − 1/(V_a + V_b)) in N/m: from open to closed orifice; ``p`` in Pa absolute; derived.

    ``area`` (m²) is the vertical effective area unless given: (23) has the lateral one.
    """
    A = par.effective_area if area is None else area
    V_b, V_a = par.bellows_volume, par.auxiliary_volume
    return par.polytropic_exponent * p * A * A * (1.0 / V_b - 1.0 / (V_a + V_b))


def orifice_damping(
    omega: Real, r: Real, d: Real, p: Real, par: PaperParameters, area: Real | None = None
) -> Real:
    """(19) c = ΔK τ/(1 + ω² τ²) in N·s/m; ``omega`` in rad/s, ``r`` of the pressures, ``d`` in m, ``p`` in Pa absolute.

    Rises and falls with r: stated in the paper. Falls with d: stated in the paper, true for ωτ < 1 only, that is for
    r above `peak_ratio`. Falls with ω at every r: its maximum is at rest, not at the natural frequency.
    """
    tau = time_constant(r, d, par)
    with np.errstate(divide="ignore", invalid="ignore"):  # choked: τ = ∞, c = 0 in motion
        return stiffness_step(p, par, area) / (
            1.0 / tau + np.where(np.equal(omega, 0.0), 0.0, np.square(omega) * tau)
        )


def peak_damping(omega: Real, p: Real, par: PaperParameters, area: Real | None = None) -> Real:
    """c_max = ΔK/(2ω) in N·s/m, at ωτ = 1: the same for every orifice; ``omega`` in rad/s; derived."""
    return stiffness_step(p, par, area) / (2.0 * omega)


def peak_ratio(omega: Real, d: Real, par: PaperParameters) -> Real:
    """r*: the pressure ratio of the largest damping, where ωτ = 1; ``omega`` in rad/s, ``d`` in m; derived.

    By bisection, to the last bit, between choked flow (τ = ∞) and r = 1 (τ = 0): τ falls all the way.
    """
    kappa = par.heat_capacity_ratio
    slope = omega * np.sqrt(par.gas_constant * par.gas_temperature) * par.series_capacity / _flow_area(d, par)
    low = np.broadcast_to(critical_ratio(kappa), np.shape(slope)).astype(np.float64)
    high = np.ones_like(low)
    for _ in range(54):
        middle = 0.5 * (low + high)
        beyond = -nozzle_slope(middle, kappa) > slope
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    return 0.5 * (low + high)


def _flow_area(d: Real, par: PaperParameters) -> Real:
    return par.discharge_coefficient * 0.25 * pi * np.square(d)
