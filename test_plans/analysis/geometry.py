"""Positions of the actuators for a pose, and displacements and forces of the springs from readings.

Bolster and platform turn about their own axes, φ_B and φ_P. The shear of the springs is ``y = y_B + e φ_B − y_P + h
φ_P`` and their roll ``θ = φ_B − φ_P``. The travel at the bump stop is ``y_B − y_P``. If bolster and platform tilt
together, the springs can shear further than the bump stop permits for the bolster alone.

``rig`` gives the dimensions (SI) by their names, as a `description.Description` does.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import copysign, pi, tau
from typing import Any, Final

import numpy as np

from bench_protocol.dimensions import across
from bench_protocol.geometry import STOP_ROOM
from bench_protocol.words import SIDES
from test_plans.analysis import Samples

Rig = Mapping[str, float]

#: Dimensions that this module needs.
WEIGHT: Final = ("bolster_mass", "gravity")
LASERS: Final = tuple(across(f"{side}.height") for side in SIDES)
ACTUATORS: Final = tuple(across(f"vertical_{side}") for side in SIDES)
HEIGHTS_ABOVE: Final = ("centre_height", "lateral_actuator_height", "column_height")
#: Dimensions to measure and to set the pose of the springs.
SEEING: Final = (*LASERS, *HEIGHTS_ABOVE, "lateral_frame_stiffness")
PLACING: Final = (*SEEING, *ACTUATORS, "stop_gap")


def bolster_weight(rig: Rig) -> float:
    """Return the weight of the bolster (N). Either the actuators carry it, or both springs carry it as a part of their
    preload.
    """
    return rig["bolster_mass"] * rig["gravity"]


def stop_travel_max(rig: Rig) -> float:
    """Return the largest travel (m) of the bolster toward the bump stop that a pose may use."""
    return rig["stop_gap"] - STOP_ROOM


@dataclass(frozen=True, slots=True)
class Pose:
    """Positions of bolster and platform (m, rad), zero when both are level and in the middle."""

    lateral: float  #: displacement of the lateral actuator
    bolster_roll: float
    platform_roll: float


def pose(rig: Rig, shear: float, roll: float = 0.0) -> Pose:
    """Return a pose that shears the springs by ``shear`` (m) and rolls them by ``roll`` (rad), and does not reach the
    bump stop.
    """
    centre = rig["centre_height"]
    travel = copysign(min(abs(shear), stop_travel_max(rig)), shear)
    platform = (shear - travel - centre * roll) / (centre + rig["column_height"])
    bolster = platform + roll
    return Pose(travel - rig["lateral_actuator_height"] * bolster, bolster, platform)


def lifted(rig: Rig, roll: float) -> dict[str, float]:
    """Return by actuator the upward travel (m) of each vertical actuator when the bolster rolls by ``roll`` (rad)."""
    return {f"vertical_{side}": rig[across(f"vertical_{side}")] * roll for side in SIDES}


#: Signals that determine the shear and roll of the springs.
POSE_SIGNALS: Final = (
    *(f"{side}.height" for side in SIDES),
    "lateral.displacement",
    "lateral.force",
    "platform.roll",
)


def roll_of(values: Mapping[str, Any], rig: Rig) -> Samples:
    """Return the roll θ of the bolster against the platform (rad), from the lasers."""
    left, right = (rig[one] for one in LASERS)
    return np.asarray((values["left.height"] - values["right.height"]) / (left - right))


def height_of_spring(values: Mapping[str, Samples], rig: Rig, side: str) -> Samples:
    """Return the height of a spring (m), from the reading of its laser and the roll."""
    return height_at(values, rig, side, rig["spring_half_spacing"] * (1.0 if side == "left" else -1.0))


def height_at(values: Mapping[str, Samples], rig: Rig, side: str, place: float) -> Samples:
    """Return the height (m) that the laser of a side would measure at another ``place`` (m to the left of the
    middle).
    """
    reading, offset = values[f"{side}.height"], place - rig[across(f"{side}.height")]
    both = all(f"{one}.height" in values for one in SIDES)
    return reading + offset * roll_of(values, rig) if offset and both else reading


def shear_of(values: Mapping[str, Any], rig: Rig) -> Samples:
    """Return the lateral displacement y (m) of the top plates relative to the platform, corrected for the deflection of
    the frame.
    """
    bolster_roll = roll_of(values, rig) + values["platform.roll"]
    pinned = values["lateral.displacement"] - values["lateral.force"] / rig["lateral_frame_stiffness"]
    return np.asarray(
        pinned
        + (rig["centre_height"] + rig["lateral_actuator_height"]) * bolster_roll
        + rig["column_height"] * values["platform.roll"]
    )


def stop_travel_of(values: Mapping[str, Any], rig: Rig) -> Samples:
    """Return the displacement at the bump stop: y_B − y_P (m)."""
    return shear_of(values, rig) - (
        rig["centre_height"] * (roll_of(values, rig) + values["platform.roll"])
        + rig["column_height"] * values["platform.roll"]
    )


def share_of_spring(rig: Rig, side: str, force: float, moment: float) -> float:
    """Return the force on one spring under a ``force`` with a ``moment``: F = F_z/2 ± M_x/(2b)."""
    return 0.5 * force + (0.5 if side == "left" else -0.5) * moment / rig["spring_half_spacing"]


def pressed_on(values: Mapping[str, Samples], rig: Rig, side: str) -> Samples:
    """Return the force of the vertical actuators on one spring (N, downward), without the bolster's weight."""
    shares = {one: share_of_spring(rig, side, 1.0, rig[across(f"vertical_{one}")]) for one in SIDES}
    return np.asarray(sum(share * values[f"vertical_{one}.force"] for one, share in shares.items() if share))


