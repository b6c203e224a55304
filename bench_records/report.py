"""The report of a run: one HTML page that stands alone, made from the files in the run's directory and nothing else."""

from __future__ import annotations

import inspect
import math
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from bench_records.circumstances import circumstances
from bench_records.layout import REPORT, RESULT, Phase, RecordedEvent
from bench_records.record import Record, read
from bench_records.result import (
    Check,
    CheckVerdict,
    Curve,
    Outcome,
    Result,
    band_width,
    conclude,
    read_result,
)

if TYPE_CHECKING:
    from bench_records.plots import Line

# The page is for reading; whoever wants more has the record.
EVENT_ROWS = 150
STRIP_STRETCHES = 400
FIGURE_SPACE, PUNCTUATION_SPACE, THIN_SPACE, MINUS = "\u2007", "\u2008", "\u2009", "\u2212"
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
TRIP = "trip"
AROUND_TRIP_S = 10.0
BAR_WIDTH, BAR_HEIGHT = 176.0, 16.0


def write_report(directory: Path | str) -> Path:
    """Write ``report.html`` from the record and the result in a directory; returns its path.

    A run that was cut off has no result: its report says so and shows what was recorded.  The bytes depend on
    the two files alone.  Raises ``RecordError`` if the record cannot be read.
    """
    path = Path(directory) / REPORT
    path.write_text(render(read(directory), _result_or_why(Path(directory))), encoding="utf-8")
    return path


def render(record: Record, result: Result) -> str:
    """The page for a record and a result."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    phases = record.phases or result.phases
    span = (0.0, max(record.duration, result.duration, 1e-3))
    return environment.get_template("report.html.j2").render(
        result=result,
        record=record,
        counts={verdict.value: result.count(verdict) for verdict in CheckVerdict},
        paragraphs=_paragraphs(result.instruction),
        rows=_check_rows(result.checks),
        headline=headline(result),
        circumstances=circumstances(record.meta),
        bar=_bar_svg,
        phases=[(number, phase, _seconds(phase.duration)) for number, phase in _numbered(phases)],
        panels=_panels(record, phases, span),
        strips=_strips(record, phases, span),
        groups=_groups(result.curves),
        timing=_timing(result),
        story=_story(record),
        events=_event_rows(record),
        hidden_events=max(0, len(_told(record)) - EVENT_ROWS),
        facts=_facts(record.meta, result),
        duration=_seconds(span[1]),
        samples=f"{len(record):,}".replace(",", THIN_SPACE),
    )


def _result_or_why(directory: Path) -> Result:
    if (directory / RESULT).exists():
        return read_result(directory)
    meta = read(directory).meta
    plan = str(meta.get("plan", directory.name))
    return conclude(plan, plan, "", [], reason=f"the run was cut off before its end: it left no {RESULT}")


# ---- words and numbers ------------------------------------------------------------------------------------


class Paragraph(NamedTuple):
    """A paragraph of the instruction, or a list if it has items."""

    text: str
    items: list[str]


def _paragraphs(docstring: str) -> list[Paragraph]:
    """The plan's own docstring as paragraphs; lines that begin with an asterisk or a dash make a list."""
    result: list[Paragraph] = []
    for block in inspect.cleandoc(docstring).split("\n\n"):
        text: list[str] = []
        items: list[str] = []
        for line in block.splitlines():
            if line.startswith(("* ", "- ")):
                items.append(line[2:].strip())
            elif items:
                items[-1] += " " + line.strip()
            else:
                text.append(line.strip())
        if text or items:
            result.append(Paragraph(" ".join(text), items))
    return result


def _numbered(phases: list[Phase]) -> list[tuple[str, Phase]]:
    """Phases with the numbers that the strip shows; set-up, main and tear-down carry their names there."""
    numbers = count(1)
    return [(str(next(numbers)) if phase.level else "", phase) for phase in phases]


def _seconds(value: float) -> str:
    return f"{value:.1f}{THIN_SPACE}s"


def _fixed(value: float, decimals: int) -> str:
    if not math.isfinite(value):
        return "\u2013"
    whole, _, fraction = f"{value:,.{decimals}f}".partition(".")
    text = whole.replace(",", THIN_SPACE) + (f".{fraction}" if fraction else "")
    return text.replace("-", MINUS)


def _aligned(text: str, most: int) -> str:
    """Padded on the right, so that decimal points stand under each other in a right-aligned column."""
    _, point, fraction = text.partition(".")
    return text + ("" if point or not most else PUNCTUATION_SPACE) + FIGURE_SPACE * (most - len(fraction))


def _is_scientific(text: str) -> bool:
    return "\u00b7" in text


