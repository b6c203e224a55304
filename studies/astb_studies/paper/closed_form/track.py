"""Track excitation: the unilateral cosine of equation (24)."""

import numpy as np

from astb_studies.paper.closed_form.parameters import Real


def angular_frequency(speed: Real, wavelength: Real) -> Real:
    """ω = 2π V/λ in rad/s of a train at ``speed`` (m/s) over a wave of ``wavelength`` (m); derived."""
    return 2.0 * np.pi * speed / wavelength


def unilateral_cosine(t: Real, amplitude: Real, omega: Real, cycles: int = 1) -> Real:
    """(24) z_t = (a/2)(1 − cos ωt) in m for 0 ≤ t ≤ ``cycles`` 2π/ω, else 0; s, m, rad/s.

    Stated in the paper, form from the literature. Never negative, ``amplitude`` high: its sine has half of that.
    """
    phase = omega * np.asarray(t)
    inside = (phase >= 0.0) & (phase <= 2.0 * np.pi * cycles)
    return np.where(inside, 0.5 * amplitude * (1.0 - np.cos(phase)), 0.0)
