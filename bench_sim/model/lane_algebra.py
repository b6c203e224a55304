"""Pressures and forces of eight springs in lock-step, and how each shares its deflection with its emergency spring.

The equations are those of `bench_sim.model.spring` and `bench_sim.model.rubber`, which are the oracle. Newton's method
goes on until the last lane has arrived; one that has arrived stays where it is, so that no lane's numbers depend on
its neighbours.
"""

from math import sqrt
from typing import Any, Final

from bench_sim.model.compiled import compiled
from bench_sim.model.lane_layout import (
    EXTRA_FRICTION,
    EXTRA_LEVEL_Y,
    EXTRA_LEVEL_Z,
    EXTRA_RATIO,
    EXTRA_SPEED,
    EXTRA_TRAVEL,
    LANES,
    PER_LANE,
    STAGE,
    Lane,
    LaneState,
)
from bench_sim.model.spring import SMALLEST_VOLUME

#: Newton's method ends below this step (m). The guess follows the bellows' acceleration, so that it costs little.
_CLOSE: Final = 1e-9
_LONGEST_STEP: Final = 0.02
_ITERATIONS: Final = 40


@compiled
def _friction_curve(s: float, level: float, travel: float) -> tuple[float, float]:
    """F/F_max and its slope at ``s`` m from the last reversal (`bench_sim.model.rubber.friction_curve`)."""
    sense = 1.0 if s >= 0.0 else -1.0
    rest = 1.0 - sense * level
    d = max(travel * rest, 1e-12)
    per_n = 1.0 / (d + abs(s))
    return level + s * per_n * rest, rest * d * per_n * per_n


@compiled
def _lateral_shape(y: float, per_scale: float) -> tuple[float, float, float]:
    """Y, Y′ and Y″ (`bench_sim.model.spring.lateral_shape`)."""
    t = y * per_scale
    s = 1.0 + t * t
    per_s = 1.0 / s
    return y * y * per_s, 2.0 * y * per_s * per_s, 2.0 * (4.0 - 3.0 * s) * per_s * per_s * per_s


@compiled
def look_ahead(w: Any, ahead: float, extra: int) -> None:
    """Guess the bellows ``ahead`` s after the start of the step, and sum what all dash-pots of the rubber pull."""
    lanes = w.shape[0] // PER_LANE
    for i in range(lanes):
        ratio_1, ratio_2, ratio_3 = w[Lane.RATIO + i], w[Lane.RATIO_2 + i], w[Lane.RATIO_3 + i]
        speed_1, speed_2, speed_3 = w[Lane.SPEED + i], w[Lane.SPEED_2 + i], w[Lane.SPEED_3 + i]
        a = ratio_1 * w[STAGE + LaneState.DASHPOT_Z + i]
        b = ratio_2 * w[STAGE + LaneState.DASHPOT_Z_2 + i]
        c = ratio_3 * w[STAGE + LaneState.DASHPOT_Z_3 + i]
        w[Lane.PULL_Z + i] = a + b + c
        w[Lane.RATE_Z + i] = a * speed_1 + b * speed_2 + c * speed_3
        a = ratio_1 * w[STAGE + LaneState.DASHPOT_Y + i]
        b = ratio_2 * w[STAGE + LaneState.DASHPOT_Y_2 + i]
        c = ratio_3 * w[STAGE + LaneState.DASHPOT_Y_3 + i]
        w[Lane.PULL_Y + i] = a + b + c
        w[Lane.RATE_Y + i] = a * speed_1 + b * speed_2 + c * speed_3
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
            z = k * w[STAGE + LaneState.EXTRA + 2 * LANES * e + i]
            y = k * w[STAGE + LaneState.EXTRA + 2 * LANES * e + LANES + i]
            rate = w[EXTRA_SPEED + LANES * e + i]
            w[Lane.PULL_Z + i] += z
            w[Lane.PULL_Y + i] += y
            w[Lane.RATE_Z + i] += z * rate
            w[Lane.RATE_Y + i] += y * rate


@compiled
def extra_friction(w: Any, e: int) -> None:
    """Force and tangent stiffness of one extra friction element, where Newton's method goes next."""
    first = LANES * e
    for i in range(LANES):
        limit = w[EXTRA_FRICTION + first + i]
        travel = w[EXTRA_TRAVEL + first + i]
        z = w[Lane.TRY_Z + i] + w[Lane.STEP_Z + i] * w[Lane.MOVING + i]
        y = w[Lane.TRY_Y + i] + w[Lane.STEP_Y + i] * w[Lane.MOVING + i]
        f, s = _friction_curve(z - w[Lane.ORIGIN_Z + i], w[EXTRA_LEVEL_Z + first + i], travel)
        w[Lane.MORE_Z + i] = limit * f + (w[Lane.MORE_Z + i] if e > 0 else 0.0)
        w[Lane.STIFFER_Z + i] = limit * s + (w[Lane.STIFFER_Z + i] if e > 0 else 0.0)
        f, s = _friction_curve(y - w[Lane.ORIGIN_Y + i], w[EXTRA_LEVEL_Y + first + i], travel)
        w[Lane.MORE_Y + i] = limit * f + (w[Lane.MORE_Y + i] if e > 0 else 0.0)
        w[Lane.STIFFER_Y + i] = limit * s + (w[Lane.STIFFER_Y + i] if e > 0 else 0.0)


