"""Coupling of lateral and roll deformation: the stiffness K_yφ of equations (11) and (12)."""

from astb_studies.paper.closed_form.parameters import Real


def coupling_stiffness(K_yy: Real, P: Real, h: Real) -> Real:
    """K_yφ = ½ (K_yy h + P) in N/rad: a sheared column of height ``h`` (m) under the load ``P`` (N), ``K_yy`` in N/m.

    Derived: the moments at top and bottom together balance F h + P y, and each takes one half.
    """
    return 0.5 * (K_yy * h + P)
