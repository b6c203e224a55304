"""The air spring: one volume function, rubber in parallel with it, the emergency spring in series.

    V(ζ,y) = V₀ + A₀ζ + ½A₁ζ² − ½(κ₀+κ₁ζ) Y(y),   Y = y²/(1+(y/y_s)²)
    F_z = p_g ∂V/∂ζ − rubber,   F_y = p_g ∂V/∂y − rubber

so that the membrane does no work of its own and ∂F_z/∂y = ∂F_y/∂ζ at constant pressure. The emergency spring, a linear
stack without mass, carries the same force: ζ = ζ_b − (F_z−P)/k_z, y = y_b − F_y/k_y, undeformed at the preload P of the
load case. This is solved for the bellows' share (ζ_b, y_b) by Newton's method, and differentiated for its speed.
A bellows that stretches, V + C_V (p − p_ref), does no work of its own either, and its force is the same function of
the pressure; p_ref is that of the load case. Below ``contact_height`` the top plate also sits on the emergency spring.
Valid for −87 mm < ζ_b (κ₀+κ₁ζ > 0).
"""

from math import sqrt, tanh
from typing import Any

from bench_sim.model.algebraic import Algebraic
from bench_sim.model.compiled import compiled
from bench_sim.model.gas import pressure, temperature
from bench_sim.model.layout import BRANCHES, State
from bench_sim.model.rubber import extra_pull, friction_curve, friction_limit, maxwell_pull
from bench_sim.model.surface import force_surface

#: A bellows is never empty: keeps the pressure finite while Newton's method looks around.
SMALLEST_VOLUME = 1e-3

#: Below this step (m) the tangents carry every quantity over; what they miss is of second order, 1e-6 N.
_CLOSE = 3e-7
_LONGEST_STEP = 0.02
_ITERATIONS = 40


@compiled
def lateral_shape(y: float, scale: float) -> tuple[float, float, float]:
    """Y, Y′ and Y″ of Y = y²/(1+(y/y_s)²) in m², m, 1."""
    s = 1.0 + (y / scale) ** 2
    return y * y / s, 2.0 * y / (s * s), 2.0 * (4.0 - 3.0 * s) / (s * s * s)


@compiled
def volume(par: Any, side: int, zeta: float, y: float) -> float:
    """Bellows volume V(ζ, y) in m³, at the pressure of the load case if it depends on that."""
    Y, _, _ = lateral_shape(y, par.membrane_travel[side])
    return (
        par.bellows_volume[side]
        + (par.effective_area[side] + 0.5 * par.effective_area_slope[side] * zeta) * zeta
        - 0.5 * (par.membrane_length[side] + par.membrane_length_slope[side] * zeta) * Y
    )


@compiled
def stretch(par: Any, side: int, p: float) -> float:
    """C_V (p − p_ref) in m³, by which the bellows is larger at this absolute pressure than under its load case."""
    reference = par.nominal_preload[side] / par.effective_area[side] + par.atmospheric_pressure
    return par.bellows_compliance[side] * (p - reference)


@compiled
def stretched_pressure(par: Any, side: int, content: float, V: float) -> float:
    """p in Pa that solves p (V + C_V (p − p_ref)) = ``content`` (J), V being the volume at p_ref."""
    b = V + stretch(par, side, 0.0)
    return 2.0 * content / (b + sqrt(b * b + 4.0 * par.bellows_compliance[side] * content))