def _scientific(value: float, decimals: int) -> str:
    if not math.isfinite(value):
        return "\u2013"
    mantissa, _, exponent = f"{value:.{decimals}e}".partition("e")
    return mantissa.replace("-", MINUS) + "\u00b710" + str(int(exponent)).translate(SUPERSCRIPT)


def _figures(one: Check) -> list[str]:
    """Value, low and high in the check's unit, all with as many digits as tell them apart.

    A hundredth of the band is resolved: more would be noise, fewer would hide a verdict.
    """
    numbers = [math.nan if n is None else n / one.scale for n in (one.number, one.low, one.high)]
    known = [n for n in numbers if math.isfinite(n)]
    largest = max((abs(n) for n in known), default=0.0)
    show = _fixed
    if not one.unit and all(n == round(n) for n in known):
        decimals = 0  # a count
    elif largest and not 1e-4 <= largest < 1e7:
        show, decimals = _scientific, 3
    else:
        width = band_width(one.low, one.high) / one.scale or largest or 1.0
        decimals = min(6, max(0, math.ceil(-math.log10(width / 100) - 1e-9)))
    # A failed value must not be rounded onto its limit.
    while one.verdict is CheckVerdict.FAIL and decimals < 15:
        shown = [show(n, decimals) for n in numbers]
        if shown[0] not in shown[1:]:
            break
        decimals += 1
    return [show(n, decimals) for n in numbers]


# ---- checks -----------------------------------------------------------------------------------------------

COLORS = {
    CheckVerdict.PASS: "#00694e",
    CheckVerdict.MARGINAL: "#b87a00",
    CheckVerdict.FAIL: "#a8201a",
    CheckVerdict.ERROR: "#5b3f8c",
}
SIGNS = {
    CheckVerdict.PASS: "\u2713",
    CheckVerdict.MARGINAL: "\u25b2",
    CheckVerdict.FAIL: "\u2715",
    CheckVerdict.ERROR: "?",
}


class CheckRow(NamedTuple):
    """A check as the table shows it."""

    check: Check
    sign: str
    value: str
    low: str
    high: str
    bar: Bar


class Bar(NamedTuple):
    """A range bar in drawing units: the band, its marginal ends, and where the value lies."""

    left: float
    right: float
    inner_left: float
    inner_right: float
    place: float | None
    beyond: int
    open_left: bool
    open_right: bool


def _check_rows(checks: list[Check]) -> list[CheckRow]:
    figures = [_figures(one) for one in checks]
    decimals = [len(text.partition(".")[2]) for row in figures for text in row if not _is_scientific(text)]
    most = max(decimals, default=0)
    rows = []
    for one, texts in zip(checks, figures, strict=True):
        value, low, high = (text if _is_scientific(text) else _aligned(text, most) for text in texts)
        rows.append(CheckRow(one, SIGNS[one.verdict], value, low, high, _bar(one)))
    return rows


def _bar(one: Check) -> Bar:
    """The band fills the middle; a side without a limit runs out of the picture."""
    margin = one.margin * band_width(one.low, one.high)
    if one.low is not None and one.high is not None:
        width = one.high - one.low or abs(one.high) or 1.0
        start, end = one.low - 0.22 * width, one.high + 0.22 * width
    else:
        limit = one.low if one.low is not None else one.high
        assert limit is not None  # a check has a limit, or it could not have been made
        reach = max(abs(limit), abs(one.number - limit) if math.isfinite(one.number) else 0.0) or 1.0
        start, end = (
            (limit - 0.45 * reach, limit + 1.1 * reach)
            if one.low is not None
            else (limit - 1.1 * reach, limit + 0.45 * reach)
        )

    def place(value: float) -> float:
        return BAR_WIDTH * (value - start) / (end - start)

    left = 0.0 if one.low is None else place(one.low)
    right = BAR_WIDTH if one.high is None else place(one.high)
    at = place(one.number) if math.isfinite(one.number) else None
    beyond = 0 if at is None else (at > BAR_WIDTH - 5) - (at < 5)
    return Bar(
        left=left,
        right=right,
        inner_left=left if one.low is None else place(one.low + margin),
        inner_right=right if one.high is None else place(one.high - margin),
        place=None if at is None else min(max(at, 5.0), BAR_WIDTH - 5),
        beyond=beyond,
        open_left=one.low is None,
        open_right=one.high is None,
    )


