"""After an ambiguous verdict (step 8): find the run of a menu, or the calibration, that decides between the rivals.

Theory of operation
-------------------
Rivals explain the existing data, but may predict different outputs for a new run. If one is true, the other predicts
the new run with a lower log predictive density, after its parameters have adapted within their present uncertainty.
Twice the difference is the BIC gap which the run would add. The true one is unknown, so the smaller gap of both
directions counts; with several rivals, that of the pair that the run separates least (`rank`, after Hunter and Reiner
1965, Buzzi-Ferraris and Forzatti 1983). The gap per minute of the rig ranks the menu.

A base parameter may imitate the difference of two rivals. Then no run of the same kind helps, but a separate
measurement of that parameter does, for example a calibration. `sensors` fixes each parameter in turn, alone, and
returns the gap that results on the existing runs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from diagnosis.contracts import Array, DiagnosisError, Experiment, MeasuredRun
from diagnosis.engine.config import DISTINGUISHED, MOST_REFERENCES, WORTH_A_REFERENCE
from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.fitting.linear import Linearisation, solve
from diagnosis.engine.fitting.predict import Prediction, predict
from diagnosis.engine.whitening import filters
from diagnosis.estimates import in_words, number
from diagnosis.finding import NextRun, NextSensor


def rank(rivals: Sequence[FittedModel], menu: Sequence[Experiment]) -> list[NextRun]:
    """Rank experiments by the BIC gap between the two least separated rivals, per minute of the rig.

    A gap below ``DISTINGUISHED`` may be an upper bound, because parameters did not adapt. Raises ``DiagnosisError`` for
    an experiment without minutes.
    """
    return sorted(
        (_ranked(rivals, experiment) for experiment in menu), key=lambda run: -(run.per_minute or 0.0)
    )


def _ranked(rivals: Sequence[FittedModel], experiment: Experiment) -> NextRun:
    if not experiment.minutes > 0.0:
        raise DiagnosisError(
            f"the experiment {experiment.name} takes {experiment.minutes:g} minutes; the time must be positive"
        )
    runs = _simulated(rivals, experiment)
    pairs = {f"{_name(a)} / {_name(b)}": (a, b) for a, b in combinations(rivals, 2)}
    gap, pair = min((_distance(a, b, runs), pair) for pair, (a, b) in pairs.items())
    # Parameters that adapt bring rivals nearer together, so rivals that are too near already need no adaptation.
    if gap >= DISTINGUISHED:
        forecasts = _forecasts(runs)
        gap, pair = min((_separation(a, b, forecasts), pair) for pair, (a, b) in pairs.items())
    return NextRun(
        experiment=experiment.name,
        minutes=experiment.minutes,
        bic_gap=number(gap),
        per_minute=number(gap / experiment.minutes),
        pair=pair,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Forecast:
    """A run with the outputs that one model predicts, and the prediction of this model for the run, with its lpd."""

    run: MeasuredRun
    prediction: Prediction


def _simulated(models: Sequence[FittedModel], experiment: Experiment) -> dict[FittedModel, MeasuredRun]:
    """Return for each model the experiment with its predicted outputs; NaN where a sample would not count in a
    record.
    """
    simulator = models[0].replay.simulator
    shape = (experiment.time.size, len(simulator.channels))
    always, never = np.ones(shape[0], dtype=bool), np.zeros(shape[0], dtype=bool)
    blank = MeasuredRun(experiment, np.zeros(shape), always, never)
    outputs = [m.replay.of([blank]).predictions(m.point)[0] for m in models]
    # Counted samples are determined once: rivals are compared by the same samples.
    counted = simulator.counted(experiment, outputs[0])
    return {
        m: replace(blank, outputs=np.where(counted, predicted, np.nan))
        for m, predicted in zip(models, outputs, strict=True)
    }


def _distance(first: FittedModel, second: FittedModel, runs: Mapping[FittedModel, MeasuredRun]) -> float:
    """Return χ² between the predictions of two models before any parameter adapts, under the noise of the first."""
    (whiten,) = filters(first.noise, [runs[first]])
    return float(np.sum(whiten(runs[first].outputs - runs[second].outputs) ** 2)) / first.noise.dispersion


def _forecasts(runs: Mapping[FittedModel, MeasuredRun]) -> dict[FittedModel, _Forecast]:
    """Return for each model the prediction of its own run. Models with the same noise share one linearisation in the
    base parameters.
    """
    forecasts: dict[FittedModel, _Forecast] = {}
    for model, run in runs.items():
        known = next(
            (forecasts[m].prediction.linearisation for m in forecasts if m.noise is model.noise), None
        )
        forecasts[model] = _Forecast(run, predict(model, [run], known))
    return forecasts


def _separation(first: FittedModel, second: FittedModel, forecasts: Mapping[FittedModel, _Forecast]) -> float:
    return min(_advantage(first, second, forecasts), _advantage(second, first, forecasts))


def _advantage(true: FittedModel, other: FittedModel, forecasts: Mapping[FittedModel, _Forecast]) -> float:
    """Return 2·(lpd of ``true`` − lpd of ``other``) on the run with the outputs that ``true`` predicts."""
    forecast, known = forecasts[true], forecasts[other].prediction.linearisation
    return 2.0 * (forecast.prediction.lpd - predict(other, [forecast.run], known).lpd)


def _name(model: FittedModel) -> str:
    return " + ".join(model.effects) or "base model"


def sensors(first: FittedModel, second: FittedModel) -> list[NextSensor]:
    """Return nuisances whose calibration would separate two rivals on the existing runs, best first.

    The rank is by the BIC gap λ²(1 − cosine²) of the first rival's effects against the second rival, computed with this
    nuisance fixed.
    """
    footprint = _footprint(first, second)
    base = second.linearisation
    now = _unexplained(base, footprint, np.ones(len(base.point.numbers), dtype=bool))
    known = second.replay.simulator.references
    found = []
    for name in dict.fromkeys(c.parameter.name for c in base.point.coordinates if not c.owner):
        free = np.array([bool(c.owner) or c.parameter.name != name for c in base.point.coordinates])
        gap = _unexplained(base, footprint, free)
        if gap > WORTH_A_REFERENCE * now:
            before = f"{now:.3g}" if now >= 0.01 else "below 0.01"
            how = known.get(name, f"measure {in_words(name)} against a reference")
            found.append(
                NextSensor(
                    name=name,
                    bic_gap=number(gap),
                    sentence=f"{how}: the expected difference between the causes (BIC) grows from {before} to "
                    f"{gap:.3g}; {DISTINGUISHED:g} is sufficient",
                )
            )
    return sorted(found, key=lambda sensor: -(sensor.bic_gap or 0.0))[:MOST_REFERENCES]


def _footprint(first: FittedModel, second: FittedModel) -> list[Array]:
    """Return the change of the outputs by the effects that only the first model has: whitened (N,), for each run."""
    point = first.point
    numbers = point.numbers.copy()
    for own in set(first.effects) - set(second.effects):
        place = point.place_of_amplitude(own)
        numbers[place] = point.coordinates[place].to_number(0.0)
    without = first.replay.predictions(point.at(numbers))
    return [
        f(predicted - less)
        for f, predicted, less in zip(
            filters(first.noise, first.replay.runs), first.predictions, without, strict=True
        )
    ]


def _unexplained(
    linearisation: Linearisation, footprint: Sequence[Array], free: np.ndarray[tuple[int], np.dtype[np.bool_]]
) -> float:
    """Return the squared norm of a footprint after projection on the free coordinates."""
    mixed, own = np.zeros(len(free)), 0.0
    for block, values in zip(linearisation.blocks, footprint, strict=True):
        mixed[block.places] += block.times(values)
        own += float(np.vdot(values, values))
    information = linearisation.information[np.ix_(free, free)]
    return max(own - float(mixed[free] @ solve(information, mixed[free])), 0.0)
