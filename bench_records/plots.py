"""The drawings of a report: each function gives one SVG element, the same bytes for the same data.

Colours are those of Okabe and Ito, which people with any kind of colour vision can tell apart, and no meaning rests
on colour alone.  Text stays text, so that it is set in the page's own type and can be searched.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from io import StringIO
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bench_records.layout import Phase
    from bench_records.result import Curve, Timing

    Numbers = npt.NDArray[np.float64]

INK = "#1c2126"
SOFT = "#68727c"
HAIR = "#dfe3e7"
SHADE = "#f1f4f6"
ALARM = "#b3261e"
PALETTE = ("#0072b2", "#d55e00", "#009e73", "#b07aa1", "#56b4e9", "#8c6d00", "#1c2126", "#999999")
DASHES: tuple[Any, ...] = ("solid", (0, (5, 1.6)), (0, (1.2, 1.2)))

WIDTH_IN = 9.6
LEFT_IN, RIGHT_IN = 0.72, 1.72
# Two points for each bin: finer than a printer's dots on this width.
BINS = 700
LOOP_POINTS = 900
MANY_LINES = 6
#: Digits of a path behind the hundredth of a point.
FINER_THAN_SEEN = re.compile(r"(?<=\.\d\d)\d+")


#: A rectangle: left, low, right, high.
Box = tuple[float, float, float, float]


class Line(NamedTuple):
    """One signal as drawn: label, times in s, values in display units."""

    label: str
    times: Numbers
    values: Numbers


def envelope(times: Numbers, values: Numbers, bins: int = BINS) -> tuple[Numbers, Numbers]:
    """A series thinned to its extremes: for each of ``bins`` stretches of time its minimum and maximum.

    No peak is lost and no value invented.  Series that are short enough come back as they are.  NaN breaks
    the line only where a whole stretch has no number; stretches without samples become NaN as well.
    """
    import numpy as np

    if times.size > 2 * bins:
        width = (times[-1] - times[0]) / bins
        index = np.minimum((times - times[0]) // width if width > 0 else np.zeros(times.size), bins - 1)
        first = np.concatenate(([0], np.flatnonzero(np.diff(index)) + 1))
        last = np.concatenate((first[1:], [times.size])) - 1
        low, high = np.fmin.reduceat(values, first), np.fmax.reduceat(values, first)
        rising = values[first] <= values[last]
        shown_t = np.column_stack((times[first], times[last])).ravel()
        shown_v = np.where(
            rising[:, None], np.column_stack((low, high)), np.column_stack((high, low))
        ).ravel()
    else:
        shown_t, shown_v = times, values
    if times.size < 3:
        return shown_t, shown_v
    gap = max(0.5, 10 * float(np.median(np.diff(times))), 2 * (times[-1] - times[0]) / bins)
    holes = np.flatnonzero(np.diff(shown_t) > gap) + 1
    return np.insert(shown_t, holes, shown_t[holes]), np.insert(shown_v, holes, np.nan)


def time_panel(
    name: str,
    title: str,
    unit: str,
    lines: Sequence[Line],
    phases: Sequence[Phase],
    span: tuple[float, float],
    marks: Sequence[float] = (),
) -> str:
    """Signals of one quantity over time, phases shaded, trips marked."""
    from matplotlib.lines import Line2D

    height = 1.62 + 0.17 * max(0, len(lines) - MANY_LINES)
    with style(), reused(height, bottom=0.30, top=0.24) as (figure, axes):
        shades = [(phase.start, 0.0, phase.end, 1.0) for phase in phases[::2]]
        _fill(axes, shades, SHADE, transform=axes.get_xaxis_transform(), zorder=0)
        for index, line in enumerate(lines):
            color, dash = PALETTE[index % len(PALETTE)], DASHES[(index // len(PALETTE)) % len(DASHES)]
            # Earlier lines are wider, so that one which runs under another still shows at its edges.
            wide = 0.9 + 0.8 * (len(lines) - 1 - index) / max(1, len(lines) - 1) if len(lines) > 1 else 1.0
            points = envelope(line.times, line.values)
            axes.add_line(Line2D(*points, color=color, linestyle=dash, linewidth=wide))
        for mark in marks:
            axes.axvline(mark, color=ALARM, linewidth=0.8, linestyle=(0, (3, 2)))
        axes.set_xlim(*span)
        axes.margins(y=0.08)
        _open_flat_band(axes)
        heading(axes, title, unit)
        _side_labels(axes, [(line.label, PALETTE[i % len(PALETTE)]) for i, line in enumerate(lines)], height)
        _seconds_axis(axes)
        return svg(figure, name)


def strips(
    name: str, rows: Sequence[tuple[str, Sequence[tuple[float, float, str]]]], span: tuple[float, float]
) -> str:
    """Rows of named stretches over time: the phases, and every signal whose values have names."""
    with style(), reused(0.23 * len(rows) + 0.30, bottom=0.28, top=0.02) as (figure, axes):
        points = (WIDTH_IN - LEFT_IN - RIGHT_IN) * 72 / (span[1] - span[0])
        # Two tones take turns, so that neighbours stay apart even in a poor copy.
        tones: tuple[list[Box], list[Box]] = ([], [])
        for row, (label, stretches) in enumerate(rows):
            for index, (start, end, text) in enumerate(stretches):
                tones[index % 2].append((start, row - 0.41, end, row + 0.41))
                if text and len(text) * 4.4 <= (end - start) * points:
                    axes.text((start + end) / 2, row, text, ha="center", va="center", fontsize=7, color=INK)
            axes.text(
                1.012, row, label, transform=axes.get_yaxis_transform(), va="center", fontsize=8, color=SOFT
            )
        for boxes, tone in zip(tones, ("#d6e4ef", "#eaf1f6"), strict=True):
            _fill(axes, boxes, tone, zorder=1)
        axes.set_xlim(*span)
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.set_yticks([])
        axes.grid(visible=False)
        axes.spines["left"].set_visible(False)
        _seconds_axis(axes)
        return svg(figure, name)


def curve_panel(name: str, title: str, curves: Sequence[Curve]) -> str:
    """Curves that share their axes: loops with a sequence of colours, sweeps with marked points."""
    import numpy as np
    from matplotlib import colormaps

    x, y = curves[0].x, curves[0].y
    with style(), reused(3.35, width=4.72, left=0.66, right=0.14, bottom=0.68, top=0.30) as (figure, axes):
        many = len(curves) > 3
        for index, one in enumerate(curves):
            # An order (frequencies, amplitudes) reads best on a scale from dark to light.
            color = colormaps["viridis"](0.88 * index / (len(curves) - 1)) if many else PALETTE[index]
            xs = np.array([np.nan if n is None else n for n in one.xs]) / x.scale
            ys = np.array([np.nan if n is None else n for n in one.ys]) / y.scale
            if one.kind == "sweep":
                axes.plot(
                    xs, ys, color=color, marker="o", markersize=4, markeredgecolor="white", label=one.name
                )
            else:
                step = max(1, math.ceil(xs.size / LOOP_POINTS))
                axes.plot(xs[::step], ys[::step], color=color, linewidth=1.0, label=one.name)
        axes.margins(0.05)
        if len(curves) > 1:
            axes.legend(
                loc="upper left",
                bbox_to_anchor=(-0.02, -0.135),
                ncols=min(len(curves), 5),
                frameon=False,
                fontsize=8,
                handlelength=1.3,
                columnspacing=1.0,
                borderpad=0.1,
            )
        heading(axes, title, y.unit, what=y.label)
        axes.set_xlabel(f"{x.label}, {x.unit}" if x.unit else x.label, loc="right")
        return svg(figure, name)


def lateness(name: str, timing: Timing) -> str:
    """How many ticks were how late, on a logarithmic scale: the rare ones are those that matter."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    with style():
        figure, axes = panel(1.95, width=6.2, left=0.72, right=0.1, bottom=0.55, top=0.28)
        places = range(len(timing.counts))
        axes.bar(places, [max(count, 0) for count in timing.counts], width=0.86, color=PALETTE[0])
        axes.set_yscale("symlog", linthresh=1.0)
        axes.set_ylim(0, 4 * max([*timing.counts, 1]))
        for place, count in zip(places, timing.counts, strict=True):
            if count:
                axes.text(
                    place,
                    count * 1.15,
                    f"{count:,}".replace(",", "\u2009"),
                    ha="center",
                    va="bottom",
                    fontsize=7,
                )
        edges = [_microseconds(edge) for edge in timing.edges]
        axes.set_xticks(list(places), [f"\u2264 {edge}" for edge in edges] + [f"> {edges[-1]}"])
        axes.yaxis.set_major_locator(LogLocator(base=100.0))
        axes.yaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_major_formatter(FuncFormatter(lambda n, _: f"{n:,.0f}".replace(",", "\u2009")))
        heading(axes, "Lateness of the ticks", "", what="number of ticks")
        axes.set_xlabel("µs after the deadline", loc="right")
        return svg(figure, name)


