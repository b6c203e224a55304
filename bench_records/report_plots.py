"""The drawings of a report. Each function returns one SVG element, with the same bytes for the same data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bench_records.plot_data import Trace
from bench_records.plots import (
    ALARM,
    INK,
    LEFT_IN,
    PALETTE,
    RIGHT_IN,
    SHADE,
    WIDTH_IN,
    heading,
    number,
    panel,
    style,
    svg,
)
from bench_records.sheet import OF_WORDS, Box, Look, Margins, Range, Sheet, scale_range
from bench_records.typography import primed, unit

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench_records.curves import Axis, Curve
    from bench_records.layout import Phase
    from bench_records.result import Timing

    Numbers = npt.NDArray[np.float64]

#: Dashes of the lines of the right axis, which distinguish them from the left ones without colour.
DASH = (5.0, 1.8)
#: Number of colours after which lines are also distinguished by points.
DOTS = (1.2, 1.2)

# Two points for each bin: finer than a printer's dots on this width.
BINS = 700
LOOP_POINTS = 900
MANY_LINES = 6
CURVE = Margins(3.35, width=4.72, left=0.66, right=0.14, bottom=0.68, top=0.30)
#: Widths in points: of a digit of a scale, of a letter of a label, of the piece of line in front of a label.
NUMBER_WIDTH = 5.0
WORD_WIDTH = 4.4
SWATCH = 13.0


class Series(NamedTuple):
    """The line of one signal: label, times in s, values in display units."""

    label: str
    times: Numbers
    values: Numbers


def envelope(times: Numbers, values: Numbers, bins: int = BINS) -> tuple[Numbers, Numbers]:
    """Reduce a series to the minimum and the maximum in each of ``bins`` intervals of time. Return times and values.

    All peaks remain, and no value is interpolated. A series that is short enough keeps all its samples. Long gaps
    between samples get a NaN, which interrupts the line. In a reduced series, NaN values interrupt the line only if an
    interval has no number at all.
    """
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
    measured_in: str,
    lines: Sequence[Series],
    phases: Sequence[Phase],
    span: tuple[float, float],
    marks: Sequence[float] = (),
    levels: Sequence[float] = (),
) -> str:
    """Return a drawing of signals of one quantity over time. Every second phase is shaded, ``marks`` are times of
    trips, and ``levels`` are limits.
    """
    height = 1.62 + 0.17 * max(0, len(lines) - MANY_LINES)
    drawn = [envelope(line.times, line.values) for line in lines]
    up = _open_flat_band(scale_range([*(values for _, values in drawn), np.asarray(levels)], 0.08))
    paper = Sheet(Margins(height, bottom=0.30, top=0.24), span, up)
    paper.shade(((phase.start, phase.end) for phase in phases[::2]), SHADE)
    paper.horizontal_scale()
    paper.heading(title, _joined(unit(measured_in), paper.vertical_scale()))
    for index, (line, points) in enumerate(zip(lines, drawn, strict=True)):
        color, dash = look(index, line.label)
        # Smaller differences than in `_wide`, because the lines of a signal over time are dense.
        wide = 0.9 + 0.8 * (len(lines) - 1 - index) / max(1, len(lines) - 1) if len(lines) > 1 else 1.0
        paper.line(*points, Look(color, wide, dash))
    for mark in marks:
        paper.mark_across(mark, Look(ALARM, 0.8, (3, 2)))
    for level in levels:
        paper.mark_up(level, Look(ALARM, 0.8))
    paper.mark_scale_without_zero()
    _side_labels(paper, without_common_end([line.label for line in lines]))
    paper.seconds()
    return paper.drawn(name)


def strips(
    name: str, rows: Sequence[tuple[str, Sequence[tuple[float, float, str]]]], span: tuple[float, float]
) -> str:
    """Return rows of named intervals over time: the phases, and the signals whose values have names."""
    paper = Sheet(Margins(0.23 * len(rows) + 0.30, bottom=0.28, top=0.02), span, (len(rows) - 0.5, -0.5))
    points = (WIDTH_IN - LEFT_IN - RIGHT_IN) * 72 / (span[1] - span[0])
    # Alternating tones distinguish neighbours even in a poor copy.
    tones: tuple[list[Box], list[Box]] = ([], [])
    for row, (_, stretches) in enumerate(rows):
        for index, (start, end, _) in enumerate(stretches):
            tones[index % 2].append((start, row - 0.41, end, row + 0.41))
    for boxes, tone in zip(tones, ("#d6e4ef", "#eaf1f6"), strict=True):
        paper.fill(boxes, tone)
    for row, (label, stretches) in enumerate(rows):
        for start, end, text in stretches:
            if text and len(text) * 5.4 + 3 <= (end - start) * points:
                middle = paper.x((start + end) / 2)
                paper.write(middle, paper.y(row) + 7 * OF_WORDS, text, size=7, anchor="middle", color=INK)
        paper.write(_right_of_axes(paper, 1.012), paper.y(row) + 8 * OF_WORDS, label)
    paper.horizontal_scale(lines=False)
    paper.seconds()
    return paper.drawn(name)


def curve_panel(name: str, title: str, curves: Sequence[Curve]) -> str:
    """Return a drawing of curves that share their axes. Loops are lines in different colours; sweeps have marked
    points and limits.
    """
    x, y = curves[0].x, curves[0].y
    traces, pointed = curve_traces(curves), curves[0].kind == "sweep"
    logarithmic = is_over_decades(curves)
    ends = [
        (trace.ys - trace.expanded, trace.ys + trace.expanded)
        for trace in traces
        if trace.expanded is not None
    ]
    across = scale_range((trace.xs for trace in traces), 0.05, logarithmic=logarithmic)
    up = scale_range([*(trace.ys for trace in traces), *(end for pair in ends for end in pair)], 0.05)
    paper = Sheet(CURVE, across, up, logarithmic=logarithmic)
    paper.heading(title, _joined(primed(y.label), unit(y.unit), paper.vertical_scale()))
    ticks = labelled_frequencies(curves) if logarithmic else ()
    foot = _joined(x.label, unit(x.unit), paper.horizontal_scale(ticks=ticks))
    paper.write(paper.right, paper.bottom + 21.96, foot, size=8.5, anchor="end")
    for trace in traces:
        paper.line(trace.xs, trace.ys, _line_style(trace, pointed=pointed))
        _error_bars(paper, trace)
    paper.mark_scale_without_zero()
    if len(traces) > 1:
        _labels_below(paper, traces, pointed=pointed)
    return paper.drawn(name)


def _line_style(trace: Trace, *, pointed: bool) -> Look:
    line = Look(trace.color, trace.width, trace.dash)
    if not pointed:
        return line
    return line._replace(bar=5.0) if trace.color == ALARM else line._replace(dot=4.0 + 1.6 * trace.width)


def _labels_below(paper: Sheet, traces: Sequence[Trace], *, pointed: bool) -> None:
    """Write the names of the lines below the axes, in as many rows as necessary."""
    left, down = paper.left, paper.bottom + 34.0
    for trace in traces:
        wide = SWATCH + 4.0 + WORD_WIDTH * len(trace.label)
        if left > paper.left and left + wide > paper.right:
            left, down = paper.left, down + 12.0
        look = _line_style(trace, pointed=pointed)
        paper.stroke((left, left + SWATCH), (down, down), look._replace(dot=0.0, bar=0.0))
        paper.stroke([left + SWATCH / 2], [down], look)
        paper.write(left + SWATCH + 4.0, down + 8.0 * OF_WORDS, trace.label, size=8.0, color=INK)
        left += wide + 10.0


def _error_bars(paper: Sheet, trace: Trace) -> None:
    """Draw the expanded uncertainty of each point in both directions."""
    if trace.expanded is None:
        return
    low, high = trace.ys - trace.expanded, trace.ys + trace.expanded
    ends = np.column_stack((low, high, np.full_like(low, np.nan))).ravel()
    paper.line(np.repeat(trace.xs, 3), ends, Look(trace.color, 0.9, bar=7.0))


def is_over_decades(curves: Sequence[Curve]) -> bool:
    """Return whether the points are frequencies that differ by more than a factor of 2, so that a logarithmic scale is
    used.
    """
    places = [n for one in curves for n in one.xs if n is not None]
    return curves[0].x.unit == "Hz" and bool(places) and min(places) > 0.0 and max(places) > 2.0 * min(places)


def labelled_frequencies(curves: Sequence[Curve]) -> list[float]:
    """Return the frequencies that get a label on a logarithmic scale without overlap.

    These are the lowest and the highest, and from left to right those between them for which there is room.
    """
    places = sorted({n / one.x.scale for one in curves for n in one.xs if n})
    first, *_, last = places
    points = 72 * (CURVE.width - CURVE.left - CURVE.right) / (1.1 * math.log(last / first))
    reach = {place: NUMBER_WIDTH * (len(number(place)) + 1) / 2 for place in places}

    def apart(one: float, other: float) -> bool:
        return points * math.log(other / one) >= reach[one] + reach[other]

    kept = [first]
    for place in places[1:-1]:
        if apart(kept[-1], place) and apart(place, last):
            kept.append(place)
    return [*kept, last]


def curve_traces(curves: Sequence[Curve]) -> list[Trace]:
    """Return the lines of a group of curves in display units, followed by their limits. Equal limits occur once."""
    x, y = curves[0].x, curves[0].y
    traces = []
    for index, one in enumerate(curves):
        color, dash = look(index, one.name)
        if len(curves) > len(PALETTE):
            from matplotlib import colormaps
            from matplotlib.colors import to_hex

            # This many lines are legible on a scale from dark to light; neighbours are also distinguished by dashes.
            color = to_hex(colormaps["viridis"](0.88 * index / (len(curves) - 1)))
            dash = (DASH, ())[index % 2]
        step = 1 if one.kind == "sweep" else max(1, math.ceil(len(one.xs) / LOOP_POINTS))
        xs, ys = _display(one.xs, x)[::step], _display(one.ys, y)[::step]
        traces.append(Trace(one.name, color, dash, xs, ys, _wide(index, len(curves)), _expanded(one)))
    limits: dict[tuple[float | None, ...], Trace] = {}
    for one in curves:
        for label, levels in (("lower limit", one.lows), ("upper limit", one.highs)):
            if any(level is not None for level in levels):
                limits.setdefault(
                    tuple(levels), Trace(label, ALARM, DASH, _display(one.xs, x), _display(levels, y), 0.8)
                )
    return traces + list(limits.values())


def _display(numbers: Sequence[float | None], axis: Axis) -> Numbers:
    return np.array([np.nan if n is None else axis.shown(n) for n in numbers])


def _expanded(one: Curve) -> Numbers | None:
    if not one.expanded:
        return None
    return np.array([np.nan if n is None else n / one.y.scale for n in one.expanded])


def _wide(index: int, count: int) -> float:
    """Return the width of a line. Earlier lines are wider, so a line that is covered by another one is visible at its
    edges.
    """
    return 0.9 + 1.5 * (count - 1 - index) / (count - 1) if 1 < count <= MANY_LINES else 1.0


def lateness(name: str, timing: Timing) -> str:
    """Return a histogram of the lateness of ticks. The scale of counts is logarithmic, because the few late ticks are
    important.
    """
    from matplotlib.ticker import LogLocator, NullLocator

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
        heading(axes, "Lateness of the ticks", "", what="number of ticks")
        axes.set_xlabel("µs after the deadline", loc="right")
        return svg(figure, name)


def _microseconds(seconds: float) -> str:
    return (
        f"{seconds * 1e6:,.4g}".replace(",", "\u2009")
        if seconds < 1e-2
        else f"{seconds * 1e6:,.0f}".replace(",", "\u2009")
    )


def _joined(*parts: str) -> str:
    return ", ".join(filter(None, parts))


def _right_of_axes(paper: Sheet, share: float) -> float:
    """Return a horizontal position in points, at ``share`` of the width of the axes. Above 1 it is right
    of the axes.
    """
    return paper.left + share * (paper.right - paper.left)


def look(index: int, label: str) -> tuple[str, tuple[float, ...]]:
    """Return colour and dashes of a line. Lines of the right spring ("right" in ``label``) are dashed; when all colours
    are used, further lines are dotted.
    """
    dash = DASH if "right" in label.split() else DOTS if index >= len(PALETTE) else ()
    return PALETTE[index % len(PALETTE)], dash


def without_common_end(labels: Sequence[str]) -> list[str]:
    """Return the labels without their last word if all have the same one. The title of the panel contains this word."""
    words = [label.split() for label in labels]
    if len(words) > 1 and len({one[-1] for one in words if one}) == 1 and all(len(one) > 1 for one in words):
        return [" ".join(one[:-1]) for one in words]
    return list(labels)


def _side_labels(paper: Sheet, labels: Sequence[str]) -> None:
    """Write the names of the lines right of the axes with a sample of each line. This is easier to read than a
    legend.
    """
    first = paper.top + 0.05 * (paper.bottom - paper.top)
    ends = [_right_of_axes(paper, share) for share in (1.012, 1.042)]
    for index, label in enumerate(labels):
        color, dash = look(index, label)
        down = first + index * 0.165 * 72
        paper.stroke(ends, (down, down), Look(color, 2.0, [0.6 * n for n in dash]))
        paper.write(_right_of_axes(paper, 1.05), down + 8.5 * OF_WORDS, label, size=8.5, color=INK)


def _open_flat_band(up: Range) -> Range:
    """Widen the scale of a nearly constant signal, so that its noise does not fill the panel."""
    low, high = up
    middle, half = (low + high) / 2, 0.01 * max(abs(low), abs(high))
    return (middle - half, middle + half) if high - low < 2 * half else up
