"""The report of a run: one self-contained HTML page, made only from the files in the directory of the run."""

from __future__ import annotations

import inspect
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from markupsafe import Markup, escape

from bench_records.check_table import CheckRow, bar_drawing, check_rows, meanings
from bench_records.conformity import percent
from bench_records.disk import kept
from bench_records.document import (
    NUMBER,
    Banner,
    Cell,
    Document,
    bullets,
    caption,
    drawing,
    element,
    facts_table,
    joined,
    key_facts,
    pairs,
    paragraph,
    section,
    table,
)
from bench_records.event_table import EVENT_ROWS, event_rows, first_trip, tabled_events
from bench_records.incident import incident_of
from bench_records.layout import REPORT, RESULT, Phase, put
from bench_records.letterhead import CHOSEN, Letterhead, read_letterhead
from bench_records.notes import Note, notes_of
from bench_records.plot_data import PlotData, asset, embedded
from bench_records.record import Record, read
from bench_records.replay import replay_of
from bench_records.result import Check, CheckVerdict, Outcome, Result, Timing, read_result
from bench_records.run_drawings import (
    Drawn,
    curve_plots,
    curve_tables,
    phase_list,
    phase_strips,
    time_panels,
)
from bench_records.run_folder import circumstances, flattened, result_without
from bench_records.signing import ROLES, files_of, footing, identification, instruments_of
from bench_records.twin import PARTS, TwinStory, read_twin
from bench_records.typography import THIN_SPACE, fixed, plain, primed

#: Largest number of checks on the first page: not passed, and close to a limit.
FAILED_ROWS: Final = 10
CLOSE_ROWS: Final = 4
#: Symbols of dynamic stiffness, which names of checks and axes contain, and their meanings.
SYMBOLS: Final = {
    "K\u2032": "the stiffness in phase with the displacement",
    "K\u2033": "the stiffness in phase with the velocity (loss stiffness)",
    "c": "the damping, K\u2033 / (2π · frequency)",
    "δ": "the loss angle, with tan δ = K\u2033 / K\u2032",
}


def write_report(directory: Path | str, letterhead: Letterhead | None = None) -> Path:
    """Write ``report.html`` from the record and the result in a directory. Return its path.

    The report of a run without a result states this, and shows the recorded data. The bytes depend only on the record,
    the result, the notes in the directory, and the letterhead. Without a ``letterhead``, the environment may name one.
    Raises ``RecordError`` if the record or the letterhead cannot be read, or if the page cannot be saved.
    """
    path = Path(directory) / REPORT
    page = report_page(directory, letterhead).encode()
    with kept(path):
        put(path, page)
    return path


def report_page(directory: Path | str, letterhead: Letterhead | None = None) -> str:
    """Return the HTML text that `write_report` writes to a file."""
    record = read(directory)
    if letterhead is None and (chosen := os.environ.get(CHOSEN)):
        letterhead = read_letterhead(Path(chosen))
    return _render(record, _result_of(record, Path(directory)), Path(directory), letterhead or Letterhead())


def _render(record: Record, result: Result, directory: Path, letterhead: Letterhead) -> str:
    phases = record.phases or result.phases
    span = (0.0, max(record.duration, result.duration, 1e-3))
    files, plots, twin = files_of(directory), PlotData(), read_twin(directory)
    replay = replay_of(record, plots)
    # The sections add the data of their plots in the order of the page, before the scripts take all data.
    sections = [
        *_first_page(result, files, str(record.meta.get("operator") or "")),
        *_conditions(result, record, twin),
        *_results(result, plots),
        *_course(record, phases, span, plots, replay),
        *_appendix(result, record, directory),
    ]
    heads = (("customer", letterhead.customer), ("order", letterhead.order))
    known = (
        (one.name, one.text or element("small", "not recorded", "blank"))
        for one in identification(record, result, span[1])
    )
    foot = f'@page {{ @bottom-left {{ content: "{footing(result, files)}"; }} }}\n'
    return Document(
        f"{result.plan}: {result.verdict.value} – {primed(result.title)}",
        f"Test report\u2002·\u2002{result.plan}",
        sections,
        heading=primed(result.title) or result.plan,
        circumstances=circumstances(record.meta),
        banner=_banner(result, twin),
        facts=(*(one for one in heads if one[1]), *known),
        style="\n".join((asset("uPlot.min.css"), asset("bench_drawing.css") if replay else "", foot)),
        top=_letterhead(letterhead),
        scripts=_scripts(plots, replay),
    ).html()