def _microseconds(seconds: float) -> str:
    return (
        f"{seconds * 1e6:,.4g}".replace(",", "\u2009")
        if seconds < 1e-2
        else f"{seconds * 1e6:,.0f}".replace(",", "\u2009")
    )


def style() -> Any:
    """The type, lines and colours of every drawing, as a context."""
    from matplotlib import rc_context

    return rc_context(
        {
            "svg.fonttype": "none",
            "svg.hashsalt": "astb",
            # Shipped with matplotlib: text is measured alike on every machine.
            "font.family": "DejaVu Sans",
            "font.size": 8.5,
            "text.color": INK,
            "axes.labelcolor": SOFT,
            "axes.labelsize": 8.5,
            "axes.edgecolor": "#9aa3ab",
            "axes.linewidth": 0.7,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.grid": True,
            "axes.axisbelow": True,
            "axes.unicode_minus": True,
            "text.parse_math": False,
            "axes.formatter.useoffset": False,
            "grid.color": HAIR,
            "grid.linewidth": 0.6,
            "xtick.color": SOFT,
            "ytick.color": SOFT,
            "xtick.labelsize": 8,
            "ytick.labelsize": 8,
            "xtick.bottom": False,
            "xtick.major.size": 0,
            "ytick.left": False,
            "ytick.major.size": 0,
            "lines.linewidth": 1.2,
            "lines.solid_joinstyle": "round",
            "path.simplify_threshold": 0.25,
        }
    )


