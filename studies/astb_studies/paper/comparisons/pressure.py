"""Figure 6: lateral stiffness over pressure, amplitude and load; damping over the pressure ratio."""

import numpy as np

from astb_studies.paper.bench_results import Points
from astb_studies.paper.checks.criteria import listed
from astb_studies.paper.checks.lateral import T1, T2, T3
from astb_studies.paper.checks.orifice import T4, T5
from astb_studies.paper.claims import BenchOutcome
from astb_studies.paper.comparisons.comparison import largest_deviation, percent
from astb_studies.paper.laws import closed_stiffness
from astb_studies.paper.plans.damping_ratio import PLATES
from astb_studies.paper.study import Study
from astb_studies.paper.subject import LOADS
from astb_studies.paper.sweeps.pressure import AMPLITUDES
from bench_protocol.units import bar, mm


def _five(study: Study) -> dict[str, Points]:
    return {load: study.bench.lateral_stiffness(load, 5 * mm) for load in LOADS}


@T1.on_the_bench("figure-06")
def over_pressure(study: Study) -> BenchOutcome:
    """Lateral stiffness over pressure, at every amplitude."""
    five = _five(study)
    off = [largest_deviation(closed_stiffness(load, one.x), one.y) for load, one in five.items()]
    rises = (
        np.all(np.diff(study.bench.lateral_stiffness(load, a).y) > 0.0) for load in LOADS for a in AMPLITUDES
    )
    return BenchOutcome(
        "; ".join(
            f"{load}: {one.y[0] / 1e3:.0f} to {one.y[-1] / 1e3:.0f} kN/m from {one.x[0] / bar:.2f} to"
            f" {one.x[-1] / bar:.2f} bar"
            for load, one in five.items()
        )
        + " (5 mm)",
        all(bool(one) for one in rises),
        f"closed form up to {percent(min(off), 0)}: it has no rubber",
    )


@T2.on_the_bench("figure-06")
def over_amplitude(study: Study) -> BenchOutcome:
    """Lateral stiffness at the largest amplitude over that at the smallest."""
    large, small = (
        {load: study.bench.lateral_stiffness(load, a) for load in LOADS}
        for a in (max(AMPLITUDES), min(AMPLITUDES))
    )
    change = {load: float(np.mean(large[load].y / small[load].y) - 1.0) for load in LOADS}
    return BenchOutcome(
        "; ".join(f"{load}: {percent(one)}" for load, one in change.items()) + " from 2.5 to 10 mm",
        all(one < -0.05 for one in change.values()),
        "friction is what the closed form lacks",
    )


@T3.on_the_bench("figure-06")
def over_load(study: Study) -> BenchOutcome:
    """Lateral stiffness under both loads, at the middle one of their pressures."""
    middle = {load: float(one.y[one.y.size // 2]) for load, one in _five(study).items()}
    return BenchOutcome(
        f"AW0 {middle['AW0'] / 1e3:.0f} kN/m, AW3 {middle['AW3'] / 1e3:.0f} kN/m:"
        f" × {middle['AW3'] / middle['AW0']:.2f} (5 mm)",
        middle["AW3"] > 1.05 * middle["AW0"],
        "",
    )


@T4.on_the_bench("figure-06")
def damping_over_ratio(study: Study) -> BenchOutcome:
    """Vertical damping over the pressure ratio, plate by plate."""
    curves = {
        d: study.bench.points(
            "damping_ratio", "Vertical damping c over pressure ratio, AW0", f"{d / mm:g} mm"
        )
        for d in PLATES
    }
    inside = {d: 0 < int(np.argmax(one.y)) < one.y.size - 1 for d, one in curves.items()}
    best = {d: float(one.x[np.argmax(one.y)]) for d, one in curves.items()}
    shown = ", ".join(
        f"{d / mm:g} mm: {curves[d].y.max() / 1e3:.0f} kN·s/m at {best[d]:.3f}" for d in PLATES if inside[d]
    )
    beyond = ", ".join(f"{d / mm:g}" for d in PLATES if not inside[d])
    return BenchOutcome(
        f"vertical: {shown}" + (f"; {beyond} mm still rising at 25 mm of amplitude" if beyond else ""),
        all(inside[d] for d in PLATES[:2]),
        "on the bench the ratio follows from the amplitude, in (19) it is free",
    )


@T5.on_the_bench("figure-06")
def damping_over_diameter(study: Study) -> BenchOutcome:
    """Vertical damping at 5 mm by plate."""
    at = []
    for d in PLATES:
        one = study.bench.points("damping_ratio", "Vertical damping c over amplitude, AW0", f"{d / mm:g} mm")
        at.append(float(np.interp(5 * mm, one.x, one.y)))
    return BenchOutcome(
        f"vertical, 5 mm: {listed(np.array(at) / 1e3, '.1f')} kN·s/m at {listed(np.array(PLATES) / mm, '.0f')} mm",
        bool(np.all(np.diff(at) < 0.0)),
        "at amplitudes beyond 10 mm the order of the plates turns round",
    )
