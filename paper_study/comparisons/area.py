"""Figure 7: effective area and equivalent volume over lateral displacement."""

import numpy as np

from bench_protocol.units import mm
from paper_study.closed_form import lateral_area
from paper_study.comparisons.comparison import ClaimComparison, closed_form_of, percent
from paper_study.study import Study
from paper_study.subject import Subject


def area(study: Study) -> list[ClaimComparison]:
    """Return what the bench and the closed forms say to the claim of figure 7."""
    change, reach = {}, 0.0
    for group in ("Effective area", "Volume"):
        one = study.bench.points("lateral_offset", group, "AW0")
        far = np.abs(one.x) > 50 * mm
        change[group] = float(one.y[far].mean() / one.y[np.abs(one.x) < 3 * mm].mean() - 1.0)
        reach = float(np.abs(one.x[far]).mean())
    text, holds = closed_form_of(study, "T6")
    par = Subject().spring("AW0")
    law = float(np.asarray(lateral_area(reach, par) / par.lateral_area)) - 1.0
    return [
        ClaimComparison(
            "T6",
            "Sideways the effective area falls a little and the equivalent volume grows by far more.",
            f"A {percent(change['Effective area'])}, V {percent(change['Volume'])} at {reach / mm:.0f} mm: the volume"
            " shrinks",
            text,
            f"A: {percent(law - change['Effective area'])} of A; V: opposite sign",
            change["Effective area"] < 0.0 and change["Volume"] > 3.0 * abs(change["Effective area"]),
            holds,
        )
    ]
