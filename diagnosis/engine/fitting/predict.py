"""How well a fit predicts runs that it has not seen: their log predictive density (lpd).

Theory of operation
-------------------
A plug-in prediction, with the fitted values alone, punishes a model for what it does not know exactly and loses
power. So the posterior of the fit, a normal distribution by Laplace's approximation, is the prior of the prediction:
shared parameters may move as far as the fit left them uncertain, and those that belong to a new record alone (an
initial pressure) start from their own priors. They are fitted to the new runs and integrated out: the lpd is minus half
the penalised χ² plus half the logarithm of det(information before) / det(information after), up to a constant of the
noise.

A prediction with the fitted numbers alone holds the shared ones where they are. Then it needs the columns of nothing
but what the new records have of their own: a fifth of the simulations.
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
    """What a fitted model says of runs that it was not fitted to, once their own nuisances are found.

    ``lpd`` is the log density of the data up to a constant of the noise; ``outputs`` (n, c) of each run.
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
    """State what a fitted model predicts of other runs, with all its uncertainty, or with its numbers ``fixed``.

    What the fit knows of the shared numbers is their prior now; those of each new record are found and marginalised by
    Laplace's approximation. ``known`` may hold columns of the nuisances for these runs.
    """
    point, prior = transferred(fitted, fitted.replay.of(runs), fixed)
    again = fit(fitted.replay.of(runs), fitted.noise, point, known, prior=prior)
    information = again.linearisation.information / fitted.noise.dispersion
    occam = np.linalg.slogdet(prior.precision)[1] - np.linalg.slogdet(information)[1]
    lpd = 0.5 * float(occam - again.penalised_chi2)
    return Prediction(again.replay, lpd, again.predictions, again.linearisation)


def of_fit(fitted: FittedModel) -> Prediction:
    """Return what a fitted model says of the runs that it was fitted to."""
    return Prediction(fitted.replay, np.nan, fitted.predictions, fitted.linearisation)


def transferred(fitted: FittedModel, replay: Replay, fixed: bool) -> tuple[Point, Prior]:
    """Return the fitted point with the new records' own nuisances, and the prior of all its numbers.

    The shared ones, among which are those of a record of which parts were fitted, are held if they are ``fixed``.
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
        precision[: len(shared), : len(shared)] += _known(fitted, shared)
    return point, Prior(point.numbers, precision)


def _known(fitted: FittedModel, shared: Sequence[int]) -> Array:
    """Return the precision (k, k) that a fit leaves of its ``shared`` numbers once the others are integrated out."""
    others = [i for i in range(len(fitted.point.numbers)) if i not in set(shared)]
    information = fitted.linearisation.information / fitted.noise.dispersion
    known: Array = information[np.ix_(shared, shared)] - information[np.ix_(shared, others)] @ solve(
        information[np.ix_(others, others)], information[np.ix_(others, shared)]
    )
    return known
