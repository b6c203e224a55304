"""The figures by name, and how one is written as SVG and PNG."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bench_records.plots import plain_numbers, style
from bench_records.plots import svg as inline
from paper_study.figures.comfort import comfort
from paper_study.figures.figure_05 import figure_5
from paper_study.figures.figure_06 import figure_6
from paper_study.figures.figure_07 import figure_7
from paper_study.figures.figure_08 import figure_8
from paper_study.figures.figure_09 import figure_9
from paper_study.figures.figure_10 import figure_10
from paper_study.figures.figure_11 import figure_11
from paper_study.figures.sensitivity import sensitivity
from paper_study.study import Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES: Final[dict[str, Callable[[Study], "Figure"]]] = {
    "figure-05": figure_5,
    "figure-06": figure_6,
    "figure-07": figure_7,
    "figure-08": figure_8,
    "figure-09": figure_9,
    "figure-10": figure_10,
    "figure-11": figure_11,
    "comfort": comfort,
    "sensitivity": sensitivity,
}


def draw(name: str, study: Study, out: Path) -> str:
    """Draw one of `FIGURES` into ``out`` as SVG and PNG; return it as an element for a page."""
    with style():
        figure = FIGURES[name](study)
        plain_numbers(figure)
        # The layout is solved once, not for each file.
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        figure.savefig(out / f"{name}.svg", metadata={"Date": None, "Creator": None})
        figure.savefig(out / f"{name}.png", dpi=150, metadata={"Software": None})
        return inline(figure, name)
