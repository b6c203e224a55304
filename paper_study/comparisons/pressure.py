"""Figure 6: lateral stiffness over pressure, amplitude and load; damping over the pressure ratio."""

import numpy as np

from bench_protocol.units import bar, mm
from paper_study.checks.criteria import listed
from paper_study.comparisons.comparison import (
    ClaimComparison,
    closed_form_of,
    largest_deviation,
    percent,
)
from paper_study.laws import closed_stiffness
from paper_study.plans.damping_ratio import PLATES
from paper_study.study import Study
from paper_study.subject import LOADS
from paper_study.sweeps.pressure import AMPLITUDES


def pressure(study: Study) -> list[ClaimComparison]:
    """Return what the bench and the closed forms say to the claims of figure 6."""
    found = []
    K = {(load, a): study.bench.lateral_stiffness(load, a) for load in LOADS for a in sorted(AMPLITUDES)}
    five = {load: K[load, 5 * mm] for load in LOADS}
    off = [largest_deviation(closed_stiffness(load, one.x), one.y) for load, one in five.items()]
    text, holds = closed_form_of(study, "T1")
    found.append(
        ClaimComparison(
            "T1",
            "Lateral stiffness rises with the pressure.",
            "; ".join(
                f"{load}: {one.y[0] / 1e3:.0f} to {one.y[-1] / 1e3:.0f} kN/m from {one.x[0] / bar:.2f} to"
                f" {one.x[-1] / bar:.2f} bar"
                for load, one in five.items()
            )
            + " (5 mm)",
            text,
            f"closed form up to {percent(min(off), 0)}: it has no rubber",
            all(bool(np.all(np.diff(one.y) > 0.0)) for one in K.values()),
            holds,
        )
    )
    falls = {
        load: float(np.mean(K[load, max(AMPLITUDES)].y / K[load, min(AMPLITUDES)].y) - 1.0) for load in LOADS
    }
    text, holds = closed_form_of(study, "T2")
    found.append(
        ClaimComparison(
            "T2",
            "Lateral stiffness falls with the excitation amplitude.",
            "; ".join(f"{load}: {percent(fall)}" for load, fall in falls.items()) + " from 2.5 to 10 mm",
            text,
            "friction is what the closed form lacks",
            all(fall < -0.05 for fall in falls.values()),
            holds,
        )
    )
    middle = {load: float(one.y[one.y.size // 2]) for load, one in five.items()}
    text, holds = closed_form_of(study, "T3")
    found.append(
        ClaimComparison(
            "T3",
            "It is larger under AW3 than under AW0.",
            f"AW0 {middle['AW0'] / 1e3:.0f} kN/m, AW3 {middle['AW3'] / 1e3:.0f} kN/m:"
            f" × {middle['AW3'] / middle['AW0']:.2f} (5 mm)",
            text,
            "",
            middle["AW3"] > 1.05 * middle["AW0"],
            holds,
        )
    )
    return [*found, *_orifices(study)]


def _orifices(study: Study) -> list[ClaimComparison]:
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
    text, holds = closed_form_of(study, "T4")
    first = ClaimComparison(
        "T4",
        "Damping first rises and then falls with the pressure ratio.",
        f"vertical: {shown}" + (f"; {beyond} mm still rising at 25 mm of amplitude" if beyond else ""),
        text,
        "on the bench the ratio follows from the amplitude, in (19) it is free",
        all(inside[d] for d in PLATES[:2]),
        holds,
    )
    at = []
    for d in PLATES:
        one = study.bench.points("damping_ratio", "Vertical damping c over amplitude, AW0", f"{d / mm:g} mm")
        at.append(float(np.interp(5 * mm, one.x, one.y)))
    text, holds = closed_form_of(study, "T5")
    second = ClaimComparison(
        "T5",
        "Damping falls with the orifice diameter.",
        f"vertical, 5 mm: {listed(np.array(at) / 1e3, '.1f')} kN·s/m at {listed(np.array(PLATES) / mm, '.0f')} mm",
        text,
        "at amplitudes beyond 10 mm the order of the plates turns round",
        bool(np.all(np.diff(at) < 0.0)),
        holds,
    )
    return [first, second]
