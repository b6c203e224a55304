"""Pressures and forces of eight springs at the same time, and how each deflection is shared between bellows and
emergency spring.

The laws are those of `bench_sim.model.bellows` and `bench_sim.model.rubber`. A lane is the position of one spring in
the vectors. Newton's method continues until the last lane has converged. A converged lane does not change any more, so
its results do not depend on the other lanes.
"""

from typing import Any, Final

from bench_sim.model.bellows import (
    ITERATIONS,
    compliance_matrix,
    envelope,
    lateral_loads,
    lateral_shape,
    newton_step,
    pressure_per_volume,
    pressure_that_stretches,
    tangents,
    vertical_loads,
)
from bench_sim.model.compiled import compiled
from bench_sim.model.gas import pressure, temperature
from bench_sim.model.lanes.layout import (
    EXTRA_FRICTION,
    EXTRA_LEVEL_Y,
    EXTRA_LEVEL_Z,
    EXTRA_RATIO,
    EXTRA_TRAVEL,
    LANES,
    PER_LANE,
    STAGE,
    Lane,
    LaneState,
)
from bench_sim.model.rubber import friction_curve, relaxing

#: Newton's method ends below this step (m). The start value includes the acceleration, so few iterations are needed.
_CLOSE: Final = 1e-9


@compiled
def look_ahead(w: Any, ahead: float, extra: int) -> None:
    """Predict the deflection of the bellows ``ahead`` s after the start of the step. Sum the displacements of all
    dash-pots of the rubber, weighted by their stiffness ratios. ``extra`` is the largest number of extra rubber
    branches in any lane.
    """
    lanes = w.shape[0] // PER_LANE
    for i in range(lanes):
        r_1, r_2, r_3 = w[Lane.RATIO + i], w[Lane.RATIO_2 + i], w[Lane.RATIO_3 + i]
        w[Lane.PULL_Z + i] = (
            r_1 * w[STAGE + LaneState.DASHPOT_Z + i]
            + r_2 * w[STAGE + LaneState.DASHPOT_Z_2 + i]
            + r_3 * w[STAGE + LaneState.DASHPOT_Z_3 + i]
        )
        w[Lane.PULL_Y + i] = (
            r_1 * w[STAGE + LaneState.DASHPOT_Y + i]
            + r_2 * w[STAGE + LaneState.DASHPOT_Y_2 + i]
            + r_3 * w[STAGE + LaneState.DASHPOT_Y_3 + i]
        )
        w[Lane.TRY_Z + i] = w[Lane.NOTED_Z + i] + ahead * (
            w[Lane.NOTED_Z_SPEED + i] + ahead * w[Lane.BEND_Z + i]
        )
        w[Lane.TRY_Y + i] = w[Lane.NOTED_Y + i] + ahead * (
            w[Lane.NOTED_Y_SPEED + i] + ahead * w[Lane.BEND_Y + i]
        )
        w[Lane.STEP_Z + i] = 0.0
        w[Lane.STEP_Y + i] = 0.0
        w[Lane.MOVING + i] = 1.0
        w[Lane.MORE_Z + i] = 0.0
        w[Lane.MORE_Y + i] = 0.0
        w[Lane.STIFFER_Z + i] = 0.0
        w[Lane.STIFFER_Y + i] = 0.0
    for e in range(extra):
        for i in range(lanes):
            k = w[EXTRA_RATIO + LANES * e + i]
            w[Lane.PULL_Z + i] += k * w[STAGE + LaneState.EXTRA + 2 * LANES * e + i]
            w[Lane.PULL_Y + i] += k * w[STAGE + LaneState.EXTRA + 2 * LANES * e + LANES + i]


@compiled
def extra_friction(w: Any, e: int) -> None:
    """Compute force and tangent stiffness of extra friction element ``e`` at the next iteration of Newton's method."""
    first = LANES * e
    for i in range(LANES):
        limit = w[EXTRA_FRICTION + first + i]
        travel = w[EXTRA_TRAVEL + first + i]
        z = w[Lane.TRY_Z + i] + w[Lane.STEP_Z + i] * w[Lane.MOVING + i]
        y = w[Lane.TRY_Y + i] + w[Lane.STEP_Y + i] * w[Lane.MOVING + i]
        f, s = friction_curve(z, w[Lane.ORIGIN_Z + i], w[EXTRA_LEVEL_Z + first + i], travel)
        w[Lane.MORE_Z + i] = limit * f + (w[Lane.MORE_Z + i] if e > 0 else 0.0)
        w[Lane.STIFFER_Z + i] = limit * s + (w[Lane.STIFFER_Z + i] if e > 0 else 0.0)
        f, s = friction_curve(y, w[Lane.ORIGIN_Y + i], w[EXTRA_LEVEL_Y + first + i], travel)
        w[Lane.MORE_Y + i] = limit * f + (w[Lane.MORE_Y + i] if e > 0 else 0.0)
        w[Lane.STIFFER_Y + i] = limit * s + (w[Lane.STIFFER_Y + i] if e > 0 else 0.0)


