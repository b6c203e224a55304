"""The report of a diagnosis: one self-contained HTML page, made from the finding and its history."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from bench_records.twin import PARTS
from bench_records.typography import primed
from diagnosis.finding import Estimate, Finding, PanelRow, Shift, Trace, Verdict
from diagnosis.report import drawings
from diagnosis.report.words import chance, gained, pair, percent, percents, prose, shown, typeset, unit

#: The page is for reading; anyone who wants more has finding.json.
TRACES, FIGURES, SENTENCES, SHIFTS, RUNS = 4, 6, 14, 16, 12
TONES: Final = {
    Verdict.NO_EFFECT: "calm",
    Verdict.NAMED: "found",
    Verdict.REMAINDER: "found",
    Verdict.AMBIGUOUS: "open",
    Verdict.UNRESOLVED: "open",
    Verdict.UNKNOWN: "alarm",
    Verdict.DOUBTFUL: "open",
}
HEADLINES: Final = {
    Verdict.NO_EFFECT: "No error of the model was found",
    Verdict.NAMED: "The cause is found",
    Verdict.REMAINDER: "A cause is found, but it does not explain everything",
    Verdict.AMBIGUOUS: "More than one cause explains these runs",
    Verdict.UNRESOLVED: "The model has an error, but no cause passes every test",
    Verdict.UNKNOWN: "The model has an error that no known cause explains",
    Verdict.DOUBTFUL: "Some data are doubtful; the other data show no error of the model",
}


class Curves(NamedTuple):
    """The two drawings of one channel of a report run."""

    trace: Trace
    detail: str
    errors: str


class RunOfInvestigation(NamedTuple):
    """One plan of an investigation, and the conclusion from all data up to it; ``minutes`` on the bench."""

    plan: str
    minutes: float
    why: str
    conclusion: str


class InvestigationHistory(NamedTuple):
    """The runs of an investigation, and why it ended; ``budget`` in minutes of the bench."""

    runs: Sequence[RunOfInvestigation]
    budget: float
    ended: str


def write_report(finding: Finding, path: Path | str, history: InvestigationHistory | None = None) -> Path:
    """Write the page of a finding and return its path. The bytes depend only on the finding and its history."""
    target = Path(path)
    target.write_text(render(finding, history), encoding="utf-8", newline="\n")
    return target


def headline(finding: Finding) -> str:
    """Return the verdict in a few words that do not exceed the evidence."""
    if finding.suspected:
        return "A cause is suspected, but no unseen run confirms it"
    return HEADLINES[finding.verdict]


def first_screen(finding: Finding) -> list[tuple[str, str]]:
    """Return the parts of the first screen that have a text, each with its label."""
    texts = ((label, getattr(finding.first_screen, name)) for name, label in PARTS.items())
    return [(label, text) for label, text in texts if text]


def render(finding: Finding, history: InvestigationHistory | None = None) -> str:
    """Return the page of a finding."""
    parts = _summary(finding) | _causes(finding) | _residual(finding) | _what_is_possible(finding)
    formats = {
        "interval": interval,
        "shown": shown,
        "prose": prose,
        "typeset": typeset,
        "unit": unit,
        "primes": primed,
        "pair": pair,
        "percent": percent,
        "percents": percents,
        "chance": chance,
        "gained": gained,
    }
    from bench_records.templates import template

    page = template("report.html.j2", Path(__file__).parent)  # the look is that of the reports of the bench
    return page.render(finding=finding, history=history, facts=_facts(finding), **formats, **parts)


def _summary(finding: Finding) -> dict[str, Any]:
    """The verdict, the gain on the report runs, and their curves before and after."""
    extended = bool(finding.models.effects)
    return {
        "tone": "open" if finding.suspected else TONES[finding.verdict],
        "headline": headline(finding),
        "word": "suspected" if finding.suspected else finding.verdict.value,
        "first_screen": first_screen(finding),
        "overall": next((gain for gain in finding.gains if gain.channel == "all"), None),
        "extended": extended,
        "proof": drawings.trace_errors("proof", finding.traces[0])
        if extended and finding.traces and not finding.suspected
        else "",
        "gain_drawing": drawings.gain_rows("gains", finding.gains),
        "curves": [
            Curves(t, drawings.trace_curves(f"trace{i}", t), drawings.trace_errors(f"error{i}", t))
            for i, t in enumerate(finding.traces[:TRACES])
        ],
    }


def _causes(finding: Finding) -> dict[str, Any]:
    """The scores of all candidates, those that were rejected, and the terms without a name."""
    return {
        "score_drawing": drawings.score_points("scores", finding.scores, finding.threshold),
        "rejected": [
            s for s in finding.scores if (s.score or 0.0) > finding.threshold and s.outcome != "accepted"
        ],
        "unknowns": [
            (
                unknown,
                drawings.panel_figure(f"unknown{i}", unknown.title, unknown.figure) if unknown.figure else "",
            )
            for i, unknown in enumerate(finding.unknowns)
        ],
    }


def _residual(finding: Finding) -> dict[str, Any]:
    """Return the results of the panel of tests on the residuals of the base model."""
    tested = [row for row in finding.panel if row.p is not None]
    clear = sorted(
        (row for row in tested if row.significant), key=lambda row: (row.q or 0.0, -(row.statistic or 0.0))
    )
    drawn = [row for row in clear if row.figure][:FIGURES]
    return {
        "panel_drawing": drawings.panel_map("panel", finding.panel),
        "tested": len(tested),
        "clear": len(clear),
        "sentences": _one_of_each_test_first(clear),
        "figures": [
            (row, drawings.panel_figure(f"panel{i}", f"{row.title}: {row.channel}", row.figure))
            for i, row in enumerate(drawn)
            if row.figure
        ],
    }


def _what_is_possible(finding: Finding) -> dict[str, Any]:
    """Return what these runs can distinguish, which runs would decide, and the shifts of the base parameters."""
    shifts = _shift_rows(finding.shifts)
    confusability = finding.confusability
    moved = [(_label(shift), shift.sigmas or 0.0) for shift in shifts]
    return {
        "cosine_drawing": drawings.cosine_map("cosines", confusability) if confusability else "",
        "inseparable": [pair for pair in confusability.pairs if not pair.separable] if confusability else [],
        "next_runs": finding.next_runs[:RUNS],
        "most": max((run.per_minute or 0.0 for run in finding.next_runs), default=0.0),
        "shifts": shifts,
        "shift_drawing": drawings.shift_rows("shifts", moved) if shifts else "",
    }


def interval(estimate: Estimate) -> str:
    """Return the 95 % interval of a fitted number as text, or the bound below which the samples do not resolve it."""
    if estimate.below is not None:
        return f"not resolved: below {shown(estimate.below, 2)}"
    if estimate.low is None or estimate.high is None:
        return "not known"
    half = 0.5 * (estimate.high - estimate.low)
    return " to ".join(pair(end, half)[0] for end in (estimate.low, estimate.high))


def _one_of_each_test_first(rows: Sequence[PanelRow]) -> list[PanelRow]:
    """Return the first rows to show: the clearest of every test, then the others, clearest first."""
    first: dict[str, PanelRow] = {}
    for row in rows:
        first.setdefault(row.test, row)
    best = list(first.values())
    return [*best, *(row for row in rows if row not in best)][:SENTENCES]


def _shift_rows(shifts: Sequence[Shift]) -> list[Shift]:
    moved = [shift for shift in shifts if shift.sigmas is not None]
    return sorted(moved, key=lambda shift: -abs(shift.sigmas or 0.0))[:SHIFTS]


def _label(shift: Shift) -> str:
    name = shift.name.replace("_", " ")
    return f"{name} [{shift.run}]" if shift.run else name


def _facts(finding: Finding) -> list[tuple[str, str]]:
    source = finding.provenance
    facts: dict[str, Any] = {
        "simulator": source.simulator,
        "identity": source.identity,
        "fitted on": ", ".join(source.fit),
        "selected on": ", ".join(source.select),
        "reported on": ", ".join(source.report),
        "files": ", ".join(source.sources),
        "hash of the data": source.digest,
        "seed": source.seed,
        **{f"version of {name}": number for name, number in source.versions.items()},
        **{name.replace("_", " "): value for name, value in source.config.items() if name != "seed"},
    }
    return [(name, _plain(value)) for name, value in facts.items() if value not in ("", None)]


def _plain(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
