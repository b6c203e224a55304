"""The mutation matrix as a picture: faults over plans, from the table that was measured."""

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from astb_studies.gallery.drawing import WIDTH, save
from astb_studies.mutations.faults import Cell, mutations, read_cells
from astb_studies.mutations.page import MOVED
from bench_records.plots import ALARM, INK, PALETTE, SOFT, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ROW: Final = 0.145
SQUARE: Final[dict[str, Any]] = {"marker": "s", "s": 58}
CAUGHT: Final[dict[str, Any]] = {"facecolor": PALETTE[0], "linewidth": 0}
OTHER: Final[dict[str, Any]] = {
    "facecolor": "white",
    "edgecolor": PALETTE[1],
    "linewidth": 0.6,
    "hatch": "/////",
}
MISSED: Final[dict[str, Any]] = {
    "marker": ".",
    "color": "#aab3bb",
    "linestyle": "none",
    "markersize": 2.5,
    "markeredgewidth": 0,
}
ESCAPED: Final[dict[str, Any]] = {"marker": "<", "color": ALARM, "linestyle": "none", "markersize": 4}


def matrix(_runs: Path, path: Path) -> None:
    """Draw a square for each fault and plan: caught, wrong reason, missed (with distance), or not tried."""
    from matplotlib.figure import Figure

    cells = {(one.mutation, one.plan): one for one in read_cells()}
    plans, faults = sorted({plan for _, plan in cells}), mutations().mutation
    places = {fault.name: row for row, fault in enumerate(faults)}
    with style():
        figure = Figure(figsize=(WIDTH, ROW * len(faults) + 1.9), layout="constrained")
        axes = figure.subplots()
        for row, fault in enumerate(faults):
            tried = [cells[fault.name, plan] for plan in plans if (fault.name, plan) in cells]
            if tried and all(cell.found != "caught" for cell in tried):
                axes.plot(len(plans) - 0.3, row, clip_on=False, **ESCAPED)
        _squares(axes, [(plans.index(one.plan), places[one.mutation], one) for one in cells.values()])
        last = -0.5
        for _, group in groupby(faults, lambda one: one.kind):
            last += len(list(group))
            axes.axhline(last, color=SOFT, linewidth=0.8)
        axes.set(xlim=(-0.6, len(plans) - 0.1), ylim=(len(faults) - 0.5, -0.5))
        names = [plan.replace("_", " ") for plan in plans]
        axes.set_xticks(range(len(plans)), names, rotation=55, ha="left", color=INK)
        axes.set_yticks(range(len(faults)), [one.name for one in faults], color=INK, fontsize=7)
        axes.xaxis.tick_top()
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
        _legend(figure)
        save(figure, path)


def _squares(axes: "Axes", cells: Sequence[tuple[int, int, Cell]]) -> None:
    """Draw a mark for each cell at its column and row; marks of one kind form a group named after the outcome."""
    groups: dict[str, list[tuple[int, int, Cell]]] = {}
    for column, row, cell in cells:
        still = cell.found == "missed" and cell.used < MOVED
        groups.setdefault("still" if still else cell.found.replace(" ", "-"), []).append((column, row, cell))
    for name, group in groups.items():
        columns, rows, found = zip(*group, strict=True)
        if name == "still":
            axes.plot(columns, rows, gid=name, **MISSED)
            continue
        looks = {"caught": CAUGHT, "wrong-reason": OTHER}
        greys = [str(0.95 - 0.3 * min(max(cell.used, 0.0), 1.0)) for cell in found]
        axes.scatter(
            columns, rows, gid=name, **SQUARE, **looks.get(name, {"facecolor": greys, "linewidth": 0})
        )


def _legend(figure: "Figure") -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles = [
        Patch(label="caught by a check that is meant for it", **CAUGHT),
        Patch(label="failed for another reason", **OTHER),
        Patch(label="missed, but on the way to a limit", facecolor="0.82"),
        Line2D([], [], label="missed", **MISSED),
        Line2D([], [], label="no plan catches it", **ESCAPED),
    ]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=5, frameon=False, labelcolor=SOFT, fontsize=8
    )
