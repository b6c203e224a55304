"""Points of the bench that two figures show: lateral stiffness over pressure, damping over the pressure ratio."""

from typing import TYPE_CHECKING

from bench_protocol.units import bar, mm
from paper_study.figures.style import KN_M, MARKERS, ORDERED, draw_points
from paper_study.plans.damping_ratio import PLATES
from paper_study.study import Study
from paper_study.sweeps.pressure import AMPLITUDES

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def lateral_points(study: Study, panel: "Axes", load: str, *, first: bool = False) -> None:
    """Draw lateral stiffness over pressure, one marker for each amplitude; of all rigs or of the ``first`` alone."""
    for a, colour, marker in zip(sorted(AMPLITUDES), ORDERED, MARKERS, strict=False):
        one = study.bench.lateral_stiffness(load, a, first=first)
        draw_points(panel, one, bar, KN_M, colour, marker, label=f"{a / mm:g} mm")


def damping_points(study: Study, panel: "Axes", *, first: bool = False) -> None:
    """Draw vertical damping over the pressure ratio, one marker for each orifice plate."""
    for d, colour, marker in zip(PLATES, ORDERED, MARKERS, strict=True):
        name = f"{d / mm:g} mm"
        one = study.bench.points(
            "damping_ratio", "Vertical damping c over pressure ratio, AW0", name, first=first
        )
        draw_points(panel, one, 1.0, KN_M, colour, marker, label=name)