@compiled
def load_bellows(w: Any) -> None:
    """In lanes that have not converged, take Newton's step and compute pressure, forces and tangent stiffness."""
    for i in range(LANES):
        moving = w[Lane.MOVING + i]
        z = w[Lane.TRY_Z + i] + moving * w[Lane.STEP_Z + i]
        y = w[Lane.TRY_Y + i] + moving * w[Lane.STEP_Y + i]
        w[Lane.TRY_Z + i] = z
        w[Lane.TRY_Y + i] = y
        Y, Y1, Y2 = lateral_shape(y, w[Lane.PER_TRAVEL + i])
        A_1, kappa_1 = w[Lane.A_1 + i], w[Lane.KAPPA_1 + i]
        growth, outside = w[Lane.GROWTH + i], w[Lane.ATMOSPHERE + i]
        V, A, B, length = envelope(
            z, Y, Y1, w[Lane.V_0 + i], w[Lane.A_0 + i], A_1, w[Lane.KAPPA_0 + i], kappa_1
        )
        V += w[Lane.STRETCH_AT_0 + i] - 2.0 * growth * outside * z
        C = w[Lane.STRETCH + i] + 2.0 * growth * z
        content = (w[Lane.HEAT_RATIO + i] - 1.0) * w[STAGE + LaneState.ENERGY + i]
        p = pressure_that_stretches(content, V, C)
        gauge = p - outside
        k_z, k_y = w[Lane.SHELL_Z + i], w[Lane.SHELL_Y + i]
        ratios = w[Lane.RATIOS + i]
        f_z, slope_z = friction_curve(
            z, w[Lane.ORIGIN_Z + i], w[Lane.LEVEL_Z + i], w[Lane.FRICTION_Z_TRAVEL + i]
        )
        f_y, slope_y = friction_curve(
            y, w[Lane.ORIGIN_Y + i], w[Lane.LEVEL_Y + i], w[Lane.FRICTION_Y_TRAVEL + i]
        )
        pull = relaxing(k_z, ratios, w[Lane.PULL_Z + i], z) + w[Lane.MORE_Z + i]
        stiff = k_z * ratios + w[Lane.STIFFER_Z + i]
        grip, per_gauge = w[Lane.FRICTION_Z + i], w[Lane.FRICTION_Z_SLOPE + i]
        touch, stop = w[Lane.CONTACT_HEIGHT + i], w[Lane.CONTACT_STIFFNESS + i]
        contact, F_z, K_zz, per_z = vertical_loads(
            z, gauge, A, A_1, growth, k_z, pull, stiff, f_z, slope_z, grip, per_gauge, touch, stop
        )
        F_y, K_yy, per_y = lateral_loads(
            y,
            gauge,
            B,
            -0.5 * length * Y2,
            k_y,
            relaxing(k_y, ratios, w[Lane.PULL_Y + i], y) + w[Lane.MORE_Y + i],
            k_y * ratios + w[Lane.STIFFER_Y + i],
            f_y,
            slope_y,
            w[Lane.FRICTION_Y + i],
            w[Lane.FRICTION_Y_SLOPE + i],
        )
        w[Lane.VOLUME + i] = V + C * p
        w[Lane.AREA + i] = A + 2.0 * growth * gauge
        w[Lane.LATERAL_AREA + i] = B
        w[Lane.PRESSURE + i] = p
        w[Lane.CONTACT + i] = contact
        w[Lane.STACK_Z + i] = F_z
        w[Lane.STACK_Y + i] = F_y
        w[Lane.STIFFNESS_ZZ + i] = K_zz
        w[Lane.STIFFNESS_ZY + i] = -0.5 * kappa_1 * Y1 * gauge
        w[Lane.STIFFNESS_YY + i] = K_yy
        w[Lane.Z_PER_PRESSURE + i] = per_z
        w[Lane.Y_PER_PRESSURE + i] = per_y


@compiled
def tangent_of(w: Any, i: int) -> tuple[float, float, float, float, float, float, float]:
    """Return the seven tangents of one lane, like `bench_sim.model.spring.tangent_of`."""
    return (
        w[Lane.AREA + i],
        w[Lane.LATERAL_AREA + i],
        w[Lane.Z_PER_PRESSURE + i],
        w[Lane.Y_PER_PRESSURE + i],
        w[Lane.STIFFNESS_ZZ + i],
        w[Lane.STIFFNESS_ZY + i],
        w[Lane.STIFFNESS_YY + i],
    )