def _letterhead(head: Letterhead) -> Markup:
    logo = Markup('<img src="{}" alt="{}">').format(head.logo, head.laboratory or "logo") if head.logo else ""
    parts = element("b", head.laboratory) + logo
    return element("div", parts, "letterhead") + "\n" if head.logo or head.laboratory else Markup()


def _banner(result: Result, twin: TwinStory | None) -> Banner:
    reason, tally = escape(headline(result)), ""
    deviations = twin.deviations if twin else ()
    if deviations:
        more = f" {len(deviations) - 1} more below." if deviations[1:] else ""
        reason += Markup("<br><b>Deviation from the model:</b> {}{}").format(deviations[0].sentence, more)
    elif twin:
        agreed = f"No deviation from the model in {twin.judged_for:.0f} s."
        reason += Markup("<br>{}").format(
            agreed
            if twin.judged_for
            else "The model could not be compared with the rig; see the reasons below."
        )
    if result.checks:
        named = {CheckVerdict.ERROR: "with an error"}
        counts = [(result.count(verdict), named.get(verdict, verdict.value)) for verdict in CheckVerdict]
        lines = [f"{n} {name}" for n, name in counts if n or name != CheckVerdict.NOT_AVAILABLE.value]
        tally = "\u2002·\u2002".join(lines)
    return Banner(result.verdict.value, reason, tally, result.verdict.value + " deviates" * bool(deviations))


def _scripts(plots: PlotData, replay: dict[str, Any] | None) -> Markup:
    """Return the data of the plots, and the scripts that draw them."""
    json = {"type": "application/json"}
    names = ("bench_drawing.js", "bench_replay.js") if replay else ()
    parts = [
        element("script", Markup(plots.json), id="plots", **json),
        element("script", plots.packed, id="plot-data", type="text/plain"),
        element("script", Markup(embedded(replay)), id="replay", **json) if replay else "",
        *(
            element("script", Markup(asset(name)))
            for name in ("uPlot.iife.min.js", *names, "numbers.js", "report.js")
        ),
    ]
    return joined(parts, "\n") + "\n"


def _first_page(result: Result, files: list[tuple[str, str]], operator: str) -> Iterator[Markup]:
    """Yield the parts of the first page after the verdict: checks that did not pass or are close to a limit, and
    signatures.
    """
    for what, some, more in notable(result.checks):
        note = f"{more} more in the table of all checks." if more else ""
        yield section(what, _check_table(some, purpose=True), caption(note))
    yield paragraph(least_sure(result.checks), "surely")
    signed = Markup("<dl><dt>{}</dt><dd>{}</dd><dt>date</dt><dd></dd><dt>signature</dt><dd></dd></dl>\n")
    names = (operator, *[""] * len(ROLES[1:]))
    yield section(
        "Signatures",
        "All values in this report come from these files. The signatures are valid only for files with these "
        "checksums.",
        facts_table((f"SHA-256 of {name}", element("code", checksum)) for name, checksum in files),
        element("div", joined(map(signed.format, ROLES, names)), "sign"),
        kind="signatures",
    )


def _conditions(result: Result, record: Record, twin: TwinStory | None) -> Iterator[Markup]:
    """Yield the instruction, the preconditions, the first trip, the deviations from the model, and the incident."""
    if paragraphs := _instruction(result.instruction, result.title):
        yield section("What was tested", *paragraphs)
    if result.warnings or result.preconditions:
        words = {None: "not checked", True: "met", False: "not met"}
        met = ((one.text, f"{words[one.met]}: {one.found}") for one in result.preconditions)
        yield section("Preconditions", facts_table(met), bullets(result.warnings))
    if story := first_trip(record):
        sentences = element("div", joined(map(paragraph, story["sentences"])), "story")
        yield section("First trip", sentences, drawing(story["drawing"]))
    if twin:
        yield _twin(twin)
    if incident := incident_of(record):
        yield section(
            "Black box of the rig",
            element("pre", incident.story, "story"),
            drawing(incident.drawing),
            caption(
                "The times in the list count from the start of the rig, those in the plot from the incident. The file "
                "black_box.parquet has all samples from 10 s before to 10 s after the incident."
            ),
        )


