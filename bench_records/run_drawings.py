"""What of a run is drawn: its phases and states as strips, its signals in panels, the curves that the plan kept."""

from __future__ import annotations

import math
from itertools import count
from typing import TYPE_CHECKING, Any, NamedTuple

from bench_records.layout import Phase
from bench_records.record import Record
from bench_records.result import Curve
from bench_records.typography import fixed, scientific

if TYPE_CHECKING:
    from bench_records.report_plots import Line

STRIP_STRETCHES = 400
#: The kind of event that tells of a limit that tripped.
TRIP = "trip"


def numbered(phases: list[Phase]) -> list[tuple[str, Phase]]:
    """Phases with the numbers that the strip shows; set-up, main and tear-down carry their names there."""
    numbers = count(1)
    return [(str(next(numbers)) if phase.level else "", phase) for phase in phases]


def time_panels(record: Record, phases: list[Phase], span: tuple[float, float]) -> list[str]:
    """A drawing over ``span`` (s) for each quantity: phases of the finest level shaded, the first trip marked."""
    from bench_records.report_plots import time_panel

    finest = max((phase.level for phase in phases), default=0)
    shaded = [phase for phase in phases if phase.level == finest]
    trips = [record.time_of(event) for event in record.events if event.kind == TRIP][:1]
    return [
        time_panel(f"time{index}", quantity, unit, lines, shaded, span, trips)
        for index, (quantity, unit, lines) in enumerate(lines_by_quantity(record, list(record.signals)))
    ]


def lines_by_quantity(record: Record, names: list[str]) -> list[tuple[str, str, list[Line]]]:
    """Drawn signals by quantity, in the order of the table of signals; one unit to a panel."""
    from bench_records.report_plots import Line

    panels: dict[tuple[str, str], list[Line]] = {}
    for name in names:
        signal = record.signals[name]
        if not signal.quantity or signal.names:
            continue
        times, values = record.series(name)
        if times.size:
            lines = panels.setdefault((signal.quantity, signal.unit), [])
            lines.append(Line(signal.title, times, values / signal.scale))
    return [(quantity, unit, lines) for (quantity, unit), lines in panels.items()]


def phase_strips(record: Record, phases: list[Phase], span: tuple[float, float]) -> str:
    """The phases, level by level, and the signals whose values have names, over ``span`` (s)."""
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


class CurveGroup(NamedTuple):
    """Curves that share a plot, and for sweeps the table of their numbers."""

    drawing: str
    title: str
    columns: list[str]
    rows: list[list[str]]


def curve_groups(curves: list[Curve]) -> list[CurveGroup]:
    """A plot for each group of curves that share their axes, in the order in which they were kept."""
    from bench_records.report_plots import curve_panel

    groups: dict[tuple[str, Any, Any, str], list[Curve]] = {}
    for one in curves:
        groups.setdefault((one.group or one.name, one.x, one.y, one.kind), []).append(one)
    return [
        CurveGroup(curve_panel(f"curve{index}", title, members), title, *_sweep_table(members))
        for index, ((title, _, _, _), members) in enumerate(groups.items())
    ]


def _sweep_table(curves: list[Curve]) -> tuple[list[str], list[list[str]]]:
    """Rows of numbers for sweeps over the same points; loops have too many to print."""
    if curves[0].kind != "sweep" or any(one.xs != curves[0].xs for one in curves):
        return [], []
    x, y = curves[0].x, curves[0].y
    head = [", ".join(filter(None, [x.label, x.unit]))] + [
        ", ".join(filter(None, [one.name, y.unit])) for one in curves
    ]
    columns = [_column(curves[0].xs, x.scale), *(_column(one.ys, y.scale) for one in curves)]
    return head, [list(row) for row in zip(*columns, strict=True)]


def _column(numbers: list[float | None], scale: float) -> list[str]:
    largest = max((abs(n / scale) for n in numbers if n), default=1.0)
    show, decimals = fixed, max(0, 2 - math.floor(math.log10(largest)))
    if not 1e-4 <= largest < 1e7:
        show, decimals = scientific, 3
    return ["\u2013" if n is None else show(n / scale, decimals) for n in numbers]
