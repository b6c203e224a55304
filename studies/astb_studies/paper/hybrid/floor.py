"""The comfort of passengers on the floor of the car: checks, limits and their computation."""

from __future__ import annotations

from typing import Final

import numpy as np

from astb_studies.paper.comfort import (
    W_B,
    W_D,
    WINDOW,
    WINDOWS,
    block_percentiles,
    mean_comfort,
    weighted,
    window_rms,
)
from astb_studies.paper.hybrid.agreement import RideResult
from astb_studies.paper.hybrid.car import STEP
from test_plans.analysis import Samples
from test_plans.check_names import CheckName

#: A block of EN 12299: five minutes.
BLOCK: Final = WINDOW * WINDOWS
#: The largest lateral index that is comfortable, and what shakes and leans more than any car should.
COMFORTABLE: Final = 2.0
SHAKE_MOST: Final = 0.5
LEAN_MOST: Final = 0.035
#: All of the time is no more than all of it.
ROUNDED: Final = 1e-6

SHAKES: Final = CheckName(
    "lateral acceleration of the floor, rms",
    "How hard wind and track shake the floor on these springs, about the mean.",
)
COMFORT: Final = CheckName(
    "comfort index N, lateral",
    "Mean comfort by EN 12299: six times the 95th percentile of the 5-s values of five minutes, weighted with W_d.",
)
RISES: Final = CheckName(
    "vertical acceleration of the floor, rms",
    "How hard the track shakes the floor up and down on these springs, about the mean.",
)
COMFORT_UPWARD: Final = CheckName(
    "comfort index N, vertical",
    "Mean comfort by EN 12299, of the vertical acceleration alone, weighted with W_b.",
)
COMFORT_OF_BOTH: Final = CheckName(
    "comfort index N_MV, lateral and vertical",
    "Mean comfort by EN 12299 of both together. Lengthwise a bench has no motion, so a train's is no less.",
)
TOUCHES: Final = CheckName(
    "time on the bump stop",
    "For how much of the time the car leans on its bump stop, which is harder than the springs.",
)
LEANS: Final = CheckName(
    "mean lean", "How far the mean wind leans the car over on springs and anti-roll bar."
)

#: Sample rate at which accelerations are weighted (Hz).
RATE: Final = 1.0 / STEP
#: Checks of the ride itself: check, unit, limits.
JUDGED: Final = (
    (SHAKES, "m/s2", None, SHAKE_MOST),
    (COMFORT, "1", None, COMFORTABLE),
    (RISES, "m/s2", None, SHAKE_MOST),
    (COMFORT_UPWARD, "1", None, COMFORTABLE),
    (COMFORT_OF_BOTH, "1", None, COMFORTABLE),
    (TOUCHES, "%", None, 1.0 + ROUNDED),
    (LEANS, "mrad", None, LEAN_MOST),
)
JUDGED_OF: Final = tuple(name for name, *_ in JUDGED)
#: Checks that are compared with the simulation, by short name.
COMPARED: Final = {
    "acceleration": SHAKES,
    "comfort index": COMFORT,
    "vertical acceleration": RISES,
    "vertical comfort index": COMFORT_UPWARD,
    "mean lean": LEANS,
}
#: An index scatters as the acceleration does of which it is made.
MADE_OF: Final = {COMFORT: SHAKES, COMFORT_UPWARD: RISES}


def finely(samples: Samples, step: float) -> Samples:
    """Interpolate samples every ``step`` s to `RATE`, by cubics through neighbours (Catmull and Rom)."""
    if step <= 1.0 / RATE:
        return samples
    at = np.arange(round(samples.size * step * RATE)) / (RATE * step)
    n = np.minimum(at.astype(int), samples.size - 2)
    x = at - n
    padded = np.concatenate([samples[:1], samples, samples[-1:]])
    a, b, c, d = (padded[n + k] for k in range(4))
    bend = x * (2.0 * a - 5.0 * b + 4.0 * c - d + x * (3.0 * (b - c) + d - a))
    return np.asarray(b + 0.5 * x * (c - a + bend))


def ridden(course: RideResult, since: float, until: float) -> dict[str, float]:
    """Return the results of the floor between two times (s), by check (SI); a comfort index needs a whole block."""
    a, rising, stop, roll = (
        course.of(name, since, until) for name in ("acceleration", "rising", "bump_stop", "roll")
    )
    found: dict[str, float] = {
        SHAKES: float(a.std()),
        RISES: float(rising.std()),
        TOUCHES: float(np.mean(stop != 0.0)),
        LEANS: abs(float(roll.mean())),
    }
    if until - since >= BLOCK:
        a_y, a_z = (
            block_percentiles(
                window_rms(weighted(finely(whole, course.step), RATE, by)[round(since * RATE) :], RATE)
            )
            for whole, by in (
                (course.of("acceleration", 0.0, until), W_D),
                (course.of("rising", 0.0, until), W_B),
            )
        )
        found[COMFORT] = float(mean_comfort(a_y).mean())
        found[COMFORT_UPWARD] = float(mean_comfort(0.0, a_z=a_z).mean())
        found[COMFORT_OF_BOTH] = float(mean_comfort(a_y, a_z=a_z).mean())
    return found
