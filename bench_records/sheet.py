"""The axes of a drawing as SVG: scales with their numbers, lines, points and filled areas.

Texts remain text in the font of the page. The width of a text is not needed, because its start, middle or end is
given.
"""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np

from bench_records.plots import HAIR, INK, LEFT_IN, RIGHT_IN, SOFT, WIDTH_IN, number

if TYPE_CHECKING:
    import numpy.typing as npt

    Numbers = npt.NDArray[np.float64]

#: A rectangle: left, low, right, high.
Box = tuple[float, float, float, float]
#: Lowest and highest value of a scale.
Range = tuple[float, float]

#: Distance down to the baseline, in font sizes: from the middle of a digit, of a word, from the upper edge of a line.
OF_FIGURES, OF_WORDS, FROM_ABOVE = 0.38, 0.26, 0.76
#: Between the scale and its numbers, in points.
GAP = 3.5
NUMBERS = 8.0
#: Lines and areas are drawn in tenths of a point, which is finer than the eye resolves and short to write.
FINE: Final = 10
#: Steps between the numbers of a scale, in powers of ten, with their further decimals.
STEPS: Final = ((1.0, 0), (2.0, 0), (2.5, 1), (5.0, 0), (10.0, -1))
#: Most intervals between the numbers of the horizontal and the vertical scale.
ACROSS, UP = 9, 5
#: Larger values are gaps, because the range of a scale must be finite.
LARGEST: Final = 1e300


class Margins(NamedTuple):
    """The size of a drawing and the margins around its axes, in inches."""

    height: float
    width: float = WIDTH_IN
    left: float = LEFT_IN
    right: float = RIGHT_IN
    bottom: float = 0.3
    top: float = 0.3


class Look(NamedTuple):
    """The style of a line. Dashes are in multiples of the line width. ``dot`` and ``bar`` are the sizes (points) of a
    mark at each point.
    """

    color: str
    width: float
    dash: Sequence[float] = ()
    dot: float = 0.0
    bar: float = 0.0


GRID: Final = Look(HAIR, 0.6)
SCALE: Final = Look("#9aa3ab", 0.7)


