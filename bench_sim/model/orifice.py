"""Mass flow of a gas through a restriction, in both directions: isentropic nozzle, ISO 6358 valve and laminar leak."""

from math import pi, sqrt
from typing import Final

from bench_sim.model.compiled import compiled
from bench_sim.model.iso6358 import ISO_DENSITY, ISO_TEMPERATURE

#: Viscosity of air at 20 °C, in Pa s.
AIR_VISCOSITY: Final = 1.81e-5


@compiled
def nozzle_function(r: float, kappa: float) -> float:
    """Return ψ(r) = √(2κ/(κ−1) · (r^{2/κ} − r^{(κ+1)/κ})), constant at its maximum below the critical ratio.

    ``r`` is downstream divided by upstream absolute pressure, 0 to 1. With q = r^{1/κ} the bracket is q (q − r), and
    the maximum is at q = (κ+1) r / 2. So one power is enough.
    """
    q = r ** (1.0 / kappa)
    if q > 0.5 * (kappa + 1.0) * r:
        q = (2.0 / (kappa + 1.0)) ** (1.0 / (kappa - 1.0))
        r = 2.0 * q / (kappa + 1.0)
    return nozzle_root(q, r, nozzle_constant(kappa))


@compiled
def nozzle_constant(kappa: float) -> float:
    """Return 2κ/(κ−1)."""
    return 2.0 * kappa / (kappa - 1.0)


@compiled
def nozzle_root(q: float, r: float, constant: float) -> float:
    """Return ψ from q = r^{1/κ} and `nozzle_constant`, for a nozzle that is not choked."""
    return sqrt(constant * max(q * (q - r), 0.0))


@compiled
def nozzle_slope(laminar: float, kappa: float) -> float:
    """Return ψ/(1−r), which is constant above the pressure ratio ``laminar``."""
    return nozzle_function(laminar, kappa) / (1.0 - laminar)


@compiled
def mass_flow(area: float, p_up: float, T_up: float, R: float, psi: float) -> float:
    """Return G = C_d A p₁/√(R T₁) · ψ in kg/s. ``area`` is C_d A in m²."""
    return area * p_up / sqrt(R * T_up) * psi


@compiled
def upstream(p_1: float, T_1: float, p_2: float, T_2: float) -> tuple[float, float, float, float]:
    """Return direction of flow (1 from 1 to 2, or −1), pressure and temperature upstream, and pressure downstream."""
    forward = p_1 >= p_2
    return 1.0 if forward else -1.0, max(p_1, p_2), T_1 if forward else T_2, min(p_1, p_2)


@compiled
def nozzle_flow(
    p_up: float, T_up: float, p_down: float, area: float, R: float, kappa: float, laminar: float
) -> float:
    """Return G = C_d A p₁/√(R T₁) · ψ(p₂/p₁) in kg/s for p_up ≥ p_down. ``area`` is C_d A in m².

    Above the pressure ratio ``laminar`` the flow is linear in 1 − r, because the square root has an infinite slope at
    r = 1.
    """
    r = p_down / p_up
    if r > laminar:
        psi = nozzle_slope(laminar, kappa) * (1.0 - r)
    else:
        psi = nozzle_function(r, kappa)
    return mass_flow(area, p_up, T_up, R, psi)


@compiled
def iso_function(r: float, b: float, laminar: float) -> float:
    """Return √(1 − ((r−b)/(1−b))²). It is 1 up to the critical ratio ``b``, and linear in r above ``laminar``."""
    s = (min(max(r, b), laminar) - b) / (1.0 - b)
    root = sqrt(1.0 - s * s)
    return root * (1.0 - r) / (1.0 - laminar) if r > laminar else root


@compiled
def iso_flow(p_up: float, T_up: float, p_down: float, conductance: float, b: float, laminar: float) -> float:
    """Return G = C ρ₀ p₁ √(T₀/T₁) · iso(p₂/p₁) in kg/s for p_up ≥ p_down (ISO 6358). ``conductance`` is C in m³/(s·Pa);
    ``b`` and ``laminar`` are those of `iso_function`.
    """
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
    """Return the nozzle flow from 1 to 2 in kg/s. It is negative if p_2 is higher. Pressures are absolute (Pa);
    ``area`` and ``laminar`` are those of `nozzle_flow`.
    """
    sense, p_up, T_up, p_down = upstream(p_1, T_1, p_2, T_2)
    return sense * nozzle_flow(p_up, T_up, p_down, area, R, kappa, laminar)


@compiled
def valve_between(
    p_1: float, T_1: float, p_2: float, T_2: float, conductance: float, b: float, laminar: float
) -> float:
    """Return the ISO 6358 flow from 1 to 2 in kg/s. It is negative if p_2 is higher. Pressures are absolute (Pa);
    ``conductance``, ``b`` and ``laminar`` are those of `iso_flow`.
    """
    sense, p_up, T_up, p_down = upstream(p_1, T_1, p_2, T_2)
    return sense * iso_flow(p_up, T_up, p_down, conductance, b, laminar)


@compiled
def laminar_between(p_1: float, p_2: float, coefficient: float) -> float:
    """Return G = k (p₁² − p₂²) in kg/s: compressible laminar flow through a fine crack."""
    return coefficient * (p_1 * p_1 - p_2 * p_2)


@compiled
def reynolds_per_flow(diameter: float) -> float:
    """Return Re/|G| = 4/(π d μ) in s/kg."""
    return 4.0 / (pi * diameter * AIR_VISCOSITY)


@compiled
def reynolds_factor(Re: float, k: float) -> float:
    """Return C_d/C_d∞ = 1/(1 + k/√Re), with Re ≥ 1. It is close to 1 − k/√Re at high Re, but never negative."""
    root = sqrt(max(Re, 1.0))
    return root / (root + k)


@compiled
def one_way(asymmetry: float, outward: float) -> float:
    """Return the factor of the flow area for the direction of flow. A positive ``outward`` is a flow out of the
    bellows. With positive ``asymmetry`` an orifice lets more air out of the bellows than into it.
    """
    return 1.0 + asymmetry * (1.0 if outward > 0.0 else -1.0)


@compiled
def effective_flow_area(diameter: float, discharge: float) -> float:
    """Return C_d π d²/4 in m²."""
    return discharge * 0.25 * pi * diameter * diameter
