"""The report of a run: one self-contained HTML page, made only from the files in the directory of the run."""

from __future__ import annotations

import inspect
import os
from pathlib import Path
from typing import Any, Final, NamedTuple

from bench_records.check_table import CheckRow, bar_drawing, check_rows, meanings
from bench_records.conformity import percent
from bench_records.disk import kept
from bench_records.event_table import EVENT_ROWS, event_rows, first_trip, tabled_events
from bench_records.incident import incident_of
from bench_records.layout import REPORT, RESULT, put
from bench_records.letterhead import CHOSEN, Letterhead, read_letterhead
from bench_records.notes import notes_of
from bench_records.plot_data import PlotData, asset, embedded
from bench_records.record import Record, read
from bench_records.replay import replay_of
from bench_records.result import Check, CheckVerdict, Outcome, Result, read_result
from bench_records.run_drawings import curve_plots, curve_tables, numbered, phase_strips, time_panels
from bench_records.run_folder import circumstances, flattened, result_without
from bench_records.signing import ROLES, files_of, footing, identification, instruments_of
from bench_records.templates import template
from bench_records.twin import PARTS, read_twin
from bench_records.typography import THIN_SPACE, fixed, plain, primed, seconds

#: Largest number of checks on the first page: not passed, and close to a limit.
FAILED_ROWS: Final = 10
CLOSE_ROWS: Final = 4


def write_report(directory: Path | str, letterhead: Letterhead | None = None) -> Path:
    """Write ``report.html`` from the record and the result in a directory; returns its path.

    The report of a run without a result states this and shows the recorded data. The bytes depend only on the
    two files, the notes in the directory and the letterhead. Without a ``letterhead`` that of the environment is used,
    if any. Raises ``RecordError`` if the record or the letterhead cannot be read, or the disk refuses the page.
    """
    path = Path(directory) / REPORT
    page = report_page(directory, letterhead).encode()
    with kept(path):
        put(path, page)
    return path


def report_page(directory: Path | str, letterhead: Letterhead | None = None) -> str:
    """Return the page that `write_report` writes, without writing it."""
    record = read(directory)
    if letterhead is None and (chosen := os.environ.get(CHOSEN)):
        letterhead = read_letterhead(Path(chosen))
    return _render(record, _result_of(record, Path(directory)), Path(directory), letterhead or Letterhead())


def _render(record: Record, result: Result, directory: Path, letterhead: Letterhead) -> str:
    phases = record.phases or result.phases
    span = (0.0, max(record.duration, result.duration, 1e-3))
    files, plots = files_of(directory), PlotData()
    replay = replay_of(record, plots)
    # The data of a plot is added while the template is rendered, in the order of the plots on the page.
    return template("report.html.j2").render(
        result=result,
        record=record,
        letterhead=letterhead,
        notes=notes_of(directory),
        counts={verdict.value: result.count(verdict) for verdict in CheckVerdict},
        paragraphs=_paragraphs(result.instruction, result.title),
        rows=check_rows(result.checks),
        notable=notable(result.checks),
        meanings=meanings(result.checks),
        surely=least_sure(result.checks),
        bars=any(one.expanded for one in result.curves),
        headline=headline(result),
        circumstances=circumstances(record.meta),
        bar=bar_drawing,
        primed=primed,
        plots=plots,
        replay=replay,
        replay_told=embedded(replay),
        asset=asset,
        identification=identification(record, result, span[1]),
        instruments=instruments_of(record.meta),
        files=files,
        footing=footing(result, files),
        roles=ROLES,
        phases=[(number, phase, seconds(phase.duration)) for number, phase in numbered(phases)],
        panels=time_panels(record, phases, span),
        strips=phase_strips(record, phases, span),
        curves=curve_plots(result.curves),
        tables=curve_tables(result.curves),
        timing=_timing(result),
        story=first_trip(record),
        incident=incident_of(record),
        twin=read_twin(directory),
        twin_parts=PARTS,
        events=event_rows(record),
        hidden_events=max(0, len(tabled_events(record)) - EVENT_ROWS),
        facts=_facts(record.meta, result),
        dimensions=_dimensions(record.meta),
    )


def _result_of(record: Record, directory: Path) -> Result:
    """Return the result in a directory, or one with the reason why it is missing."""
    if (directory / RESULT).exists():
        return read_result(directory)
    return result_without(record)


class Paragraph(NamedTuple):
    """A paragraph of the instruction, or a list if it has items."""

    text: Any
    items: list[Any]