@compiled
def load_bellows(x: Any, mem: Any, par: Any, side: int, zeta: float, y: float, out: Any) -> None:
    """Pressure, force and tangent stiffness of one bellows at its own displacement (ζ_b, y_b), into ``out``."""
    Y, Y1, Y2 = lateral_shape(y, par.membrane_travel[side])
    A1 = par.effective_area_slope[side]
    kappa_1 = par.membrane_length_slope[side]
    length = par.membrane_length[side] + kappa_1 * zeta
    V = par.bellows_volume[side] + (par.effective_area[side] + 0.5 * A1 * zeta) * zeta - 0.5 * length * Y
    V = max(V, SMALLEST_VOLUME)
    A = par.effective_area[side] + A1 * zeta - 0.5 * kappa_1 * Y
    B = -0.5 * length * Y1
    p = pressure(x[State.BELLOWS_ENERGY + side], V, par.heat_capacity_ratio)
    if par.bellows_compliance[side] > 0.0:
        p = stretched_pressure(par, side, p * V, V)
        V += stretch(par, side, p)
    gauge = p - par.atmospheric_pressure

    k_z = par.shell_stiffness_vertical[side]
    k_y = par.shell_stiffness_lateral[side]
    branch_z, stiff_z = maxwell_pull(x, par, State.VERTICAL_DASHPOT + side * BRANCHES, k_z, zeta)
    branch_y, stiff_y = maxwell_pull(x, par, State.LATERAL_DASHPOT + side * BRANCHES, k_y, y)

    if par.extra_branch_ratio[0] != 0.0 or par.extra_friction[0] != 0.0:
        more, stiffer = extra_pull(x, mem, par, 0, side, k_z, zeta)
        branch_z += more
        stiff_z += stiffer
        more, stiffer = extra_pull(x, mem, par, 1, side, k_y, y)
        branch_y += more
        stiff_y += stiffer

    f_z, slope_z = friction_curve(
        zeta, mem.friction_origin[0, side], mem.friction_level[0, side], par.friction_vertical_travel[side]
    )
    f_y, slope_y = friction_curve(
        y, mem.friction_origin[1, side], mem.friction_level[1, side], par.friction_lateral_travel[side]
    )
    limit_z = friction_limit(par.friction_vertical[side], par.friction_vertical_slope[side], gauge)
    limit_y = friction_limit(par.friction_lateral[side], par.friction_lateral_slope[side], gauge)
    grip = 1.0 if gauge > 0.0 else 0.0

    contact = max(par.contact_height - zeta, 0.0)
    K_contact = par.contact_stiffness if contact > 0.0 else 0.0

    cross = -0.5 * kappa_1 * Y1 * gauge
    out[Algebraic.VOLUME + side] = V
    out[Algebraic.AREA + side] = A
    out[Algebraic.LATERAL_AREA + side] = B
    out[Algebraic.PRESSURE + side] = p
    out[Algebraic.CONTACT + side] = contact
    out[Algebraic.STACK_VERTICAL + side] = (
        gauge * A - k_z * zeta - branch_z - limit_z * f_z + K_contact * contact
    )
    out[Algebraic.STACK_LATERAL + side] = gauge * B - k_y * y - branch_y - limit_y * f_y
    out[Algebraic.STIFFNESS_ZZ + side] = gauge * A1 - k_z - stiff_z - limit_z * slope_z - K_contact
    out[Algebraic.STIFFNESS_ZY + side] = cross
    out[Algebraic.STIFFNESS_YY + side] = -0.5 * gauge * length * Y2 - k_y - stiff_y - limit_y * slope_y
    out[Algebraic.VERTICAL_PER_PRESSURE + side] = A - grip * par.friction_vertical_slope[side] * f_z
    out[Algebraic.LATERAL_PER_PRESSURE + side] = B - grip * par.friction_lateral_slope[side] * f_y


@compiled
def energy_kept(par: Any, side: int, out: Any) -> float:
    """−dp/dV = p/(V + C_V p) in Pa/m³ at constant internal energy."""
    p = out[Algebraic.PRESSURE + side]
    V = out[Algebraic.VOLUME + side]
    if par.bellows_compliance[side] > 0.0:
        V += par.bellows_compliance[side] * p
    return p / V