def _twin(twin: TwinStory) -> Markup:
    """Return the section on the comparison with the model: all deviations, and the parts of the run that
    were judged.
    """
    deviations: list[Markup | str] = [
        facts_table((label, getattr(one.summary, name)) for name, label in PARTS.items())
        if one.summary
        else one.sentence
        for one in twin.all_deviations
    ]
    agreed = "The rig agreed with its model in all parts of the run that could be judged."
    words: dict[bool | None, str] = {True: "no deviation", False: "with a deviation"}
    rows = [
        (f"{one.start:.1f} s", f"{one.end:.1f} s", words.get(one.along, f"not judged: {one.why}"))
        for one in twin.judged
    ]
    return section(
        "Comparison with the model",
        *(deviations or [agreed if twin.judged_for else "No part of the run could be judged."]),
        caption(
            f"The model “{twin.model}” receives the measured motion and predicts the other readings. It could judge "
            f"{twin.judged_for:.0f} s of {twin.until:.0f} s."
        ),
        table("from | to | result", rows),
    )


_CHECK: Final = Markup("""\
<tr>
<td class="name">{0.name}</td>
<td class="n value">{0.value}</td>
<td class="n">{0.uncertainty}</td>
<td class="n" data-of="low">{0.low}</td>
<td class="n" data-of="high">{0.high}</td>
<td class="u">{0.unit}</td>
<td class="within">{1}</td>
<td class="verdict {2}"><i>{0.sign}</i>{0.check.verdict.value}</td>
</tr>
""")


def _check_table(rows: Sequence[CheckRow], *, purpose: bool = False) -> Markup:
    """Return the table of checks. Each check is a group of rows: values, details, and with ``purpose`` a sentence on
    its purpose.
    """
    bodies = []
    for row in rows:
        kind = row.check.verdict.value.replace(" ", "-")
        notes = [
            Markup('<tr><td colspan="8" class="note">{}</td></tr>\n').format(note)
            for note in (row.check.about if purpose else "", row.detail)
            if note
        ]
        bodies.append(element("tbody", joined([_CHECK.format(row, bar_drawing(row), kind), *notes]), kind))
    heads = "check | measured :n | ± U :n | lower limit :n | upper limit :n | unit :u | between the limits | verdict"
    return table(heads, joined(bodies, "\n"), "checks")


def _results(result: Result, plots: PlotData) -> Iterator[Markup]:
    """Yield all checks, their purpose, and the curves with their numbers."""
    if result.checks:
        yield section(
            "All checks" if notable(result.checks) else "Checks",
            _check_table(check_rows(result.checks)),
            caption(
                "The grey bar is the range between the limits. A value in its hatched ends is marginal: it is within "
                "the limits, but the true value may be outside. The line through a value is its expanded uncertainty "
                "U, with a coverage of about 95 %. U is k times the standard uncertainty. An arrow marks a value "
                f"outside the drawing. {_symbols(result)}"
            ),
        )
    if purposes := meanings(result.checks):
        yield section("Purpose of the checks", facts_table(purposes))
    if result.curves:
        bars = any(one.expanded for one in result.curves)
        symbols = "" if result.checks else _symbols(result)
        yield section(
            "Curves",
            pairs(_zooming(one, plots) for one in curve_plots(result.curves)),
            *(
                table([Cell(head, NUMBER) for head in one.columns], one.rows, "numbers")
                for one in curve_tables(result.curves)
            ),
            caption(f"The line through a point is its expanded uncertainty. {symbols}" if bars else symbols),
        )


def _symbols(result: Result) -> str:
    """Return sentences that explain the symbols in the names of checks and axes, or "" if there are none."""
    names = [
        *(one.name for one in result.checks),
        *(axis.label for one in result.curves for axis in (one.x, one.y)),
    ]
    used = {word for name in names for word in primed(name).split()}
    return " ".join(f"{symbol} is {text}." for symbol, text in SYMBOLS.items() if symbol in used)


def _zooming(drawn: Drawn, plots: PlotData) -> Markup:
    place = {"data-plot": str(plots.add(drawn.plot))}
    return element("div", Markup(drawn.picture), "zoom", **place) + "\n"