def actuator_moment(values: Mapping[str, Samples], rig: Rig) -> Samples:
    """Return the moment of the vertical actuators against the roll (N·m)."""
    return np.asarray(
        -sum(rig[across(f"vertical_{side}")] * values[f"vertical_{side}.force"] for side in SIDES)
    )


@dataclass(frozen=True, slots=True)
class Drive:
    """The load of one actuator (or a pair), and the transmission between actuator and load, from data sheets."""

    mass: float  #: kg per actuator
    frame: float  #: N/m
    frame_damping: float  #: N·s/m
    stiffness: float  #: N/m of the springs, per actuator; an upper bound
    loop_frequency: float  #: Hz, of the closed loop
    loop_damping: float
    speed: float  #: m/s

    def command(self, amplitude: float, frequency: float, force: float) -> float:
        """Return the command amplitude (m) that moves the bolster by ``amplitude``, or as far as possible.

        ``force`` (N) is the actuator force that is available for the motion. At 25 Hz the piston reaches 0.7 of its
        command, and the resonance of the frame amplifies the motion of the bolster. The result is corrected for both.
        """
        omega = tau * frequency
        frame = complex(self.frame, omega * self.frame_damping)
        needed = abs(complex(self.stiffness - self.mass * omega**2, 0.0))
        amplitude = min(amplitude, force / max(needed, self.stiffness))
        r = frequency / self.loop_frequency
        loop = 1 / abs(complex(1 - r**2, 2 * self.loop_damping * r))
        bolster = abs(frame / (frame + self.stiffness - self.mass * omega**2))
        return float(min(amplitude / (loop * bolster), 0.9 * self.speed / (2 * pi * frequency)))


#: Dimensions that a `drive` needs.
DRIVEN: Final = (
    *WEIGHT,
    *(f"{way}_frame_{what}" for way in ("vertical", "lateral") for what in ("stiffness", "damping")),
    "actuator_frequency",
    "actuator_damping",
    "actuator_speed",
    "vertical_force_max",
    "lateral_force_max",
)


def drive(rig: Rig, way: str, stiffness: float) -> Drive:
    """Return the `Drive` of an actuator, ``vertical`` (one of two) or ``lateral``, for springs of ``stiffness``
    (N/m).
    """
    return Drive(
        rig["bolster_mass"] / (2 if way == "vertical" else 1),
        rig[f"{way}_frame_stiffness"],
        rig[f"{way}_frame_damping"],
        stiffness,
        rig["actuator_frequency"],
        rig["actuator_damping"],
        rig["actuator_speed"],
    )
