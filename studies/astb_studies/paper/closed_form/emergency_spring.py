"""The emergency spring, a stack of rubber layers under the bellows: equation (16)."""

from typing import TypeVar

from astb_studies.paper.closed_form.parameters import Complex, PaperParameters, Real, Topology

Stiffness = TypeVar("Stiffness", Real, Complex)


def layered_stiffness(par: PaperParameters) -> Real:
    """(16) K_e = G A/(n t) in N/m: ``rubber_layers`` layers in simple shear; literature.

    The layers carry the same force one after the other: more of them are softer.
    """
    return par.rubber_shear_modulus * par.rubber_area / (par.rubber_layers * par.rubber_layer_thickness)


def combined(K: Stiffness, K_e: Real, topology: Topology) -> Stiffness:
    """Diaphragm ``K`` (N/m, real or complex) and emergency spring ``K_e`` (N/m) as one stiffness.

    "series" is physics: both carry the same lateral force. "parallel" is stated in the paper. With a rubber stack of 1
    to 4 MN/m, it hides the diaphragm and most of the influence of load and displacement.
    """
    if topology == "series":
        return K * K_e / (K + K_e)
    if topology == "parallel":
        return K + K_e
    raise ValueError(f"topology = {topology!r}; it must be 'series' or 'parallel'")
