"""What moves springs on a bench and what tells of them: from their place to set-points, from load cells to their force.

``rig`` gives the dimensions (SI) by the names of `bench_protocol.dimensions`. A rig with a car in its tick and a host
that computes the car do both alike.
"""

from collections.abc import Mapping
from math import sqrt
from typing import Final, NamedTuple

from bench_protocol.dimensions import across, direction, place
from bench_protocol.units import mm
from bench_protocol.words import SIDES

Rig = Mapping[str, float]


class Springs(NamedTuple):
    """What both springs do to what they carry, beyond that (N, N, N·m about the middle of their top plates)."""

    lateral: float
    vertical: float
    moment: float


class Place(NamedTuple):
    """How the springs stand (m, m, rad): sheared, lengthened, rolled."""

    shear: float
    height: float
    roll: float


#: What is left of the way to the bench's own bump stop, for a sine of 5 mm.
STOP_ROOM: Final = 7 * mm
#: Shear up to which bolster and platform are moved so that the bench's own bump stop is not met: in proportion, so that
#: nothing has a corner.
SHEAR_MAX: Final = 80 * mm
#: What springs do that stand where they rest.
STILL: Final = Springs(0.0, 0.0, 0.0)


def column_of(rig: Rig, cell: str) -> tuple[float, ...]:
    """Return what one newton on a ``cell`` says of force and moment on the bolster: its column of the wrench.

    Along x ahead, y to the left and z up, and about them through the middle between the springs' top plates, where a
    force that the springs oppose to a shear makes no moment of its own: w = Σ (d_k, r_k × d_k) f_k; moments in m.
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


def setpoints_of(at: Place, rig: Rig, springs: Springs = STILL) -> dict[str, float]:
    """Return where bolster and platform have to be for the springs to stand so, by the names of the set-points.

    From where they are level; of what is asked it is linear. Frame and oil between piston and bolster give way to what
    the ``springs`` do beyond where they rest.
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
    """Return by how much further each piston has to go (m), for what stands behind it gives way."""
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
