"""Axes that drawings of one size share: matplotlib draws their contents, and this module sets the text around them.

The text is text of the page, in the font of the page. matplotlib would measure each word in its own font to place it,
which took two thirds of the time of a drawing. The page only needs the start, the end or the middle of a text.
"""

from __future__ import annotations

import html
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from bench_records.plots import HAIR, INK, LEFT_IN, RIGHT_IN, SOFT, WIDTH_IN, panel, style, svg

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

#: A rectangle: left, low, right, high.
Box = tuple[float, float, float, float]

#: Distance down to the baseline, in font sizes: from the middle of a digit, of a word, from the upper edge of a line.
OF_FIGURES, OF_WORDS, FROM_ABOVE = 0.38, 0.26, 0.76
#: Between the scale and its numbers, in points.
GAP = 3.5
NUMBERS = 8.0


class Margins(NamedTuple):
    """The size of a drawing and the margins around its axes (inches)."""

    height: float
    width: float = WIDTH_IN
    left: float = LEFT_IN
    right: float = RIGHT_IN
    bottom: float = 0.3
    top: float = 0.3


class Sheet:
    """One drawing: ``axes`` for matplotlib, and texts with positions in points from the upper left corner."""

    def __init__(self, figure: Figure, axes: Axes, margins: Margins) -> None:
        self._figure, self.axes = figure, axes
        self.left, self.right = 72 * margins.left, 72 * (margins.width - margins.right)
        self.top, self.bottom = 72 * margins.top, 72 * (margins.height - margins.bottom)
        self._words: list[str] = []

    def x(self, value: float) -> float:
        """Return the horizontal position of a value in points."""
        low, high = self.axes.get_xlim()
        if self.axes.get_xscale() == "log":
            low, high, value = math.log(low), math.log(high), math.log(value)
        return self.left + (value - low) / (high - low) * (self.right - self.left)

    def y(self, value: float) -> float:
        """Return the vertical position of a value in points."""
        low, high = self.axes.get_ylim()
        return self.bottom - (value - low) / (high - low) * (self.bottom - self.top)

    def share(self, x: float, y: float) -> tuple[float, float]:
        """Return a place, given in points, as shares of the width and the height of the axes."""
        return (x - self.left) / (self.right - self.left), (self.bottom - y) / (self.bottom - self.top)

    def write(
        self,
        x: float,
        y: float,
        text: str,
        *,
        size: float = NUMBERS,
        anchor: Literal["start", "middle", "end"] = "start",
        color: str = SOFT,
        bold: bool = False,
    ) -> None:
        """Add a text at ``y`` that begins, ends or has its middle at ``x``."""
        weight = "font-weight: 700; " if bold else ""
        look = f"{weight}font-size: {size:g}px; text-anchor: {anchor}; fill: {color}"
        self._words.append(f'<text style="{look}" x="{x:.2f}" y="{y:.2f}">{html.escape(text)}</text>')

    def mark_scale_without_zero(self) -> None:
        """Draw a zigzag on the vertical scale, at the end toward zero, if the scale does not include zero."""
        low, high = self.axes.get_ylim()
        if low <= 0.0 <= high:
            return
        y = self.bottom - 9 if low > 0.0 else self.top + 1
        zigzag = f"M{self.left:.2f} {y:.2f}l-3 2l6 2l-6 2l3 2"
        ground = f"M{self.left:.2f} {y:.2f}v8"
        self._words.append(
            f'<g class="no-zero" fill="none"><title>the scale does not begin at zero</title>'
            f'<path d="{ground}" stroke="#fff" stroke-width="2"/><path d="{zigzag}" stroke="{SOFT}"/></g>'
        )

    def heading(self, title: str, measured: str) -> None:
        """Add the title on the left above the axes, and the quantity and its unit on the right."""
        self.write(self.left, self.top - 5, title, size=9.5, color=INK, bold=True)
        self.write(self.right, self.top - 5, measured, size=8.5, anchor="end")

    def horizontal_numbers(self, *, lines: bool = True) -> str:
        """Add the numbers of the horizontal scale, with lines above them; return their common factor, if any."""
        places, factor = _ticks(self.axes.xaxis)
        for value, text in places:
            self.write(self.x(value), self.bottom + GAP + FROM_ABOVE * NUMBERS, text, anchor="middle")
        if lines:
            self._rule([((value, 0.0), (value, 1.0)) for value, _ in places], self.axes.get_xaxis_transform())
        return factor

    def vertical_numbers(self) -> str:
        """Add the numbers of the vertical scale, with lines next to them; return their common factor, if any."""
        places, factor = _ticks(self.axes.yaxis)
        for value, text in places:
            self.write(self.left - GAP, self.y(value) + OF_FIGURES * NUMBERS, text, anchor="end")
        self._rule([((0.0, value), (1.0, value)) for value, _ in places], self.axes.get_yaxis_transform())
        return factor

    def seconds(self) -> None:
        """Add the unit "s" next to the last number of the scale, where there is free space."""
        self.write(self.right + 9, self.bottom + 3.2 + FROM_ABOVE * NUMBERS, "s")

    def fill(self, boxes: Sequence[Box], color: str, **rest: Any) -> None:
        """Fill rectangles as one shape; they do not affect the limits of the axes."""
        corners = [[(x0, y0), (x0, y1), (x1, y1), (x1, y0), (x0, y0)] for x0, y0, x1, y1 in boxes]
        self._shape(corners, closed=True, facecolor=color, linewidth=0, **rest)

    def drawn(self, name: str) -> str:
        """Return the drawing as an SVG element for the page."""
        lines, end, rest = svg(self._figure, name).rpartition("</svg>")
        return lines + "\n".join([*self._words, end]) + rest

    def _rule(self, lines: Sequence[Sequence[tuple[float, float]]], transform: Any) -> None:
        look = {"edgecolor": HAIR, "linewidth": 0.6, "capstyle": "projecting", "zorder": 0.5}
        self._shape(lines, closed=False, fill=False, transform=transform, **look)

    def _shape(self, parts: Sequence[Sequence[tuple[float, float]]], *, closed: bool, **look: Any) -> None:
        from matplotlib.patches import PathPatch
        from matplotlib.path import Path

        if parts:
            last = Path.CLOSEPOLY if closed else Path.LINETO
            codes = [code for part in parts for code in (Path.MOVETO, *[Path.LINETO] * (len(part) - 2), last)]
            self.axes.add_artist(PathPatch(Path([point for part in parts for point in part], codes), **look))