def panel(
    height: float,
    width: float = WIDTH_IN,
    left: float = LEFT_IN,
    right: float = RIGHT_IN,
    bottom: float = 0.3,
    top: float = 0.3,
) -> tuple[Figure, Axes]:
    """A figure with one pair of axes; sizes and margins in inches."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), facecolor="none")
    axes = figure.add_axes(
        (left / width, bottom / height, 1 - (left + right) / width, 1 - (bottom + top) / height)
    )
    axes.set_facecolor("none")
    axes.locator_params(axis="y", nbins=5)
    return figure, axes


@contextmanager
def reused(height: float, **sizes: float) -> Iterator[tuple[Figure, Axes]]:
    """A `panel` that drawings of one size share, cleared at the end of all that was added meanwhile.

    Making axes and their scales takes as long as drawing ten lines in them.
    """
    figure, axes = _shared(height, **sizes)
    before = set(axes.get_children())
    axes.relim()
    axes.autoscale()
    try:
        yield figure, axes
    finally:
        for artist in axes.get_children():
            if artist not in before:
                artist.remove()


@cache
def _shared(height: float, **sizes: float) -> tuple[Figure, Axes]:
    figure, axes = panel(height, **sizes)
    # What it measures stands in the heading; for a label beside the scale all its numbers would be measured.
    axes.yaxis.set_label_coords(0.0, 0.5)
    return figure, axes


def _fill(axes: Axes, boxes: Sequence[Box], color: str, **rest: Any) -> None:
    """Fill rectangles, all as one shape; they do not count for the limits of the axes."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    corners = [[(x0, y0), (x0, y1), (x1, y1), (x1, y0), (x0, y0)] for x0, y0, x1, y1 in boxes]
    if corners:
        codes = [Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY] * len(corners)
        shape = Path([point for box in corners for point in box], codes)
        axes.add_artist(PathPatch(shape, facecolor=color, linewidth=0, **rest))


def heading(axes: Axes, title: str, unit: str, what: str = "") -> None:
    """The title on the left of the axes, what is drawn and its unit on the right."""
    # With y given nothing else of the drawing is measured to find the place.
    axes.set_title(title, loc="left", fontsize=9.5, fontweight="bold", pad=5, y=1.0)
    told = ", ".join(filter(None, [what, unit]))
    axes.set_title(told, loc="right", fontsize=8.5, color=SOFT, pad=5, y=1.0)


def _side_labels(axes: Axes, labels: Sequence[tuple[str, Any]], height: float) -> None:
    """Names beside the lines, in their colours: nearer to the eye than a legend in a box."""
    step = 0.165 / (height - 0.54)
    for index, (label, color) in enumerate(labels):
        place = 0.95 - index * step
        axes.plot(
            [1.012, 1.034], [place, place], transform=axes.transAxes, color=color, linewidth=2, clip_on=False
        )
        axes.text(1.042, place, label, transform=axes.transAxes, fontsize=8.5, va="center")


def _seconds_axis(axes: Axes) -> None:
    """The unit stands beside the last number of the scale, where nothing else is."""
    axes.annotate("s", (1, 0), (9, -3.2), "axes fraction", "offset points", va="top", fontsize=8, color=SOFT)


def _open_flat_band(axes: Axes) -> None:
    """Keep noise on a constant from filling the panel as if it were a signal."""
    low, high = axes.get_ylim()
    least = 0.02 * max(abs(low), abs(high))
    if high - low < least:
        middle = (low + high) / 2
        axes.set_ylim(middle - least / 2, middle + least / 2)


def svg(figure: Figure, name: str) -> str:
    """The figure as an element for the page: its ids made its own, its path data no finer than the eye."""
    out = StringIO()
    figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = out.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r' d="[^"]*"', lambda m: FINER_THAN_SEEN.sub("", m.group()).replace("\n", ""), text)
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = text.replace("url(#", f"url(#{name}-").replace('href="#', f'href="#{name}-')
    # The page's type rules; only size and weight are the drawing's own.
    text = text.replace(" font-family: 'DejaVu Sans';", "")
    text = re.sub(
        r'<svg [^>]*?viewBox="([^"]*)"[^>]*>', r'<svg class="plot" viewBox="\1" role="img">', text, count=1
    )
    return re.sub(r"\n\s*", "\n", text)
