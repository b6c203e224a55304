"""Geometry of a bench: from the pose of the springs to set-points, and from load cells to the force of the springs.

``rig`` has the dimensions (SI) by the names of `bench_protocol.dimensions`. A rig with a car in its tick and a host
that computes the car use the same functions.
"""

from collections.abc import Mapping
from math import sqrt
from typing import Final, NamedTuple

from bench_protocol.dimensions import across, direction, place
from bench_protocol.units import mm
from bench_protocol.words import SIDES

Rig = Mapping[str, float]


class Springs(NamedTuple):
    """Change of the load of both springs on the body above (N, N, N·m about the middle of their top plates)."""

    lateral: float
    vertical: float
    moment: float


class SpringPose(NamedTuple):
    """The pose of the springs (m, m, rad): shear, change of height, roll."""

    shear: float
    height: float
    roll: float


#: Remaining travel to the bench's own bump stop, for a sine of 5 mm.
STOP_ROOM: Final = 7 * mm
#: Shear up to which the bench's own bump stop is avoided. Bolster and platform share the shear in proportion, so that
#: the motion has no kink.
SHEAR_MAX: Final = 80 * mm
#: Load of springs at rest.
STILL: Final = Springs(0.0, 0.0, 0.0)


def column_of(rig: Rig, cell: str) -> tuple[float, ...]:
    """Return the force and the moment on the bolster for one newton on a ``cell``, as six numbers (1, 1, 1, m, m, m).

    Axes: x ahead, y to the left, z up, through the middle between the springs' top plates. About this point, the
    reaction of the springs to a shear has no moment: w = Σ (d_k, r_k × d_k) f_k; moments per force in m.
    """
    x, y, z = (rig[name] for name in place(cell))
    d_x, d_y, d_z = pointing(rig, cell)
    z -= rig["column_height"]
    return d_x, d_y, d_z, y * d_z - z * d_y, z * d_x - x * d_z, x * d_y - y * d_x


def pointing(rig: Rig, cell: str) -> tuple[float, float, float]:
    """Return the direction of a ``cell``, a unit vector ahead, to the left and up."""
    ahead, left, up = direction(cell)
    d_x, d_y, d_z = rig[ahead], rig[left], rig[up]
    size = sqrt(d_x**2 + d_y**2 + d_z**2)
    return d_x / size, d_y / size, d_z / size


def setpoints_of(at: SpringPose, rig: Rig, springs: Springs = STILL) -> dict[str, float]:
    """Return the set-points of bolster and platform for a pose of the springs, by their names.

    The set-points are relative to the level position and linear in the pose. Frame and oil between piston and bolster
    are compliant, so the set-points also compensate for the deflection by the change of load ``springs``.
    """
    share = (rig["stop_gap"] - STOP_ROOM) / SHEAR_MAX
    platform = ((1.0 - share) * at.shear - rig["centre_height"] * at.roll) / (
        rig["centre_height"] + rig["column_height"]
    )
    bolster = platform + at.roll
    given = _given_way(springs, rig)
    return {
        "lateral.displacement_setpoint": share * at.shear
        - rig["lateral_actuator_height"] * bolster
        + given["lateral"],
        "platform.roll_setpoint": platform,
        **{
            f"vertical_{side}.displacement_setpoint": at.height
            + rig[across(f"vertical_{side}")] * bolster
            + given[f"vertical_{side}"]
            for side in SIDES
        },
    }


def _given_way(springs: Springs, rig: Rig) -> dict[str, float]:
    """Return the additional travel of each piston (m) that compensates for the compliance behind it."""
    left, right = (rig[across(f"vertical_{side}")] for side in SIDES)
    above = rig["centre_height"] + rig["lateral_actuator_height"]
    moment = -springs.moment - above * springs.lateral
    up = (moment + right * springs.vertical) / (left - right)
    frame = rig["vertical_frame_stiffness"]
    return {
        "lateral": -springs.lateral / rig["lateral_frame_stiffness"],
        "vertical_left": up / frame,
        "vertical_right": (-springs.vertical - up) / frame,
    }
