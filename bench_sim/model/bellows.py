"""The equations of the bellows and of the emergency spring in series with it, as functions of numbers without
branches.

`bench_sim.model.spring` calls them for the two springs of a bench. `bench_sim.model.lanes` calls them for eight
springs at the same time, where the compiler makes vector instructions of them. For this reason each decision is a
selection of one of two values, and a division that is needed twice is computed once as a reciprocal.
"""

from math import sqrt
from typing import Final

from bench_sim.model.compiled import compiled
from bench_sim.model.rubber import friction_limit

#: A bellows is never empty: this keeps the pressure finite during Newton's method.
SMALLEST_VOLUME: Final = 1e-3
#: Limits of Newton's method: largest step (m), and number of steps.
LONGEST_STEP: Final = 0.02
ITERATIONS: Final = 40


@compiled
def lateral_shape(y: float, per_scale: float) -> tuple[float, float, float]:
    """Return Y = y²/(1+(y/y_s)²) in m² and its derivatives Y′ (m) and Y″ (1). ``per_scale`` is 1/y_s."""
    t = y * per_scale
    s = 1.0 + t * t
    per_s = 1.0 / s
    return y * y * per_s, 2.0 * y * per_s * per_s, 2.0 * (4.0 - 3.0 * s) * per_s * per_s * per_s


@compiled
def envelope(
    z: float, Y: float, Y1: float, V_0: float, A_0: float, A_1: float, kappa_0: float, kappa_1: float
) -> tuple[float, float, float, float]:
    """Return V in m³ at the pressure of the load case, ∂V/∂ζ and ∂V/∂y in m², and κ₀+κ₁ζ in m."""
    length = kappa_0 + kappa_1 * z
    V = max(V_0 + (A_0 + 0.5 * A_1 * z) * z - 0.5 * length * Y, SMALLEST_VOLUME)
    return V, A_0 + A_1 * z - 0.5 * kappa_1 * Y, -0.5 * length * Y1, length


@compiled
def pressure_that_stretches(content: float, V: float, compliance: float) -> float:
    """Return the pressure p in Pa that solves p (V + C_V p) = ``content`` (J). V is the volume at zero pressure (m³),
    ``compliance`` is C_V in m³/Pa.
    """
    return 2.0 * content / (V + sqrt(V * V + 4.0 * compliance * content))


@compiled
def pressure_that_carries(load: float, A: float, growth: float) -> float:
    """Return the gauge pressure p_g in Pa that solves p_g (A + A_p p_g) = ``load`` (N). A is the area at zero pressure
    (m²), ``growth`` is A_p in m²/Pa.
    """
    return 2.0 * load / (A + sqrt(A * A + 4.0 * growth * load))


@compiled
def vertical_loads(
    z: float,
    gauge: float,
    A: float,
    A_1: float,
    growth: float,
    shell: float,
    rubber: float,
    stiff: float,
    f: float,
    slope: float,
    friction: float,
    friction_slope: float,
    contact_height: float,
    contact_stiffness: float,
) -> tuple[float, float, float, float]:
    """Return the compression of the contact in m, F_z in N, ∂F_z/∂ζ_b at constant pressure in N/m, and ∂F_z/∂p in m².

    ``A`` (m²) is the area at zero pressure, ``growth`` (m²/Pa) its increase per gauge pressure, and ``A_1`` is ∂A/∂ζ in
    m. ``shell`` (N/m) is the elastic stiffness. ``rubber`` (N) is the force of the relaxing elements, and ``stiff``
    (N/m) their stiffness. ``f`` is the value of the friction curve, ``slope`` (1/m) its slope; ``friction`` (N) and
    ``friction_slope`` (N/Pa) are those of `friction_limit`.
    """
    limit = friction_limit(friction, friction_slope, gauge)
    contact = max(contact_height - z, 0.0)
    K = contact_stiffness if contact > 0.0 else 0.0
    return (
        contact,
        gauge * (A + growth * gauge) - shell * z - rubber - limit * f + K * contact,
        gauge * A_1 - shell - stiff - limit * slope - K,
        A + 2.0 * growth * gauge - (friction_slope if gauge > 0.0 else 0.0) * f,
    )


@compiled
def lateral_loads(
    y: float,
    gauge: float,
    B: float,
    bend: float,
    shell: float,
    rubber: float,
    stiff: float,
    f: float,
    slope: float,
    friction: float,
    friction_slope: float,
) -> tuple[float, float, float]:
    """Return F_y in N, ∂F_y/∂y_b in N/m and ∂F_y/∂p in m². ``B`` is ∂V/∂y in m², and ``bend`` is ∂²V/∂y² in m. The
    other arguments are as in `vertical_loads`.
    """
    limit = friction_limit(friction, friction_slope, gauge)
    return (
        gauge * B - shell * y - rubber - limit * f,
        gauge * bend - shell - stiff - limit * slope,
        B - (friction_slope if gauge > 0.0 else 0.0) * f,
    )


