"""Figure 7: effective area and equivalent volume over lateral displacement."""

import numpy as np

from astb_studies.paper.checks.displacement import T6
from astb_studies.paper.claims import BenchOutcome
from astb_studies.paper.closed_form import lateral_area
from astb_studies.paper.comparisons.comparison import percent
from astb_studies.paper.study import Study
from astb_studies.paper.subject import Subject
from bench_protocol.units import mm


@T6.on_the_bench("figure-07")
def area(study: Study) -> BenchOutcome:
    """Change of area and volume at the largest offset."""
    change, reach = {}, 0.0
    for group in ("Effective area", "Volume"):
        one = study.bench.points("lateral_offset", group, "AW0")
        far = np.abs(one.x) > 50 * mm
        change[group] = float(one.y[far].mean() / one.y[np.abs(one.x) < 3 * mm].mean() - 1.0)
        reach = float(np.abs(one.x[far]).mean())
    par = Subject().spring("AW0")
    law = float(np.asarray(lateral_area(reach, par) / par.lateral_area)) - 1.0
    return BenchOutcome(
        f"A {percent(change['Effective area'])}, V {percent(change['Volume'])} at {reach / mm:.0f} mm: the volume"
        " shrinks",
        change["Effective area"] < 0.0 and change["Volume"] > 3.0 * abs(change["Effective area"]),
        f"A: {percent(law - change['Effective area'])} of A; V: opposite sign",
    )
