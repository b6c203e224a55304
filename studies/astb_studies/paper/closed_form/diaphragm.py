"""Lateral stiffness of the rubber diaphragm by its gas: equations (8) to (10).

The "effective area" and the "equivalent volume" are two fitted numbers of the lateral stiffness, not derivatives of one
volume. A volume that grows with |y| would push a conservative bellows away from its centre. By symmetry, a small
lateral motion does not change the volume. With the area that carries the load the formula would give ten times the
stiffness.
"""

import numpy as np

from astb_studies.paper.closed_form.parameters import PaperParameters, Real


def lateral_area(y: Real, par: PaperParameters) -> Real:
    """(8) A(y) = A_L0 (1 − α y²) in m², ``y`` in m.

    That it falls is stated in the paper; the square is assumed. Negative beyond y = 1/√α (0.38 m).
    """
    return par.lateral_area * (1.0 - par.lateral_area_decay * np.square(y))


def equivalent_volume(y: Real, par: PaperParameters) -> Real:
    """(8) V_eq(y) = V_0 (1 + β y²) in m³, ``y`` in m.

    That it grows, and by far more than the area falls, is stated in the paper; the square is assumed.
    """
    return par.bellows_volume * (1.0 + par.volume_growth * np.square(y))


def pressure_gradient(y: Real, p: Real, par: PaperParameters) -> Real:
    """(9) dp/dy = −n p A/V_eq in Pa/m for a sealed diaphragm, ``y`` in m, ``p`` in Pa absolute; derived."""
    return -par.polytropic_exponent * p * lateral_area(y, par) / equivalent_volume(y, par)


def diaphragm_stiffness(y: Real, p: Real, par: PaperParameters, *, area_term: bool = False) -> Real:
    """(10) K_r = n p A²/V_eq in N/m, restoring positive; ``y`` in m, ``p`` in Pa absolute.

    With ``area_term`` plus (p − p_a) dA/d|y|, which is not positive. The form is that of the literature on vertical
    stiffness, put in lateral terms by the paper. It is read as a secant, F = K_r y, as (20) has it.
    """
    stiffness = -pressure_gradient(y, p, par) * lateral_area(y, par)
    if area_term:
        slope = -2.0 * par.lateral_area * par.lateral_area_decay * np.abs(y)
        stiffness = stiffness + (p - par.atmospheric_pressure) * slope
    return stiffness
