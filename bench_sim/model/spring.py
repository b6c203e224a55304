"""The air spring: gas in a volume that depends on height and lateral displacement, rubber in parallel, emergency
spring in series.

    V(ζ,y) = V₀ + A₀ζ + ½A₁ζ² − ½(κ₀+κ₁ζ) Y(y),   Y = y²/(1+(y/y_s)²)
    F_z = p_g ∂V/∂ζ − rubber,   F_y = p_g ∂V/∂y − rubber

Forces and volume follow from one function. Therefore the membrane does no work, and ∂F_z/∂y = ∂F_y/∂ζ at constant
pressure. The emergency spring is a linear stack without mass and carries the same force: ζ = ζ_b − (F_z−P)/k_z, y =
y_b − F_y/k_y. It is undeformed at the preload P of the load case. Newton's method solves this for the displacement of
the bellows (ζ_b, y_b), and the time derivative gives the speed. A bellows that stretches, V + C_V (p − p_ref), does no
work either, and its force is the same function of the pressure. p_ref is the pressure of the load case. An effective
area that grows with the gauge pressure, A_e + A_p (p_g − p_A), also stretches the wall. Force and volume follow from
one potential Φ(ζ,y,p), F = ∂Φ/∂ζ and V = ∂Φ/∂p:

    Φ = … + A_p (p_g (p_g − p_A) ζ + (p_g − p_A)² h),   h = V₀/A₀

So V grows by A_p ((2p_g − p_A) ζ + 2 (p_g − p_A) h), because the bellows widens over its whole height. The cords store
the energy A_p (p_g² (ζ + h) − p_A² h). Below ``contact_height`` the top plate also sits on the emergency spring. The
model is valid for −87 mm < ζ_b (κ₀+κ₁ζ > 0).
"""

from math import tanh
from typing import Any

from bench_sim.model.algebraic import Algebraic
from bench_sim.model.bellows import (
    ITERATIONS,
    LONGEST_STEP,
    bellows_speeds,
    compliance_matrix,
    envelope,
    lateral_loads,
    lateral_shape,
    newton_step,
    pressure_per_volume,
    pressure_that_carries,
    pressure_that_stretches,
    tangents,
    vertical_loads,
)
from bench_sim.model.compiled import compiled
from bench_sim.model.gas import pressure, temperature
from bench_sim.model.layout import BRANCHES, State
from bench_sim.model.rubber import extra_pull, friction_curve, maxwell_pull
from bench_sim.model.surface import force_surface, lateral_surface, moment_surface

#: Newton's method ends below this step (m). The rest is corrected linearly, with an error of second order, 1e-6 N.
_CLOSE = 3e-7


@compiled
def volume(par: Any, side: int, zeta: float, y: float) -> float:
    """Return the bellows volume V(ζ, y) in m³, without the increase by pressure (`stretch`)."""
    V, _, _, _, _, _ = shape(par, side, zeta, y)
    return V


@compiled
def shape(par: Any, side: int, zeta: float, y: float) -> tuple[float, float, float, float, float, float]:
    """Return V, ∂V/∂ζ, ∂V/∂y and κ₀+κ₁ζ (`envelope`), then Y′ and Y″ (`lateral_shape`)."""
    Y, Y1, Y2 = lateral_shape(y, 1.0 / par.membrane_travel[side])
    V, A, B, length = envelope(
        zeta,
        Y,
        Y1,
        par.bellows_volume[side],
        unpressed_area(par, side),
        par.effective_area_slope[side],
        par.membrane_length[side],
        par.membrane_length_slope[side],
    )
    return V, A, B, length, Y1, Y2


@compiled
def unpressed_area(par: Any, side: int) -> float:
    """Return A₀ − A_p p_A in m²: the effective area at design height and zero gauge pressure."""
    return par.effective_area[side] - par.effective_area_growth[side] * par.area_reference_pressure


@compiled
def compliance(par: Any, side: int, zeta: float) -> float:
    """Return C = ∂V/∂p = C_V + 2 A_p (ζ + h) in m³/Pa."""
    height = par.bellows_volume[side] / par.effective_area[side]
    return par.bellows_compliance[side] + 2.0 * par.effective_area_growth[side] * (zeta + height)


