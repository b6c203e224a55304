"""The whole diagnosis: from runs and a simulator to a finding, reproducible from its seed.

The method has nine steps; docs/explanation/how-the-diagnosis-works.md explains them with examples. Each step has files
that start with their theory of operation. All levels and limits are in `config.py`.

    1  residual           residual/panel.py
    2  base parameters    base_model.py, by fitting/
    3  noise              noise_estimate.py, noise.py, whitening.py
    4  footprint, score   footprints.py, screening.py
    5  threshold          threshold.py
    6  fit and gates      search.py: trials.py, gates.py, family.py, admission.py, rivals.py, finite_sizes.py (causes
                          that act only at times), backward.py
    7  unknown terms      omnibus.py, unknown.py, cause_removal.py
    8  verdict            verdict.py, constancy.py, prior_conflict.py, rivals_unseen.py (rivals that unseen runs allow);
                          displaced.py (steps 6 to 8 without effects that displaced a better cause);
                          equivalence_classes.py (laws of one phenomenon that these runs do not distinguish);
                          then confusability.py (detection limits) and next_run.py (runs that would decide)
    9  gain               best_base.py, gain.py, remainder.py; model_error.py and intervals.py (intervals);
                          goodness.py (each channel against its noise: it may contradict *no effect*)

`diagnose` takes them in this order, except for the first. The panel of step 1 tests the residual of the base model in
units of the noise. The noise is final only after step 7, so the panel is computed then. No other step uses it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from itertools import combinations

from diagnosis.contracts import (
    Array,
    CheckFigures,
    Dataset,
    DiagnosisError,
    Experiment,
    Hypothesis,
    MeasuredRun,
    Simulator,
)
from diagnosis.engine.base_model import without_effects
from diagnosis.engine.best_base import best_before, noise_ratio
from diagnosis.engine.config import NOISE_RATIO_SHOWN, PANEL_FDR, Config
from diagnosis.engine.confusability import Company, confusability, unseen
from diagnosis.engine.displaced import without_substitutes
from diagnosis.engine.equivalence_classes import indistinguishable_laws
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.predict import Prediction, predict
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.gain import Comparison, compare, models, shifts
from diagnosis.engine.gates import not_above, samples_at_rest
from diagnosis.engine.goodness import Misfit, as_sentence, humming, misfits
from diagnosis.engine.intervals import intervals
from diagnosis.engine.memory import give_back, share_heap
from diagnosis.engine.model_error import widened
from diagnosis.engine.next_run import rank, sensors
from diagnosis.engine.predicted_checks import confirmed, predicted_checks
from diagnosis.engine.prediction_share import residual_bound
from diagnosis.engine.prior_conflict import contradicted, imitations
from diagnosis.engine.remainder import Remainder, held_back, least_left, remainder
from diagnosis.engine.residual.panel import panel
from diagnosis.engine.rivals_unseen import Undecided, undecided
from diagnosis.engine.runs import measured_channels, split
from diagnosis.engine.search import Progress, search
from diagnosis.engine.search_state import Problem, SearchResult
from diagnosis.engine.summary import ROLES, Conclusions, further, summarised
from diagnosis.engine.suspects import suspects
from diagnosis.engine.threads import algebra_on_one_core, aside
from diagnosis.engine.verdict import Judgement, final, judge, without_surfaces
from diagnosis.engine.wording import cause, laws, rivals, scores
from diagnosis.finding import (
    Cause,
    Finding,
    NextRun,
    NextSensor,
    PanelRow,
    Provenance,
    Rival,
    Suspect,
    Unseen,
    Verdict,
)


@algebra_on_one_core
def diagnose(
    dataset: Dataset,
    simulator: Simulator,
    config: Config | None = None,
    progress: Progress | None = None,
    menu: Sequence[Experiment] = (),
    checks: CheckFigures | None = None,
) -> Finding:
    """Return a finding: the effects that the simulator lacks, their uncertainty, and how much they improve the
    prediction.

    If all runs have the same role, ``split`` assigns roles. ``menu`` holds runs that the rig could do next, each with
    its duration in minutes. ``checks`` compute the figures of test plans, which the models predict.

    Raises ``DiagnosisError`` for data or a request that cannot be diagnosed.
    """
    share_heap()
    give_back()  # The reader of the data has left space.
    config = config or Config()
    report = progress or (lambda _text, _part: None)
    data, model = measured_channels(dataset, simulator)
    if len({run.role for run in data.runs}) == 1:
        data = split(data, config.seed)
    if not data.of("fit"):
        raise DiagnosisError("no run has the role 'fit'; give this role to at least one run")
    hypotheses = _chosen(model.catalogue, config)
    sharper = model.sharpened(data.of("fit"), data.channels)
    hypotheses |= {name: one for name, one in sharper.items() if name in hypotheses}
    replay = Replay(model, data.of("fit"), config.workers)
    problem = Problem(replay, data.of("select"), hypotheses, config)

    found = search(problem, report)  # steps 2 to 6
    report("looking for unknown effects", 0.91)
    judgement = without_substitutes(problem, judge(problem, found))  # steps 7 and 8
    del found  # The columns of all candidates are large and no longer needed.
    report("calculating the improvement", 0.92)
    return _finding(data, judgement, hypotheses, config, menu, checks)  # steps 1 and 9


def _chosen(catalogue: Mapping[str, Hypothesis], config: Config) -> dict[str, Hypothesis]:
    """Return the part of the catalogue that the diagnosis searches."""
    if config.effects is None:
        return dict(catalogue)
    for name in config.effects:
        if name not in catalogue:
            raise DiagnosisError(
                f"there is no effect {name!r} in the catalogue; its effects are {', '.join(catalogue)}"
            )
    return {name: catalogue[name] for name in config.effects}


def _finding(
    data: Dataset,
    judgement: Judgement,
    hypotheses: Mapping[str, Hypothesis],
    config: Config,
    menu: Sequence[Experiment],
    checks: CheckFigures | None,
) -> Finding:
    """Compare the base model and the extended model, and return the finding with all results."""
    role, runs = held_back(data)
    judgement, after = _worthwhile(judgement, runs, config)
    found, extended, named = judgement.found, judgement.model, judgement.screened.model
    base = _base_model(found, extended, named)
    watching = _panel_aside(base, config)
    floors = not_above(found.floors, extended, after)
    best, before = best_before(base, after, floors) if extended.effects else (base, after)
    left = remainder(role, base, before, after, extended, [one.effect for one in found.accepted], floors)
    alike = undecided(found, named, hypotheses, left, after, floors)
    wrong = _misfits(data, base, extended, after, floors, config.alpha)
    missed, hums = [as_sentence(one, ROLES) for one in wrong], humming(data, config.alpha)
    verdict = verdict_on(final(judgement.verdict, left, len(alike)), data, wrong, hums)
    differing = _differing(judgement.verdict, verdict, (best, extended), data, floors)
    gain = _gain(before, after, floors, role, config)
    covariance = widened(named, judgement.screened.tests, residual_bound(data.of("select"), found.floors))
    accepted = _causes(found, named, covariance, hypotheses, left, config)
    causes, others, near = _reported(judgement, verdict, accepted, alike, hypotheses, config)
    next_runs, next_sensors = _deciding(judgement, alike, config, menu) if others else ([], [])
    spread = covariance if extended is named else widened(extended, ())
    predicted = predicted_checks(checks, data.beside, best, extended, spread, seed=config.seed)
    screening, beyond = found.steps[0].screening, judgement.screened.screening
    finding = Finding(
        verdict=verdict,
        sentence="",
        causes=confirmed(causes, predicted),
        threshold=screening.threshold,
        alpha=config.alpha,
        provenance=_provenance(data, extended, config),
        models=models(best, extended, gain),
        ambiguous_with=others,
        suspects=near,
        scores=scores(found, beyond),
        gains=gain.gains,
        coverage=gain.coverage,
        not_seen=_not_seen(judgement, left, config),
        next_runs=next_runs,
        next_sensors=next_sensors,
        shifts=shifts(best, extended, spread),
        panel=watching(),
        confusability=confusability(screening),
        unknowns=list(judgement.unknowns),
        remains=[*filter(None, [differing]), *_remains(data, judgement, left), *missed],
        traces=gain.traces,
        doubts=[*data.doubts, *hums, *contradicted(extended)],
        readings=list(data.readings),
        quality=list(data.quality),
        imitations=imitations(best, extended) if causes else [],
        checks=predicted,
    )
    misfit = missed[0] if missed and not (causes or near) else ""
    return summarised(finding, Conclusions(accepted, left, hypotheses, further(beyond), misfit, differing))


def _gain(before: Prediction, after: Prediction, floors: Array, role: str, config: Config) -> Comparison:
    """Compare the models on the test runs; without such runs the comparison is empty."""
    if config.with_gain and role == "report":
        return compare(before, after, floors, seed=config.seed)
    return Comparison()


def _reported(
    judgement: Judgement,
    verdict: Verdict,
    accepted: list[Cause],
    alike: Sequence[Undecided],
    hypotheses: Mapping[str, Hypothesis],
    config: Config,
) -> tuple[list[Cause], list[Rival], list[Suspect]]:
    """Return the causes, alternatives and suspects that go with a verdict."""
    if verdict is Verdict.UNRESOLVED:
        ambiguous = config.ambiguous
        return [], [], suspects(judgement.dismissed, judgement.found, accepted, hypotheses, ambiguous)
    if verdict is Verdict.AMBIGUOUS:
        return accepted, rivals(judgement.found, hypotheses, config.ambiguous, alike), []
    return accepted, [], []


def _worthwhile(
    judgement: Judgement, runs: Sequence[MeasuredRun], config: Config
) -> tuple[Judgement, Prediction]:
    """Return the judgement and its prediction of unseen ``runs``. Surfaces are removed from the model if they make this
    prediction worse.
    """
    after, named = predict(judgement.model, runs, fixed=True), judgement.screened.model
    if judgement.model is named:
        return judgement, after
    without = predict(named, runs, after.linearisation, fixed=True)
    floors = judgement.found.floors
    if noise_ratio(after, floors) < noise_ratio(without, floors):
        return judgement, after
    return without_surfaces(judgement, config), without


def _differing(
    judged: Verdict, verdict: Verdict, models: tuple[FittedModel, FittedModel], data: Dataset, floors: Array
) -> str:
    """Return a sentence if the verdict by the test runs differs from that by the validation runs; otherwise ""."""
    select = data.of("select")
    if verdict is judged or not data.of("report") or not select:
        return ""
    before, after = (predict(model, select, fixed=True) for model in models)
    ratios = noise_ratio(before, floors), noise_ratio(after, floors)
    chosen = final(judged, Remainder("select", *ratios, least_left(before, after, floors)))
    if chosen is verdict:
        return ""
    return (
        f"The test runs changed the verdict. By the validation runs it would be {chosen.value}, with an error of "
        f"{ratios[1]:.3g} times the noise."
    )


def _misfits(
    data: Dataset, base: FittedModel, model: FittedModel, after: Prediction, floors: Array, alpha: float
) -> list[Misfit]:
    """Return the misfits of a model on its fit runs, and of its prediction ``after`` on the runs that are held back."""
    there = {
        "fit": (model.replay.runs, model.predictions),
        held_back(data)[0]: (after.replay.runs, after.outputs),
    }
    errors = [
        (one, [(run, run.outputs - outputs) for run, outputs in zip(runs, predicted, strict=True)])
        for one, (runs, predicted) in there.items()
    ]
    at_rest = samples_at_rest((*data.of("fit"), *data.of("select")), base.noise)
    return misfits(data.channels, errors, floors, at_rest, alpha)


def _panel_aside(base: FittedModel, config: Config) -> Callable[[], list[PanelRow]]:
    """Start the panel of tests in another thread; return a function that waits for its rows."""
    return aside(
        config.workers,
        lambda: panel(base, seed=config.seed, alpha=PANEL_FDR) if config.with_panel else [],
    )


def _not_seen(judgement: Judgement, left: Remainder, config: Config) -> list[Unseen]:
    """Return the detection limit of each effect that was not found."""
    screened, accepted = judgement.screened, judgement.found.accepted
    company = Company(sum(a.lambda_**2 for a in accepted), screened.model.samples, left.after, config)
    return unseen(screened.screening, screened.model, company, [one.effect for one in accepted])


def verdict_on(
    verdict: Verdict, data: Dataset, wrong: Sequence[Misfit] = (), hums: Sequence[str] = ()
) -> Verdict:
    """Return the verdict that the data allow.

    A verdict of no effect is not valid if the data are in doubt, or if errors exceed the noise.
    """
    if verdict is not Verdict.NO_EFFECT:
        return verdict
    if wrong:
        return Verdict.UNRESOLVED
    return Verdict.DOUBTFUL if hums or any(row.doubt for row in data.quality) else verdict


def _causes(
    found: SearchResult,
    named: FittedModel,
    covariance: Array,
    hypotheses: Mapping[str, Hypothesis],
    left: Remainder,
    config: Config,
) -> list[Cause]:
    """Return the accepted causes for the finding, each with other laws of the same phenomenon that fit equally well."""
    fits = indistinguishable_laws(found, hypotheses, config.ambiguous, config.rough)
    causes = []
    for one in found.accepted:
        effect = hypotheses[one.effect]
        others = laws(found, hypotheses, one.effect, fits[one.effect])
        would = next((hypotheses[law.effect].separated_by for law in others), "") or effect.separated_by
        numbers = intervals(effect, named, covariance)
        causes.append(cause(one, effect, numbers, left, others, would if others else ""))
    return causes


def _base_model(found: SearchResult, extended: FittedModel, named: FittedModel) -> FittedModel:
    """Fit the base model under the noise of the extended model, from the last fit of the base model if there is one."""
    point = without_effects(extended.point)
    near = next((one for one in found.without.values() if not one.effects), None)
    if near is None:
        return fit(extended.replay, extended.noise, point, named.linearisation)
    return fit(extended.replay, extended.noise, near.point, near.linearisation)


def _deciding(
    judgement: Judgement, alike: Sequence[Undecided], config: Config, menu: Sequence[Experiment]
) -> tuple[list[NextRun], list[NextSensor]]:
    """Rank the runs that would separate undecided causes, and the parameters to calibrate for the same purpose."""
    model = judgement.screened.model
    others = [
        *(one.model for one in alike),
        *(
            fit(model.replay, model.noise, trial.point, model.linearisation)
            for _, trial in judgement.found.ambiguous(config.ambiguous)
        ),
    ]
    references = {
        sensor.name: sensor
        for first, second in combinations((model, *others), 2)
        for sensor in reversed(sensors(first, second))
    }
    ranked = sorted(references.values(), key=lambda sensor: -(sensor.bic_gap or 0.0))
    return rank((model, *others), menu) if menu else [], ranked


def _remains(data: Dataset, judgement: Judgement, left: Remainder) -> list[str]:
    """Return sentences on unexplained errors, and on checks that were not possible."""
    screening = judgement.screened.screening
    sentences = []
    if open_ := [
        f"{screening.candidates[i].effect.title} ({screening.z[i]:.2f})" for i in screening.exceeding
    ]:
        sentences.append(
            f"These effects may also be present, because their scores in the final model are above its threshold of "
            f"{screening.threshold:.2f}: {'; '.join(open_)}."
        )
    if not judgement.model.converged:
        sentences.append("The fit of the last model did not converge; its intervals are not reliable.")
    if left.after > NOISE_RATIO_SHOWN:
        sentences.append(
            f"{ROLES[left.role]}, the remaining error is {left.after:.3g} times the noise. The model does not "
            "explain all of it."
        )
    if not data.of("select"):
        sentences.append(
            "There are no validation runs (role 'select'), so no cause was tested on data outside of its fit."
        )
    if not data.of("report"):
        sentences.append(
            "There are no test runs (role 'report'), so the improvement on unseen data is unknown."
        )
    return sentences


def _provenance(data: Dataset, model: FittedModel, config: Config) -> Provenance:
    names = {
        role: [run.experiment.name for run in data.runs if run.role == role]
        for role in ("fit", "select", "report")
    }
    settings = {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(config).items()}
    return Provenance(
        simulator=model.replay.simulator.name,
        identity=model.replay.simulator.identity,
        seed=config.seed,
        fit=names["fit"],
        select=names["select"],
        report=names["report"],
        digest=data.digest,
        sources=list(data.sources),
        versions={package: version(package) for package in ("astb", "numpy", "scipy")},
        config=settings,
    )