@compiled
def pressure_per_volume(p: float, V: float, compliance: float) -> float:
    """Return −dp/dV = p/(V + C_V p) in Pa/m³ at constant internal energy."""
    return p / (V + compliance * p)


@compiled
def compliance_matrix(
    A: float,
    B: float,
    per_z: float,
    per_y: float,
    K_zz: float,
    K_zy: float,
    K_yy: float,
    c_z: float,
    c_y: float,
    p_V: float,
) -> tuple[float, float, float, float]:
    """Return the matrix 1 − C·K of the series connection, row by row. ``A`` and ``B`` are ∂V/∂ζ and ∂V/∂y (m²),
    ``per_z`` and ``per_y`` are ∂F_z/∂p and ∂F_y/∂p (m²), and ``K_…`` the tangent stiffnesses at constant pressure
    (N/m). ``c_z`` and ``c_y`` are the compliances of the emergency spring (m/N). ``p_V`` is −dp/dV in Pa/m³ of the
    present process.
    """
    return (
        1.0 - c_z * (K_zz - per_z * p_V * A),
        -c_z * (K_zy - per_z * p_V * B),
        -c_y * (K_zy - per_y * p_V * A),
        1.0 - c_y * (K_yy - per_y * p_V * B),
    )


@compiled
def solve_two(a: float, b: float, c: float, d: float, u: float, v: float) -> tuple[float, float]:
    """Return the solution (z, y) of a z + b y = u, c z + d y = v."""
    inverse = 1.0 / (a * d - b * c)
    return (d * u - b * v) * inverse, (a * v - c * u) * inverse


@compiled
def newton_step(a: float, b: float, c: float, d: float, miss_z: float, miss_y: float) -> tuple[float, float]:
    """Return the Newton correction of the vertical and the lateral deflection of the bellows in m, limited to
    `LONGEST_STEP`. ``a`` to ``d`` are the matrix (`compliance_matrix`), ``miss_z`` and ``miss_y`` the residuals in m.
    """
    z, y = solve_two(a, b, c, d, miss_z, miss_y)
    return min(max(z, -LONGEST_STEP), LONGEST_STEP), min(max(y, -LONGEST_STEP), LONGEST_STEP)


@compiled
def tangents(
    z: float,
    y: float,
    A: float,
    B: float,
    per_z: float,
    per_y: float,
    K_zz: float,
    K_zy: float,
    K_yy: float,
    p_V: float,
) -> tuple[float, float, float, float]:
    """Return the linearised changes of F_z, F_y (N), volume (m³) and pressure (Pa) by a small step (z, y) in m. The
    change of the volume is that at constant pressure. The other arguments are as in `compliance_matrix`.
    """
    V = A * z + B * y
    p = -p_V * V
    return K_zz * z + K_zy * y + per_z * p, K_zy * z + K_yy * y + per_y * p, V, p


@compiled
def bellows_speeds(
    z_speed: float,
    y_speed: float,
    relax_z: float,
    relax_y: float,
    heating: float,
    p: float,
    V: float,
    compliance: float,
    kappa: float,
    A: float,
    B: float,
    per_z: float,
    per_y: float,
    K_zz: float,
    K_zy: float,
    K_yy: float,
    c_z: float,
    c_y: float,
) -> tuple[float, float, float]:
    """Return ζ̇_b and ẏ_b in m/s, and dV/dt in m³/s, from the time derivative of the series connection.

    dp/dt = ((κ−1)Ḣ − κ p (∂V/∂ζ ζ̇_b + ∂V/∂y ẏ_b))/(V + κ C_V p). Ḣ is the sum of incoming enthalpy and heat, and
    ``heating`` is (κ−1)Ḣ in W. ``relax_z`` and ``relax_y`` are the rates of the forces by relaxation in N/s.
    ``compliance`` is C_V; the arguments from ``A`` on are as in `compliance_matrix`.
    """
    per_V = 1.0 / (V + kappa * compliance * p)
    a, b, c, d = compliance_matrix(A, B, per_z, per_y, K_zz, K_zy, K_yy, c_z, c_y, kappa * p * per_V)
    p_rate = heating * per_V
    u = z_speed + c_z * (per_z * p_rate + relax_z)
    v = y_speed + c_y * (per_y * p_rate + relax_y)
    z, y = solve_two(a, b, c, d, u, v)
    V_rate = A * z + B * y
    return z, y, V_rate + compliance * (heating - kappa * p * V_rate) * per_V
