"""How well a fit predicts runs that it has not seen: their log predictive density."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.contracts import Array, MeasuredRun
from diagnosis.engine.config import FIXED_WEIGHT, FLAT_WEIGHT
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.linear import Linearisation, Prior, solve
from diagnosis.engine.fitting.point import Coordinate, Point
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
    held: bool = False,
) -> Prediction:
    """Say what a fitted model predicts of other runs, with all its uncertainty, or with its numbers ``held``.

    What the fit knows of the shared numbers is their prior now; those of each new run are found and marginalised by
    Laplace's approximation. ``known`` may hold columns of the nuisances for these runs, whitened alike.
    """
    point, prior = _transferred(fitted, fitted.replay.of(runs), FIXED_WEIGHT if held else 1.0)
    again = fit(fitted.replay.of(runs), fitted.noise, point, known, prior=prior)
    here = again.linearisation
    gram = here.information / fitted.noise.dispersion
    evidence = np.linalg.slogdet(prior.precision)[1] - np.linalg.slogdet(gram)[1]
    return Prediction(again.replay, 0.5 * float(evidence - again.penalised_chi2), again.predictions, here)


def _transferred(fitted: FittedModel, replay: Replay, weight: float) -> tuple[Point, Prior]:
    """Return the fitted point with the new runs' own nuisances, and what is known of all its numbers.

    The precision of the shared ones counts with a ``weight``.
    """
    old = fitted.point
    shared = [i for i, c in enumerate(old.coordinates) if not c.run]
    own = [i for i, c in enumerate(old.coordinates) if c.run]
    gram = fitted.linearisation.information / fitted.noise.dispersion
    known = gram[np.ix_(shared, shared)] - gram[np.ix_(shared, own)] @ solve(
        gram[np.ix_(own, own)], gram[np.ix_(own, shared)]
    )
    names = dict.fromkeys(c.parameter for c in (old.coordinates[i] for i in own))
    fresh = [Coordinate(parameter, run=run) for parameter in names for run in replay.names]
    point = Point(
        (*(old.coordinates[i] for i in shared), *fresh),
        np.concatenate((old.numbers[shared], np.zeros(len(fresh)))),
    )
    precision = np.diag([*([0.0] * len(shared)), *(c.weight for c in fresh)]) + FLAT_WEIGHT * np.eye(
        len(fresh) + len(shared)
    )
    precision[: len(shared), : len(shared)] += weight * known
    return point, Prior(point.numbers, precision)