def _bar_svg(row: CheckRow) -> Any:
    """The range bar as an element; drawn by hand, since dozens of them must cost nothing."""
    from markupsafe import Markup

    bar, middle = row.bar, BAR_HEIGHT / 2
    color = COLORS[row.check.verdict]
    parts = [
        f'<line x1="0" x2="{BAR_WIDTH:g}" y1="{middle:g}" y2="{middle:g}" stroke="#dfe3e7"/>',
        _rectangle(bar.left, bar.right, "#d3dae0"),
        *(
            _hatched(start, end)
            for start, end in ((bar.left, bar.inner_left), (bar.inner_right, bar.right))
            if end - start > 0.5
        ),
        *(
            f'<line x1="{at:.1f}" x2="{at:.1f}" y1="2" y2="{BAR_HEIGHT - 2:g}" stroke="#5b6670"/>'
            for at, absent in ((bar.left, bar.open_left), (bar.right, bar.open_right))
            if not absent
        ),
    ]
    if bar.place is not None and bar.beyond:
        tip = 5.0 * bar.beyond
        parts.append(
            f'<path d="M{bar.place - tip:.1f} {middle - 5:g}l{2 * tip:.1f} 5l{-2 * tip:.1f} 5z" fill="{color}"/>'
        )
    elif bar.place is not None:
        parts.append(
            f'<path d="M{bar.place:.1f} {middle - 6:g}l4.5 6l-4.5 6l-4.5 -6z" fill="{color}" stroke="#fff"/>'
        )
    size = f'width="{BAR_WIDTH:g}" height="{BAR_HEIGHT:g}" viewBox="0 0 {BAR_WIDTH:g} {BAR_HEIGHT:g}"'
    return Markup(f'<svg class="bar" {size} role="img">{"".join(parts)}</svg>')


def _rectangle(start: float, end: float, color: str) -> str:
    y = BAR_HEIGHT / 2 - 3
    return f'<rect x="{start:.1f}" y="{y:g}" width="{max(end - start, 1):.1f}" height="6" fill="{color}"/>'


def _hatched(start: float, end: float) -> str:
    """Amber with slanted strokes: a marginal zone that survives a black-and-white copy."""
    low, pitch = BAR_HEIGHT / 2 + 3, 2.4
    strokes = "".join(
        f"M{start + pitch * i:.1f} {low:g}l{pitch:g} -6" for i in range(max(1, int((end - start) / pitch)))
    )
    zone = _rectangle(start, end, "#f3d28a")
    return f'{zone}<path d="{strokes}" stroke="#8f5a00" stroke-width="0.8" fill="none"/>'


# ---- drawings ---------------------------------------------------------------------------------------------


def _panels(record: Record, phases: list[Phase], span: tuple[float, float]) -> list[str]:
    from bench_records.plots import time_panel

    finest = max((phase.level for phase in phases), default=0)
    shaded = [phase for phase in phases if phase.level == finest]
    trips = [record.time_of(event) for event in record.events if event.kind == TRIP][:1]
    return [
        time_panel(f"time{index}", quantity, unit, lines, shaded, span, trips)
        for index, (quantity, unit, lines) in enumerate(_quantities(record, list(record.signals)))
    ]


def _quantities(record: Record, names: list[str]) -> list[tuple[str, str, list[Line]]]:
    """Drawn signals by quantity, in the order of the table of signals; one unit to a panel."""
    from bench_records.plots import Line

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