@contextmanager
def sheet(margins: Margins) -> Iterator[Sheet]:
    """Yield a sheet to draw on; at the end its axes are cleared for the next drawing of this size.

    Creating axes and their scales takes as long as drawing ten lines in them.
    """
    with style():
        figure, axes = _shared(margins)
        before = set(axes.get_children())
        axes.relim()
        axes.autoscale()
        try:
            yield Sheet(figure, axes, margins)
        finally:
            if axes.get_xscale() != "linear":
                axes.set_xscale("linear")
            for artist in axes.get_children():
                if artist not in before:
                    artist.remove()


@cache
def _shared(margins: Margins) -> tuple[Figure, Axes]:
    figure, axes = panel(*margins)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_visible(False)  # its numbers are words
    return figure, axes


def _ticks(axis: Axis) -> tuple[list[tuple[float, str]], str]:
    """Return the ticks of a scale within its range, with their numbers, and the common factor of all numbers."""
    low, high = sorted(axis.get_view_interval())
    slack = 1e-9 * (high - low)
    places, formatter = axis.get_majorticklocs().tolist(), axis.get_major_formatter()
    texts = formatter.format_ticks(places)
    inside = [
        (place, text)
        for place, text in zip(places, texts, strict=True)
        if low - slack <= place <= high + slack
    ]
    return inside, formatter.get_offset()
