"""Figure 11: stiffness and damping over frequency."""

import numpy as np

from astb_studies.paper.checks.frequency import T9
from astb_studies.paper.checks.orifice import T10
from astb_studies.paper.claims import BenchOutcome
from astb_studies.paper.closed_form import amplitude_damping
from astb_studies.paper.comparisons.comparison import largest_deviation, percent
from astb_studies.paper.study import Study
from astb_studies.paper.subject import LOADS, Subject
from astb_studies.paper.sweeps.frequency import SWEEP_AMPLITUDE
from astb_studies.paper.sweeps.ratio import NATURAL


@T9.on_the_bench("figure-11")
def stiffness(study: Study) -> BenchOutcome:
    """Lateral stiffness at a small amplitude, and the vertical one with a pipe, by frequency."""
    small, surge = [], []
    rises = overshoots = True
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
    return BenchOutcome(
        f"lateral, 0.9 mm, 1 to 25 Hz: {', '.join(small)}, no oscillation; vertical, with pipe and 0.5 mm: "
        + "; ".join(surge),
        rises and overshoots,
        "the closed form lets lateral motion press air through the orifice; in the plant it hardly does",
    )


@T10.on_the_bench("figure-11")
def damping(study: Study) -> BenchOutcome:
    """Vertical damping by frequency: its maximum, and its value at 10 Hz."""
    peaks, off = [], []
    one_peak = True
    for load in LOADS:
        plan = f"frequency_sweep_{load.lower()}"
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
    return BenchOutcome(
        "vertical: " + "; ".join(peaks),
        one_peak,
        f"peak of the closed form {', '.join(percent(one, 0) for one in off)} (AW0, AW3): it has no emergency"
        " spring in series",
    )