@compiled
def load_bellows(w: Any) -> None:
    """Go on by Newton's step where it has not arrived; pressure, force and tangent stiffness there."""
    for i in range(LANES):
        moving = w[Lane.MOVING + i]
        z = w[Lane.TRY_Z + i] + moving * w[Lane.STEP_Z + i]
        y = w[Lane.TRY_Y + i] + moving * w[Lane.STEP_Y + i]
        w[Lane.TRY_Z + i] = z
        w[Lane.TRY_Y + i] = y
        Y, Y1, Y2 = _lateral_shape(y, w[Lane.PER_TRAVEL + i])
        A1 = w[Lane.A_1 + i]
        kappa_1 = w[Lane.KAPPA_1 + i]
        length = w[Lane.KAPPA_0 + i] + kappa_1 * z
        V = max(w[Lane.V_0 + i] + (w[Lane.A_0 + i] + 0.5 * A1 * z) * z - 0.5 * length * Y, SMALLEST_VOLUME)
        A = w[Lane.A_0 + i] + A1 * z - 0.5 * kappa_1 * Y
        B = -0.5 * length * Y1
        content = (w[Lane.HEAT_RATIO + i] - 1.0) * w[STAGE + LaneState.ENERGY + i]
        V += w[Lane.STRETCH_AT_0 + i]
        p = 2.0 * content / (V + sqrt(V * V + 4.0 * w[Lane.STRETCH + i] * content))
        gauge = p - w[Lane.ATMOSPHERE + i]
        k_z = w[Lane.SHELL_Z + i]
        k_y = w[Lane.SHELL_Y + i]
        ratios = w[Lane.RATIOS + i]
        turn_z, turn_y = w[Lane.ORIGIN_Z + i], w[Lane.ORIGIN_Y + i]
        f_z, slope_z = _friction_curve(z - turn_z, w[Lane.LEVEL_Z + i], w[Lane.FRICTION_Z_TRAVEL + i])
        f_y, slope_y = _friction_curve(y - turn_y, w[Lane.LEVEL_Y + i], w[Lane.FRICTION_Y_TRAVEL + i])
        pressed = max(gauge, 0.0)
        limit_z = w[Lane.FRICTION_Z + i] + w[Lane.FRICTION_Z_SLOPE + i] * pressed
        limit_y = w[Lane.FRICTION_Y + i] + w[Lane.FRICTION_Y_SLOPE + i] * pressed
        grip = 1.0 if gauge > 0.0 else 0.0
        contact = max(w[Lane.CONTACT_HEIGHT + i] - z, 0.0)
        K_contact = w[Lane.CONTACT_STIFFNESS + i] if contact > 0.0 else 0.0
        cross = -0.5 * kappa_1 * Y1 * gauge
        F_z = (
            gauge * A
            - k_z * (z + ratios * z - w[Lane.PULL_Z + i])
            - w[Lane.MORE_Z + i]
            - limit_z * f_z
            + K_contact * contact
        )
        F_y = gauge * B - k_y * (y + ratios * y - w[Lane.PULL_Y + i]) - w[Lane.MORE_Y + i] - limit_y * f_y
        K_zz = gauge * A1 - k_z * (1.0 + ratios) - w[Lane.STIFFER_Z + i] - limit_z * slope_z - K_contact
        K_yy = -0.5 * gauge * length * Y2 - k_y * (1.0 + ratios) - w[Lane.STIFFER_Y + i] - limit_y * slope_y
        w[Lane.VOLUME + i] = V + w[Lane.STRETCH + i] * p
        w[Lane.AREA + i] = A
        w[Lane.LATERAL_AREA + i] = B
        w[Lane.PRESSURE + i] = p
        w[Lane.CONTACT + i] = contact
        w[Lane.STACK_Z + i] = F_z
        w[Lane.STACK_Y + i] = F_y
        w[Lane.STIFFNESS_ZZ + i] = K_zz
        w[Lane.STIFFNESS_ZY + i] = cross
        w[Lane.STIFFNESS_YY + i] = K_yy
        w[Lane.Z_PER_PRESSURE + i] = A - grip * w[Lane.FRICTION_Z_SLOPE + i] * f_z
        w[Lane.Y_PER_PRESSURE + i] = B - grip * w[Lane.FRICTION_Y_SLOPE + i] * f_y