class Sheet:
    """One drawing. Positions are in points from the upper left corner. ``across`` and ``up`` are the ranges of the
    horizontal and the vertical scale.

    Later parts are drawn over earlier ones.
    """

    def __init__(self, margins: Margins, across: Range, up: Range, *, logarithmic: bool = False) -> None:
        self._width, self._height = 72 * margins.width, 72 * margins.height
        self.left, self.right = 72 * margins.left, self._width - 72 * margins.right
        self.top, self.bottom = 72 * margins.top, self._height - 72 * margins.bottom
        self._across, self._up, self._logarithmic = across, up, logarithmic
        self._parts: list[str] = []

    def x(self, value: Any) -> Any:
        """Return the horizontal position in points of a value, or of an array of values."""
        low, high = self._across
        if self._logarithmic:
            low, high, value = math.log(low), math.log(high), np.log(value)
        return self.left + (value - low) / (high - low) * (self.right - self.left)

    def y(self, value: Any) -> Any:
        """Return the vertical position in points of a value, or of an array of values."""
        low, high = self._up
        return self.bottom - (value - low) / (high - low) * (self.bottom - self.top)

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
        """Add a text at the height ``y``. Its start, middle or end (``anchor``) is at ``x``."""
        weight = "font-weight: 700; " if bold else ""
        look = f"{weight}font-size: {size:g}px; text-anchor: {anchor}; fill: {color}"
        self._parts.append(f'<text style="{look}" x="{x:.2f}" y="{y:.2f}">{html.escape(text)}</text>')

    def mark_scale_without_zero(self) -> None:
        """Draw a zigzag on the vertical scale, at the end nearest to zero, if the scale does not include zero."""
        low, high = self._up
        if low <= 0.0 <= high:
            return
        y = self.bottom - 9 if low > 0.0 else self.top + 1
        zigzag = f"M{self.left:.2f} {y:.2f}l-3 2l6 2l-6 2l3 2"
        ground = f"M{self.left:.2f} {y:.2f}v8"
        self._parts.append(
            f'<g class="no-zero" fill="none"><title>the scale does not begin at zero</title>'
            f'<path d="{ground}" stroke="#fff" stroke-width="2"/><path d="{zigzag}" stroke="{SOFT}"/></g>'
        )

    def heading(self, title: str, measured: str) -> None:
        """Add the title on the left above the axes, and quantity and unit on the right."""
        self.write(self.left, self.top - 5, title, size=9.5, color=INK, bold=True)
        self.write(self.right, self.top - 5, measured, size=8.5, anchor="end")

    def horizontal_scale(self, *, lines: bool = True, ticks: Sequence[float] = ()) -> str:
        """Add the horizontal scale with numbers and grid lines. Return the common factor of the numbers as text, or
        "".

        ``ticks`` are the values that get a number. Without them, equidistant values are used.
        """
        places, factor = _ticks(*self._across, ACROSS) if not ticks else ([(n, number(n)) for n in ticks], "")
        for value, text in places:
            self.write(self.x(value), self.bottom + GAP + FROM_ABOVE * NUMBERS, text, anchor="middle")
            if lines:
                self.mark_across(value, GRID)
        self.stroke((self.left, self.right), (self.bottom, self.bottom), SCALE)
        return factor

    def vertical_scale(self) -> str:
        """Add the vertical scale with numbers and grid lines. Return the common factor of the numbers as
        text, or "".
        """
        places, factor = _ticks(*self._up, UP)
        for value, text in places:
            self.write(self.left - GAP, self.y(value) + OF_FIGURES * NUMBERS, text, anchor="end")
            self.mark_up(value, GRID)
        self.stroke((self.left, self.left), (self.bottom, self.top), SCALE)
        return factor

    def mark_across(self, value: float, look: Look) -> None:
        """Draw a vertical line at a value of the horizontal scale."""
        self.stroke([self.x(value)] * 2, (self.bottom, self.top), look)

    def mark_up(self, value: float, look: Look) -> None:
        """Draw a horizontal line at a value of the vertical scale."""
        self.stroke((self.left, self.right), [self.y(value)] * 2, look)

    def seconds(self) -> None:
        """Add the unit "s" after the last number of the horizontal scale."""
        self.write(self.right + 9, self.bottom + 3.2 + FROM_ABOVE * NUMBERS, "s")

    def fill(self, boxes: Iterable[Box], color: str) -> None:
        """Fill rectangles, given in values of the scales, as one shape."""
        parts = []
        for x0, y0, x1, y1 in boxes:
            left, low, right, high = (
                round(FINE * n) for n in (self.x(x0), self.y(y0), self.x(x1), self.y(y1))
            )
            parts.append(f"M{left} {low}V{high}H{right}V{low}z")
        self._shape("".join(parts), f'fill="{color}"')

    def shade(self, stretches: Iterable[tuple[float, float]], color: str) -> None:
        """Fill the full height between pairs of values of the horizontal scale."""
        self.fill(((start, self._up[0], end, self._up[1]) for start, end in stretches), color)

    def line(self, xs: Any, ys: Any, look: Look) -> None:
        """Draw a line through values. NaN makes a gap, and so does a value beyond the horizontal scale."""
        xs, ys = (np.where(abs(one) < LARGEST, one, np.nan) for one in (np.asarray(xs), np.asarray(ys)))
        xs = np.where((xs < self._across[0]) | (xs > self._across[1]), np.nan, xs)
        self.stroke(self.x(xs), self.y(ys), look)

    def stroke(self, xs: Any, ys: Any, look: Look) -> None:
        """Draw a line through positions in points. NaN makes a gap."""
        points = np.rint(FINE * np.column_stack((xs, ys)))
        places = (
            points[np.isfinite(points).all(axis=1)].astype(np.int64).tolist() if look.dot or look.bar else ()
        )
        dashes = " ".join(f"{FINE * look.width * n:g}" for n in look.dash)
        dashed = f' stroke-dasharray="{dashes}"' if dashes else ' stroke-linecap="square"'
        style = (
            f'fill="none" stroke="{look.color}" stroke-linejoin="round" stroke-width="{FINE * look.width:g}"'
        )
        self._shape(_path(points), style + dashed)
        if look.dot:
            dots = "".join(f'<circle cx="{x}" cy="{y}" r="{FINE * look.dot / 2:g}"/>' for x, y in places)
            self._parts.append(f'<g transform="scale({1 / FINE})" fill="{look.color}">{dots}</g>')
        if look.bar:
            half = round(FINE * look.bar / 2)
            bars = "".join(f"M{x - half} {y}h{2 * half}" for x, y in places)
            self._shape(bars, f'stroke="{look.color}" stroke-width="{FINE}"')

    def drawn(self, name: str) -> str:
        """Return the drawing as an SVG element for a page."""
        head = f'<svg class="plot" id="{name}" viewBox="0 0 {self._width:g} {self._height:g}" role="group">'
        return "\n".join([head, *self._parts, "</svg>"])

    def _shape(self, path: str, style: str) -> None:
        if path:
            self._parts.append(f'<path transform="scale({1 / FINE})" {style} d="{path}"/>')


