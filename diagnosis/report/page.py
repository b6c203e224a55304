"""The report of a diagnosis: one self-contained HTML page, made from the finding and its history."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import starmap
from pathlib import Path
from typing import Any, Final, NamedTuple

from markupsafe import Markup, escape

from bench_records.document import (
    Banner,
    Document,
    bullets,
    caption,
    drawing,
    element,
    facts_table,
    figure,
    joined,
    key_facts,
    pairs,
    paragraph,
    section,
    subheading,
    table,
)
from bench_records.twin import PARTS
from bench_records.typography import primed
from diagnosis.contracts import DataQuality
from diagnosis.estimates import Z95, in_words
from diagnosis.finding import (
    Cause,
    CheckPrediction,
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
from diagnosis.report.words import chance, gained, pair, percent, percents, prose, shown, typeset, unit

#: The page is for reading; finding.json has all data.
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


#: Terms of the statistics and their meaning.
_TERMS: Final = (
    ("base model", "the model that was diagnosed, with its parameters fitted to the data"),
    ("candidate", "an effect that the base model lacks and that the diagnosis tests"),
    ("cause", "a candidate that passed every test, and is accepted"),
    ("final model", "the base model with the causes"),
    ("fit runs", "runs to which parameters are fitted"),
    ("validation runs", "runs that select among the candidates"),
    ("test runs", "runs on which the error is measured; no fit uses them"),
    ("prior", "the expected value of a parameter before the fit, with its uncertainty"),
    ("residual", "measured value minus value of the fitted model, also called error"),
    (
        "footprint",
        "the change of the measured values by an effect, after subtraction of what other parameters can also produce",
    ),
    ("score", "the fitted size of a footprint in the residual, divided by its standard deviation"),
    ("threshold", "the score that chance alone seldom exceeds"),
    ("λ", "how much an accepted cause explains: the root of the increase of χ² without it"),
    ("cosine", "the similarity of two footprints, from 0 (different) to 1 (equal)"),
    ("BIC", "a number that compares models by their misfit and number of parameters; a lower BIC is better"),
    ("log density", "how well a model and its stated uncertainty predict new runs; a higher value is better"),
)
_STYLE: Final = """\
.banner.calm { --tone: var(--pass); } .banner.found { --tone: var(--found); }
.banner.open { --tone: var(--marginal); } .banner.alarm { --tone: var(--fail); }
.banner .word { font-size: 1.25rem; letter-spacing: .06em; max-width: 15rem; line-height: 1.2; }
.cause { border-left: 4px solid var(--found); padding: .15rem 0 .2rem 1.1rem; margin: 0 0 1.5rem; break-inside: avoid; }
.cause.rival { border-color: #b87a00; } .cause table { max-width: 38rem; margin: .4rem 0 .5rem; }
.cause small { font: 400 .8rem/1.3 "Helvetica Neue", Helvetica, "Liberation Sans", sans-serif; color: var(--soft); }
.equation { font: italic 1.06rem/1.5 "STIX Two Text", "Cambria Math", Charter, Georgia, serif; margin: .2rem 0 .3rem; }
.source { color: var(--soft); font-size: .84rem; }
.share { background: var(--part); height: .72em; display: inline-block; min-width: 1px; vertical-align: middle; }
h3.sub { margin: 1.5rem 0 .5rem; } .bars { width: 30%; } * + .pair { margin-top: 1rem; }
dl.first > div { display: grid; grid-template-columns: 8.5rem 1fr; gap: 0 .8rem; margin-bottom: .3rem; }
dl.first, dl.first dd { margin: 0; } dl.first dt { color: var(--soft); }
@media (max-width: 40rem) { dl.first > div { grid-template-columns: 1fr; } }
.statistics { font-size: 1.5rem; margin: 2.4rem 0 .6rem; }
ul.sentences { max-width: 54rem; } ul.sentences li { margin-bottom: .18rem; }
"""
#: Names of the settings of a diagnosis on the page.
_SETTINGS: Final = {
    "alpha": "chance of a false alarm per diagnosis",
    "alpha_unknown": "significance level of unknown effects (surfaces)",
    "max_effects": "maximum number of causes",
    "fits": "candidates fitted in each step",
    "ambiguous": "largest BIC gap of alternatives",
    "lpd_loss": "largest permitted loss of log density of the validation runs",
    "workers": "processor threads",
    "rough": "smallest λ of a further cause, divided by λ of the accepted causes",
    "gain": "smallest share of the error that a cause must explain",
    "with_panel": "tests of the error calculated",
    "with_gain": "improvement on test runs calculated",
    "effects": "tested effects",
}
_DOUBTFUL: Final = Markup("<b>Doubtful:</b> ")
_COVERED: Final = (
    "If fewer samples than expected are in a band, the errors are larger than the noise. If more samples are in it, "
    "the noise was estimated too large."
)


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
    shows_proof = finding.models.effects and finding.traces and not finding.suspected
    head = (
        bullets((_DOUBTFUL + prose(one) for one in finding.doubts), "sentences"),
        bullets(map(prose, finding.readings), "sentences"),
        Banner(
            "suspected" if finding.suspected else finding.verdict.value,
            element("dl", joined(element("div", one) for one in lines), "first"),
            tone="open" if finding.suspected else TONES[finding.verdict],
        ),
        figure(drawings.trace_errors("proof", finding.traces[0]) if shows_proof else ""),
    )
    return Document(
        f"{finding.verdict.value} – diagnosis of {simulator}",
        f"Diagnosis\u2002·\u2002{simulator}",
        [*_conclusions(finding, history), *_statistics(finding), *_tests(finding), *_limits(finding)],
        heading=headline(finding),
        banner=joined(head),
        style=_STYLE,
    ).html()


def _conclusions(finding: Finding, history: InvestigationHistory | None) -> Iterator[Markup]:
    """Yield the sections on data quality, causes and rivals, suspects, history, unknown effects, detectability and
    gain.
    """
    titles = _titles(finding)
    if finding.quality:
        heads = "file | column | check | finding | count | first at | treatment"
        yield section(
            "Data quality",
            "The checks of the data found these problems.",
            table(heads, map(_quality_row, finding.quality)),
        )
    if finding.causes:
        others = "Other causes that explain these runs equally well"
        yield section(
            "The causes" if finding.causes[1:] else "The cause",
            *map(_cause, finding.causes),
            subheading(others) if finding.ambiguous_with else "",
            *(_candidate(one, f", instead of: {titles[one.instead_of]}") for one in finding.ambiguous_with),
        )
    if finding.suspects:
        yield section(
            "Where to look first",
            "None of these candidates passes every test. If the structure of the model has an error, this list can "
            "show effects that the rig does not have.",
            *(_candidate(one, note=f"Not accepted: {typeset(one.why)}.") for one in finding.suspects),
        )
    if history:
        rows = [
            (place, run.plan, run.minutes, prose(run.why), prose(run.conclusion))
            for place, run in enumerate(history.runs, start=1)
        ]
        used = f"{shown(sum(run.minutes for run in history.runs))} of {shown(history.budget)} minutes on the bench"
        yield section(
            "How this was found",
            table(":n | plan | minutes :n value | why | result so far", rows),
            caption(f"The runs used {used}. Reason for the end: {typeset(history.ended)}"),
        )
    if finding.unknowns:
        yield section("Unknown effects", *starmap(_unknown, enumerate(finding.unknowns)))
    if finding.verdict is Verdict.NO_EFFECT:
        yield _detectable(finding.not_seen)
    if finding.gains:
        yield _gain(finding)


def _quality_row(one: DataQuality) -> tuple[object, ...]:
    doubt = Markup("; <b>doubt</b>") if one.doubt else ""
    of = f"gap{'s' if one.count > 1 else ''} in" if one.check == "missing" else "of"
    found, count = prose(one.found), f"{one.count} {of} {one.samples} samples"
    return one.file, one.column, one.check, found, count, one.first, escape(prose(one.consequence)) + doubt


def _cause(cause: Cause) -> Markup:
    """Return a cause and the other laws of its phenomenon."""
    other = f", another law of {cause.phenomenon}"
    separated = (
        f" This run can distinguish them: {typeset(cause.separated_by)}." if cause.separated_by else ""
    )
    note = f"These runs cannot distinguish this law from {cause.title}.{separated}"
    return joined([_candidate(cause), *(_candidate(law, other, note) for law in cause.laws)])


def _candidate(one: Cause | Rival | Suspect, about: str = "", note: str = "") -> Markup:
    name = element("small", f"\u2002family: {one.family}\u2002·\u2002key: {one.effect}{about}")
    rows = [(in_words(p.name), pair(p.value, p.sd)[0], unit(p.unit), interval(p)) for p in one.parameters]
    source = getattr(one, "source", "")
    equation, _, symbols = getattr(one, "equation", "").partition("\n")
    parts = (
        element("h3", joined([one.title, " ", name])),
        paragraph(equation, "equation"),
        paragraph(symbols, "source"),
        table("parameter | value :n value | unit :u | 95 % interval :n", rows),
        paragraph(source and f"Source: {source}", "source"),
        caption(note),
    )
    return element("div", joined(parts), "cause" if isinstance(one, Cause) else "cause rival") + "\n"


def _unknown(place: int, one: Unknown) -> Markup:
    about = paragraph(prose(one.sentence)) + caption(
        "A surface is a smooth function of two quantities. It has no physical law and does not name a cause."
    )
    drawn = drawings.panel_figure(f"unknown{place}", one.title, one.figure) if one.figure else ""
    return element("div", element("div", about) + figure(drawn), "pair")


def _detectable(unseen: Sequence[Unseen]) -> Markup:
    """Return the sizes from which on effects would be found; empty without any."""
    if not unseen:
        return Markup()
    heads = "effect | family :u | smallest :n value | unit :u | remaining footprint :n | result :u words"
    return section(
        "Smallest detectable effects",
        "An effect that was not found may still exist. At the size in this table or above, it would be found in 95 of "
        "100 cases.",
        table(heads, map(_unseen_row, unseen)),
        caption(
            "The remaining footprint is the share of the effect on the measured values that the model cannot imitate."
        ),
    )


def _unseen_row(one: Unseen) -> tuple[object, ...]:
    measured_in = "" if one.smallest is None else unit(one.unit)
    return one.title, one.family, one.smallest, measured_in, percent(one.visible), prose(one.sentence)


def _gain(finding: Finding) -> Markup:
    """Return the errors of both models on the report runs, and their curves."""
    extended, report = bool(finding.models.effects), finding.provenance.report
    covered = (map(percent, (one.level, one.before, one.after)) for one in finding.coverage)
    within = [(f"in the range that contains {level} of the noise", *both, level) for level, *both in covered]
    return section(
        "Improvement on the test runs" if extended else "How well the model predicts the test runs",
        f"No parameter was fitted to {'these runs' if report[1:] else 'this run'}: {', '.join(report)}.",
        table(
            "channel | RMS error before :n | after :n value | noise :n | unit :u | before, share of the signal :n "
            "words | after, share of the signal :n words | after, times the noise :n words | removed share of the "
            "squared error :n value words | 95 % interval :n",
            map(_gain_row, finding.gains),
        ),
        caption(
            "Before: the base model. After: the model with the causes. The signal is the standard deviation of the "
            "measured values. The removed share is (RMS₀² − RMS₁²) / (RMS₀² − noise²). RMS₀ is the RMS error before, "
            "and RMS₁ after. No model can remove the noise."
        ),
        table("share of the samples | before :n | after :n value | expected :n", within, "numbers"),
        caption(_COVERED if within else ""),
        drawing(drawings.gain_rows("gains", finding.gains) if extended else ""),
        pairs(
            draw(f"{name}{place}", one)
            for place, one in enumerate(finding.traces[:TRACES])
            for name, draw in (("trace", drawings.trace_curves), ("error", drawings.trace_errors))
        ),
    )


def _gain_row(one: Gain) -> tuple[object, ...]:
    removed = "within the noise" if one.fraction is None else percent(one.fraction)
    shares = (percent(one.nrmse_before), percent(one.nrmse_after), one.noise_ratio, removed)
    errors = (one.rmse_before, one.rmse_after, one.floor, unit(one.unit))
    return one.channel, *errors, *shares, percents(one.fraction_low, one.fraction_high)


def _statistics(finding: Finding) -> Iterator[Markup]:
    """Yield the figures behind the verdict: of the models, of the parameters and of each candidate."""
    source = finding.provenance
    gain = next((one for one in finding.gains if one.channel == "all" and one.noise_ratio is not None), None)
    facts = {
        "error before, on the test runs": gain and f"{shown(gain.noise_ratio_before)} × noise",
        "error after": gain and f"{shown(gain.noise_ratio)} × noise",
        "reduction of the RMS error (not squared) beyond the noise": gain
        and gain.fraction is not None
        and percent(gain.reduction),
        "fit, validation and test runs": f"{len(source.fit)}, {len(source.select)}, {len(source.report)}",
        "tested effects": str(len(finding.scores)),
        "chance of a false alarm per diagnosis": percent(finding.alpha),
    }
    known = key_facts((name, text) for name, text in facts.items() if text)
    yield element("h2", "Statistics", "statistics") + known
    yield section("Terms", facts_table(_TERMS))
    if finding.imitations:
        yield section(
            "Parameters that imitate the cause",
            "Without the cause, the fitted values of these parameters are far from the expected values. With the "
            "cause, they are near these. The distances are in standard deviations of the prior.",
            table(
                "parameter | run :u | without the cause :n value | with the cause :n | expected (prior) :n | "
                "± (95 %) :n | unit :u | distance without the cause :n words | distance with the cause :n words",
                map(_imitation_row, finding.imitations[:SHIFTS]),
            ),
        )
    if finding.checks:
        extended = ", and by the model with the causes (extended)" if finding.models.effects else ""
        heads = (
            "check | stock :n | tuned :n | extended :n value | ± (95 %) :n | measured :n value | unit :u | "
            "measured in :u"
        )
        yield section(
            "Predicted results of test plans",
            "These stiffnesses K′ and dampings c are predicted by the model with its parameters as shipped (stock), by "
            f"the base model at its best fit (tuned){extended}. AW0 is the empty car, AW3 the full car.",
            table(heads, map(_check_row, finding.checks)),
            caption(
                "The column ± is half of the 95 % interval of the extended prediction. No parameter was fitted to "
                "these results."
            ),
        )
    if rows := [*_strengths(finding)]:
        heads = (
            "effect | status | score :n | λ :n | BIC :n | log density of the validation runs :n | cosine :n"
        )
        yield section(
            "Strength of the evidence",
            f"The threshold of the scores is {shown(finding.threshold)}.",
            table(heads, rows),
            caption(
                "An alternative remains possible if its BIC is worse by less than 10. If the remaining error exceeds "
                "the noise, an alternative that predicts the test runs equally well also remains possible."
            ),
        )
    if finding.next_runs or finding.next_sensors:
        yield _next_steps(finding)


def _imitation_row(one: Imitation) -> tuple[object, ...]:
    values = (shown(n, 4) for n in (one.before, one.after, one.expected))
    return (
        in_words(one.name),
        one.run,
        *values,
        shown(Z95 * one.sd, 2),
        unit(one.unit),
        one.sigmas,
        one.sigmas_after,
    )


def _check_row(one: CheckPrediction) -> tuple[str, ...]:
    stock, tuned, measured = (pair(n, one.uncertainty)[0] for n in (one.stock, one.tuned, one.measured))
    extended = pair(one.extended, one.uncertainty)
    return primed(one.name), stock, tuned, *extended, measured, unit(one.unit), one.run


def _strengths(finding: Finding) -> Iterator[tuple[object, ...]]:
    """Yield effect, status, score, λ, BIC, log predictive density and cosine of each cause, rival and suspect."""
    titles = _titles(finding)
    for cause in finding.causes:
        gains = (gained(cause.bic_gain), gained(cause.lpd_gain))
        yield cause.title, cause.status, cause.score, cause.strength, *gains, ""
    for rival in finding.ambiguous_with:
        gap = gained(None if rival.bic_gap is None else -rival.bic_gap)
        yield (
            rival.title,
            f"instead of: {titles[rival.instead_of]}",
            "",
            "",
            f"{gap} than with that cause",
            "",
            rival.cosine,
        )
    for suspect in finding.suspects:
        yield suspect.title, "not accepted", "", suspect.strength, "", "", ""
    for one in finding.unknowns:
        near = "; ".join(f"{titles[other.effect]} (cosine {shown(other.cosine)})" for other in one.nearest)
        test = f"χ² = {shown(one.statistic)} with {one.freedom} degrees of freedom, p {chance(one.p)}"
        text = f"fitted surface, no cause. Test on the fit runs: {test}. Similar effects: {near}"
        yield one.title, text, "", "", "", gained(one.lpd_gain), ""


def _next_steps(finding: Finding) -> Markup:
    """Return the runs and reference measurements that would distinguish the causes."""
    most = max((run.per_minute or 0.0 for run in finding.next_runs), default=0.0)
    titles = _titles(finding)
    keys = re.compile("|".join(sorted(map(re.escape, titles), key=len, reverse=True)))
    rows = [
        (
            run.experiment,
            run.minutes,
            _gap(run.bic_gap),
            _gap(run.per_minute),
            _share(run.per_minute, most),
            keys.sub(lambda key: titles[key[0]], run.pair),
        )
        for run in finding.next_runs[:RUNS]
    ]
    note = (
        "The BIC gap shows how much worse the wrong model would predict this run. The parameters of both models are "
        "fitted again, within their tolerances. A gap of 10 is enough to distinguish the models."
    )
    heads = "run | minutes :n | expected BIC gap :n value | gap per minute :n | :bars | causes that this "
    heads += "run distinguishes least :u"
    sensors = bullets((prose(one.sentence) for one in finding.next_sensors), "sentences")
    return section(
        "How to distinguish the causes",
        table(heads, rows),
        caption(note if rows else ""),
        subheading("Reference measurements that also help") + sensors if sensors else "",
    )


def _share(value: float | None, most: float) -> Markup:
    width = round(100.0 * max(value or 0.0, 0.0) / most, 1) if most > 0.0 else 0
    return element("span", "", "share", style=f"width:{width}%")


def _tests(finding: Finding) -> Iterator[Markup]:
    """Yield the scores of all candidates, with those that were rejected, and the tests of the residuals."""
    rejected = [
        (one.title, one.family, one.score, typeset(one.shape), typeset(one.outcome))
        for one in finding.scores
        if (one.score or 0.0) > finding.threshold and one.outcome != "accepted"
    ]
    yield section(
        "Tested effects",
        "Each candidate has a score. By chance alone, the highest of all scores exceeds the threshold in "
        f"{percent(finding.alpha)} of diagnoses.",
        drawing(drawings.score_points("scores", finding.scores, finding.threshold)),
        subheading("Candidates above the threshold that were not accepted") if rejected else "",
        table("effect | family :u | score :n | at shape values :u words | reason", rejected),
    )
    if not finding.panel:
        return
    tested = [row for row in finding.panel if row.p is not None]
    clear = sorted(
        (row for row in tested if row.significant), key=lambda row: (row.q or 0.0, -(row.statistic or 0.0))
    )
    by_chance = (
        f" On average, at most {percent(0.01)} of the significant tests are false alarms." if clear else ""
    )
    rows = [
        (prose(row.sentence), row.run, chance(row.q), row.points_to) for row in _one_of_each_test_first(clear)
    ]
    drawn = [(f"{row.title}: {row.channel}", row.figure) for row in clear if row.figure][:FIGURES]
    yield section(
        "Tests of the error of the base model",
        "These tests show where and when the measured values differ from the base model. No test assumes a cause. "
        f"{len(tested)} tests apply, and {len(clear)} of them are significant.{by_chance}",
        drawing(drawings.panel_map("panel", finding.panel)),
        caption(
            "Each row is a test, each column a measured signal. The number is the statistic of a significant test (k: "
            "thousands, M: millions). A larger number makes the field darker. A field without a number can be due to "
            "chance. Each test has its own scale, so compare numbers only within a row. A dot means that the test does "
            "not apply."
        ),
        table(
            "result | run :u words | probability of such a result by chance :n | possible causes :u words",
            rows,
        ),
        pairs(drawings.panel_figure(f"panel{place}", *one) for place, one in enumerate(drawn)),
    )


def _limits(finding: Finding) -> Iterator[Markup]:
    """Yield what these runs can distinguish, how the base parameters moved, open points and provenance."""
    if finding.verdict is not Verdict.NO_EFFECT:
        yield _detectable(finding.not_seen)
    if finding.confusability:
        titles = _titles(finding)
        alike = table(
            "effect | similar effect | cosine :n | expected BIC gap :n",
            (
                (titles[one.first], titles[one.second], one.cosine, _gap(one.bic_gap))
                for one in finding.confusability.pairs
                if not one.separable
            ),
        )
        yield section(
            "What these runs can distinguish",
            "No method can distinguish two effects with the same footprint. A darker field means more similar "
            "footprints. The numbers are cosines above 0.9.",
            drawing(drawings.cosine_map("cosines", finding.confusability, titles)),
            subheading("Pairs that these runs cannot distinguish at the expected size") + alike
            if alike
            else "",
        )
    if shifts := _largest_shifts(finding.shifts):
        yield section(
            "The parameters of the base model, before and after",
            "If the model lacks a cause, wrong values of its parameters compensate for the cause. Their intervals are "
            "then too narrow. The shift is divided by the standard deviation from the fit without the cause. If a "
            "parameter is outside the grey band, its 95 % interval in the base model was too narrow.",
            drawing(
                drawings.shift_rows("shifts", [(_label(shift), shift.sigmas or 0.0) for shift in shifts])
            ),
            table(
                "parameter | run :u | before :n | ± (95 %) :n | after :n value | ± (95 %) :n | unit :u | shift, σ :n",
                map(_shift_row, shifts),
            ),
        )
    if finding.remains:
        yield section("Open points", bullets(map(prose, finding.remains), "sentences"))
    yield section(
        "Data and settings",
        "The same data, settings and versions give the same result.",
        facts_table(_facts(finding)),
    )


def _shift_row(one: Shift) -> tuple[str, ...]:
    numbers = ((one.before, one.sd_before), (one.after, one.sd_after))
    before, after = (pair(value, None if sd is None else Z95 * sd) for value, sd in numbers)
    return in_words(one.name), one.run, *before, *after, unit(one.unit), shown(one.sigmas, 2)


def _gap(value: float | None) -> str:
    return "below 0.01" if value is not None and value < 0.01 else shown(value)


def _titles(finding: Finding) -> dict[str, str]:
    """Return the titles of all tested effects by key."""
    return {one.effect: one.title for one in finding.causes} | {
        one.effect: one.title for one in finding.scores
    }


def interval(estimate: Estimate) -> str:
    """Return the 95 % interval of a fitted number as text, or the bound below which the samples do not resolve it."""
    if estimate.below is not None:
        return f"below {shown(estimate.below, 2)} (too small to measure)"
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


def _largest_shifts(shifts: Sequence[Shift]) -> list[Shift]:
    moved = [shift for shift in shifts if shift.sigmas is not None]
    return sorted(moved, key=lambda shift: -abs(shift.sigmas or 0.0))[:SHIFTS]


def _label(shift: Shift) -> str:
    return f"{in_words(shift.name)} [{shift.run}]" if shift.run else in_words(shift.name)


def _facts(finding: Finding) -> list[tuple[str, str]]:
    source = finding.provenance
    facts: dict[str, Any] = {
        "simulator": source.simulator,
        "identity": source.identity,
        "fit runs": ", ".join(source.fit),
        "validation runs": ", ".join(source.select),
        "test runs": ", ".join(source.report),
        "files": ", ".join(source.sources),
        "hash of the data": source.digest,
        "seed": source.seed,
        **{f"version of {name}": number for name, number in source.versions.items()},
        **{_SETTINGS.get(name, name): value for name, value in source.config.items() if name != "seed"},
    }
    return [(name, _plain(value)) for name, value in facts.items() if value not in ("", None)]


def _plain(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
