"""Figure 11: stiffness and damping over frequency."""

import numpy as np

from paper_study.closed_form import amplitude_damping
from paper_study.comparisons.comparison import ClaimComparison, closed_form_of, largest_deviation, percent
from paper_study.study import Study
from paper_study.subject import LOADS, Subject
from paper_study.sweeps.frequency import SWEEP_AMPLITUDE
from paper_study.sweeps.ratio import NATURAL


def frequency(study: Study) -> list[ClaimComparison]:
    """Return what the bench and the closed forms say to the claims of figure 11."""
    small, surge, peaks = [], [], []
    rises = overshoots = one_peak = True
    off = []
    for load in LOADS:
        plan = f"frequency_sweep_{load.lower()}"
        K = study.bench.points(plan, "Lateral, 0.9 mm: stiffness |K| per spring", f"{load}, orifice")
        small.append(f"{load} {percent(float(K.y[-1] / K.y[0]) - 1.0)}")
        rises &= bool(K.y[-1] > K.y[0])
        overshoots &= bool(K.y.max() > 1.05 * K.y[-1])
        V = study.bench.points(plan, "Vertical stiffness |K| per spring", f"{load}, pipe, 0.5 mm")
        low, high = int(np.argmin(V.y)), int(np.argmax(V.y))
        surge.append(
            f"{load} {V.y[low] / 1e3:.0f} kN/m at {V.x[low]:g} Hz, {V.y[high] / 1e3:.0f} kN/m at {V.x[high]:g} Hz"
        )
        c = study.bench.points(plan, "Vertical damping c per spring", f"{load}, orifice")
        c = c[c.x >= 0.3]
        top = int(np.argmax(c.y))
        last = float(np.interp(10.0, c.x, c.y) / c.y[top])
        peaks.append(
            f"{load} {c.y[top] / 1e3:.1f} kN·s/m at {c.x[top]:g} Hz, {100 * last:.0f} % of it at 10 Hz"
        )
        one_peak &= top > 0 and 0.7 * NATURAL <= c.x[top] <= 1.3 * NATURAL and last < 0.1
        par = Subject().spring(load)
        law = amplitude_damping(2 * np.pi * c.x, SWEEP_AMPLITUDE, par.orifice_diameter, par.pressure, par)
        off.append(largest_deviation(np.asarray(law)[top : top + 1], c.y[top : top + 1]))
    nine, nine_holds = closed_form_of(study, "T9")
    ten, ten_holds = closed_form_of(study, "T10")
    return [
        ClaimComparison(
            "T9",
            "Lateral stiffness rises with frequency, oscillates at high frequency and settles.",
            f"lateral, 0.9 mm, 1 to 25 Hz: {', '.join(small)}, no oscillation; vertical, with pipe and 0.5 mm: "
            + "; ".join(surge),
            nine,
            "the closed form lets lateral motion press air through the orifice; in the plant it hardly does",
            rises and overshoots,
            nine_holds,
        ),
        ClaimComparison(
            "T10",
            "Damping is largest at the natural frequency and small at high frequency.",
            "vertical: " + "; ".join(peaks),
            ten,
            f"peak of the closed form {', '.join(percent(one, 0) for one in off)} (AW0, AW3): it has no emergency"
            " spring in series",
            one_peak,
            ten_holds,
        ),
    ]