def _paragraphs(docstring: str, title: str) -> list[Paragraph]:
    """Return the docstring of the plan as paragraphs, without the title, which is in the head of the page.

    Lines that begin with an asterisk or a dash make a list.
    """
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
        if (text and " ".join(text) != title) or items:
            result.append(Paragraph(_prose(" ".join(text)), [_prose(item) for item in items]))
    return result


def _prose(text: str) -> Any:
    """Return a text for the page, with code between backticks as HTML code elements."""
    from markupsafe import Markup, escape

    parts = primed(text).split("`")
    if len(parts) % 2 == 0:  # an unpaired backtick
        return escape(primed(text))
    return Markup("").join(
        Markup("<code>{}</code>").format(part) if index % 2 else part for index, part in enumerate(parts)
    )


def notable(checks: list[Check]) -> list[tuple[str, list[CheckRow], int]]:
    """Return the checks for the first page: not passed, then close to a limit, each with the number of further ones."""
    failed = [one for one in checks if not one.passed]
    # Failed checks come before those without a value.
    failed.sort(key=lambda one: one.verdict is not CheckVerdict.FAIL)
    close = [one for one in checks if one.verdict is CheckVerdict.MARGINAL]
    close.sort(key=lambda one: 1.0 if one.conformity is None else one.conformity)
    parts = (("Not passed", failed, FAILED_ROWS), ("Close to a limit", close, CLOSE_ROWS))
    return [(what, check_rows(some[:most]), max(0, len(some) - most)) for what, some, most in parts if some]


def least_sure(checks: list[Check]) -> str:
    """Return a sentence on the check with the lowest probability of conformity; "" if not all checks pass."""
    known = [(one.conformity, one) for one in checks if one.conformity is not None]
    if not known or any(one.verdict is not CheckVerdict.PASS for one in checks):
        return ""
    probability, one = min(known, key=lambda pair: pair[0])
    return (
        f"The least certain check is {primed(one.name)}: it conforms with {percent(probability)} probability."
    )


def _timing(result: Result) -> dict[str, Any] | None:
    from bench_records.report_plots import lateness

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
            figures.append((name, f"{fixed(value * 1e6, 0 if value > 1e-4 else 1)}{THIN_SPACE}µs"))
    return {
        "figures": figures,
        "late": timing.late,
        "disturbed": timing.disturbed,
        "measured": timing.max is not None or bool(timing.counts),
        "drawing": lateness("lateness", timing) if timing.counts and timing.edges else "",
    }


def _facts(meta: dict[str, Any], result: Result) -> list[tuple[str, str]]:
    """Return the facts to repeat the run: flat, in order, each once."""
    beside = {name: value for name, value in meta.items() if name not in {"title", "instruction"}}
    facts: dict[str, Any] = {"plan": result.plan, "rig": result.rig, "seed": result.seed, **beside}
    if isinstance(told := meta.get("instruments"), dict):  # a table has the pieces
        facts["instruments"] = {name: value for name, value in told.items() if name != "pieces"}
    if isinstance(told := meta.get("dimensions"), dict):  # so have the dimensions
        facts["dimensions"] = {name: value for name, value in told.items() if name != "known"}
    return [
        (name.replace("_", " "), text)
        for name, value in flattened(facts)
        if (text := "" if value is None else plain(value))
    ]


def _dimensions(meta: dict[str, Any]) -> dict[str, Any]:
    """Return the dimensions of the rig by name, each with value, uncertainty (SI) and provenance."""
    told = meta.get("dimensions")
    known = told.get("known") if isinstance(told, dict) else None
    return dict(sorted(known.items())) if isinstance(known, dict) else {}


def headline(result: Result) -> str:
    """Return the verdict as a sentence."""
    if result.verdict is Outcome.BLOCKED:
        return result.reason
    total = len(result.checks)
    noun = "check" if total == 1 else "checks"
    if result.verdict is Outcome.FAIL:
        return f"{result.count(CheckVerdict.FAIL)} of {total} {noun} outside the limits"
    if result.verdict is Outcome.INCOMPLETE:
        lacking = result.count(CheckVerdict.NOT_AVAILABLE)
        return f"{lacking} of {total} {noun} not available on this rig; the others within the limits"
    marginal = result.count(CheckVerdict.MARGINAL)
    return f"{total} {noun} within the limits" + (
        f", {marginal} of them close to a limit" if marginal else ""
    )