def scale_range(values: Iterable[Numbers], margin: float, *, logarithmic: bool = False) -> Range:
    """Return the range of all finite values, widened at both ends by the fraction ``margin``. If all values are
    equal, the range is still not empty.
    """
    numbers = np.concatenate([np.ravel(one) for one in values] or [np.empty(0)])
    numbers = numbers[abs(numbers) < LARGEST]
    if not numbers.size:
        return 0.0, 1.0
    low, high = float(numbers.min()), float(numbers.max())
    if logarithmic:
        by = (high / low) ** margin if high > low else 2.0
        return low / by, high * by
    largest = max(abs(low), abs(high))
    by = margin * (high - low)
    if high - low <= max(1e-12 * largest, 1 / LARGEST):
        by = 0.05 * largest if largest > 1e-12 else 0.05
    return low - by, high + by


def _ticks(low: float, high: float, most: int) -> tuple[list[tuple[float, str]], str]:
    """Return the ticks of a scale with their numbers as text, and the common factor of the numbers as text.

    There are at most ``most`` intervals of 1, 2, 2.5 or 5 times a power of ten.
    """
    least = (high - low) / most
    decade = math.floor(math.log10(least))
    step, digits = next((n * 10.0**decade, m) for n, m in STEPS if n * 10.0**decade >= (1 - 1e-9) * least)
    ticks = [step * n for n in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]
    power = math.floor(math.log10(max(map(abs, ticks))))
    if -5 < power < 6:
        power = 0
    decimals = max(0, digits - decade + power)
    texts = [f"{tick / 10.0**power:.{decimals}f}".replace("-", "\u2212") for tick in ticks]
    return list(zip(ticks, texts, strict=True)), f"1e{power}".replace("-", "\u2212") if power else ""


def _path(points: Numbers) -> str:
    """Return the SVG path through integer positions (n, 2). Points within straight lines are left out."""
    known = np.isfinite(points.sum(axis=1))
    ends = np.flatnonzero(np.diff(known)) + 1
    parts = []
    for part in np.split(points, ends)[0 if known[:1].all() else 1 :: 2]:
        piece = part.astype(np.int64)
        steps = np.diff(piece, axis=0)
        moved = np.flatnonzero(steps.any(axis=1))
        if not moved.size:
            continue
        before, after = steps[moved[:-1]], steps[moved[1:]]
        turns = (before[:, 0] * after[:, 1] != before[:, 1] * after[:, 0]) | (
            (before * after).sum(axis=1) < 0
        )
        corners = piece[np.concatenate(([0], moved[1:][turns], [len(piece) - 1]))]
        lines = " ".join(map(str, np.diff(corners, axis=0).ravel().tolist())).replace(" -", "-")
        parts.append(f"M{corners[0, 0]} {corners[0, 1]}l{lines}")
    return "".join(parts)
