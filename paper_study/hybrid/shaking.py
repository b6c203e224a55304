"""A motion that dies away: it shakes friction out of springs, and tells how late a bench follows."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, pi, sin
from typing import TYPE_CHECKING, Final

from bench_protocol.units import Hz, mm, mrad, s
from paper_study.hybrid.agreement import ROLLED, UP, followed
from paper_study.hybrid.car import STEP, Place, Springs
from paper_study.hybrid.coupling import Delay, move_on

if TYPE_CHECKING:
    from test_plans.run import Run

#: How far and how fast springs are moved sideways, up and down and in roll: from well beyond what saturates friction,
#: each at a frequency of its own.
SIZES: Final = (8 * mm, 8 * mm, 3 * mrad)
FREQUENCIES: Final = (1.1 * Hz, 1.5 * Hz, 1.9 * Hz)
RISES: Final = 1 * s
FADES: Final = 4 * s
LASTS: Final = 20 * s


@dataclass(slots=True)
class Shake:
    """Three sines at once that rise, and die away."""

    time: float = 0.0

    def place_at(self, ahead: float) -> Place:
        """Return how the springs will stand ``ahead`` s from now."""
        t = min(max(self.time + ahead, 0.0), LASTS)
        share = min(t / RISES, 1.0) * exp(-t / FADES) * (1.0 - t / LASTS)
        return Place(
            *(share * size * sin(2.0 * pi * f * t) for size, f in zip(SIZES, FREQUENCIES, strict=True))
        )

    def step(self, springs: Springs) -> None:
        """Go on, whatever the springs do."""
        self.time += STEP


def shake_loose(run: Run) -> Delay:
    """Move the springs, less and less, so that no friction holds them; return how late they came."""
    foreseen = Delay.foreseen(run.rig)
    with run.phase("shake loose"):
        course = move_on(run, Shake(), foreseen, LASTS)
        hold = course.held(RISES, FADES)
        ways = followed(*course.places(run.rig, RISES, LASTS), hold, run.rig)
        found = foreseen.after(ways[ROLLED].late, ways[UP].late, hold, run.rig)
        late = f"pistons are {1e3 * found.pistons:.1f} ms late, the platform {1e3 * found.platform:.1f} ms"
        run.say(f"{late}, and readings come every {1e3 * hold:.0f} ms")
    return found
