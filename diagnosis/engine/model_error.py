"""Step 9, intervals: widen the covariance of a fit for errors of the model itself.

Theory of operation
-------------------
The covariance of least squares includes only noise. If the errors of the model exceed the noise, the numbers absorb a
part of them, whatever the number of samples. Four measures of this are added to the covariance, and one limits the
first two:

* **A smooth error of the form** (`_of_form`). A simulator's surfaces represent any missing term. Let the coefficients c
  of one surface be random, with an unknown common spread τ in units of their prior spread. Then the error of the fit is
  R·c, where R is the regression of its numbers on the surface's columns, and its covariance grows by τ²·R·Rᵀ. The
  projected scores of the surface determine τ, because along the eigenvectors of their information g they have the
  variances φ·g + τ²·g². τ² is its mean over this likelihood with the prior τ ~ normal(0, 1), so an error too small to
  see is not excluded. Only directions far above the noise are used, because the others would give too large a τ. Of
  several surfaces, the one with the clearest error counts.
* **A cause that varies** (`_of_inconstancy`). If a cause is not the same in all stretches of the runs (`constancy.py`),
  its fit to all of them is inexact too. A unit of χ² is one variance of the amplitude. Half of the excess E is in the
  direction of the cause itself, and a part of it cancels over the stretches. So the variance grows by a quarter of E,
  with that of the correlated numbers.
* **A limit from the validation runs** (`_bounded`). Both measures above are possible errors. The validation runs show
  the actual one: the relative error of an amplitude is at most the part of the error that its cause leaves there
  (`prediction_share.py`). This limits the added standard deviation.
* **The scatter between repeats** (`_of_repeats`). With enough records, or at least runs, each has its own gradient of
  χ². In an exact model the gradients differ only by noise; different specimens, mountings and days increase the
  difference. The sandwich of these gradients, J⁻¹·(Σ g·gᵀ)·J⁻¹, is the observed covariance, times Student's factor for
  their number. It is used if it is larger.
* **Unseen errors** (`_unseen`). Parameters may imitate an error of the inputs exactly: areas and volumes imitate the
  zero of a laser. The simulator declares such errors. They are added, however good the fit is.

Estimates do not change; only their intervals grow. For an exact model with noise they grow hardly at all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from diagnosis.contracts import Array
from diagnosis.engine.config import (
    LEAST_REPEATS,
    OWED_TO_INTERVAL,
    SHOWN_INFORMATION,
    SPREADS_TRIED,
    WIDER_SURFACE,
)
from diagnosis.engine.constancy import inconstancy
from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.fitting.linear import inverse
from diagnosis.engine.omnibus import Omnibus
from diagnosis.engine.prediction_share import ResidualBound
from diagnosis.estimates import Z95


def widened(model: FittedModel, tests: Sequence[Omnibus], left: ResidualBound | None = None) -> Array:
    """Return the covariance (k, k) of the numbers of a fit, including errors of the model. ``tests`` are those of the
    surfaces.

    ``left`` returns the part of the error that a cause leaves on the validation runs.
    """
    covariance = _of_form(model, tests) + _of_inconstancy(model)
    if left is not None:
        covariance = _bounded(model, covariance, left)
    repeats = _of_repeats(model)
    if repeats is None:
        return covariance + _unseen(model)
    ratio = np.divide(
        repeats, np.diagonal(covariance), out=np.ones_like(repeats), where=np.diagonal(covariance) > 0.0
    )
    wider = np.sqrt(np.maximum(ratio, 1.0))
    return covariance * np.outer(wider, wider) + _unseen(model)


def _bounded(model: FittedModel, covariance: Array, left: ResidualBound) -> Array:
    """Return a covariance (k, k) in which the added standard deviation of each amplitude is limited by ``left``, from
    the validation runs.
    """
    plain = model.covariance()
    more = covariance - plain
    factor = np.ones(len(plain))
    for effect in _causes(model):
        place = model.point.place_of_amplitude(effect)
        if more[place, place] > plain[place, place]:
            most = left(model, effect) * abs(model.point.numbers[place])
            factor[place] = min(1.0, most / float(np.sqrt(more[place, place])))
    return plain + more * np.outer(factor, factor)


def _causes(model: FittedModel) -> list[str]:
    """Return the effects of a model that are causes, without surfaces."""
    return [effect for effect in model.effects if effect in model.replay.simulator.catalogue]


def _unseen(model: FittedModel) -> Array:
    """Return the covariance (k, k) from errors that the data cannot show."""
    simulator, coordinates = model.replay.simulator, model.point.coordinates
    total = np.zeros((len(coordinates), len(coordinates)))
    for error in simulator.unseen_errors:
        moved = np.array(
            [
                0.0 if c.owner else c.to_number(value + error.get(c.parameter.name, 0.0)) - number
                for c, value, number in zip(
                    coordinates, model.point.values(), model.point.numbers, strict=True
                )
            ]
        )
        total += np.outer(moved, moved)
    return total


def _of_form(model: FittedModel, tests: Sequence[Omnibus]) -> Array:
    covariance = model.covariance()
    clearest = max(
        (_spread(test, model.noise.dispersion) for test in tests),
        default=(0.0, 0.0, None),
        key=lambda one: one[0],
    )
    _, square, test = clearest
    if test is None:
        return covariance
    regression = test.projection.regression
    return covariance + square * regression @ regression.T


def _of_inconstancy(model: FittedModel) -> Array:
    """Return the covariance (k, k) from causes of a model that vary between stretches."""
    covariance = model.covariance()
    total = np.zeros_like(covariance)
    for effect in _causes(model):
        place = model.point.place_of_amplitude(effect)
        variance = covariance[place, place]
        if variance > 0.0 and (excess := inconstancy(model, effect)):
            total += OWED_TO_INTERVAL * excess / variance * np.outer(covariance[place], covariance[place])
    return total


def _spread(test: Omnibus, dispersion: float) -> tuple[float, float, Omnibus]:
    """Return three values for a surface: ln of the likelihood ratio of an error of this form against none, the mean of
    its τ², and the test.
    """
    values, vectors = np.linalg.eigh(test.projection.information)
    shown = values > SHOWN_INFORMATION * dispersion
    information, scores = values[shown], vectors[:, shown].T @ test.projection.score
    if not information.size:
        return 0.0, 0.0, test
    spreads = np.linspace(0.0, WIDER_SURFACE, SPREADS_TRIED) ** 2 / WIDER_SURFACE
    variances = dispersion * information + np.outer(spreads**2, information**2)
    logarithms = -0.5 * np.sum(np.log(variances) + scores**2 / variances, axis=1) - 0.5 * spreads**2
    weights = np.exp(logarithms - logarithms.max()) * np.gradient(spreads)
    return float(logarithms.max() - logarithms[0]), float(weights @ spreads**2 / weights.sum()), test


def _of_repeats(model: FittedModel) -> Array | None:
    """Return the variances (k,) from the scatter of records or runs; None if there are too few."""
    linearisation, runs = model.linearisation, model.replay.runs
    for groups in ([run.experiment.record for run in runs], [run.experiment.name for run in runs]):
        names = list(dict.fromkeys(groups))
        if len(names) >= LEAST_REPEATS:
            break
    else:
        return None
    gradients = np.zeros((len(names), len(linearisation.point.numbers)))
    for group, block in zip(groups, linearisation.blocks, strict=True):
        gradients[names.index(group), block.places] += block.times(block.residual)
    count = len(names)
    away = gradients - gradients.mean(axis=0)
    moved = away @ inverse(linearisation.information)
    student = float(stdtrit(count - 1, 0.975)) / Z95
    variances: Array = student**2 * count / (count - 1) * np.sum(moved**2, axis=0)
    return variances
