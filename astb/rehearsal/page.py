"""The page of a rehearsal: limits by what is left of them, the envelope, and curves with their limits drawn in."""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple

from astb.rehearsal.envelope import Extreme
from astb.rehearsal.rehearsing import LimitMargin, Rehearsal
from bench_protocol.units import litre
from bench_records.disk import kept
from bench_records.layout import ICE
from bench_records.record import Record, read
from bench_records.report_plots import time_panel
from bench_records.run_drawings import lines_by_quantity, numbered, phase_strips
from bench_records.run_folder import circumstances
from bench_records.templates import template
from bench_records.typography import THIN_SPACE, fixed, seconds, unit

PAGE: Final = "rehearsal.html"
#: A reading that was never missing for a tenth of what is allowed needs no line.
_TOLD_FROM: Final = 0.1
_PLACES: Final = ("lower", "upper")


class _LimitRow(NamedTuple):
    name: str
    row: LimitMargin
    used: str
    width: float  #: of its bar, in per cent
    when: str


class _ExtremeRow(NamedTuple):
    name: str
    unit: str
    low: str
    low_in: str
    high: str
    high_in: str


def write_page(found: Rehearsal, directory: Path) -> Path:
    """Write ``rehearsal.html`` from what was found and the record in ``directory``; return its path.

    RecordError if the record cannot be read or the page not written.
    """
    record = read(directory)
    span = (0.0, max(record.duration, 1e-3))
    rows = [row for row in found.limits if row.kind != "timeout" or row.used >= _TOLD_FROM]
    text = template("rehearsal.html.j2", Path(__file__).parent).render(
        found=found,
        word=word(found),
        sentence=sentence(found),
        circumstances=circumstances(record.meta),
        limits=[_limit_row(row) for row in rows],
        silent=len(found.limits) - len(rows),
        extremes=[_extreme_row(one) for one in found.envelope],
        air=f"{fixed(found.air / litre, 0)}{THIN_SPACE}l",
        duration=seconds(found.duration),
        strips=phase_strips(record, record.phases, span),
        phases=[(number, phase, seconds(phase.duration)) for number, phase in numbered(record.phases)],
        panels=_panels(record, found, span),
    )
    path = directory / PAGE
    with kept(path):
        path.write_text(text, encoding="utf-8", newline="\n")
    return path


def word(found: Rehearsal) -> str:
    """Return in a word or two how the rehearsal ended."""
    if found.refusal:
        return "refused"
    return "blocked" if found.verdict.value == "blocked" else "clear"


def sentence(found: Rehearsal) -> str:
    """Return in a sentence what came of it: what would trip where, or which limit came closest."""
    if found.refusal:
        one = found.refusal
        return f"{one.words}; in {one.step or 'no step'} at {one.time:.2f} s"
    if found.verdict.value == "blocked":
        return found.reason
    row = found.limits[0]
    return (
        f"no limit trips; closest to one is {_named(row)}: {row.closest} of {row.limit}, "
        f"in {row.step or 'no step'} at {row.time:.2f} s"
    )


def limit_line(row: LimitMargin) -> str:
    """Return a limit and how close it came, in a line of text."""
    began = f" from {row.began}" if row.began else ""
    where = f" in {row.step} at {row.time:.2f} s" if row.closest and row.step else ""
    return (
        f"{100 * row.used:3.0f} % of the way{began} to {_named(row)} {row.limit}: {row.closest or 'never'}{where} "
        f"→ {row.action} ({row.source})"
    )


def _named(row: LimitMargin) -> str:
    return f"{row.signal.replace('.', ' ').replace('_', ' ')}, {row.kind}"


def _limit_row(row: LimitMargin) -> _LimitRow:
    used = f"{fixed(100 * row.used, 0)}{THIN_SPACE}%"
    when = f"{row.step}, {seconds(row.time)}" if row.closest and row.step else ""
    return _LimitRow(_named(row), row, used, round(min(100 * row.used, 100.0), 1), when)


def _extreme_row(one: Extreme) -> _ExtremeRow:
    name = one.signal.replace(".", " ").replace("_", " ") + (", speed" if one.is_speed else "")
    is_warmth = one.unit == "K" and not one.is_speed
    low, high = ((end - (ICE if is_warmth else 0.0)) / one.scale for end in (one.low, one.high))
    digits = 0 if max(abs(low), abs(high)) >= 1000 else 1 if max(abs(low), abs(high)) >= 10 else 2
    return _ExtremeRow(
        name,
        unit("degC" if is_warmth else one.unit),
        fixed(low, digits),
        one.low_in,
        fixed(high, digits),
        one.high_in,
    )


def _panels(record: Record, found: Rehearsal, span: tuple[float, float]) -> list[str]:
    """Return a drawing for each quantity that has a limit, with its limits in it, and when the first one trips."""
    limited = list(dict.fromkeys(row.signal for row in found.limits))
    finest = max((phase.level for phase in record.phases), default=0)
    shaded = [phase for phase in record.phases if phase.level == finest]
    marks = [found.refusal.time] if found.refusal else []
    names = [name for name in record.signals if name in limited]
    panels = []
    for index, (quantity, measured_in, lines) in enumerate(lines_by_quantity(record, names)):
        of = {name: record.signals[name] for name in names if record.signals[name].quantity == quantity}
        levels = sorted(
            {of[row.signal].shown(row.at) for row in found.limits if row.signal in of and row.kind in _PLACES}
        )
        panels.append(time_panel(f"time{index}", quantity, measured_in, lines, shaded, span, marks, levels))
    return panels
