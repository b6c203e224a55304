"""Mass flow of a gas through a restriction: isentropic nozzle, ISO 6358 valve and laminar leak, each with direction."""

from math import pi, sqrt
from typing import Final

from bench_sim.model.compiled import compiled
from bench_sim.model.iso6358 import ISO_DENSITY, ISO_TEMPERATURE

#: Of air at 20 °C, in Pa s.
AIR_VISCOSITY: Final = 1.81e-5


@compiled
def nozzle_function(r: float, kappa: float) -> float:
    """ψ(r) = √(2κ/(κ−1) · (r^{2/κ} − r^{(κ+1)/κ})), held at its maximum below the critical ratio.

    ``r`` is downstream over upstream absolute pressure, 0 … 1. With q = r^{1/κ} the bracket is q (q − r), and the
    maximum lies where q = (κ+1) r / 2, so one power decides and evaluates.
    """
    q = r ** (1.0 / kappa)
    if q > 0.5 * (kappa + 1.0) * r:
        q = (2.0 / (kappa + 1.0)) ** (1.0 / (kappa - 1.0))
        r = 2.0 * q / (kappa + 1.0)
    return sqrt(2.0 * kappa / (kappa - 1.0) * max(q * (q - r), 0.0))


@compiled
def nozzle_flow(
    p_up: float, T_up: float, p_down: float, area: float, R: float, kappa: float, laminar: float
) -> float:
    """G = C_d A p₁/√(R T₁) · ψ(p₂/p₁) in kg/s for p_up ≥ p_down; ``area`` is C_d A in m².

    Above the pressure ratio ``laminar`` the flow is linear in 1 − r: the square root has an infinite slope at r = 1.
    """
    r = p_down / p_up
    if r > laminar:
        psi = nozzle_function(laminar, kappa) * (1.0 - r) / (1.0 - laminar)
    else:
        psi = nozzle_function(r, kappa)
    return area * p_up / sqrt(R * T_up) * psi


@compiled
def iso_function(r: float, b: float, laminar: float) -> float:
    """√(1 − ((r−b)/(1−b))²): 1 at and below the critical ratio ``b``, linear above ``laminar``."""
    if r <= b:
        return 1.0
    if r > laminar:
        s = (laminar - b) / (1.0 - b)
        return sqrt(1.0 - s * s) * (1.0 - r) / (1.0 - laminar)
    s = (r - b) / (1.0 - b)
    return sqrt(1.0 - s * s)


@compiled
def iso_flow(p_up: float, T_up: float, p_down: float, conductance: float, b: float, laminar: float) -> float:
    """G = C ρ₀ p₁ √(T₀/T₁) · iso(p₂/p₁) in kg/s for p_up ≥ p_down; ``conductance`` in m³/(s·Pa) (ISO 6358)."""
    return (
        conductance
        * ISO_DENSITY
        * p_up
        * sqrt(ISO_TEMPERATURE / T_up)
        * iso_function(p_down / p_up, b, laminar)
    )


@compiled
def orifice_between(
    p_1: float, T_1: float, p_2: float, T_2: float, area: float, R: float, kappa: float, laminar: float
) -> float:
    """Nozzle flow from 1 to 2 in kg/s; negative when 2 is the upstream side."""
    if p_1 >= p_2:
        return nozzle_flow(p_1, T_1, p_2, area, R, kappa, laminar)
    return -nozzle_flow(p_2, T_2, p_1, area, R, kappa, laminar)


@compiled
def valve_between(
    p_1: float, T_1: float, p_2: float, T_2: float, conductance: float, b: float, laminar: float
) -> float:
    """ISO 6358 flow from 1 to 2 in kg/s; negative when 2 is the upstream side."""
    if p_1 >= p_2:
        return iso_flow(p_1, T_1, p_2, conductance, b, laminar)
    return -iso_flow(p_2, T_2, p_1, conductance, b, laminar)


@compiled
def laminar_between(p_1: float, p_2: float, coefficient: float) -> float:
    """G = k (p₁² − p₂²) in kg/s: compressible laminar flow through a fine crack."""
    return coefficient * (p_1 * p_1 - p_2 * p_2)


@compiled
def reynolds_factor(flow: float, diameter: float, k: float) -> float:
    """C_d/C_d∞ = 1/(1 + k/√Re), Re = 4|G|/(π d μ): 1 − k/√Re where that is close to 1, and above 0 at reversal."""
    root = sqrt(max(4.0 * abs(flow) / (pi * diameter * AIR_VISCOSITY), 1.0))
    return root / (root + k)


@compiled
def effective_flow_area(diameter: float, discharge: float) -> float:
    """C_d π d²/4 in m²."""
    return discharge * 0.25 * pi * diameter * diameter
