"""The orifice under a harmonic motion of finite amplitude: the pressure ratio that (18) leaves free, derived.

For pressures close to each other (17) is Δp = R T G|G|/(2 p (C_d A_o)²). Harmonic balance puts the resistance
R = 8/(3π) R T Ĝ/(2 p (C_d A_o)²) instead of R_f, and the flow Ĝ follows from the motion that it damps. With the
time constant τ of (19) that is a quadratic equation in (ωτ)²:

    (ωτ)² = ½ (√(1 + 4ε²) − 1),   ε = (ω/ω_0)²,   ω_0⁻² = 4 R T n A a (C_a C_b/(C_a+C_b))²/(3π V_b (C_d A_o)²)

So c(ω) has a maximum, at ωτ = ½ and ω = (5/16)^¼ ω_0, of 0.4 ΔK/ω. It lies at ω ∝ C_d d²/√a under any load, and is
proportional to p √a/(C_d d²). The plant's own peak is within 2 % of it in frequency and 6 % in height.
"""

from math import pi

import numpy as np

from astb_studies.paper.closed_form.orifice_damping import stiffness_step
from astb_studies.paper.closed_form.parameters import PaperParameters, Real


def amplitude_time_constant(omega: Real, amplitude: Real, d: Real, par: PaperParameters) -> Real:
    """τ in s at ``omega`` > 0 (rad/s) for a vertical ``amplitude`` (m) through an orifice ``d`` (m); derived."""
    e = np.square(omega / _scale(amplitude, d, par))
    # ½ (√(1+4ε²) − 1), without the difference of nearly equal numbers
    return np.sqrt(2.0 * e * e / (1.0 + np.sqrt(1.0 + 4.0 * e * e))) / omega


def amplitude_damping(omega: Real, amplitude: Real, d: Real, p: Real, par: PaperParameters) -> Real:
    """c = ΔK τ/(1 + ω²τ²) in N·s/m with the τ of the amplitude; ``p`` in Pa absolute, the rest as above; derived.

    It has the maximum over frequency, and the fall with the diameter beyond it, that the paper states.
    """
    tau = amplitude_time_constant(omega, amplitude, d, par)
    return stiffness_step(p, par) * tau / (1.0 + np.square(omega * tau))


def peak_angular_frequency(amplitude: Real, d: Real, par: PaperParameters) -> Real:
    """ω of the largest damping in rad/s, (5/16)^¼ ω_0; ``amplitude`` and ``d`` in m; derived."""
    return (5.0 / 16.0) ** 0.25 * _scale(amplitude, d, par)


def _scale(amplitude: Real, d: Real, par: PaperParameters) -> Real:
    """ω_0 in rad/s."""
    area = par.discharge_coefficient * 0.25 * pi * np.square(d)
    flow = par.polytropic_exponent * par.effective_area * amplitude / par.bellows_volume
    return (
        np.sqrt(3.0 * pi / (4.0 * par.gas_constant * par.gas_temperature * flow)) * area / par.series_capacity
    )
