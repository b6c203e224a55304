"""Figure 9: lateral stiffness over lateral displacement."""

import numpy as np

from astb_studies.paper.checks.criteria import listed
from astb_studies.paper.checks.displacement import T7
from astb_studies.paper.claims import BenchOutcome
from astb_studies.paper.comparisons.comparison import largest_deviation, percent
from astb_studies.paper.laws import closed_secant
from astb_studies.paper.study import Study
from astb_studies.paper.subject import LOADS
from bench_protocol.units import mm


@T7.on_the_bench("figure-09")
def displacement(study: Study) -> BenchOutcome:
    """Secant and small motion by offset."""
    parts, holds = [], True
    off = []
    for load in LOADS:
        secant = study.bench.points("lateral_offset", "Lateral secant stiffness per spring", load)
        tangent = study.bench.points("lateral_offset", "Lateral stiffness K' of 1 mm per spring", load)
        sizes = np.abs(tangent.x)
        far, centre = tangent.y[sizes > 50 * mm].mean(), tangent.y[sizes < 3 * mm].mean()
        softer = percent(float(far / centre) - 1.0, 0)
        parts.append(f"{load} secant {listed(secant.y / 1e3, '.0f')} kN/m, small motion {softer} at 60 mm")
        holds &= bool(np.all(np.diff(secant.y) < 0.0)) and bool(far < centre)
        off.append(largest_deviation(closed_secant(load, secant.x), secant.y))
    return BenchOutcome(
        "; ".join(parts) + " (20, 40, 60 mm)",
        holds,
        f"closed form up to {percent(min(off), 0)}; most of the bench's fall from 20 mm on is friction",
    )