def _course(
    record: Record,
    phases: list[Phase],
    span: tuple[float, float],
    plots: PlotData,
    replay: dict[str, Any] | None,
) -> Iterator[Markup]:
    """Yield the animated drawing, the phases, and the signals over time."""
    strips, panels = phase_strips(record, phases, span), time_panels(record, phases, span)
    if not strips and not panels:
        return
    shown = ""
    if replay:
        shown = caption(
            f"The drawing shows the bench from behind, with a picture every {replay['step']} s. Click on a plot below "
            "to show the bench at that time. To open this page at 12.3 s, add #t=12.3 to its address."
        )
        shown = element("div", Markup('<div class="replay"></div>\n') + shown, "hint")
    drawn = (drawing(strips), phase_list(phases), *(_zooming(one, plots) for one in panels))
    hint = element("span", " Drag over a plot to zoom; double-click to return.", "hint")
    lines = "Dashed lines are readings of the right side of the bench. An axis with a zigzag does not begin at zero."
    yield section("The run", shown, element("div", joined(drawn), "stack"), caption(lines + hint))


def _appendix(result: Result, record: Record, directory: Path) -> Iterator[Markup]:
    """Yield timing, events, instruments, the facts to repeat the run, and notes added later."""
    if result.timing:
        yield _timing(result.timing)
    if events := event_rows(record):
        later = max(0, len(tabled_events(record)) - EVENT_ROWS)
        rows = [(when, Cell(kind, f"kind {kind}"), text, details) for when, kind, text, details in events]
        yield section(
            "Events",
            table("time, s :n | kind | event | details :u words", rows, "events"),
            caption(
                f"The table ends here. The file record.parquet has {later} later events." if later else ""
            ),
        )
    pieces = [(*one[:3], *(text or "–" for text in one[3:])) for one in instruments_of(record.meta)]
    if pieces:
        heads = "readings | instrument | serial number | certificate | calibrated | due"
        yield section("Instruments", table(heads, pieces, "instruments"))
    facts = facts_table(_facts(record.meta, result))
    yield section("Data to repeat this run", facts, *_dimensions(record.meta), kind="again")
    if notes := notes_of(directory):
        yield section(
            "Later notes",
            "These notes were added after the run. They are not part of the signed files, which are unchanged.",
            facts_table(map(_note, notes)),
        )


def _note(one: Note) -> tuple[Markup, Markup]:
    when = one.at.replace("T", " ").replace("Z", " UTC")
    file = f"notes/{one.file}" if one.file else ""
    checksum = element("code", f"SHA-256 {one.sha256}") if one.file else ""
    parts = (one.text, file, checksum)
    return joined(filter(None, (when, one.by)), "<br>"), joined(filter(None, parts), "<br>")


def _result_of(record: Record, directory: Path) -> Result:
    """Return the result in a directory. If there is none, return a result that states the reason."""
    if (directory / RESULT).exists():
        return read_result(directory)
    return result_without(record)


def _instruction(docstring: str, title: str) -> list[Markup]:
    """Return the docstring of the plan as paragraphs. Its title is left out, because the head of the page shows it.

    Lines that begin with an asterisk or a dash make a list.
    """
    result: list[Markup] = []
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
            result += [paragraph(_prose(" ".join(text))), bullets(map(_prose, items))]
    return result


def _prose(text: str) -> Markup:
    """Return a text for the page. Text between backticks becomes an HTML code element."""
    parts = primed(text).split("`")
    if len(parts) % 2 == 0:  # an unpaired backtick
        return escape(primed(text))
    return joined(element("code", part) if index % 2 else part for index, part in enumerate(parts))


def notable(checks: list[Check]) -> list[tuple[str, list[CheckRow], int]]:
    """Return the checks for the first page in two groups: not passed, and close to a limit. Each group has a title,
    its rows, and the number of further checks.
    """
    failed = [one for one in checks if not one.passed]
    # Failed checks come before those without a value.
    failed.sort(key=lambda one: one.verdict is not CheckVerdict.FAIL)
    close = [one for one in checks if one.verdict is CheckVerdict.MARGINAL]
    close.sort(key=lambda one: 1.0 if one.conformity is None else one.conformity)
    parts = (("Not passed", failed, FAILED_ROWS), ("Close to a limit", close, CLOSE_ROWS))
    return [(what, check_rows(some[:most]), max(0, len(some) - most)) for what, some, most in parts if some]


