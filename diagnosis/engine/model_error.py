"""Step 9, intervals: how far the numbers of a fit may be off because the model itself is not exact.

Theory of operation
-------------------
The covariance of least squares knows of noise alone. Where the model is rougher than the noise, the numbers absorb a
part of its error, however many samples there are. Four measures of that are added to the covariance, and one limits the
first two:

* **A smooth error of the form** (`_of_form`). A simulator's surfaces represent whatever a model may lack. Take the
  coefficients c of one as random, with an unknown common spread τ in units of their prior spread: then the fit is off
  by R·c, where R is the regression of its numbers on the surface's columns, and its covariance grows by τ²·R·Rᵀ. The
  projected scores of the surface determine τ, for in the eigenvectors of their information g they have variances φ·g +
  τ²·g². τ² is its mean over that likelihood, with τ as large as is assumed of the surface (normal, 1) before: where a
  small error would not be seen, it is not denied. Asked are the directions that stand far above the noise; in the
  others, what the surface cannot say of the error would pass for a large τ. Of several surfaces, the one with the
  clearest error counts.
* **What a cause owes to the form** (`_of_inconstancy`). A cause that is not the same in all stretches of the runs
  (`constancy.py`) is off where it is fitted to all of them as well. A unit of χ² is one variance of the amplitude. Of
  the excess E, half lies in the direction of the cause itself, and in the sum over all stretches a part of that
  cancels: the variance grows by a quarter of E, and the numbers that make room for the cause go with it.
* **Not more than select runs leave** (`_bounded`). Both state what the form could do. What it did is seen on the runs
  that chose the model: an amplitude may be off by the part of the error at most that its cause leaves there
  (`prediction_share.py`). More than that, as a standard deviation, the form adds to no amplitude.
* **The scatter between repeats** (`_of_repeats`). Where there are records enough, or at least runs, each pulls at the
  numbers with its own gradient. In a right model they differ as noise does; specimens, mountings and days make
  them differ by more. The sandwich of these gradients, J⁻¹·(Σ g·gᵀ)·J⁻¹, is the covariance that they show, wider by
  Student's factor for so few of them. It counts where it is the larger one.
* **Errors without a trace** (`_unseen`). A simulator may know of its inputs that an error of theirs is imitated exactly
  by its parameters, as a laser's zero is by areas and volumes. However good the fit, they are off by as much.

Estimates do not change; only their intervals grow. With the structure right and noise alone, they add next to nothing.
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
    """Return the covariance (k, k) of a fit's numbers that holds errors of the model; ``tests`` are of its surfaces.

    ``left`` states what the select runs leave of each cause.
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
    """Return a covariance (k, k) in which the form widens no amplitude by more than the select runs allow."""
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
    """Return the effects of a model that are causes; a surface is none."""
    return [effect for effect in model.effects if effect in model.replay.simulator.catalogue]


def _unseen(model: FittedModel) -> Array:
    """Return the covariance (k, k) of errors that leave no trace in the data."""
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
    """Return the covariance (k, k) of what the causes of a model owe to its form."""
    covariance = model.covariance()
    total = np.zeros_like(covariance)
    for effect in _causes(model):
        place = model.point.place_of_amplitude(effect)
        variance = covariance[place, place]
        if variance > 0.0 and (excess := inconstancy(model, effect)):
            total += OWED_TO_INTERVAL * excess / variance * np.outer(covariance[place], covariance[place])
    return total


def _spread(test: Omnibus, dispersion: float) -> tuple[float, float, Omnibus]:
    """Return how likely a surface's error is against none (ln), and the mean of its τ²."""
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
    """Return the variances (k,) that records or runs show by their scatter; None where there are too few."""
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
