"""The report of a diagnosis: one self-contained HTML page, made from the finding and its history."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import starmap
from pathlib import Path
from typing import Final, NamedTuple

from markupsafe import Markup

from bench_records.document import (
    Document,
    bullets,
    caption,
    drawing,
    element,
    facts_table,
    figure,
    joined,
    pairs,
    paragraph,
    section,
    subheading,
    table,
)
from bench_records.twin import PARTS
from bench_records.typography import primed
from diagnosis.contracts import DataQuality
from diagnosis.engine.config import DISTINGUISHED
from diagnosis.estimates import Z95, in_words, percent
from diagnosis.finding import (
    EXPLAINED,
    Cause,
    CheckPrediction,
    Coverage,
    Estimate,
    Finding,
    Gain,
    Imitation,
    PanelRow,
    Rival,
    Shift,
    Suspect,
    Unknown,
    Unseen,
    Verdict,
)
from diagnosis.report import drawings
from diagnosis.report.words import pair, prose, shown, typeset, unit

#: The page is for reading; finding.json has all data.
TRACES, FIGURES, SENTENCES, SHIFTS, RUNS = 4, 6, 8, 16, 12
#: A signal with a smaller error, divided by the noise, has no row.
AT_NOISE: Final = 1.1
#: The level of the noise band on the page.
COVERED: Final = 0.95
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
    Verdict.AMBIGUOUS: "Several causes are possible; each explains these runs",
    Verdict.UNRESOLVED: "The model has an error, but no cause passes every test",
    Verdict.UNKNOWN: "The model has an error that no known cause explains",
    Verdict.DOUBTFUL: "Some data are doubtful; the other data show no error of the model",
}


#: Terms of the page and their meaning.
_TERMS: Final = (
    ("base model", "the model without causes, with its parameters fitted to the data"),
    ("fit runs", "runs to which the parameters are fitted"),
    ("validation runs", "runs with which the causes are selected"),
    ("test runs", "runs that are only used to check the prediction"),
    ("error", "measured value minus value of the model; RMS: root of the mean square"),
    ("noise", "scatter of a measured signal that no model can predict (RMS)"),
    (
        "score",
        "size of an effect in the error of a model, divided by the standard deviation of this size; the base model is "
        "meant if no other is stated",
    ),
    ("threshold", "chance alone hardly ever gives a larger score; each model has its own threshold"),
    ("final model", "the model with the causes, if any"),
)
_DOUBTFUL: Final = Markup("<b>Doubtful:</b> ")
_STYLE: Final = """\
.banner.calm { --tone: var(--pass); } .banner.found { --tone: var(--found); }
.banner.open { --tone: var(--marginal); } .banner.alarm { --tone: var(--fail); }
.banner { border-left-width: .6rem; }
.cause { border-left: 4px solid var(--found); padding: .15rem 0 .2rem 1.1rem; margin: 0 0 1.5rem; break-inside: avoid; }
.cause.rival { border-color: #b87a00; } .cause table { max-width: 38rem; margin: .4rem 0 .5rem; }
.cause small { font: 400 .8rem/1.3 "Helvetica Neue", Helvetica, "Liberation Sans", sans-serif; color: var(--soft); }
.equation { font: italic 1.06rem/1.5 "STIX Two Text", "Cambria Math", Charter, Georgia, serif; margin: .2rem 0 .3rem; }
.source { color: var(--soft); font-size: .84rem; }
.share { background: var(--part); height: .72em; display: inline-block; min-width: 1px; vertical-align: middle; }
h3.sub { margin: 1.5rem 0 .5rem; } .bars { width: 30%; } * + .pair { margin-top: 1rem; }
dl.first > div { display: grid; grid-template-columns: 10rem 1fr; gap: 0 .8rem; margin-bottom: .3rem; }
dl.first, dl.first dd { margin: 0; } dl.first dt { color: var(--soft); }
@media (max-width: 40rem) { dl.first > div { grid-template-columns: 1fr; } }
.statistics { font-size: 1.5rem; margin: 2.4rem 0 .6rem; }
ul.sentences { max-width: 54rem; } ul.sentences li { margin-bottom: .18rem; }
"""


class RunOfInvestigation(NamedTuple):
    """One plan of an investigation, and the conclusion from all data so far. ``minutes`` is the time on the bench."""

    plan: str
    minutes: float
    why: str
    conclusion: str


class InvestigationHistory(NamedTuple):
    """The runs of an investigation, and why it ended. ``budget`` is in minutes of the bench."""

    runs: Sequence[RunOfInvestigation]
    budget: float
    ended: str


def write_report(finding: Finding, path: Path | str, history: InvestigationHistory | None = None) -> Path:
    """Write the page of a finding and return its path. The bytes depend only on the finding and its history."""
    target = Path(path)
    target.write_text(render(finding, history), encoding="utf-8", newline="\n")
    return target


def headline(finding: Finding) -> str:
    """Return the verdict in a few words that claim no more than the evidence shows."""
    if finding.suspected:
        return "A cause is suspected, but no test run confirms it"
    if finding.verdict is Verdict.NAMED and any(cause.laws for cause in finding.causes):
        return "A cause is found, but not its exact law"
    if finding.verdict is Verdict.NAMED and len(finding.causes) > 1:
        return "The causes are found"
    return HEADLINES[finding.verdict]


def first_screen(finding: Finding) -> list[tuple[str, str]]:
    """Return the parts of the first screen that have a text, each with its label."""
    texts = ((label, getattr(finding.first_screen, name)) for name, label in PARTS.items())
    return [(label, text) for label, text in texts if text]


def render(finding: Finding, history: InvestigationHistory | None = None) -> str:
    """Return the page of a finding."""
    simulator = finding.provenance.simulator
    lines = (element("dt", label) + element("dd", prose(text)) for label, text in first_screen(finding))
    summary = element("dl", joined(element("div", one) for one in lines), "first")
    tone = "open" if finding.suspected else TONES[finding.verdict]
    shows_proof = finding.models.effects and finding.traces and not finding.suspected
    head = (
        bullets((_DOUBTFUL + prose(one) for one in finding.doubts), "sentences"),
        element("div", element("div", summary, "why"), f"banner {tone}"),
        figure(drawings.trace_errors("proof", finding.traces[0], _names(finding)) if shows_proof else ""),
    )
    return Document(
        f"{headline(finding)} – diagnosis of {simulator}",
        f"Diagnosis\u2002·\u2002{simulator}",
        [*_conclusions(finding, history), *_details(finding), *_tests(finding), *_limits(finding)],
        heading=headline(finding),
        banner=joined(head),
        style=_STYLE,
    ).html()


def _conclusions(finding: Finding, history: InvestigationHistory | None) -> Iterator[Markup]:
    """Yield the sections on causes and rivals, suspects, next runs, unknown effects, detectability, gain, history and
    open points.
    """
    if finding.causes:
        titles = _titles(finding)
        several = bool(finding.causes[1:])
        open_ = "Possible cause" if finding.verdict is Verdict.AMBIGUOUS else "The cause"
        yield section(
            f"{open_}{'s' * several}",
            *map(_cause, finding.causes),
            subheading("Other causes that explain the data equally well") if finding.ambiguous_with else "",
            *(
                _candidate(one, f"Possible instead of {titles[one.instead_of]}." if several else "")
                for one in finding.ambiguous_with
            ),
        )
    if finding.suspects:
        yield section(
            "Where to look first",
            "None of these effects passes every test. If the model has another error, the rig may have none of them.",
            *(_candidate(one, f"Not accepted: {typeset(one.why)}.") for one in finding.suspects),
        )
    if finding.next_runs or finding.next_sensors:
        yield _next_steps(finding)
    kept = [one for one in finding.unknowns if one.kept]
    if kept:
        yield section("Unknown effects", *starmap(_unknown, enumerate(kept)))
    if finding.verdict is Verdict.NO_EFFECT:
        yield _detectable(finding.not_seen)
    if finding.gains:
        yield _gain(finding)
    if history:
        rows = [
            (place, run.plan, run.minutes, prose(run.why), prose(run.conclusion))
            for place, run in enumerate(history.runs, start=1)
        ]
        used = f"{shown(sum(run.minutes for run in history.runs))} of {shown(history.budget)} minutes on the bench"
        yield section(
            "How this was found",
            table(":n | plan | duration in min :n value | reason | result so far", rows),
            caption(f"The runs used {used}. Reason for the end: {typeset(history.ended)}"),
        )
    unused = [one.sentence for one in finding.unknowns if not one.kept]
    if finding.remains or unused:
        yield section("Open points", bullets(map(prose, [*finding.remains, *unused]), "sentences"))


def _cause(cause: Cause) -> Markup:
    """Return the part of the page on a cause and on the other laws of its phenomenon."""
    separated = (
        f" This run can distinguish them: {typeset(cause.separated_by)}." if cause.separated_by else ""
    )
    note = f"Another law of {cause.phenomenon}. The data cannot distinguish it from {cause.title}.{separated}"
    return joined([_candidate(cause), *(_candidate(law, note) for law in cause.laws)])


def _candidate(one: Cause | Rival | Suspect, note: str = "") -> Markup:
    name = element("small", f"\u2002effect name: {one.effect}")
    rows = [(in_words(p.name), pair(p.value, p.sd)[0], unit(p.unit), interval(p)) for p in one.parameters]
    source = getattr(one, "source", "")
    equation, _, symbols = getattr(one, "equation", "").partition("\n")
    parts = (
        element("h3", joined([prose(one.title), " ", name])),
        caption(note),
        paragraph(equation, "equation"),
        bullets(symbols.split("; ") if symbols else (), "source"),
        table("parameter | value :n value | unit :u | 95 % interval :n", rows),
        paragraph(source and f"Source: {source}", "source"),
    )
    return element("div", joined(parts), "cause" if isinstance(one, Cause) else "cause rival") + "\n"


def _unknown(place: int, one: Unknown) -> Markup:
    about = paragraph(prose(one.sentence)) + caption(
        "The function has no physical law and does not name a cause."
    )
    drawn = drawings.panel_figure(f"unknown{place}", one.title, one.figure) if one.figure else ""
    return element("div", element("div", about) + figure(drawn), "pair")


def _detectable(unseen: Sequence[Unseen]) -> Markup:
    """Return a section on the smallest detectable size of each effect that was not found; empty if there is none."""
    if not unseen:
        return Markup()
    hidden: dict[str, list[str]] = {}
    for one in unseen:
        if one.smallest is None:
            hidden.setdefault(one.sentence, []).append(one.title)
    sized = [(one.title, typeset(one.sentence)) for one in unseen if one.smallest is not None]
    return section(
        "Smallest detectable effects",
        "An effect that was not found may still exist. If its size is at least the value in this table, these runs "
        "show it in 95 of 100 cases."
        if sized
        else "",
        table("effect | detectable size", sized),
        subheading("Effects without a detectable size") if hidden else "",
        table("effects | reason", [("; ".join(names), prose(why)) for why, names in hidden.items()]),
    )


def _gain(finding: Finding) -> Markup:
    """Return a section with the errors of both models on the test runs, and their curves."""
    runs = finding.provenance.report
    names = _names(finding)
    both = len(set(names)) > 1
    above = [one for one in finding.gains if one.channel == "all" or not _at_noise(one)]
    quiet = len(finding.gains) - len(above)
    heads = f"signal | error {names[0]} :n | error {names[1]} :n value | " if both else "signal | error :n | "
    heads += "noise :n | unit :u"
    return section(
        "Improvement on the test runs" if both else "How well the model predicts the test runs",
        f"RMS errors on the {f'{len(runs)} test runs' if runs[1:] else 'test run'}. No parameter was fitted to "
        f"{'these runs' if runs[1:] else 'this run'}.",
        table(heads, (_gain_row(one, both=both) for one in above)),
        caption(
            f"The errors of {'all' if len(above) < 2 else 'the other'} {quiet} signals are at the noise."
            if quiet > 1
            else "The error of one other signal is at the noise."
            if quiet
            else ""
        ),
        *(caption(_covered(one, names)) for one in finding.coverage if one.level == COVERED),
        drawing(drawings.gain_rows("gains", above, names) if both else ""),
        pairs(
            draw(f"{name}{place}", one, names)
            for place, one in enumerate(finding.traces[:TRACES])
            for name, draw in (("trace", drawings.trace_curves), ("error", drawings.trace_errors))
        ),
    )


def _names(finding: Finding) -> tuple[str, str]:
    """Return the texts for the two models of a finding."""
    if not finding.models.effects:
        return drawings.FUNCTION if _kept(finding) else drawings.MODEL
    return drawings.CAUSES if len(finding.models.effects) > 1 else drawings.CAUSE


def _at_noise(one: Gain) -> bool:
    ratios = one.noise_ratio_before, one.noise_ratio
    return all(ratio is not None and ratio < AT_NOISE for ratio in ratios)


def _kept(finding: Finding) -> bool:
    return any(one.kept for one in finding.unknowns)


def _covered(one: Coverage, names: tuple[str, str]) -> str:
    """Return a sentence on the share of samples within a noise band, for both models."""
    level, before, after = (percent(part or 0.0) for part in (one.level, one.before, one.after))
    found = after if names[0] == names[1] else f"{before} {names[0]} and {after} {names[1]}"
    return f"Errors within the {level} band of the noise: {found}. A perfect model has {level}."


def _gain_row(one: Gain, *, both: bool) -> tuple[object, ...]:
    errors = (one.rmse_before, one.rmse_after) if both else (one.rmse_after,)
    return "all signals" if one.channel == "all" else one.channel, *errors, one.floor, unit(one.unit)


def _details(finding: Finding) -> Iterator[Markup]:
    """Yield the sections on terms and on predicted results of plans."""
    yield section("Terms", facts_table(_TERMS))
    if finding.checks:
        measured = any(one.measured is not None for one in finding.checks)
        without, extended = _names(finding)
        heads = f"result | {without}, before the fit :n | {without}, fitted :n | {extended} (95 % interval) :n value"
        if without == extended:
            heads = "result | before the fit :n | fitted (95 % interval) :n value"
        heads += " | unit :u" + " | measured :n | measured in :u" * measured
        yield section(
            "Predicted results of test plans",
            "K′ is the dynamic stiffness, and c the damping. AW0 is the empty car, and AW3 the full car. No parameter "
            "was fitted to these results.",
            table(
                heads,
                (_check_row(one, both=without != extended, measured=measured) for one in finding.checks),
            ),
        )


def _check_row(one: CheckPrediction, *, both: bool, measured: bool) -> tuple[str, ...]:
    stock, tuned, read = (pair(n, one.uncertainty)[0] for n in (one.stock, one.tuned, one.measured))
    extended = " ± ".join(pair(one.extended, one.uncertainty))
    found = (read, one.run) if measured else ()
    return primed(one.name), stock, *((tuned,) if both else ()), extended, unit(one.unit), *found


def _next_steps(finding: Finding) -> Markup:
    """Return a section on the runs and reference measurements that would distinguish the causes."""
    most = max((run.per_minute or 0.0 for run in finding.next_runs), default=0.0)
    titles = _titles(finding)
    keys = re.compile("|".join(sorted(map(re.escape, titles), key=len, reverse=True)))
    rows = [
        (
            run.experiment,
            run.minutes,
            "yes" if (run.bic_gap or 0.0) >= DISTINGUISHED else "no",
            _share(run.per_minute, most),
            keys.sub(lambda key: titles[key[0]], run.pair),
        )
        for run in finding.next_runs[:RUNS]
    ]
    heads = "run | duration in min :n | distinguishes all causes :u | power per minute :bars | most similar causes :u"
    sensors = bullets((prose(one.sentence) for one in finding.next_sensors), "sentences")
    return section(
        "How to distinguish the causes",
        "Make the first run of this table next." if rows else "",
        table(heads, rows),
        subheading("Reference measurements that also help") + sensors if sensors else "",
    )


def _share(value: float | None, most: float) -> Markup:
    width = round(100.0 * max(value or 0.0, 0.0) / most, 1) if most > 0.0 else 0
    return element("span", "", "share", style=f"width:{width}%")


def _tests(finding: Finding) -> Iterator[Markup]:
    """Yield the sections on the scores of all candidates, including rejected ones, and on the tests of the
    residuals.
    """
    known = {*finding.names, *(one.effect for one in finding.ambiguous_with)}
    above = [
        one for one in finding.scores if (one.score or 0.0) > finding.threshold and one.effect not in known
    ]
    rejected = [(one.title, one.score, prose(one.outcome)) for one in above if one.outcome != EXPLAINED]
    explained = len(above) - len(rejected)
    yield section(
        "Tested effects",
        f"{len({one.effect for one in finding.scores})} effects were tested. In {percent(finding.alpha)} of diagnoses, "
        "chance alone gives a score above the threshold. The figure shows scores in the base model.",
        drawing(drawings.score_points("scores", finding.scores, finding.threshold)),
        subheading("Effects above the threshold that were not accepted") if rejected else "",
        table("effect | score :n | reason", rejected),
        caption(
            "Scores are calculated for small effects. Effects with equal scores can act alike when small, but not when "
            "large."
            if len({shown(score) for _, score, _ in rejected}) < len(rejected)
            else ""
        ),
        caption(
            f"{explained} other effect{'s exceed' if explained > 1 else ' exceeds'} the threshold with the base model, "
            "but not with the final model."
            if explained
            else ""
        ),
    )
    if not finding.panel:
        return
    clear = sorted(
        (row for row in finding.panel if row.significant),
        key=lambda row: (row.q or 0.0, -(row.statistic or 0.0)),
    )
    rows = [(prose(row.sentence), row.run, row.points_to) for row in _one_of_each_test_first(clear)]
    drawn = [(f"{row.title}: {row.channel}", row.figure) for row in clear if row.figure][:FIGURES]
    yield section(
        "Errors of the base model",
        "These tests show where and when the measured values differ from the base model. They also find "
        "errors that are much smaller than the noise. The verdict does not use them.",
        drawing(drawings.panel_map("panel", finding.panel)),
        caption(
            "Each row is a test, and each column a signal. Orange: the test finds an error; the darker, the clearer. "
            "Grey: chance can explain the error. Dot: the test does not apply. Most tests first filter the error "
            "so that neighbouring samples of the noise are independent, and subtract what other tests describe. So "
            "their results can differ from the figures, which show the error itself."
        ),
        table("clearest results | run :u words | typical causes :u words", rows),
        pairs(drawings.panel_figure(f"panel{place}", *one) for place, one in enumerate(drawn)),
    )


def _limits(finding: Finding) -> Iterator[Markup]:
    """Yield the sections on what these runs can distinguish, on changes of the base parameters, and on the data and
    their checks.
    """
    if finding.verdict is not Verdict.NO_EFFECT:
        yield _detectable(finding.not_seen)
    if finding.confusability:
        titles = _titles(finding)
        alike: dict[str, list[str]] = {}
        for one in finding.confusability.pairs:
            if not one.separable:
                alike.setdefault(titles[one.first], []).append(titles[one.second])
        rows = [(first, "; ".join(others)) for first, others in alike.items()]
        few = len(finding.confusability.effects) <= drawings.MOST_NUMBERS
        numbers = " The numbers are similarities above 0.9." if few else ""
        yield section(
            "What these runs can distinguish",
            "Two effects in a dark field change the measured values in nearly the same way. If their similarity is "
            "nearly 1, small effects cannot be distinguished; larger ones may be." + numbers,
            drawing(drawings.cosine_map("cosines", finding.confusability, titles)),
            subheading("Effects that look alike at their expected sizes") if rows else "",
            caption("Each pair is listed once. Effects of other sizes may be distinguished." if rows else ""),
            table("effect | similar effects", rows),
        )
    expected = {(one.name, one.run): one for one in finding.imitations}
    changed = [_shift_row(one, expected.get((one.name, one.run))) for one in _largest_shifts(finding.shifts)]
    if changed:
        names = _names(finding)
        yield section(
            f"Parameters that the cause{'s change' if names is drawings.CAUSES else ' changes'}",
            "These parameters have different values in the two fits. The values have 95 % intervals.",
            table(
                f"parameter | run :u | {names[0]} :n | {names[1]} :n value | expected :n | unit :u", changed
            ),
        )
    if finding.quality or finding.readings:
        yield section(
            "Data quality",
            bullets(map(prose, finding.readings), "sentences"),
            table("file | columns | problem | number | treatment", _quality_rows(finding.quality)),
        )
    yield section(
        "Data and settings",
        "The same data, settings and versions give the same result. All settings are in finding.json.",
        facts_table(_facts(finding)),
    )


def _quality_rows(rows: Sequence[DataQuality]) -> list[tuple[object, ...]]:
    """Return the rows of the table of data quality. Columns of a file with the same result share a row."""
    columns: dict[tuple[str, ...], list[str]] = {}
    for one in rows:
        of = f"gap{'s' if one.count > 1 else ''} in" if one.check == "missing" else "of"
        count, then = f"{one.count} {of} {one.samples} samples", prose(one.consequence)
        key = (one.file, prose(one.found), count, f"{then}; doubtful" if one.doubt else then)
        columns.setdefault(key, []).append(one.column)
    return [(key[0], ", ".join(names), *key[1:]) for key, names in columns.items()]


def _shift_row(one: Shift, prior: Imitation | None) -> tuple[str, ...]:
    numbers = ((one.before, one.sd_before), (one.after, one.sd_after))
    before, after = (" ± ".join(pair(value, None if sd is None else Z95 * sd)) for value, sd in numbers)
    expected = " ± ".join(pair(prior.expected, Z95 * prior.sd)) if prior else ""
    return in_words(one.name), one.run, before, after, expected, unit(one.unit)


def _titles(finding: Finding) -> dict[str, str]:
    """Return the titles of all tested effects by key."""
    return {one.effect: one.title for one in finding.causes} | {
        one.effect: one.title for one in finding.scores
    }


def interval(estimate: Estimate) -> str:
    """Return the 95 % interval of a fitted number as text; an upper bound if the samples do not resolve the number."""
    if estimate.below is not None:
        return f"below {shown(estimate.below, 2)} (too small to measure)"
    if estimate.low is None or estimate.high is None:
        return "not known"
    half = 0.5 * (estimate.high - estimate.low)
    return " to ".join(pair(end, half)[0] for end in (estimate.low, estimate.high))


def _one_of_each_test_first(rows: Sequence[PanelRow]) -> list[PanelRow]:
    """Return the panel rows to show: first the clearest row of every test, then the others, clearest first."""
    first: dict[str, PanelRow] = {}
    for row in rows:
        first.setdefault(row.test, row)
    best = list(first.values())
    return [*best, *(row for row in rows if row not in best)][:SENTENCES]


def _largest_shifts(shifts: Sequence[Shift]) -> list[Shift]:
    """Return the parameters whose values with the causes are outside the 95 % intervals without the causes, largest
    shift first.
    """
    moved = [shift for shift in shifts if abs(shift.sigmas or 0.0) > Z95]
    return sorted(moved, key=lambda shift: -abs(shift.sigmas or 0.0))[:SHIFTS]


def _facts(finding: Finding) -> list[tuple[str, str]]:
    source = finding.provenance
    facts = {
        "verdict code in finding.json": finding.verdict.value,
        "model": source.simulator,
        "identity": source.identity,
        "fit runs": ", ".join(source.fit),
        "validation runs": ", ".join(source.select),
        "test runs": ", ".join(source.report),
        "files": ", ".join(source.sources),
        "hash of the data": source.digest,
        "random seed": str(source.seed),
        "software": ", ".join(f"{name} {number}" for name, number in source.versions.items()),
    }
    return [(name, value) for name, value in facts.items() if value]