def least_sure(checks: list[Check]) -> str:
    """Return a sentence on the check with the lowest probability of conformity, or "" if a check is marginal or did not
    pass, or if no probability is known.
    """
    known = [(one.conformity, one) for one in checks if one.conformity is not None]
    if not known or any(one.verdict is not CheckVerdict.PASS for one in checks):
        return ""
    probability, one = min(known, key=lambda pair: pair[0])
    return f"The check with the lowest probability of conformity is “{primed(one.name)}”, with {percent(probability)}."


def _timing(timing: Timing) -> Markup:
    from bench_records.report_plots import lateness

    figures = [
        ("ticks", f"{timing.ticks:,}".replace(",", THIN_SPACE)),
        ("late ticks", f"{timing.late:,}".replace(",", THIN_SPACE)),
    ]
    if timing.period is not None:
        figures.append(("period", f"{timing.period * 1e3:g}{THIN_SPACE}ms"))
    for name, value in (
        ("median delay", timing.p50),
        ("99th percentile of the delay", timing.p99),
        ("largest delay", timing.max),
    ):
        if value is not None:
            figures.append((name, f"{fixed(value * 1e6, 0 if value > 1e-4 else 1)}{THIN_SPACE}µs"))
    disturbed = ", ".join(f"{name} ({late})" for name, late in timing.disturbed.items())
    text = "No tick was late."
    meaning = "A tick is one time step of the rig. "
    if timing.max is None and not timing.counts:
        text = "The run was in virtual time, so every tick was on time."
    elif timing.late:
        during = f"Checks with late ticks during their measurement: {disturbed}."
        none = "No tick was late during the measurement of a check."
        text = f"Late ticks: {timing.late}. {during if disturbed else none}"
    drawn = lateness("lateness", timing) if timing.counts and timing.edges else ""
    return section(
        "Timing of the rig", key_facts(figures), meaning + text, element("div", Markup(drawn), "narrow")
    )


def _facts(meta: dict[str, Any], result: Result) -> list[tuple[str, str]]:
    """Return the facts that are needed to repeat the run, as pairs of name and text."""
    others = {name: value for name, value in meta.items() if name not in {"title", "instruction"}}
    facts: dict[str, Any] = {"plan": result.plan, "rig": result.rig, "seed": result.seed, **others}
    if isinstance(known := meta.get("instruments"), dict):  # a table has the pieces
        facts["instruments"] = {name: value for name, value in known.items() if name != "pieces"}
    if isinstance(known := meta.get("dimensions"), dict):  # so have the dimensions
        facts["dimensions"] = {name: value for name, value in known.items() if name != "known"}
    return [
        (name.replace("_", " "), text)
        for name, value in flattened(facts)
        if (text := "" if value is None else plain(value))
    ]


def _dimensions(meta: dict[str, Any]) -> list[Markup]:
    """Return the dimensions of the rig, sorted by name, with value, uncertainty (SI) and provenance."""
    dimensions = meta.get("dimensions")
    known = dimensions.get("known") if isinstance(dimensions, dict) else None
    if not known or not isinstance(known, dict):
        return []
    rows = [
        (name, *(str(one[key]) for key in ("value", "uncertainty", "provenance")))
        for name, one in sorted(known.items())
    ]
    numbers = table("dimension | value, SI :n | uncertainty, SI :n | source", rows, "numbers")
    return [
        paragraph(
            f"The run used {len(known)} dimensions of the rig. They are also in meta.json. Values without a unit are "
            "in SI units."
        ),
        element("details", element("summary", "Dimensions of the rig") + numbers, "hint"),
    ]


def headline(result: Result) -> str:
    """Return a sentence on the verdict."""
    if result.verdict is Outcome.BLOCKED:
        return result.reason
    total = len(result.checks)
    noun = "check" if total == 1 else "checks"
    if result.verdict is Outcome.FAIL:
        return f"{result.count(CheckVerdict.FAIL)} of {total} {noun} outside the limits"
    if result.verdict is Outcome.INCOMPLETE:
        lacking = result.count(CheckVerdict.NOT_AVAILABLE)
        return f"{lacking} of {total} {noun} not available on this rig; the others are within the limits"
    marginal = result.count(CheckVerdict.MARGINAL)
    return f"{total} {noun} within the limits" + (
        f", {marginal} of them close to a limit" if marginal else ""
    )
