"""Total lateral dynamic stiffness: equation (23).

With the pipe's inertance, the stiffness has a minimum and a peak, and then returns to that of the closed diaphragm.
Without inertance, it rises from the stiffness of both chambers to that of the diaphragm alone.
"""

import numpy as np

from astb_studies.paper.closed_form.diaphragm import diaphragm_stiffness
from astb_studies.paper.closed_form.emergency_spring import combined, layered_stiffness
from astb_studies.paper.closed_form.orifice_damping import flow_resistance
from astb_studies.paper.closed_form.parameters import Complex, PaperParameters, Real, Topology
from astb_studies.paper.closed_form.torsion import roll_factor


def gas_stiffness(
    omega: Real, K_r: Real, par: PaperParameters, r: Real | None = None, d: Real | None = None
) -> Complex:
    """K_r (iω + 1/(Z C_a))/(iω + 1/(Z C_a) + 1/(Z C_b)) in N/m, Z = R_f + iω L_p/A_p; ``omega`` in rad/s; derived.

    ``r`` is the pressure ratio of (18), ``d`` the orifice (m); those of ``par`` unless given. K_r V_b/(V_a + V_b) at
    rest, K_r at infinity; at every frequency if the orifice is choked.
    """
    resistance = flow_resistance(
        par.pressure_ratio if r is None else r, par.orifice_diameter if d is None else d, par
    )
    C_a, C_b = par.auxiliary_capacity, par.bellows_capacity
    # Numerator and denominator times C_b/R_f: a choked orifice has an infinite resistance.
    omega, g = np.asarray(omega, dtype=np.float64), 1.0 / resistance
    denominator = g * (1.0 + C_b / C_a - omega**2 * par.pipe_inertance * C_b) + 1j * omega * C_b
    moving = omega != 0.0
    share = np.where(moving, g / np.where(moving, denominator, 1.0), C_a / (C_a + C_b))
    return np.asarray(K_r * (1.0 - share), dtype=np.complex128)


def dynamic_stiffness(
    omega: Real,
    y: Real,
    p: Real,
    par: PaperParameters,
    *,
    topology: Topology,
    phi: Real = 0.0,
    r: Real | None = None,
    d: Real | None = None,
) -> Complex:
    """(23) K_dyn(ω; y, φ, p) = [K_gas(ω) with K_e] k(φ) + iω c_rubber in N/m.

    ``omega`` in rad/s, ``y`` in m, ``p`` in Pa absolute, ``phi`` in rad; ``topology`` has no default because the paper
    says one and physics the other. That the parts add up: stated in the paper; their frequency dependence is derived.
    """
    K = combined(
        gas_stiffness(omega, diaphragm_stiffness(y, p, par), par, r, d), layered_stiffness(par), topology
    )
    return K * roll_factor(phi, par) + 1j * np.asarray(omega) * par.rubber_damping


def damping_of(K: Complex, omega: Real) -> Real:
    """(2) c = K″/ω in N·s/m of a complex stiffness ``K`` (N/m) at ``omega`` > 0 (rad/s); definition."""
    return np.asarray(K).imag / omega


def surge_frequencies(par: PaperParameters) -> tuple[Real, Real]:
    """Where the stiffness has its minimum and its peak, in Hz, without losses; derived.

    The gas of the auxiliary chamber alone, and of both chambers, on the mass in the pipe: 1/(2π √(C L_p/A_p)).
    """
    inertance = par.pipe_inertance
    return (
        1.0 / (2.0 * np.pi * np.sqrt(par.auxiliary_capacity * inertance)),
        1.0 / (2.0 * np.pi * np.sqrt(par.series_capacity * inertance)),
    )
