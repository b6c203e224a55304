"""How well a fit predicts unseen runs: their log predictive density (lpd).

Theory of operation
-------------------
A prediction with the fitted values alone ignores their uncertainty, and the test loses power. So the posterior of the
fit, a normal distribution by Laplace's approximation, is the prior of the prediction: shared parameters may move within
their uncertainty, and parameters of a new record (an initial pressure) have their own priors. All are fitted to the new
runs and integrated out: the lpd is minus half the penalised χ² plus half the logarithm of det(information before) /
det(information after), up to a constant of the noise.

A ``fixed`` prediction keeps the fitted shared numbers. It needs columns only for the parameters of the new records: a
fifth of the simulations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.contracts import Array, MeasuredRun
from diagnosis.engine.config import FLAT_WEIGHT
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.linear import Linearisation, Prior, solve
from diagnosis.engine.fitting.point import Point
from diagnosis.engine.fitting.replay import Replay


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """The prediction of a fitted model for unseen runs, after a fit of their own nuisances.

    ``lpd`` is the log density of the data up to a constant of the noise; ``outputs`` (n, c) are those of each run.
    """

    replay: Replay
    lpd: float
    outputs: tuple[Array, ...]
    linearisation: Linearisation


def predict(
    fitted: FittedModel,
    runs: Sequence[MeasuredRun],
    known: Linearisation | None = None,
    *,
    fixed: bool = False,
) -> Prediction:
    """Predict other runs with a fitted model, with all its uncertainty, or with its shared numbers ``fixed``.

    The posterior of the shared numbers from the fit is their prior here. The numbers of each new record are fitted and
    marginalised by Laplace's approximation. ``known`` may hold columns of the nuisances for these runs.
    """
    point, prior = transferred(fitted, fitted.replay.of(runs), fixed)
    again = fit(fitted.replay.of(runs), fitted.noise, point, known, prior=prior)
    information = again.linearisation.information / fitted.noise.dispersion
    occam = np.linalg.slogdet(prior.precision)[1] - np.linalg.slogdet(information)[1]
    lpd = 0.5 * float(occam - again.penalised_chi2)
    return Prediction(again.replay, lpd, again.predictions, again.linearisation)


def of_fit(fitted: FittedModel) -> Prediction:
    """Return a prediction of the fit runs themselves: the outputs of the fitted model. The lpd is NaN."""
    return Prediction(fitted.replay, np.nan, fitted.predictions, fitted.linearisation)


def transferred(fitted: FittedModel, replay: Replay, fixed: bool) -> tuple[Point, Prior]:
    """Return the fitted point with the nuisances of new records added, and the prior of all its numbers.

    ``fixed`` keeps the shared numbers at their fitted values. Numbers of a record count as shared if parts of this
    record were fitted.
    """
    old = fitted.point
    there = {"", *replay.records}
    shared = [i for i, c in enumerate(old.coordinates) if c.record in there]
    moved = old.with_records(replay.records)
    keep = [*shared, *range(len(old.coordinates), len(moved.coordinates))]
    coordinates = [moved.coordinates[i] for i in keep]
    coordinates[: len(shared)] = [replace(c, held=fixed) for c in coordinates[: len(shared)]]
    point = Point(tuple(coordinates), moved.numbers[keep])
    precision = FLAT_WEIGHT * np.eye(len(keep))
    precision += np.diag([0.0] * len(shared) + [c.weight for c in coordinates[len(shared) :]])
    if not fixed:
        precision[: len(shared), : len(shared)] += _marginal_precision(fitted, shared)
    return point, Prior(point.numbers, precision)


def _marginal_precision(fitted: FittedModel, shared: Sequence[int]) -> Array:
    """Return the precision (k, k) of the ``shared`` numbers of a fit, with the others integrated out."""
    others = [i for i in range(len(fitted.point.numbers)) if i not in set(shared)]
    information = fitted.linearisation.information / fitted.noise.dispersion
    known: Array = information[np.ix_(shared, shared)] - information[np.ix_(shared, others)] @ solve(
        information[np.ix_(others, others)], information[np.ix_(others, shared)]
    )
    return known