@compiled
def seek(w: Any) -> int:
    """Compute Newton's next step towards ζ_b − (F_z−P)/k_z = ζ and y_b − F_y/k_y = y. Return the number of lanes that
    have not converged.
    """
    left = 0
    for i in range(LANES):
        moving = w[Lane.MOVING + i]
        z = w[Lane.TRY_Z + i]
        y = w[Lane.TRY_Y + i]
        c_z, c_y = w[Lane.GIVE_Z + i], w[Lane.GIVE_Y + i]
        C = w[Lane.STRETCH + i] + 2.0 * w[Lane.GROWTH + i] * z
        p_V = pressure_per_volume(w[Lane.PRESSURE + i], w[Lane.VOLUME + i], C)
        miss_z = w[Lane.HEIGHT + i] + w[STAGE + LaneState.CREEP + i] - z
        miss_z += c_z * (w[Lane.STACK_Z + i] - w[Lane.PRELOAD + i])
        miss_y = w[Lane.LATERAL + i] - y + c_y * w[Lane.STACK_Y + i]
        A, B, per_z, per_y, K_zz, K_zy, K_yy = tangent_of(w, i)
        a, b, c, d = compliance_matrix(A, B, per_z, per_y, K_zz, K_zy, K_yy, c_z, c_y, p_V)
        step_z, step_y = newton_step(a, b, c, d, miss_z, miss_y)
        go = moving if abs(step_z) + abs(step_y) >= _CLOSE else 0.0
        left += 1 if go > 0.0 else 0
        w[Lane.MOVING + i] = go
        w[Lane.STEP_Z + i] = step_z
        w[Lane.STEP_Y + i] = step_y
    return left


@compiled
def carry_over(w: Any) -> None:
    """Correct the forces linearly by Newton's last step, and compute the state of the gas."""
    for i in range(LANES):
        z, y = w[Lane.STEP_Z + i], w[Lane.STEP_Y + i]
        p, V, growth = w[Lane.PRESSURE + i], w[Lane.VOLUME + i], w[Lane.GROWTH + i]
        C = w[Lane.STRETCH + i] + 2.0 * growth * w[Lane.TRY_Z + i]
        A, B, per_z, per_y, K_zz, K_zy, K_yy = tangent_of(w, i)
        p_V = pressure_per_volume(p, V, C)
        F_z, F_y, dV, dp = tangents(z, y, A, B, per_z, per_y, K_zz, K_zy, K_yy, p_V)
        w[Lane.STACK_Z + i] += F_z
        w[Lane.STACK_Y + i] += F_y
        w[Lane.VOLUME + i] = V + dV + C * dp
        w[Lane.PRESSURE + i] = p + dp
        w[Lane.AREA + i] = A + w[Lane.A_1 + i] * z + 2.0 * growth * dp
        w[Lane.BELLOWS_Z + i] = w[Lane.TRY_Z + i] + z
        w[Lane.BELLOWS_Y + i] = w[Lane.TRY_Y + i] + y
        R, kappa = w[Lane.GAS_CONSTANT + i], w[Lane.HEAT_RATIO + i]
        energy = w[STAGE + LaneState.AUXILIARY_ENERGY + i]
        w[Lane.TEMPERATURE + i] = temperature(
            w[STAGE + LaneState.MASS + i], w[STAGE + LaneState.ENERGY + i], R, kappa
        )
        w[Lane.AUXILIARY_TEMPERATURE + i] = temperature(
            w[STAGE + LaneState.AUXILIARY_MASS + i], energy, R, kappa
        )
        w[Lane.AUXILIARY_PRESSURE + i] = pressure(energy, w[Lane.AUXILIARY_VOLUME + i], kappa)


@compiled
def lane_algebra(w: Any, ahead: float, extra: int, frictions: int) -> None:
    """Compute bellows deflection, forces and gas of all lanes, ``ahead`` s after the start of the step.

    ``extra`` is the largest number of extra rubber branches in any lane, ``frictions`` that of friction elements.
    """
    look_ahead(w, ahead, extra)
    for _ in range(ITERATIONS):
        if frictions > 0:
            extra_friction(w, 0)
        if frictions > 1:
            extra_friction(w, 1)
        if frictions > 2:
            extra_friction(w, 2)
        load_bellows(w)
        if seek(w) == 0:
            break
    carry_over(w)