@compiled
def share_with_emergency_spring(
    x: Any, mem: Any, par: Any, side: int, zeta: float, y: float, guess_z: float, guess_y: float, out: Any
) -> None:
    """Solve ζ_b − (F_z−P)/k_z = ζ and y_b − F_y/k_y = y for the bellows' share, and leave its loads in ``out``."""
    if par.emergency_spring == 0.0:
        z_b = zeta
        y_b = y
        load_bellows(x, mem, par, side, z_b, y_b, out)
    else:
        c_z = 1.0 / par.emergency_stiffness_vertical[side]
        c_y = 1.0 / par.emergency_stiffness_lateral[side]
        z_b = guess_z
        y_b = guess_y
        step_z = _LONGEST_STEP
        step_y = _LONGEST_STEP
        for _ in range(_ITERATIONS):
            load_bellows(x, mem, par, side, z_b, y_b, out)
            miss_z = zeta - z_b + c_z * (out[Algebraic.STACK_VERTICAL + side] - par.nominal_preload[side])
            miss_y = y - y_b + c_y * out[Algebraic.STACK_LATERAL + side]
            p_V = energy_kept(par, side, out)
            a, b, c, d = compliance_matrix(side, c_z, c_y, p_V, out)
            determinant = a * d - b * c
            step_z = min(max((d * miss_z - b * miss_y) / determinant, -_LONGEST_STEP), _LONGEST_STEP)
            step_y = min(max((a * miss_y - c * miss_z) / determinant, -_LONGEST_STEP), _LONGEST_STEP)
            z_b += step_z
            y_b += step_y
            if abs(step_z) + abs(step_y) < _CLOSE:
                break
        carry_over(par, side, step_z, step_y, out)
    out[Algebraic.BELLOWS_VERTICAL + side] = z_b
    out[Algebraic.BELLOWS_LATERAL + side] = y_b


@compiled
def carry_over(par: Any, side: int, step_z: float, step_y: float, out: Any) -> None:
    """Move the loads of one bellows by a last small step along their tangents."""
    V_step = out[Algebraic.AREA + side] * step_z + out[Algebraic.LATERAL_AREA + side] * step_y
    p_step = -energy_kept(par, side, out) * V_step
    cross = out[Algebraic.STIFFNESS_ZY + side]
    out[Algebraic.STACK_VERTICAL + side] += (
        out[Algebraic.STIFFNESS_ZZ + side] * step_z
        + cross * step_y
        + out[Algebraic.VERTICAL_PER_PRESSURE + side] * p_step
    )
    out[Algebraic.STACK_LATERAL + side] += (
        cross * step_z
        + out[Algebraic.STIFFNESS_YY + side] * step_y
        + out[Algebraic.LATERAL_PER_PRESSURE + side] * p_step
    )
    if par.bellows_compliance[side] > 0.0:
        V_step += par.bellows_compliance[side] * p_step
    out[Algebraic.VOLUME + side] += V_step
    out[Algebraic.PRESSURE + side] += p_step
    out[Algebraic.AREA + side] += par.effective_area_slope[side] * step_z


@compiled
def compliance_matrix(
    side: int, c_z: float, c_y: float, p_V: float, out: Any
) -> tuple[float, float, float, float]:
    """1 − C·K of the series connection, row by row; ``p_V`` = −dp/dV in Pa/m³ for the change of state at hand."""
    A = out[Algebraic.AREA + side]
    B = out[Algebraic.LATERAL_AREA + side]
    per_z = out[Algebraic.VERTICAL_PER_PRESSURE + side]
    per_y = out[Algebraic.LATERAL_PER_PRESSURE + side]
    cross = out[Algebraic.STIFFNESS_ZY + side]
    return (
        1.0 - c_z * (out[Algebraic.STIFFNESS_ZZ + side] - per_z * p_V * A),
        -c_z * (cross - per_z * p_V * B),
        -c_y * (cross - per_y * p_V * A),
        1.0 - c_y * (out[Algebraic.STIFFNESS_YY + side] - per_y * p_V * B),
    )


