"""Step 9, checks: predict with three models the figures that test plans measure on the rig.

Theory of operation
-------------------
If the base model imitates a cause, unseen runs of the same plan may show no gain. Other plans show the difference. So
the figures of their checks are predicted by the stock model (nominal parameters), the tuned one (the best base model)
and the extended one. The uncertainty of the extended model is the scatter of its predictions over draws from the
covariance of its numbers.

A planned experiment has a given initial state, so the errors of the sensors that measure it stay nominal. If a run in
the data contains a figure, the row is for this run: all models replay its measured motion, and the uncertainty includes
its own nuisances and the noise of its sensors. No number is fitted to this run. If the row shows an error of the tuned
model, and a much smaller one of the extended model, the cause improves the prediction of unseen data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from msgspec.structs import replace

from diagnosis.contracts import Array, CheckFigures, Effects, Experiment, Figures, Job, MeasuredRun
from diagnosis.engine.config import CHECK_DRAWS, RELATIVE
from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.fitting.point import Point
from diagnosis.engine.simulation import simulate_many
from diagnosis.estimates import Z95, number
from diagnosis.finding import NAMED, SUSPECTED, Cause, CheckPrediction

Models = Sequence[tuple[Mapping[str, float], Effects]]


def predicted_checks(
    checks: CheckFigures | None,
    beside: Sequence[MeasuredRun],
    before: FittedModel,
    after: FittedModel,
    covariance: Array,
    *,
    seed: int,
) -> list[CheckPrediction]:
    """Return a row for each figure of the planned experiments. A measured run in ``beside`` with the same figure
    replaces the plan.

    ``covariance`` (k, k) is that of the numbers of ``after``. Without ``checks`` there are no rows.
    """
    if checks is None:
        return []
    rng = np.random.default_rng(seed)
    drawn = rng.multivariate_normal(after.point.numbers, covariance, CHECK_DRAWS, method="eigh")
    points = [before.point, after.point, *(after.point.at(numbers) for numbers in drawn)]
    rows: dict[str, CheckPrediction] = {}
    for experiment in checks.experiments:
        models = [(_planned(checks, point), point.effects()) for point in points]
        figures = _figures(checks, after, experiment, models)
        rows |= {row.name: row for row in _rows(figures)}
    for run in beside:
        own = [_begun(point, run, rng if k > 1 else None) for k, point in enumerate(points)]
        figures = _figures(checks, after, run.experiment, own, rng)
        seen = checks.figures(run.experiment, _named(after, run.outputs))
        measured = {name: value for (name, _), value in seen.items()}
        rows |= {
            row.name: replace(row, measured=measured[row.name], run=run.experiment.name)
            for row in _rows(figures)
            if row.name in measured
        }
    return list(rows.values())


def gained(rows: Sequence[CheckPrediction]) -> bool:
    """Return whether measured figures show an error of the tuned model, and a much smaller one of the extended
    model.
    """
    arms = [
        (one.measured - one.tuned, one.measured - one.extended, one.uncertainty / Z95)
        for one in rows
        if one.measured is not None and one.tuned is not None and one.extended is not None and one.uncertainty
    ]
    if not arms:
        return False
    tuned, extended, sigma = np.array(arms).T
    before, after = (float(np.mean((error / sigma) ** 2)) for error in (tuned, extended))
    return before > Z95**2 and max(after - 1.0, 0.0) < RELATIVE**2 * (before - 1.0)


def confirmed(causes: Sequence[Cause], rows: Sequence[CheckPrediction]) -> list[Cause]:
    """Return the causes. A single suspected cause becomes a named one if figures of other plans confirm it."""
    alone = len(causes) == 1 and causes[0].status == SUSPECTED
    return [replace(causes[0], status=NAMED)] if alone and gained(rows) else list(causes)


def _rows(figures: Sequence[Figures]) -> list[CheckPrediction]:
    """Return a row for each figure. ``figures`` are from the stock, the tuned and the extended model, then from all
    draws.
    """
    stock, tuned, extended, *others = figures
    return [
        CheckPrediction(
            name=name,
            unit=unit,
            stock=number(stock[name, unit]),
            tuned=number(tuned[name, unit]),
            extended=number(value),
            uncertainty=number(Z95 * float(np.std([one[name, unit] for one in others], ddof=1))),
        )
        for (name, unit), value in extended.items()
    ]


def _figures(
    checks: CheckFigures,
    model: FittedModel,
    experiment: Experiment,
    models: Models,
    rng: np.random.Generator | None = None,
) -> list[Figures]:
    """Return the figures of an experiment by the stock model and by all ``models``. With ``rng``, noise is added to the
    outputs of the draws.
    """
    simulator = model.replay.simulator
    noise = np.array([channel.noise for channel in simulator.channels])
    jobs = [Job(experiment, parameters, effects) for parameters, effects in (({}, {}), *models)]
    found = []
    for k, outputs in enumerate(simulate_many(simulator, jobs)):
        read = outputs + noise * rng.standard_normal(outputs.shape) if rng is not None and k > 2 else outputs
        found.append(checks.figures(experiment, _named(model, read)))
    return found


def _named(model: FittedModel, outputs: Array) -> dict[str, Array]:
    names = [channel.name for channel in model.replay.simulator.channels]
    return dict(zip(names, outputs.T, strict=True))


def _planned(checks: CheckFigures, point: Point) -> dict[str, float]:
    """Return the shared parameters of a model, without the errors that a planned experiment does not have."""
    return {name: value for name, value in point.parameters("").items() if not checks.states(name)}


def _begun(
    point: Point, run: MeasuredRun, rng: np.random.Generator | None
) -> tuple[dict[str, float], Effects]:
    """Return the parameters and effects of a model for a run that it was not fitted to. The run's own nuisances are
    nominal, or drawn with ``rng``.
    """
    record = run.experiment.record
    there = point.with_records([record])
    if rng is not None:
        own = there.numbers.copy()
        own[len(point.numbers) :] = rng.standard_normal(len(own) - len(point.numbers))
        there = there.at(own)
    return there.parameters(record), there.effects()
