"""Common parts of the drawings of the gallery: the style of a figure, and its output."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bench_records.plots import FINER_THAN_SEEN, PALETTE, SOFT, plain_numbers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH: Final = 9.6
#: Left and right differ in colour, width and dash, so that both are seen where one lies on the other.
SIDE: Final[dict[str, dict[str, Any]]] = {
    "left": {"color": PALETTE[4], "linestyle": "solid", "linewidth": 2.4},
    "right": {"color": PALETTE[1], "linestyle": (0, (5, 1.6)), "linewidth": 1.1},
}
LEGEND: Final[dict[str, Any]] = {"frameon": False, "labelcolor": SOFT, "fontsize": 8}


def figure_of(height: float, *shape: int, **kwargs: Any) -> "tuple[Figure, Any]":
    """Return a figure and its axes; ``height`` in inches."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    return figure, figure.subplots(*shape, **kwargs)


def save(figure: "Figure", path: Path) -> None:
    """Write a drawing whose bytes depend only on its content."""
    plain_numbers(figure)
    figure.draw_without_rendering()  # ticks depend on sizes, and sizes on ticks: the second layout has both
    figure.savefig(path, format="svg", metadata={"Date": None, "Creator": None}, facecolor="white")
    text = path.read_text(encoding="utf-8")
    text = re.sub(r' d="[^"]*"', lambda m: FINER_THAN_SEEN.sub("", m.group()).replace("\n", ""), text)
    path.write_text(text, encoding="utf-8")
