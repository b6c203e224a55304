"""The page of a rehearsal: limits by remaining margin, the envelope, and curves with their limits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from markupsafe import Markup

from astb.rehearsal.envelope import Extreme
from astb.rehearsal.rehearsing import LimitMargin, Rehearsal
from bench_protocol.units import litre
from bench_records.disk import kept
from bench_records.document import (
    Banner,
    Cell,
    Document,
    bullets,
    caption,
    drawing,
    section,
    table,
)
from bench_records.layout import ICE
from bench_records.record import Record, read
from bench_records.report_plots import time_panel
from bench_records.run_drawings import lines_by_quantity, phase_list, phase_strips
from bench_records.run_folder import circumstances
from bench_records.typography import THIN_SPACE, fixed, seconds, unit

PAGE: Final = "rehearsal.html"
#: A reading needs no line if its longest gap is shorter than a tenth of the permitted one.
_TOLD_FROM: Final = 0.1
_PLACES: Final = ("lower", "upper")


_STYLE: Final = """\
.banner.clear { --tone: var(--pass); } .banner.refused { --tone: var(--fail); }
.used { position: relative; min-width: 7rem; } .used span { position: relative; }
.used i { position: absolute; left: 0; top: .3rem; bottom: .3rem; background: var(--part); }
"""


def write_page(found: Rehearsal, directory: Path) -> Path:
    """Write ``rehearsal.html`` from the rehearsal and the record in ``directory``; return its path.

    Raises RecordError if the record cannot be read or the page not written.
    """
    record = read(directory)
    span = (0.0, max(record.duration, 1e-3))
    notes = [
        *found.notes,
        *(f"warning only, the plan continues: {one}" for one in found.indicated),
    ]
    blocked = found.verdict.value == "blocked"
    ended = f"the plan would end without a verdict: {found.reason}"
    finished = f"verdict on the simulated spring: {found.verdict.value}"
    page = Document(
        f"{found.plan}, rehearsed: {word(found)}",
        f"Rehearsal · {found.plan}",
        [
            *([section("Notes on the simulation", bullets(notes))] if notes else []),
            _limits(found),
            _envelope(found.envelope),
            section(
                "Curves with limits",
                drawing(phase_strips(record, record.phases, span)),
                phase_list(record.phases),
                *map(drawing, _panels(record, found, span)),
                caption(
                    "Red lines are limits. The dashed line is the time of the first trip."
                    if found.refusal
                    else "Red lines are limits."
                ),
            ),
        ],
        heading=found.title,
        circumstances=circumstances(record.meta),
        banner=Banner(word(found), sentence(found), ended if blocked else finished),
        facts=(
            ("duration", seconds(found.duration)),
            ("air consumption (0 °C, 1013 mbar)", f"{fixed(found.air / litre, 0)}{THIN_SPACE}l"),
            ("rig", found.rig),
            ("parameters of the simulation", found.model),
            *((name.replace("_", " "), text) for name, text in found.parameters.items()),
        ),
        style=_STYLE,
    )
    path = directory / PAGE
    with kept(path):
        path.write_text(page.html(), encoding="utf-8", newline="\n")
    return path


def _limits(found: Rehearsal) -> Markup:
    rows = [row for row in found.limits if row.kind != "timeout" or row.used >= _TOLD_FROM]
    silent = len(found.limits) - len(rows)
    note = (
        "“First” is the first reading. “Closest” is the value nearest to the limit that lasted long enough to trip it. "
        "If the rig limits a predicted value, “closest” is the prediction. “Used” is 0 % at the first reading and "
        "100 % at the limit."
    )
    if found.refusal:
        note += " Readings after the end of the plan do not count."
    if silent:
        note += f" {silent} limits on the age of readings are not listed, because each used less than 10 %."
    heads = (
        "limited reading | first :n | closest :n value | limit :n | used | phase and time | action | source"
    )
    return section("Limits, the closest first", table(heads, map(_limit_row, rows)), caption(note))


def _envelope(extremes: Sequence[Extreme]) -> Markup:
    heads = "reading | lowest :n value | phase | highest :n value | phase | unit :u"
    note = "The readings include the noise of the transducers. Speeds are differences over 20 ms."
    return section("Extremes of the readings", table(heads, map(_extreme_row, extremes)), caption(note))


def word(found: Rehearsal) -> str:
    """Return the result of the rehearsal in one word."""
    if found.refusal:
        return "refused"
    return "blocked" if found.verdict.value == "blocked" else "clear"


def sentence(found: Rehearsal) -> str:
    """Return the result as a sentence: the limit that would trip and its place, or the closest limit."""
    if found.refusal:
        one = found.refusal
        return f"{one.words}, in {one.step or 'no step'} at {one.time:.2f} s"
    if found.verdict.value == "blocked":
        return found.reason
    row = found.limits[0]
    return (
        f"no limit trips; the smallest margin is at {_named(row)}, {row.limit}: the closest value is {row.closest}, "
        f"in {row.step or 'no step'} at {row.time:.2f} s"
    )


def limit_line(row: LimitMargin) -> str:
    """Return a line of text on a limit, and on how close the plan came to it."""
    began = f" from {row.began}" if row.began else ""
    where = f" in {row.step} at {row.time:.2f} s" if row.closest and row.step else ""
    return (
        f"{100 * row.used:3.0f} % of the way{began} to {_named(row)}, {row.limit}: {row.closest or 'never'}{where}; "
        f"action: {row.action} (source: {row.source})"
    )


def _named(row: LimitMargin) -> str:
    kind = f"{row.kind} limit" if row.kind in _PLACES else row.kind
    return f"{row.signal.replace('.', ' ').replace('_', ' ')}, {kind}"


def _limit_row(row: LimitMargin) -> tuple[object, ...]:
    used = f"{fixed(100 * row.used, 0)}{THIN_SPACE}%"
    when = f"{row.step}, {seconds(row.time)}" if row.closest and row.step else ""
    bar = Markup('<i style="width: {}%"></i><span>{}</span>').format(
        round(min(100 * row.used, 100.0), 1), used
    )
    ends = (row.began or "–", row.closest or "–", row.limit)
    return (_named(row), *ends, Cell(bar, "used"), when, row.action, row.source)


def _extreme_row(one: Extreme) -> tuple[str, ...]:
    name = one.signal.replace(".", " ").replace("_", " ") + (", speed" if one.is_speed else "")
    is_warmth = one.unit == "K" and not one.is_speed
    low, high = ((end - (ICE if is_warmth else 0.0)) / one.scale for end in (one.low, one.high))
    digits = 0 if max(abs(low), abs(high)) >= 1000 else 1 if max(abs(low), abs(high)) >= 10 else 2
    measured_in = unit("degC" if is_warmth else one.unit)
    return (name, fixed(low, digits), one.low_in, fixed(high, digits), one.high_in, measured_in)


def _panels(record: Record, found: Rehearsal, span: tuple[float, float]) -> list[str]:
    """Return a drawing for each quantity with a limit, with its limits and the time of the first trip."""
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
