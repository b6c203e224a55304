"""Influence of the roll angle on the lateral stiffness: the last of equations (13) to (15)."""

import numpy as np

from astb_studies.paper.closed_form.parameters import PaperParameters, Real


def roll_factor(phi: Real, par: PaperParameters) -> Real:
    """K_lat(φ)/K_lat(0) = 1 + γ (1 − exp(−(φ/φ_0)²)), ``phi`` in rad; even in φ.

    Assumed: it has the shape that the paper states, a steep rise that is over at 0.05. An elastic coupling is odd in φ
    and cannot cause this. In the plant, the secant F_y/y at an offset rises, for one sign of roll only.
    """
    return 1.0 + par.roll_hardening * (1.0 - np.exp(-np.square(phi / par.roll_scale)))
