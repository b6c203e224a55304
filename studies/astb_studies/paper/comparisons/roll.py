"""Figure 10: lateral stiffness over the roll angle."""

import numpy as np

from astb_studies.paper.bench_results import Points
from astb_studies.paper.checks.roll import T8
from astb_studies.paper.claims import BenchOutcome
from astb_studies.paper.comparisons.comparison import MINUS, percent
from astb_studies.paper.study import Study
from astb_studies.paper.subject import LOADS


@T8.on_the_bench("figure-10")
def roll(study: Study) -> BenchOutcome:
    """Secant and first harmonic of rolled springs, to both sides."""
    parts, any_sign = [], True
    for load in LOADS:
        plan, name = f"roll_angle_{load.lower()}", f"{load}, valve isolated"
        secant = study.bench.points(plan, "Lateral secant F/y at +20 mm per spring", name)
        first = study.bench.points(plan, "Lateral stiffness K' of 5 mm about +20 mm per spring", name)

        def at(angle: float, one: Points) -> float:
            return float(np.interp(angle, one.x, one.y))

        last = float(secant.x.max())
        change = {sign: at(sign * 0.05, secant) / at(0.0, secant) - 1.0 for sign in (1, -1)}
        beyond = (at(last, secant) - at(0.05, secant)) / (at(0.05, secant) - at(0.0, secant))
        harmonic = at(0.05, first) / at(0.0, first) - 1.0
        parts.append(
            f"{load}: secant {percent(change[1], 0)} at +0.05 rad, {percent(beyond, 0)} of that beyond;"
            f" {percent(change[-1], 0)} at {MINUS}0.05 rad; first harmonic {percent(harmonic)}"
        )
        any_sign &= change[1] > 0.2 and change[-1] > 0.2 and harmonic > 0.2
    return BenchOutcome(
        "; ".join(parts),
        any_sign,
        "the bench's coupling is odd in roll, the closed form even: half of the picture is mirrored",
    )
