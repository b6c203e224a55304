"""The bolster with three degrees of freedom, its lateral bump stop, and the vibration platform under the springs."""

from math import pi
from typing import Any

from bench_sim.model.algebraic import Algebraic
from bench_sim.model.compiled import compiled
from bench_sim.model.layout import BUMP_POINTS, Input, State


@compiled
def bump_stop_force(displacement: float, par: Any) -> float:
    """Return the restoring force on the bolster in N. The table is interpolated linearly, and extrapolated beyond its
    last point.
    """
    travel = abs(displacement)
    if travel <= par.bump_stop_travel[0]:
        return 0.0
    k = 1
    while k < BUMP_POINTS - 1 and travel > par.bump_stop_travel[k]:
        k += 1
    left = par.bump_stop_travel[k - 1]
    low = par.bump_stop_force[k - 1]
    slope = (par.bump_stop_force[k] - low) / (par.bump_stop_travel[k] - left)
    force = low + slope * (travel - left)
    return -force if displacement > 0.0 else force


@compiled
def extra_stop_force(displacement: float, par: Any) -> float:
    """Return the restoring force of a second lateral stop in N. It is linear beyond its gap."""
    reach = max(abs(displacement) - par.extra_stop_gap, 0.0)
    return (-1.0 if displacement > 0.0 else 1.0) * par.extra_stop_stiffness * reach


@compiled
def stop_force(displacement: float, par: Any) -> float:
    """Return the restoring force of all lateral stops on the bolster in N."""
    if par.extra_stop_stiffness == 0.0:
        return bump_stop_force(displacement, par)
    return bump_stop_force(displacement, par) + extra_stop_force(displacement, par)


@compiled
def felt_acceleration(roll: float, lateral: float, vertical: float, angular: float, par: Any) -> float:
    """Return ÿ + (g + z̈)φ − h_m φ̈ in m/s²: the reading of a lateral accelerometer at h_m above the bolster's
    centre.

    An accelerometer measures its own acceleration minus the acceleration of gravity. Its axis rolls with the bolster.
    If the left side of the bolster is higher, gravity appears as an acceleration to the left, and points above the
    centre move to the right.
    """
    return lateral + (par.gravity + vertical) * roll - par.accelerometer_height * angular


@compiled
def bolster_term(x: Any, par: Any, out: Any, dx: Any) -> None:
    """Convert the sums of forces (N) in ``dx`` to accelerations of the bolster. Springs and actuators have added them
    before.

    m z̈ = ΣF_z − ΣF_act − m g;  m ÿ = ΣF_y + F_act + F_bs;  J φ̈ = Σ moments.
    """
    bump = stop_force(x[State.BOLSTER_LATERAL] - x[State.PLATFORM_LATERAL], par)
    out[Algebraic.BUMP_STOP] = bump
    dx[State.BOLSTER_LATERAL_SPEED] = (dx[State.BOLSTER_LATERAL_SPEED] + bump) / par.bolster_mass
    dx[State.BOLSTER_VERTICAL_SPEED] = dx[State.BOLSTER_VERTICAL_SPEED] / par.bolster_mass - par.gravity
    dx[State.BOLSTER_ROLL_SPEED] /= par.bolster_inertia
    out[Algebraic.LATERAL_ACCELERATION] = dx[State.BOLSTER_LATERAL_SPEED]
    out[Algebraic.ACCELEROMETER] = felt_acceleration(
        x[State.BOLSTER_ROLL],
        dx[State.BOLSTER_LATERAL_SPEED],
        dx[State.BOLSTER_VERTICAL_SPEED],
        dx[State.BOLSTER_ROLL_SPEED],
        par,
    )
    for k in range(3):
        dx[State.BOLSTER_LATERAL + k] += x[State.BOLSTER_LATERAL_SPEED + k]


@compiled
def platform_term(x: Any, u: Any, par: Any, out: Any, dx: Any) -> None:
    """Add the motion of the platform to the derivatives. It follows its commands with second order, and no load
    affects it.
    """
    omega = 2.0 * pi * par.platform_frequency
    for k in range(3):
        if k == 0:
            command = u[Input.PLATFORM_LATERAL]
        elif k == 1:
            command = u[Input.PLATFORM_VERTICAL]
        else:
            command = u[Input.PLATFORM_ROLL]
        speed = x[State.PLATFORM_LATERAL_SPEED + k]
        dx[State.PLATFORM_LATERAL + k] += speed
        dx[State.PLATFORM_LATERAL_SPEED + k] += omega * (
            omega * (command - x[State.PLATFORM_LATERAL + k]) - 2.0 * par.platform_damping * speed
        )
    for k in range(2):
        out[Algebraic.PLATFORM_ACCELERATION + k] = dx[State.PLATFORM_LATERAL_SPEED + k]