def _strips(record: Record, phases: list[Phase], span: tuple[float, float]) -> str:
    import numpy as np

    from bench_records.plots import strips

    rows: list[tuple[str, list[tuple[float, float, str]]]] = []
    for level in sorted({phase.level for phase in phases}):
        label = "part" if level == 0 else "phase"
        rows.append(
            (
                label,
                [
                    (phase.start, phase.end, number or phase.name)
                    for number, phase in _numbered(phases)
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


class Group(NamedTuple):
    """Curves that share a plot, and for sweeps the table of their numbers."""

    drawing: str
    title: str
    columns: list[str]
    rows: list[list[str]]


def _groups(curves: list[Curve]) -> list[Group]:
    from bench_records.plots import curve_panel

    groups: dict[tuple[str, Any, Any, str], list[Curve]] = {}
    for one in curves:
        groups.setdefault((one.group or one.name, one.x, one.y, one.kind), []).append(one)
    return [
        Group(curve_panel(f"curve{index}", title, members), title, *_sweep_table(members))
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
    show, decimals = _fixed, max(0, 2 - math.floor(math.log10(largest)))
    if not 1e-4 <= largest < 1e7:
        show, decimals = _scientific, 3
    return ["\u2013" if n is None else show(n / scale, decimals) for n in numbers]


# ---- timing, events, facts --------------------------------------------------------------------------------


def _timing(result: Result) -> dict[str, Any] | None:
    from bench_records.plots import lateness

    timing = result.timing
    if timing is None:
        return None
    figures = [
        ("ticks", f"{timing.ticks:,}".replace(",", THIN_SPACE)),
        ("late", f"{timing.late:,}".replace(",", THIN_SPACE)),
    ]
    if timing.period is not None:
        figures.append(("period", f"{timing.period * 1e3:g}{THIN_SPACE}ms"))
    for name, value in (("median", timing.p50), ("99th percentile", timing.p99), ("worst", timing.max)):
        if value is not None:
            figures.append((name, f"{_fixed(value * 1e6, 0 if value > 1e-4 else 1)}{THIN_SPACE}µs"))
    return {
        "figures": figures,
        "late": timing.late,
        "measured": timing.max is not None or bool(timing.counts),
        "drawing": lateness("lateness", timing) if timing.counts and timing.edges else "",
    }


def _told(record: Record) -> list[RecordedEvent]:
    """Events for the table: phases have one of their own, and settings are for whoever replays the run."""
    return [event for event in record.events if event.kind not in {"phase", "setting"}]


def _event_rows(record: Record) -> list[tuple[str, str, str, str]]:
    return [
        (_fixed(record.time_of(event), 3), event.kind, event.text, _details(event.data))
        for event in sorted(_told(record), key=lambda event: event.time_ns)[:EVENT_ROWS]
    ]


def _details(data: dict[str, Any]) -> str:
    return ", ".join(f"{key} = {_plain(value)}" for key, value in data.items())


def _story(record: Record) -> dict[str, Any] | None:
    """Which limit tripped first, what followed, and the signals around it: the first cause, not the last symptom."""
    from bench_records.plots import time_panel

    events = sorted(record.events, key=lambda event: event.time_ns)
    trips = [event for event in events if event.kind == TRIP]
    if not trips:
        return None
    first = trips[0]
    at = record.time_of(first)
    sentences = [f"First out: {first.text} at {_fixed(at, 3)}{THIN_SPACE}s."]
    followers = [event for event in events if first.time_ns <= event.time_ns and event is not first]
    followers = [event for event in followers if event.kind in {TRIP, "state"}]
    near = [event for event in followers if record.time_of(event) - at <= AROUND_TRIP_S]
    if near:
        told = "; ".join(
            f"{_fixed((event.time_ns - first.time_ns) / 1e6, 0)}{THIN_SPACE}ms later {event.text}"
            for event in near[:6]
        )
        more = f"; and {len(near) - 6} more" if len(near) > 6 else ""
        sentences.append(f"Then {told}{more}.")
    else:
        sentences.append(
            f"Nothing else tripped or changed state in the {AROUND_TRIP_S:.0f}{THIN_SPACE}s after it."
        )
    name = first.data.get("signal")
    drawing = ""
    if name in record.signals and record.signals[name].quantity:
        span = (max(0.0, at - AROUND_TRIP_S), min(record.duration, at + AROUND_TRIP_S))
        for quantity, unit, lines in _quantities(record, [name]):
            near_lines = [
                line._replace(times=line.times[inside], values=line.values[inside])
                for line in lines
                for inside in [(line.times >= span[0]) & (line.times <= span[1])]
            ]
            marks = [record.time_of(event) for event in trips if span[0] <= record.time_of(event) <= span[1]]
            drawing = time_panel(
                "first-out", f"{quantity} around the trip", unit, near_lines, [], span, marks[:1]
            )
    return {"sentences": sentences, "drawing": drawing}


def _facts(meta: dict[str, Any], result: Result) -> list[tuple[str, str]]:
    """What is needed to run this again: flat, in order, each fact once."""
    facts: dict[str, Any] = {"plan": result.plan, "rig": result.rig, "seed": result.seed, **meta}
    return [
        (name.replace("_", " "), text)
        for key in facts
        for name, text in _flattened(key, facts[key])
        if text and not (key == "rig" and not text)
    ]


def _flattened(key: str, value: Any) -> list[tuple[str, str]]:
    if isinstance(value, dict):
        return [pair for inner, below in value.items() for pair in _flattened(f"{key} \u203a {inner}", below)]
    return [(key, "" if value is None else _plain(value))]


def _plain(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}".replace("-", MINUS)
    if isinstance(value, list):
        return ", ".join(_plain(one) for one in value)
    return str(value)


def headline(result: Result) -> str:
    """The verdict in a sentence."""
    if result.verdict is Outcome.BLOCKED:
        return result.reason
    total = len(result.checks)
    noun = "check" if total == 1 else "checks"
    if result.verdict is Outcome.FAIL:
        return f"{result.count(CheckVerdict.FAIL)} of {total} {noun} outside the limits"
    marginal = result.count(CheckVerdict.MARGINAL)
    return f"{total} {noun} within the limits" + (f", {marginal} of them close to one" if marginal else "")
