"""A decaying motion that removes friction from the springs, and measures the delay of a bench."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, pi, sin
from typing import TYPE_CHECKING, Final

import numpy as np

from astb_studies.paper.hybrid.agreement import ROLLED, UP, WAYS, followed
from astb_studies.paper.hybrid.car import STEP
from astb_studies.paper.hybrid.coupling import Delay, move_on
from bench_protocol.geometry import SpringPose, Springs
from bench_protocol.units import Hz, mm, mrad, s

if TYPE_CHECKING:
    from test_plans.run import Run

#: Amplitudes of the springs sideways, up and down and in roll, one after the other: well above the saturation of
#: friction. The frequency is that of the track, so that the measured delay includes the error of the prediction.
SIZES: Final = (8 * mm, 8 * mm, 4 * mrad)
FREQUENCY: Final = 1.2 * Hz
RISES: Final = 1 * s
FADES: Final = 2 * s
EACH: Final = 10 * s
LASTS: Final = len(SIZES) * EACH


@dataclass(slots=True)
class Shake:
    """A sine with rise and decay, in one direction after the other."""

    time: float = 0.0

    def place_at(self, ahead: float) -> SpringPose:
        """Return the place of the springs ``ahead`` s from now, predicted from speed and acceleration as for a car."""
        before, now, after = (np.array(self._position(self.time + way * STEP)) for way in (-1, 0, 1))
        speed, acceleration = (after - before) / (2.0 * STEP), (after - 2.0 * now + before) / STEP**2
        return SpringPose(*(now + ahead * speed + 0.5 * ahead**2 * acceleration).tolist())

    @staticmethod
    def _position(time: float) -> list[float]:
        way, t = divmod(min(max(time, 0.0), LASTS), EACH)
        share = min(t / RISES, 1.0) * exp(-t / FADES) * (1.0 - t / EACH)
        moved = share * sin(2.0 * pi * FREQUENCY * t)
        return [size * moved if k == way else 0.0 for k, size in enumerate(SIZES)]

    def step(self, springs: Springs) -> None:
        """Advance one `STEP`; the forces of the springs have no effect."""
        self.time += STEP


def shake_loose(run: Run) -> Delay:
    """Move the springs with decreasing amplitude, so that no friction remains; return their delay."""
    foreseen = Delay.foreseen(run.rig)
    with run.phase("shake loose"):
        course = move_on(run, Shake(), foreseen, LASTS)
        hold = course.held(EACH, 2.0 * EACH)
        late = {}
        for k, way in enumerate(WAYS):
            moves = k * EACH + RISES, (k + 1) * EACH
            late[way] = followed(*course.places(run.rig, *moves), hold, run.rig)[way].late
        found = foreseen.after(late[ROLLED], late[UP], hold, run.rig)
        text = f"pistons are {1e3 * found.pistons:.1f} ms late, the platform {1e3 * found.platform:.1f} ms"
        run.say(f"{text}, and readings come every {1e3 * hold:.0f} ms")
    return found
