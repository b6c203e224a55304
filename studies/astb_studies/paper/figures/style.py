"""Style of the figures: sizes, colours, markers, and the parts of a panel."""

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter, NullLocator

from astb_studies.paper.bench_results import Points
from bench_protocol.arrays import Floats
from bench_records.plots import INK, PALETTE

if TYPE_CHECKING:
    from matplotlib.axes import Axes


COLOUR: Final = {"AW0": PALETTE[0], "AW3": PALETTE[1]}
MARKER: Final = {"AW0": "o", "AW3": "s"}
#: Ordered values (amplitudes, diameters) have colours from dark to light; markers distinguish them without colour.
ORDERED: Final = ("#2d1160", "#8c2981", "#de4968", "#f0944d")
MARKERS: Final = ("o", "s", "^", "D")
DASHED: Final = (0, (4.5, 1.8))
DOTTED: Final = (0, (1.2, 1.4))
DASHDOT: Final = (0, (4.5, 1.4, 1.2, 1.4))
KN_M: Final = 1e3
PANEL_IN: Final = 3.5
WIDE_IN: Final = 4.5
MEASURED: Final[tuple[str, dict[str, Any]]] = (
    "bench",
    {"linestyle": "none", "marker": "o", "markersize": 5, "markeredgecolor": "white"},
)
PLANT_MODEL: Final[tuple[str, dict[str, Any]]] = ("plant's model, identified parameters", {})


def panels_of(columns: int, rows: int = 1, height: float = 3.15, **kwargs: Any) -> tuple["Figure", Any]:
    """Return a new figure and its panels, an array (rows, columns); ``height`` of a row in inches."""
    width = PANEL_IN * columns if columns > 2 else WIDE_IN * columns
    engine = ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06, wspace=0.03, hspace=0.05)
    figure = Figure(figsize=(width, height * rows + 0.35), layout=engine, facecolor="white")
    axes = figure.subplots(rows, columns, squeeze=False, **kwargs)
    return figure, axes


def label_panel(axes: "Axes", letter: str, title: str, x: str, y: str) -> None:
    """Give a panel its letter, its title and the names of its axes."""
    axes.set_title(f"({letter})  {title}", loc="left", fontsize=9, fontweight="bold", pad=6)
    axes.set_xlabel(x)
    axes.set_ylabel(y)


def draw_points(
    axes: "Axes",
    one: Points,
    x: float,
    y: float,
    colour: str,
    marker: str = "o",
    *,
    label: str = "",
    hollow: bool = False,
    size: float = 4.6,
) -> None:
    """Draw measured points, with a bar from the lowest to the highest rig where there are several.

    ``x`` and ``y`` are the SI values of the axes' units.
    """
    spread = np.vstack([one.y - one.low, one.high - one.y]) / y
    axes.errorbar(
        one.x / x,
        one.y / y,
        yerr=spread if spread.max() > 0.0 else None,
        color=colour,
        linestyle="none",
        marker=marker,
        markersize=size,
        markerfacecolor="white" if hollow else colour,
        markeredgecolor=colour if hollow else "white",
        markeredgewidth=0.9 if hollow else 0.6,
        elinewidth=0.9,
        zorder=3,
    )
    if label:  # the key shows the point without its bar
        face: dict[str, Any] = {
            "markerfacecolor": "white" if hollow else colour,
            "markeredgecolor": colour if hollow else "white",
        }
        axes.plot([], [], linestyle="none", marker=marker, markersize=size, label=label, **face)


def draw_line(
    axes: "Axes", x: Floats, y: Any, colour: str, dash: Any = "solid", label: str = "", **kw: Any
) -> None:
    """Draw a computed curve; ``x`` and ``y`` in the panel's units."""
    axes.plot(x, y, color=colour, linestyle=dash, label=label or None, **({"linewidth": 1.25} | kw))


def add_key(figure: Figure, *entries: tuple[str, dict[str, Any]], columns: int = 0) -> None:
    """Add one legend below the panels for points, lines and dashes."""
    styles: list[dict[str, Any]] = [{"color": INK, "linewidth": 1.25} | style for _, style in entries]
    handles = [Line2D([], [], **style) for style in styles]
    figure.legend(
        handles,
        [text for text, _ in entries],
        loc="outside lower center",
        ncols=columns or len(entries),
        frameon=False,
        fontsize=8,
        handlelength=2.0,
        columnspacing=1.6,
    )


def add_legend(axes: "Axes", **kwargs: Any) -> None:
    """Add a legend of the points inside one panel."""
    axes.legend(**({"frameon": False, "fontsize": 7.5, "handlelength": 1.6, "labelspacing": 0.35} | kwargs))


def plain_log_ticks(panel: "Axes", ticks: tuple[float, ...]) -> None:
    """Label a logarithmic axis at ``ticks``, as plain numbers."""
    panel.set_xticks(ticks, [f"{one:g}" for one in ticks])
    panel.xaxis.set_minor_locator(NullLocator())
    panel.xaxis.set_minor_formatter(NullFormatter())
