"""The bolster with three degrees of freedom, its lateral bump stop, and the vibration platform under the springs."""

from math import pi
from typing import Any

from bench_sim.model.algebraic import Algebraic
from bench_sim.model.compiled import compiled
from bench_sim.model.layout import BUMP_POINTS, Input, State


@compiled
def bump_stop_force(displacement: float, par: Any) -> float:
    """Restoring force on the bolster in N: a table, linear between its points and beyond the last one."""
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
    """Restoring force in N of a second lateral stop, linear beyond its gap."""
    reach = max(abs(displacement) - par.extra_stop_gap, 0.0)
    return (-1.0 if displacement > 0.0 else 1.0) * par.extra_stop_stiffness * reach


@compiled
def stop_force(displacement: float, par: Any) -> float:
    """Restoring force of all lateral stops on the bolster in N."""
    if par.extra_stop_stiffness == 0.0:
        return bump_stop_force(displacement, par)
    return bump_stop_force(displacement, par) + extra_stop_force(displacement, par)


@compiled
def felt_acceleration(roll: float, lateral: float, vertical: float, angular: float, par: Any) -> float:
    """Return ÿ + (g + z̈)φ − h_m φ̈ in m/s²: the reading of a lateral accelerometer h_m above the bolster's centre.

    The accelerometer measures its acceleration minus that of gravity, along an axis that rolls with the bolster. When
    the left side is up, this axis points up on the left. Gravity then reads as an acceleration to the left, and points
    above the centre move to the right.
    """
    return lateral + (par.gravity + vertical) * roll - par.accelerometer_height * angular


@compiled
def bolster_term(x: Any, par: Any, out: Any, dx: Any) -> None:
    """Compute the accelerations of the bolster from the forces (N) that springs and actuators added to ``dx``.

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
    """Add the motions of the platform, which follow their commands with second order, independent of the load."""
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
