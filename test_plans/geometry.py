"""The bench's dimensions from its drawing: where to put its actuators, and what its readings say about the springs.

Bolster and platform turn about their own axes, φ_B and φ_P. The springs are sheared by
``y = y_B + e φ_B − y_P + h φ_P`` and rolled by ``θ = φ_B − φ_P``; the bump stop looks at ``y_B − y_P`` alone. Bolster
and platform tilted together shear the springs further than the bump stop would let the bolster go by itself.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import copysign, pi, tau
from typing import Final

import numpy as np

from bench_protocol.units import MN, Hz, kN, m, mm, s
from bench_protocol.words import SIDES
from test_plans.analysis import Samples

#: The bolster hangs on the actuators or rests on both springs: its weight is part of the preload.
BOLSTER_MASS: Final = 1200.0
GRAVITY: Final = 9.80665
BOLSTER_WEIGHT: Final = BOLSTER_MASS * GRAVITY
#: b: from the middle of the bench to each spring.
SPRING_HALF_SPACING: Final = 1.0 * m
#: e: the bolster's centre of gravity above the top plates; h_a: the lateral actuator above that; h: height of a spring.
CENTRE_HEIGHT: Final = 0.25 * m
LATERAL_ACTUATOR_HEIGHT: Final = 0.35 * m
COLUMN_HEIGHT: Final = 0.20 * m
#: The bump stop begins at 25 mm; poses leave room for a sine of 5 mm.
BUMP_STOP_GAP: Final = 25 * mm
STOP_TRAVEL_MAX: Final = 18 * mm

#: Data sheets: frame and oil between piston and bolster, and the closed loop of each actuator.
VERTICAL_FRAME: Final = 100 * MN / m
LATERAL_FRAME: Final = 40 * MN / m
VERTICAL_FRAME_DAMPING: Final = 50 * kN * s / m
LATERAL_FRAME_DAMPING: Final = 25 * kN * s / m
LOOP_FREQUENCY: Final = 25 * Hz
LOOP_DAMPING: Final = 0.7
SPEED_MAX: Final = 0.6 * m / s
#: Limits of the bench at which it holds by itself, with some room.
VERTICAL_FORCE_MAX: Final = 180 * kN
LATERAL_FORCE_MAX: Final = 25 * kN


@dataclass(frozen=True, slots=True)
class Pose:
    """Where bolster and platform stand (m, rad), seen from bolster and platform level and in the middle."""

    lateral: float  #: displacement of the lateral actuator
    bolster_roll: float
    platform_roll: float


def pose(shear: float, roll: float = 0.0) -> Pose:
    """Return how the springs are sheared by ``shear`` (m) and rolled by ``roll`` (rad) clear of the bump stop."""
    travel = copysign(min(abs(shear), STOP_TRAVEL_MAX), shear)
    platform = (shear - travel - CENTRE_HEIGHT * roll) / (CENTRE_HEIGHT + COLUMN_HEIGHT)
    bolster = platform + roll
    return Pose(travel - LATERAL_ACTUATOR_HEIGHT * bolster, bolster, platform)


#: What has to be read to know how the springs are sheared and rolled.
POSE_SIGNALS: Final = (
    *(f"{side}.height" for side in SIDES),
    "lateral.displacement",
    "lateral.force",
    "platform.roll",
)


def roll_of(values: Mapping[str, Samples]) -> Samples:
    """Roll θ of the bolster against the platform (rad), from the lasers."""
    return np.asarray((values["left.height"] - values["right.height"]) / (2 * SPRING_HALF_SPACING))


def shear_of(values: Mapping[str, Samples]) -> Samples:
    """Lateral displacement y of the top plates against the platform (m); the frame gives way by its force."""
    bolster_roll = roll_of(values) + values["platform.roll"]
    pinned = values["lateral.displacement"] - values["lateral.force"] / LATERAL_FRAME
    return np.asarray(
        pinned
        + (CENTRE_HEIGHT + LATERAL_ACTUATOR_HEIGHT) * bolster_roll
        + COLUMN_HEIGHT * values["platform.roll"]
    )


def stop_travel_of(values: Mapping[str, Samples]) -> Samples:
    """What the bump stop sees of it: y_B − y_P (m)."""
    return shear_of(values) - (
        CENTRE_HEIGHT * (roll_of(values) + values["platform.roll"]) + COLUMN_HEIGHT * values["platform.roll"]
    )


@dataclass(frozen=True, slots=True)
class Drive:
    """What one actuator (or a pair of them) moves, and what stands between: all from the data sheets."""

    mass: float  #: kg per actuator
    frame: float  #: N/m
    frame_damping: float  #: N·s/m
    stiffness: float  #: N/m of the springs, per actuator; an upper bound

    def command(self, amplitude: float, frequency: float, force: float) -> float:
        """Return the amplitude (m) to ask for so that the bolster moves by ``amplitude``, or by as much as it can.

        ``force`` (N) is what the actuator has left for it. At 25 Hz the piston follows with 0.7 of its command, and
        the bolster on the frame answers with more: both are undone here.
        """
        omega = tau * frequency
        frame = complex(self.frame, omega * self.frame_damping)
        needed = abs(complex(self.stiffness - self.mass * omega**2, 0.0))
        amplitude = min(amplitude, force / max(needed, self.stiffness))
        r = frequency / LOOP_FREQUENCY
        loop = 1 / abs(complex(1 - r**2, 2 * LOOP_DAMPING * r))
        bolster = abs(frame / (frame + self.stiffness - self.mass * omega**2))
        return float(min(amplitude / (loop * bolster), 0.9 * SPEED_MAX / (2 * pi * frequency)))


LATERAL_DRIVE: Final = Drive(BOLSTER_MASS, LATERAL_FRAME, LATERAL_FRAME_DAMPING, 0.6 * MN / m)