@compiled
def seek(w: Any) -> int:
    """Newton's next step towards ζ_b − (F_z−P)/k_z = ζ and y_b − F_y/k_y = y; how many lanes have not arrived."""
    left = 0
    for i in range(LANES):
        moving = w[Lane.MOVING + i]
        z = w[Lane.TRY_Z + i]
        y = w[Lane.TRY_Y + i]
        V = w[Lane.VOLUME + i]
        A = w[Lane.AREA + i]
        B = w[Lane.LATERAL_AREA + i]
        p = w[Lane.PRESSURE + i]
        F_z = w[Lane.STACK_Z + i]
        F_y = w[Lane.STACK_Y + i]
        cross = w[Lane.STIFFNESS_ZY + i]
        per_z = w[Lane.Z_PER_PRESSURE + i]
        per_y = w[Lane.Y_PER_PRESSURE + i]
        c_z = w[Lane.GIVE_Z + i]
        c_y = w[Lane.GIVE_Y + i]
        p_V = p / (V + w[Lane.STRETCH + i] * p)
        miss_z = w[Lane.HEIGHT + i] + w[STAGE + LaneState.CREEP + i] - z + c_z * (F_z - w[Lane.PRELOAD + i])
        miss_y = w[Lane.LATERAL + i] - y + c_y * F_y
        a = 1.0 - c_z * (w[Lane.STIFFNESS_ZZ + i] - per_z * p_V * A)
        bb = -c_z * (cross - per_z * p_V * B)
        c = -c_y * (cross - per_y * p_V * A)
        d = 1.0 - c_y * (w[Lane.STIFFNESS_YY + i] - per_y * p_V * B)
        inverse = 1.0 / (a * d - bb * c)
        step_z = min(max((d * miss_z - bb * miss_y) * inverse, -_LONGEST_STEP), _LONGEST_STEP)
        step_y = min(max((a * miss_y - c * miss_z) * inverse, -_LONGEST_STEP), _LONGEST_STEP)
        go = moving if abs(step_z) + abs(step_y) >= _CLOSE else 0.0
        left += 1 if go > 0.0 else 0
        w[Lane.MOVING + i] = go
        w[Lane.STEP_Z + i] = step_z
        w[Lane.STEP_Y + i] = step_y
    return left


@compiled
def carry_over(w: Any) -> None:
    """Move the loads by Newton's last step along their tangents, and look at the gas."""
    for i in range(LANES):
        z = w[Lane.STEP_Z + i]
        y = w[Lane.STEP_Y + i]
        p = w[Lane.PRESSURE + i]
        V = w[Lane.VOLUME + i]
        C = w[Lane.STRETCH + i]
        cross = w[Lane.STIFFNESS_ZY + i]
        dV = w[Lane.AREA + i] * z + w[Lane.LATERAL_AREA + i] * y
        dp = -p / (V + C * p) * dV
        w[Lane.STACK_Z + i] += w[Lane.STIFFNESS_ZZ + i] * z + cross * y + w[Lane.Z_PER_PRESSURE + i] * dp
        w[Lane.STACK_Y + i] += cross * z + w[Lane.STIFFNESS_YY + i] * y + w[Lane.Y_PER_PRESSURE + i] * dp
        w[Lane.VOLUME + i] = V + dV + C * dp
        w[Lane.PRESSURE + i] = p + dp
        w[Lane.AREA + i] += w[Lane.A_1 + i] * z
        w[Lane.BELLOWS_Z + i] = w[Lane.TRY_Z + i] + z
        w[Lane.BELLOWS_Y + i] = w[Lane.TRY_Y + i] + y
        R = w[Lane.GAS_CONSTANT + i]
        g = w[Lane.HEAT_RATIO + i] - 1.0
        w[Lane.TEMPERATURE + i] = g * w[STAGE + LaneState.ENERGY + i] / (w[STAGE + LaneState.MASS + i] * R)
        w[Lane.AUXILIARY_TEMPERATURE + i] = (
            g * w[STAGE + LaneState.AUXILIARY_ENERGY + i] / (w[STAGE + LaneState.AUXILIARY_MASS + i] * R)
        )
        w[Lane.AUXILIARY_PRESSURE + i] = (
            g * w[STAGE + LaneState.AUXILIARY_ENERGY + i] / w[Lane.AUXILIARY_VOLUME + i]
        )


@compiled
def lane_algebra(w: Any, ahead: float, extra: int, frictions: int) -> None:
    """The bellows' share of the deflection, ``ahead`` s after the start of the step, its loads, and all gas.

    ``extra`` branches and ``frictions`` elements are as many as the lane with most of them has.
    """
    look_ahead(w, ahead, extra)
    for _ in range(_ITERATIONS):
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
