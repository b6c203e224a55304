"""Coupling of lateral and roll deformation: equations (11) and (12)."""

import numpy as np

from astb_studies.paper.closed_form.parameters import Real


def coupling_stiffness(K_yy: Real, P: Real, h: Real) -> Real:
    """K_yφ = ½ (K_yy h + P) in N/rad: a sheared column of height ``h`` (m) under the load ``P`` (N), ``K_yy`` in N/m.

    Derived: the moments at top and bottom together balance F h + P y, and each takes one half.
    """
    return 0.5 * (K_yy * h + P)


def coupled_reaction(
    y: Real, phi: Real, K_yy: Real, K_yphi: Real, K_phiphi: Real
) -> tuple[np.ndarray, np.ndarray]:
    """(11) F_y = K_yy y + K_yφ φ in N and (12) M_x = K_yφ y + K_φφ φ in N·m, restoring positive; ``phi`` in rad.

    The coupling and its symmetry: stated in the paper, after Facchinetti et al. (2010). It is odd in φ: it helps
    against one sign of roll and works for the other.
    """
    y, phi = np.asarray(y), np.asarray(phi)
    return K_yy * y + K_yphi * phi, K_yphi * y + K_phiphi * phi


def free_roll_stiffness(K_yy: Real, K_yphi: Real, K_phiphi: Real, restraint: Real = 0.0) -> Real:
    """K_yy − K_yφ²/(K_φφ + K) in N/m: lateral stiffness when the top may roll against a ``restraint`` K (N·m/rad).

    Derived: M_x + K φ = 0 in (12). Negative for one spring by itself: it is the pair of springs, 2b² k_z, that
    keeps the top upright.
    """
    return K_yy - np.square(K_yphi) / (K_phiphi + restraint)
