"""The whole diagnosis: from runs and a simulator to a finding, reproducible from its seed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from importlib.metadata import version
from itertools import combinations
from typing import Final

from diagnosis.contracts import Dataset, DiagnosisError, Experiment, Hypothesis, MeasuredRun, Simulator
from diagnosis.engine.config import Config
from diagnosis.engine.confusability import confusability, unseen
from diagnosis.engine.fitting.fit import PATIENT, FittedModel, fit
from diagnosis.engine.fitting.point import Point
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.footprints import Footprints, candidates, footprints, joined, with_surfaces
from diagnosis.engine.gain import Measured, measure, models, shifts
from diagnosis.engine.naming import Naming, Search
from diagnosis.engine.next_run import rank, sensors
from diagnosis.engine.residual.panel import panel
from diagnosis.engine.runs import measured, split
from diagnosis.engine.screening import ScreenedModel, fit_and_screen
from diagnosis.engine.verdict import Judgement, judge
from diagnosis.engine.wording import cause, rivals, scores, sentence
from diagnosis.finding import Finding, Gain, NextRun, NextSensor, Provenance, Verdict

#: So many times the noise on the report runs are worth a sentence.
WORSE: Final = 1.2

Progress = Callable[[str, float], None]


def diagnose(
    dataset: Dataset,
    simulator: Simulator,
    config: Config | None = None,
    progress: Progress | None = None,
    menu: Sequence[Experiment] = (),
) -> Finding:
    """Say what the data tell of the simulator: what it lacks, how sure that is, and what adding it gains.

    Runs that all have the same role are split by ``split``. ``menu`` holds the runs that the rig could do next, each
    with its minutes. Raises ``DiagnosisError`` for data or a request that cannot be diagnosed.
    """
    config = config or Config()
    tell = progress or (lambda _text, _part: None)
    data, model = measured(dataset, simulator)
    if len({run.role for run in data.runs}) == 1:
        data = split(data, config.seed)
    if not data.of("fit"):
        raise DiagnosisError("no run has the role 'fit': the parameters must be fitted to at least one")
    effects = _chosen(model.catalogue, config)
    replay = Replay(model, data.of("fit"), config.workers)

    naming = Search(replay, data.of("select"), effects, config, tell).run()
    tell("looking for what has no name", 0.85)
    sight, judgement, naming = _judged(naming, effects, config)
    tell("measuring the gain", 0.92)
    return _conclusion(data, naming, sight, judgement, effects, config, menu)


def _chosen(catalogue: Mapping[str, Hypothesis], config: Config) -> dict[str, Hypothesis]:
    """Return the part of the catalogue that is looked for."""
    if config.effects is None:
        return dict(catalogue)
    for name in config.effects:
        if name not in catalogue:
            raise DiagnosisError(f"the catalogue holds no effect {name!r}; it has {', '.join(catalogue)}")
    return {name: catalogue[name] for name in config.effects}


def _judged(
    naming: Naming, effects: Mapping[str, Hypothesis], config: Config
) -> tuple[ScreenedModel, Judgement, Naming]:
    """Judge the result of the search, with the noise estimated anew without what surfaces explain.

    What is doubtful leaves the model.
    """
    select = naming.prediction.replay.runs if naming.prediction else ()
    replay = naming.model.replay
    if not replay.simulator.surfaces:
        sight = ScreenedModel(naming.model, naming.screen, ())
        return sight, judge(naming, sight, sight, select, config), naming
    around = with_surfaces(replay, naming.around)
    while True:
        sight = fit_and_screen(replay, around, alpha=config.alpha, seed=config.seed, steps=PATIENT)
        whole = _with_more(around, replay, select, config) if select else sight
        judgement = judge(naming, sight, whole, select, config)
        if not judgement.doubtful:
            return sight, judgement, naming
        naming = replace(
            naming, accepted=tuple(a for a in naming.accepted if a.effect not in judgement.doubtful)
        )
        point = around.point
        for name in judgement.doubtful:
            point = point.without(name)
        entries = candidates([e for name, e in effects.items() if name not in point.owners])
        around = with_surfaces(replay, footprints(replay, point, entries))


def _with_more(
    around: Footprints, replay: Replay, select: Sequence[MeasuredRun], config: Config
) -> ScreenedModel:
    """Look at the select runs too: what has no name is often clearest where nothing was fitted."""
    more = replay.of(select)
    there = with_surfaces(more, footprints(more, around.point.with_runs(more.names), around.entries))
    together = replay.of((*replay.runs, *select))
    return fit_and_screen(together, joined(around, there), alpha=config.alpha, seed=config.seed)


def _conclusion(
    data: Dataset,
    naming: Naming,
    sight: ScreenedModel,
    judgement: Judgement,
    effects: Mapping[str, Hypothesis],
    config: Config,
    menu: Sequence[Experiment],
) -> Finding:
    after, verdict = judgement.model, judgement.verdict
    before = fit(after.replay, after.noise, _bare(after.point), sight.model.linearisation)
    covariance = sight.model.covariance()
    causes = [cause(a, effects[a.effect], sight.model.point, covariance) for a in naming.accepted]
    others = (
        rivals(naming, [c.effect for c in causes], effects, config.ambiguous)
        if verdict is Verdict.AMBIGUOUS
        else []
    )
    runs, references = _separating(naming, sight.model, config, menu) if others else ([], [])
    report = data.of("report")
    gain = measure(before, after, report, naming.floors, seed=config.seed) if report else Measured([], [], [])
    first = naming.steps[0].screen
    return Finding(
        verdict=verdict,
        sentence=sentence(verdict, causes, others, judgement.unknowns, naming),
        causes=causes,
        threshold=first.threshold,
        alpha=config.alpha,
        provenance=_provenance(data, after, config),
        models=models(before, after),
        ambiguous_with=others,
        scores=scores(naming),
        gains=gain.gains,
        coverage=gain.coverage,
        not_seen=unseen(sight.screen, sight.model.linearisation, [c.effect for c in causes]),
        next_runs=runs,
        next_sensors=references,
        shifts=shifts(before, after),
        panel=panel(before, seed=config.seed, alpha=0.01),
        confusability=confusability(first),
        unknowns=list(judgement.unknowns),
        remains=_remains(data, sight, after, naming, gain.gains),
        traces=gain.traces,
    )


def _bare(point: Point) -> Point:
    """Return the point without any effect or surface."""
    for owner in point.owners:
        point = point.without(owner)
    return point


def _separating(
    naming: Naming, model: FittedModel, config: Config, menu: Sequence[Experiment]
) -> tuple[list[NextRun], list[NextSensor]]:
    """Rank the runs that would part what these runs do not, and what could be known otherwise."""
    rivals = [
        fit(model.replay, model.noise, trial.point, model.linearisation)
        for _, trial in naming.confused(config.ambiguous)
    ]
    references = {
        found.name: found
        for first, second in combinations((model, *rivals), 2)
        for found in reversed(sensors(first, second))
    }
    ranked = sorted(references.values(), key=lambda found: -(found.bic_gap or 0.0))
    return rank((model, *rivals), menu) if menu else [], ranked


def _remains(
    data: Dataset, sight: ScreenedModel, after: FittedModel, naming: Naming, gains: Sequence[Gain]
) -> list[str]:
    """Return sentences on what is still not explained, or could not be checked."""
    told = [
        f"{sight.screen.candidates[i].effect.title} still scores {sight.screen.z[i]:.1f}, "
        f"above {sight.screen.threshold:.1f}."
        for i in sight.screen.exceeding
    ]
    told += [
        f"{trial.effect} was seen but not accepted: {trial.failed}."
        for trial in naming.steps[-1].trials
        if trial.failed
    ]
    if not after.converged:
        told.append("The fit of the last model did not come to rest; its intervals are not to be trusted.")
    whole = gains[0].noise_ratio if gains else None
    if whole is not None and whole > WORSE:
        told.append(
            f"On the report runs {whole:.2g} times the noise is left: not all that is wrong there was found."
        )
    if not data.of("select"):
        told.append("There is no run to select on: no cause was tested on data that it was not fitted to.")
    if not data.of("report"):
        told.append("There is no run to report on: the gain on unseen data is not known.")
    return told


def _provenance(data: Dataset, model: FittedModel, config: Config) -> Provenance:
    names = {
        role: [run.experiment.name for run in data.runs if run.role == role]
        for role in ("fit", "select", "report")
    }
    settings = {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(config).items()}
    return Provenance(
        simulator=model.replay.simulator.name,
        seed=config.seed,
        fit=names["fit"],
        select=names["select"],
        report=names["report"],
        digest=data.digest,
        sources=list(data.sources),
        versions={package: version(package) for package in ("astb", "numpy", "scipy")},
        config=settings,
    )