@compiled
def stretch(par: Any, side: int, zeta: float, p: float) -> float:
    """Return the increase of `volume` by the absolute pressure ``p`` in m³: C_V (p − p_ref) + 2 A_p (p_g ζ + (p_g −
    p_A) h).
    """
    reference = par.nominal_preload[side] / par.effective_area[side] + par.atmospheric_pressure
    height = par.bellows_volume[side] / par.effective_area[side]
    gauge = p - par.atmospheric_pressure
    grown = gauge * zeta + (gauge - par.area_reference_pressure) * height
    return par.bellows_compliance[side] * (p - reference) + 2.0 * par.effective_area_growth[side] * grown


@compiled
def stretched_pressure(par: Any, side: int, zeta: float, content: float, V: float) -> float:
    """Return the pressure p in Pa that solves p (V + `stretch`) = ``content`` (J). V is the volume without
    `stretch`.
    """
    return pressure_that_stretches(content, V + stretch(par, side, zeta, 0.0), compliance(par, side, zeta))


@compiled
def resting_gauge(par: Any, side: int) -> float:
    """Return the gauge pressure p_g in Pa that carries the preload of the load case at design height."""
    return pressure_that_carries(
        par.nominal_preload[side], unpressed_area(par, side), par.effective_area_growth[side]
    )


@compiled
def shell_pull(
    x: Any, mem: Any, par: Any, side: int, k_z: float, k_y: float, zeta: float, y: float
) -> tuple[float, float, float, float]:
    """Return vertical force and stiffness of all relaxing elements in the shell of one bellows (N, N/m), then the
    lateral ones. ``k_z`` and ``k_y`` (N/m) are the elastic stiffnesses, to which the ratios of the branches refer.
    """
    branch_z, stiff_z = maxwell_pull(x, par, State.VERTICAL_DASHPOT + side * BRANCHES, k_z, zeta)
    branch_y, stiff_y = maxwell_pull(x, par, State.LATERAL_DASHPOT + side * BRANCHES, k_y, y)
    if par.extra_branch_ratio[0] != 0.0 or par.extra_friction[0] != 0.0:
        more, stiffer = extra_pull(x, mem, par, 0, side, k_z, zeta)
        branch_z += more
        stiff_z += stiffer
        more, stiffer = extra_pull(x, mem, par, 1, side, k_y, y)
        branch_y += more
        stiff_y += stiffer
    return branch_z, stiff_z, branch_y, stiff_y


@compiled
def load_bellows(x: Any, mem: Any, par: Any, side: int, zeta: float, y: float, out: Any) -> None:
    """Write pressure, forces and tangent stiffness of one bellows at its displacement (ζ_b, y_b) to ``out``."""
    V, A, B, length, Y1, Y2 = shape(par, side, zeta, y)
    p = pressure(x[State.BELLOWS_ENERGY + side], V, par.heat_capacity_ratio)
    growth = par.effective_area_growth[side]
    if par.bellows_compliance[side] > 0.0 or growth != 0.0:
        p = stretched_pressure(par, side, zeta, p * V, V)
        V += stretch(par, side, zeta, p)
    gauge = p - par.atmospheric_pressure

    k_z = par.shell_stiffness_vertical[side]
    k_y = par.shell_stiffness_lateral[side]
    branch_z, stiff_z, branch_y, stiff_y = shell_pull(x, mem, par, side, k_z, k_y, zeta, y)
    f_z, slope_z = friction_curve(
        zeta, mem.friction_origin[0, side], mem.friction_level[0, side], par.friction_vertical_travel[side]
    )
    f_y, slope_y = friction_curve(
        y, mem.friction_origin[1, side], mem.friction_level[1, side], par.friction_lateral_travel[side]
    )
    contact, F_z, K_zz, per_z = vertical_loads(
        zeta,
        gauge,
        A,
        par.effective_area_slope[side],
        growth,
        k_z,
        branch_z,
        stiff_z,
        f_z,
        slope_z,
        par.friction_vertical[side],
        par.friction_vertical_slope[side],
        par.contact_height,
        par.contact_stiffness,
    )
    F_y, K_yy, per_y = lateral_loads(
        y,
        gauge,
        B,
        -0.5 * length * Y2,
        k_y,
        branch_y,
        stiff_y,
        f_y,
        slope_y,
        par.friction_lateral[side],
        par.friction_lateral_slope[side],
    )
    out[Algebraic.VOLUME + side] = V
    out[Algebraic.AREA + side] = A + 2.0 * growth * gauge
    out[Algebraic.LATERAL_AREA + side] = B
    out[Algebraic.PRESSURE + side] = p
    out[Algebraic.CONTACT + side] = contact
    out[Algebraic.STACK_VERTICAL + side] = F_z
    out[Algebraic.STACK_LATERAL + side] = F_y
    out[Algebraic.STIFFNESS_ZZ + side] = K_zz
    out[Algebraic.STIFFNESS_ZY + side] = -0.5 * par.membrane_length_slope[side] * Y1 * gauge
    out[Algebraic.STIFFNESS_YY + side] = K_yy
    out[Algebraic.VERTICAL_PER_PRESSURE + side] = per_z
    out[Algebraic.LATERAL_PER_PRESSURE + side] = per_y


