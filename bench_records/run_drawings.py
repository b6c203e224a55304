"""The drawings of a run: phases and states as strips, signals in panels, and the curves of the plan."""

from __future__ import annotations

import math
from itertools import count
from typing import TYPE_CHECKING, Any, NamedTuple

from markupsafe import Markup

from bench_records.curves import Axis, Curve
from bench_records.document import element, joined
from bench_records.layout import Phase
from bench_records.plot_data import Plot, Trace
from bench_records.record import Record
from bench_records.typography import fixed, primed, scientific, seconds, unit

if TYPE_CHECKING:
    from bench_records.report_plots import Series

STRIP_STRETCHES = 400
#: Largest number of columns next to the first one; more are not legible on paper.
TABLE_COLUMNS = 8
#: Resolution for the zoom into the signals of a run: number of stretches with two points each.
FINE = 4000
#: The kind of event that reports a tripped limit.
TRIP = "trip"


def numbered(phases: list[Phase]) -> list[tuple[str, Phase]]:
    """Return pairs of a phase's number in the drawing of the phases, and the phase. Set-up, main and tear-down have ""
    instead of a number.
    """
    numbers = count(1)
    return [(str(next(numbers)) if phase.level else "", phase) for phase in phases]


def phase_list(phases: list[Phase]) -> Markup:
    """Return a list of the numbers, names and durations of phases, or empty markup if there are none."""
    lines = [
        element("span", number, "no")
        + element("span", phase.name, "" if phase.level else "part")
        + element("span", seconds(phase.duration), "time")
        for number, phase in numbered(phases)
    ]
    return element("ol", joined(element("li", one) for one in lines), "phases") + "\n" if lines else Markup()


class Drawn(NamedTuple):
    """A drawing as a picture, and its numbers for the zoom."""

    picture: str
    plot: Plot


def time_panels(record: Record, phases: list[Phase], span: tuple[float, float]) -> list[Drawn]:
    """Return a drawing over the time ``span`` (s) for each quantity. Every second phase of the deepest level is shaded,
    and the first trip is marked.
    """
    from bench_records.report_plots import time_panel

    finest = max((phase.level for phase in phases), default=0)
    shaded = [phase for phase in phases if phase.level == finest]
    trips = [record.time_of(event) for event in record.events if event.kind == TRIP][:1]
    shades = [(phase.start, phase.end) for phase in shaded[::2]]
    return [
        Drawn(
            time_panel(f"time{index}", quantity, measured_in, lines, shaded, span, trips),
            Plot("time", quantity, "time, s", unit(measured_in), _fine(lines), shades=shades, marks=trips),
        )
        for index, (quantity, measured_in, lines) in enumerate(
            lines_by_quantity(record, list(record.signals))
        )
    ]


def _fine(lines: list[Series]) -> list[Trace]:
    from bench_records.report_plots import envelope, look

    return [
        Trace(line.label, *look(index, line.label), *envelope(line.times, line.values, FINE))
        for index, line in enumerate(lines)
    ]


def lines_by_quantity(record: Record, names: list[str]) -> list[tuple[str, str, list[Series]]]:
    """Return quantity, unit and lines of each panel, in the order of ``names``. A panel has one quantity and one unit.
    Signals without a quantity or samples, or with named values, are left out.
    """
    from bench_records.report_plots import Series

    panels: dict[tuple[str, str], list[Series]] = {}
    for name in names:
        signal = record.signals[name]
        if not signal.quantity or signal.names:
            continue
        times, values = record.series(name)
        if times.size:
            lines = panels.setdefault((signal.quantity, signal.shown_unit), [])
            lines.append(Series(signal.title, times, signal.shown(values)))
    return [(quantity, unit, lines) for (quantity, unit), lines in panels.items()]


def phase_strips(record: Record, phases: list[Phase], span: tuple[float, float]) -> str:
    """Return a drawing over the time ``span`` (s) of the phases by level, and of the signals whose values
    have names.
    """
    import numpy as np

    from bench_records.report_plots import strips

    rows: list[tuple[str, list[tuple[float, float, str]]]] = []
    for level in sorted({phase.level for phase in phases}):
        label = "part" if level == 0 else "phase"
        rows.append(
            (
                label,
                [
                    (phase.start, phase.end, number or phase.name)
                    for number, phase in numbered(phases)
                    if phase.level == level
                ],
            )
        )
    for signal in record.signals.values():
        if not signal.names:
            continue
        times, values = record.series(signal.name)
        if not times.size:
            continue
        changes = np.concatenate(([0], np.flatnonzero(np.diff(values)) + 1))[:STRIP_STRETCHES]
        ends = np.append(times[changes[1:]], times[-1])
        words = [
            signal.names.get(int(value), f"{value:g}") if math.isfinite(value) else "\u2013"
            for value in values[changes]
        ]
        rows.append((signal.title, list(zip(times[changes].tolist(), ends.tolist(), words, strict=True))))
    return strips("strips", rows, span) if rows else ""


class Table(NamedTuple):
    """A table of sweeps over the same points: headings, and values as text."""

    columns: list[str]
    rows: list[list[str]]


def curve_plots(curves: list[Curve]) -> list[Drawn]:
    """Return a plot for each group of curves that share their axes, in the stored order."""
    from bench_records.report_plots import curve_panel, curve_traces, is_over_decades, labelled_frequencies

    groups: dict[tuple[str, Axis, Axis, Any], list[Curve]] = {}
    for one in curves:
        groups.setdefault((one.group or one.name, one.x, one.y, one.kind), []).append(one)
    found = []
    for index, ((title, x, y, kind), members) in enumerate(groups.items()):
        named, over_decades = primed(title), is_over_decades(members)
        ticks = labelled_frequencies(members) if over_decades else ()
        plot = Plot(kind, named, _titled(x), _titled(y), curve_traces(members), over_decades, ticks=ticks)
        found.append(Drawn(curve_panel(f"curve{index}", named, members), plot))
    return found


def _titled(axis: Axis) -> str:
    return ", ".join(filter(None, [primed(axis.label), unit(axis.unit)]))


def curve_tables(curves: list[Curve]) -> list[Table]:
    """Return tables of all sweeps. Sweeps with the same points are side by side. Loops have too many points for a
    table.
    """
    over: dict[tuple[Axis, tuple[float | None, ...]], list[Curve]] = {}
    for one in curves:
        if one.kind == "sweep":
            over.setdefault((one.x, tuple(one.xs)), []).append(one)
    tables = []
    for (x, xs), members in over.items():
        for first in range(0, len(members), TABLE_COLUMNS):
            part = members[first : first + TABLE_COLUMNS]
            columns = [_column(list(xs), x), *(_column(one.ys, one.y) for one in part)]
            heads = [_titled(x), *(f"{one.name}: {_titled(one.y)}" for one in part)]
            tables.append(Table(heads, [list(row) for row in zip(*columns, strict=True)]))
    return tables


def _column(values: list[float | None], axis: Axis) -> list[str]:
    numbers = [None if n is None else axis.shown(n) for n in values]
    largest = max((abs(n) for n in numbers if n), default=1.0)
    show, decimals = fixed, max(0, 2 - math.floor(math.log10(largest)))
    if not 1e-4 <= largest < 1e7:
        show, decimals = scientific, 3
    return ["\u2013" if n is None else show(n, decimals) for n in numbers]
