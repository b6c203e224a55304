"""The picture of the mutation matrix: what each plan made of each fault, on one printed page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from campaigns.mutations import Cell, Mutation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CAUGHT, BY_LUCK, NOT_TRIED = "●", "○", "·"
#: Less of the way to a limit than this counts as nothing.
MOVED: Final = 0.1
KINDS: Final = {"plant": "parts and air", "sensor": "sensors", "wire": "wires"}
#: A row, a column, and what stands left of them, above and right (mm): with up to 65 faults it is an A4 page.
ROW, COLUMN, LEFT, TOP, RIGHT = 3.9, 5.0, 52.0, 42.0, 14.0
INK, PALE, WARNING = "#1c2a3a", "#8a94a0", "#b45309"
_INCH: Final = 25.4


def sign(cell: Cell | None) -> str:
    """Return what stands for a cell, None for a plan that was not tried on the fault."""
    if cell is None:
        return NOT_TRIED
    if cell.found != "missed":
        return CAUGHT if cell.found == "caught" else BY_LUCK
    return f"{100 * cell.used:.0f}" if cell.used >= MOVED else ""


def write_picture(
    path: Path, rows: Sequence[tuple[Mutation, Mapping[str, Cell]]], plans: Sequence[str]
) -> None:
    """Write the picture as SVG; a row is a fault and its cells by plan."""
    from matplotlib import rc_context

    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "mutation matrix", "font.size": 6.5}):
        _drawn(rows, plans).savefig(path, metadata={"Date": None})


def _drawn(rows: Sequence[tuple[Mutation, Mapping[str, Cell]]], plans: Sequence[str]) -> "Figure":
    from matplotlib.figure import Figure

    kinds = list(dict.fromkeys(one.kind for one, _ in rows))
    height, width = len(rows) + len(kinds), len(plans)
    size = (LEFT + COLUMN * width + RIGHT, TOP + ROW * height + 2)
    figure = Figure(figsize=(size[0] / _INCH, size[1] / _INCH), facecolor="white")
    axes = figure.add_axes(
        (LEFT / size[0], 2 / size[1], COLUMN * width / size[0], ROW * height / size[1]),
        xlim=(-0.5, width - 0.5),
        ylim=(height - 0.5, -0.5),
    )
    axes.set_axis_off()
    for x, plan in enumerate(plans):
        axes.text(x, -0.7, plan, rotation=60, ha="left", va="bottom", color=INK, rotation_mode="anchor")
        axes.axvline(x - 0.5, color="#e4e8ec", linewidth=0.5, zorder=0)
    y = -1
    kind = ""
    for one, cells in rows:
        y += 1
        if one.kind != kind:
            kind = one.kind
            axes.text(-0.7, y, KINDS[kind], ha="right", va="center", color=PALE, style="italic")
            y += 1
        missed = all(cell.found != "caught" for cell in cells.values())
        if missed:
            axes.axhspan(y - 0.5, y + 0.5, color="#fdecd2", zorder=-1)
        axes.axhline(y + 0.5, color="#e4e8ec", linewidth=0.5, zorder=0)
        axes.text(-0.7, y, one.name, ha="right", va="center", color=WARNING if missed else INK)
        for x, plan in enumerate(plans):
            mark = sign(cells.get(plan))
            color = {CAUGHT: INK, BY_LUCK: WARNING}.get(mark, PALE)
            size_of = 8.5 if mark in (CAUGHT, BY_LUCK) else 5.5
            axes.text(x, y, mark, ha="center", va="center_baseline", color=color, fontsize=size_of)
    return figure
