"""How well a fit predicts runs that it has not seen: their log predictive density (lpd).

Theory of operation
-------------------
A plug-in prediction, with the fitted values alone, punishes a model for what it does not know exactly and loses
power. So the posterior of the fit, a normal distribution by Laplace's approximation, is the prior of the prediction:
shared parameters may move as far as the fit left them uncertain, and those that belong to a new record alone (an
initial pressure) start from their own priors. They are fitted to the new runs and integrated out: the lpd is minus half
the penalised χ² plus half the logarithm of det(information before) / det(information after), up to a constant of the
noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.contracts import Array, MeasuredRun
from diagnosis.engine.config import FIXED_WEIGHT, FLAT_WEIGHT
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
    """Say what a fitted model predicts of other runs, with all its uncertainty, or with its numbers ``fixed``.

    What the fit knows of the shared numbers is their prior now; those of each new record are found and marginalised by
    Laplace's approximation. ``known`` may hold columns of the nuisances for these runs, whitened alike.
    """
    point, prior = _transferred(fitted, fitted.replay.of(runs), FIXED_WEIGHT if fixed else 1.0)
    again = fit(fitted.replay.of(runs), fitted.noise, point, known, prior=prior)
    information = again.linearisation.information / fitted.noise.dispersion
    occam = np.linalg.slogdet(prior.precision)[1] - np.linalg.slogdet(information)[1]
    lpd = 0.5 * float(occam - again.penalised_chi2)
    return Prediction(again.replay, lpd, again.predictions, again.linearisation)


def _transferred(fitted: FittedModel, replay: Replay, weight: float) -> tuple[Point, Prior]:
    """Return the fitted point with the new records' own nuisances, and what is known of all its numbers.

    The precision of the shared ones counts with a ``weight``; those of a record of which parts were fitted are
    among them.
    """
    old = fitted.point
    there = {"", *replay.records}
    shared = [i for i, c in enumerate(old.coordinates) if c.record in there]
    own = [i for i, c in enumerate(old.coordinates) if c.record not in there]
    information = fitted.linearisation.information / fitted.noise.dispersion
    known = information[np.ix_(shared, shared)] - information[np.ix_(shared, own)] @ solve(
        information[np.ix_(own, own)], information[np.ix_(own, shared)]
    )
    moved = old.with_records(replay.records)
    keep = [*shared, *range(len(old.coordinates), len(moved.coordinates))]
    point = Point(tuple(moved.coordinates[i] for i in keep), moved.numbers[keep])
    fresh = point.coordinates[len(shared) :]
    precision = np.diag([*([0.0] * len(shared)), *(c.weight for c in fresh)]) + FLAT_WEIGHT * np.eye(
        len(fresh) + len(shared)
    )
    precision[: len(shared), : len(shared)] += weight * known
    return point, Prior(point.numbers, precision)
