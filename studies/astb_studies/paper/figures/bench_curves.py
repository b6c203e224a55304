"""Points of the bench that two figures show: lateral stiffness over pressure, damping over the pressure ratio."""

from typing import TYPE_CHECKING

from astb_studies.paper.combined import STIFFNESS
from astb_studies.paper.figures.style import KN_M, MARKERS, ORDERED, draw_points
from astb_studies.paper.plans.damping_ratio import PLATES
from astb_studies.paper.study import Study
from astb_studies.paper.sweeps.pressure import AMPLITUDES
from bench_protocol.units import bar, mm
from bench_records.plots import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def lateral_points(study: Study, panel: "Axes", load: str, *, first: bool = False) -> None:
    """Draw lateral stiffness over pressure, one marker for each amplitude; of all rigs or of the ``first`` alone."""
    for a, colour, marker in zip(sorted(AMPLITUDES), ORDERED, MARKERS, strict=False):
        one = study.bench.lateral_stiffness(load, a, first=first)
        draw_points(panel, one, bar, KN_M, colour, marker, label=f"{a / mm:g} mm")
    at_once(study, panel, load, "pressure", bar)


def at_once(
    study: Study,
    panel: "Axes",
    load: str,
    over: str,
    x: float = 1.0,
    *,
    check: str = STIFFNESS,
    colour: str = INK,
    label: str = "wind and track",
) -> None:
    """Draw the points of wind, track and roll at once over the varied quantity, in units of ``x`` (SI), if known."""
    one = study.bench.at_once(load, over, check)
    one = one[one.low > 0.0]
    draw_points(panel, one, x, KN_M, colour, "X", hollow=True, label=label, size=5.4)


def damping_points(study: Study, panel: "Axes", *, first: bool = False) -> None:
    """Draw vertical damping over the pressure ratio, one marker for each orifice plate."""
    for d, colour, marker in zip(PLATES, ORDERED, MARKERS, strict=True):
        name = f"{d / mm:g} mm"
        one = study.bench.points(
            "damping_ratio", "Vertical damping c over pressure ratio, AW0", name, first=first
        )
        draw_points(panel, one, 1.0, KN_M, colour, marker, label=name)