@compiled
def displacements(x: Any, par: Any, out: Any) -> None:
    """Displacements of both springs and their speeds.

    ζ_i = z_B + s_i b φ_B − z_P − s_i b φ_P,  y_i = y_B + e φ_B − y_P + h φ_P,  θ = φ_B − φ_P
    """
    out[Algebraic.ROLL] = x[State.BOLSTER_ROLL] - x[State.PLATFORM_ROLL]
    y = (
        x[State.BOLSTER_LATERAL]
        + par.centre_height * x[State.BOLSTER_ROLL]
        - x[State.PLATFORM_LATERAL]
        + par.column_height * x[State.PLATFORM_ROLL]
    )
    y_speed = (
        x[State.BOLSTER_LATERAL_SPEED]
        + par.centre_height * x[State.BOLSTER_ROLL_SPEED]
        - x[State.PLATFORM_LATERAL_SPEED]
        + par.column_height * x[State.PLATFORM_ROLL_SPEED]
    )
    for i in range(2):
        arm = (1.0 - 2.0 * i) * par.spring_half_spacing
        out[Algebraic.HEIGHT + i] = (
            x[State.BOLSTER_VERTICAL] - x[State.PLATFORM_VERTICAL] + arm * out[Algebraic.ROLL]
        )
        out[Algebraic.HEIGHT_SPEED + i] = (
            x[State.BOLSTER_VERTICAL_SPEED]
            - x[State.PLATFORM_VERTICAL_SPEED]
            + arm * (x[State.BOLSTER_ROLL_SPEED] - x[State.PLATFORM_ROLL_SPEED])
        )
        out[Algebraic.LATERAL + i] = y
        out[Algebraic.LATERAL_SPEED + i] = y_speed


@compiled
def spring_algebra(t: float, x: Any, mem: Any, par: Any, out: Any) -> None:
    """Displacements of both springs, their bellows' share, and the state of the gas in the chambers."""
    displacements(x, par, out)
    ahead = t - mem.solved_time
    kappa = par.heat_capacity_ratio
    for i in range(2):
        share_with_emergency_spring(
            x,
            mem,
            par,
            i,
            out[Algebraic.HEIGHT + i] + x[State.CREEP + i],
            out[Algebraic.LATERAL + i],
            mem.bellows_vertical[i] + ahead * mem.bellows_vertical_speed[i],
            mem.bellows_lateral[i] + ahead * mem.bellows_lateral_speed[i],
            out,
        )
        out[Algebraic.TEMPERATURE + i] = temperature(
            x[State.BELLOWS_MASS + i], x[State.BELLOWS_ENERGY + i], par.gas_constant, kappa
        )
        energy = x[State.AUXILIARY_ENERGY + i]
        out[Algebraic.AUXILIARY_PRESSURE + i] = pressure(energy, par.auxiliary_volume[i], kappa)
        out[Algebraic.AUXILIARY_TEMPERATURE + i] = temperature(
            x[State.AUXILIARY_MASS + i], energy, par.gas_constant, kappa
        )


@compiled
def work_term(par: Any, out: Any, dx: Any) -> None:
    """−p dV/dt of both bellows, after all enthalpy and heat have been added to ``dx``.

    The bellows' speed follows from differentiating the series connection in time, with
    dp/dt = ((κ−1)Ḣ − κ p (∂V/∂ζ ζ̇_b + ∂V/∂y ẏ_b))/(V + κ C_V p), where Ḣ is what has been added so far.
    """
    kappa = par.heat_capacity_ratio
    for i in range(2):
        p = out[Algebraic.PRESSURE + i]
        V = out[Algebraic.VOLUME + i]
        if par.bellows_compliance[i] > 0.0:
            V += kappa * par.bellows_compliance[i] * p
        heating = (kappa - 1.0) * dx[State.BELLOWS_ENERGY + i]
        z_speed = out[Algebraic.HEIGHT_SPEED + i] + dx[State.CREEP + i]
        y_speed = out[Algebraic.LATERAL_SPEED + i]
        if par.emergency_spring != 0.0:
            c_z = 1.0 / par.emergency_stiffness_vertical[i]
            c_y = 1.0 / par.emergency_stiffness_lateral[i]
            a, b, c, d = compliance_matrix(i, c_z, c_y, kappa * p / V, out)
            p_rate = heating / V
            z_speed += c_z * (
                out[Algebraic.VERTICAL_PER_PRESSURE + i] * p_rate + out[Algebraic.DASHPOT_VERTICAL + i]
            )
            y_speed += c_y * (
                out[Algebraic.LATERAL_PER_PRESSURE + i] * p_rate + out[Algebraic.DASHPOT_LATERAL + i]
            )
            determinant = a * d - b * c
            z_speed, y_speed = (
                (d * z_speed - b * y_speed) / determinant,
                (a * y_speed - c * z_speed) / determinant,
            )
        out[Algebraic.BELLOWS_VERTICAL_SPEED + i] = z_speed
        out[Algebraic.BELLOWS_LATERAL_SPEED + i] = y_speed
        V_rate = out[Algebraic.AREA + i] * z_speed + out[Algebraic.LATERAL_AREA + i] * y_speed
        if par.bellows_compliance[i] > 0.0:
            V_rate += par.bellows_compliance[i] * (heating - kappa * p * V_rate) / V
        dx[State.BELLOWS_ENERGY + i] -= p * V_rate