@compiled
def tangent_of(side: int, out: Any) -> tuple[float, float, float, float, float, float, float]:
    """Return ∂V/∂ζ, ∂V/∂y, ∂F_z/∂p, ∂F_y/∂p, ∂F_z/∂ζ, ∂F_z/∂y and ∂F_y/∂y of one bellows."""
    return (
        out[Algebraic.AREA + side],
        out[Algebraic.LATERAL_AREA + side],
        out[Algebraic.VERTICAL_PER_PRESSURE + side],
        out[Algebraic.LATERAL_PER_PRESSURE + side],
        out[Algebraic.STIFFNESS_ZZ + side],
        out[Algebraic.STIFFNESS_ZY + side],
        out[Algebraic.STIFFNESS_YY + side],
    )


@compiled
def energy_kept(par: Any, side: int, zeta: float, out: Any) -> float:
    """Return −dp/dV in Pa/m³ of one bellows at constant internal energy."""
    return pressure_per_volume(
        out[Algebraic.PRESSURE + side], out[Algebraic.VOLUME + side], compliance(par, side, zeta)
    )


@compiled
def share_with_emergency_spring(
    x: Any, mem: Any, par: Any, side: int, zeta: float, y: float, guess_z: float, guess_y: float, out: Any
) -> None:
    """Solve ζ_b − (F_z−P)/k_z = ζ and y_b − F_y/k_y = y for the bellows displacement (ζ_b, y_b). Write it and the
    loads to ``out``.
    """
    if par.emergency_spring == 0.0:
        z_b = zeta
        y_b = y
        load_bellows(x, mem, par, side, z_b, y_b, out)
    else:
        c_z = 1.0 / par.emergency_stiffness_vertical[side]
        c_y = 1.0 / par.emergency_stiffness_lateral[side]
        z_b = guess_z
        y_b = guess_y
        step_z = LONGEST_STEP
        step_y = LONGEST_STEP
        for _ in range(ITERATIONS):
            load_bellows(x, mem, par, side, z_b, y_b, out)
            miss_z = zeta - z_b + c_z * (out[Algebraic.STACK_VERTICAL + side] - par.nominal_preload[side])
            miss_y = y - y_b + c_y * out[Algebraic.STACK_LATERAL + side]
            A, B, per_z, per_y, K_zz, K_zy, K_yy = tangent_of(side, out)
            p_V = energy_kept(par, side, z_b, out)
            a, b, c, d = compliance_matrix(A, B, per_z, per_y, K_zz, K_zy, K_yy, c_z, c_y, p_V)
            step_z, step_y = newton_step(a, b, c, d, miss_z, miss_y)
            z_b += step_z
            y_b += step_y
            if abs(step_z) + abs(step_y) < _CLOSE:
                break
        carry_over(par, side, z_b - step_z, step_z, step_y, out)
    out[Algebraic.BELLOWS_VERTICAL + side] = z_b
    out[Algebraic.BELLOWS_LATERAL + side] = y_b


@compiled
def carry_over(par: Any, side: int, zeta: float, step_z: float, step_y: float, out: Any) -> None:
    """Correct the loads of one bellows linearly for a last small step from ``zeta``."""
    A, B, per_z, per_y, K_zz, K_zy, K_yy = tangent_of(side, out)
    p_V = energy_kept(par, side, zeta, out)
    F_z, F_y, V, p = tangents(step_z, step_y, A, B, per_z, per_y, K_zz, K_zy, K_yy, p_V)
    out[Algebraic.STACK_VERTICAL + side] += F_z
    out[Algebraic.STACK_LATERAL + side] += F_y
    out[Algebraic.VOLUME + side] += V + compliance(par, side, zeta) * p
    out[Algebraic.PRESSURE + side] += p
    out[Algebraic.AREA + side] += (
        par.effective_area_slope[side] * step_z + 2.0 * par.effective_area_growth[side] * p
    )