@compiled
def coupling_stiffness(par: Any, side: int) -> float:
    """K_yφ = ½ (K_yy h + P) in N/rad: a sheared column of height h under the constant nominal load P."""
    K = (
        par.membrane_length[side] * par.nominal_preload[side] / par.effective_area[side]
        + par.shell_stiffness_lateral[side]
    )
    if par.emergency_spring != 0.0:
        K = 1.0 / (1.0 / K + 1.0 / par.emergency_stiffness_lateral[side])
    return 0.5 * (K * par.column_height + par.nominal_preload[side])


@compiled
def spring_term(par: Any, out: Any, dx: Any) -> None:
    """Forces of both springs on the bolster (left in its speed derivatives as force, to be divided by mass later).

    F_y −= σ K_yφ φ_s tanh(θ/φ_s),  M = −(K_φ0 + K_φp P/A_e) θ − σ K_yφ y sech²(θ/φ_s): both from one potential
    σ K_yφ y φ_s tanh(θ/φ_s) beside the series connection, in the total displacement y. They depend on the constant
    nominal load P instead of the pressure, which would make them do work on the gas that no volume accounts for.
    The contact loses energy as F (1 − d ζ̇): a dash-pot that grows with the force.
    """
    theta = out[Algebraic.ROLL]
    saturated = tanh(theta / par.coupling_angle)
    for i in range(2):
        K = par.coupling_sign * coupling_stiffness(par, i)
        gauge = par.nominal_preload[i] / par.effective_area[i]
        loss = max(-par.contact_loss * out[Algebraic.HEIGHT_SPEED + i], -1.0)
        F_z = out[Algebraic.STACK_VERTICAL + i] + par.contact_stiffness * out[Algebraic.CONTACT + i] * loss
        if par.force_surface_displacement[1] > par.force_surface_displacement[0]:
            F_z += force_surface(par, out[Algebraic.HEIGHT + i], out[Algebraic.HEIGHT_SPEED + i])
        F_y = out[Algebraic.STACK_LATERAL + i] - K * par.coupling_angle * saturated
        M = -(par.torsional_stiffness[i] + par.torsional_stiffness_slope[i] * gauge) * theta
        M -= K * out[Algebraic.LATERAL + i] * (1.0 - saturated * saturated)
        out[Algebraic.VERTICAL_FORCE + i] = F_z
        out[Algebraic.LATERAL_FORCE + i] = F_y
        out[Algebraic.ROLL_MOMENT + i] = M
        arm = (1.0 - 2.0 * i) * par.spring_half_spacing
        dx[State.BOLSTER_VERTICAL_SPEED] += F_z
        dx[State.BOLSTER_LATERAL_SPEED] += F_y
        dx[State.BOLSTER_ROLL_SPEED] += arm * F_z + par.centre_height * F_y + M