@compiled
def displacements(x: Any, par: Any, out: Any) -> None:
    """Write the displacements and speeds of both springs to ``out``.

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
    """Write the displacements of both springs and of their bellows, and the state of the gas in all chambers to
    ``out``.
    """
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
    """Subtract p dV/dt of both bellows (`bellows_speeds`), after all enthalpy and heat have been added to ``dx``."""
    kappa = par.heat_capacity_ratio
    for i in range(2):
        c_z = 0.0
        c_y = 0.0
        if par.emergency_spring != 0.0:
            c_z = 1.0 / par.emergency_stiffness_vertical[i]
            c_y = 1.0 / par.emergency_stiffness_lateral[i]
        A, B, per_z, per_y, K_zz, K_zy, K_yy = tangent_of(i, out)
        p = out[Algebraic.PRESSURE + i]
        z_speed, y_speed, V_rate = bellows_speeds(
            out[Algebraic.HEIGHT_SPEED + i] + dx[State.CREEP + i],
            out[Algebraic.LATERAL_SPEED + i],
            out[Algebraic.DASHPOT_VERTICAL + i],
            out[Algebraic.DASHPOT_LATERAL + i],
            (kappa - 1.0) * dx[State.BELLOWS_ENERGY + i],
            p,
            out[Algebraic.VOLUME + i],
            compliance(par, i, out[Algebraic.BELLOWS_VERTICAL + i]),
            kappa,
            A,
            B,
            per_z,
            per_y,
            K_zz,
            K_zy,
            K_yy,
            c_z,
            c_y,
        )
        out[Algebraic.BELLOWS_VERTICAL_SPEED + i] = z_speed
        out[Algebraic.BELLOWS_LATERAL_SPEED + i] = y_speed
        dx[State.BELLOWS_ENERGY + i] -= p * V_rate


@compiled
def coupling_stiffness(par: Any, side: int) -> float:
    """Return K_yφ = ½ (K_yy h + P) in N/rad: that of a sheared column of height h under the constant nominal load P."""
    K = (
        par.membrane_length[side] * par.nominal_preload[side] / par.effective_area[side]
        + par.shell_stiffness_lateral[side]
    )
    if par.emergency_spring != 0.0:
        K = 1.0 / (1.0 / K + 1.0 / par.emergency_stiffness_lateral[side])
    return 0.5 * (K * par.column_height + par.nominal_preload[side])


@compiled
def load_bolster(par: Any, side: int, F_z: float, F_y: float, M: float, dx: Any) -> None:
    """Add forces and moment of one spring to the derivatives of the bolster's speeds. Another term divides them by
    the mass later.
    """
    arm = (1.0 - 2.0 * side) * par.spring_half_spacing
    dx[State.BOLSTER_VERTICAL_SPEED] += F_z
    dx[State.BOLSTER_LATERAL_SPEED] += F_y
    dx[State.BOLSTER_ROLL_SPEED] += arm * F_z + par.centre_height * F_y + M


@compiled
def spring_term(par: Any, out: Any, dx: Any) -> None:
    """Add the forces (N) and moments of both springs to the derivatives of the bolster's speeds.

    Another term divides them by the mass later. F_y −= σ K_yφ φ_s tanh(θ/φ_s),  M = −(K_φ0 + K_φp P/A_e) θ − σ K_yφ y
    sech²(θ/φ_s). Both coupling terms follow from one potential σ K_yφ y φ_s tanh(θ/φ_s), parallel to the series
    connection, in the total displacement y. They depend on the constant nominal load P. If they depended on the
    pressure, they would do work on the gas without a change of volume. The contact dissipates energy by F (1 − d ζ̇),
    a damping in proportion to the force.
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
        shear = out[Algebraic.LATERAL + i]
        F_y = out[Algebraic.STACK_LATERAL + i] - K * par.coupling_angle * saturated
        F_y += lateral_surface(par, shear, out[Algebraic.LATERAL_SPEED + i], theta)
        M = -(par.torsional_stiffness[i] + par.torsional_stiffness_slope[i] * gauge) * theta
        M -= K * shear * (1.0 - saturated * saturated)
        M += moment_surface(par, shear, theta)
        out[Algebraic.VERTICAL_FORCE + i] = F_z
        out[Algebraic.LATERAL_FORCE + i] = F_y
        out[Algebraic.ROLL_MOMENT + i] = M
        load_bolster(par, i, F_z, F_y, M, dx)
