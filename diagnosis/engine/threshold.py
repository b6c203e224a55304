"""Step 5, threshold: the score that chance alone exceeds in one of so many diagnoses, all candidates together.

Theory of operation
-------------------
Many candidates are tried, and one of them matches chance best. If nothing is hidden, the scores are jointly normal
with unit variances, and their correlations are the cosines between the projected footprints: two candidates that do
the same have the same score, whatever the noise. The threshold is the (1 − α) quantile of the *largest* of all
scores. It needs no simulation and is exact to first order: candidates that are alike cost less than candidates that
are not, points of a shape grid next to nothing.

A one-sided effect counts with its physical sign only, any other by its size.

The event is rare: of plain draws of that normal distribution, one in 1/α says anything. So only draws are made in which
some score exceeds a level: one of the M sides on which a score can be is chosen at random, its score is drawn above the
level, the others as they go with it. Such a draw comes up for each of its S exceeding scores and counts M/S times the
chance of one of them (importance sampling "at least one rare event": Owen, Maximov and Chertkov 2019, Electronic
Journal of Statistics 13, 231-279). A first round with a low level finds where the quantile is, a second one begins just
below it.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr, ndtri

from diagnosis.contracts import Array
from diagnosis.engine.columns import Mask
from diagnosis.engine.config import THRESHOLD_DRAWS, THRESHOLD_MARGIN


def threshold(cosines: Array, one_sided: Mask, alpha: float, seed: int) -> float:
    """Return the score that the largest of N(0, cosines) exceeds with probability alpha; two-sided ones by size."""
    if len(cosines) == 0:
        return float("inf")
    values, vectors = np.linalg.eigh(cosines)
    seen = values > 0.0
    root = vectors[:, seen] * np.sqrt(values[seen])
    root /= np.linalg.norm(root, axis=1, keepdims=True)
    rng = np.random.default_rng(seed)
    single = float(-ndtri(alpha))  # no quantile of several scores is lower
    rough = _quantile(root, one_sided, alpha, single, rng)
    return _quantile(root, one_sided, alpha, max(single, rough - THRESHOLD_MARGIN), rng)


def _quantile(root: Array, one_sided: Mask, alpha: float, level: float, rng: np.random.Generator) -> float:
    """Return the quantile from draws of which each exceeds a ``level``; scores are ``root`` (m, r) times N(0, 1)."""
    sides = np.concatenate((np.arange(len(root)), np.flatnonzero(~one_sided)))
    chance = float(ndtr(-level))
    side = rng.integers(len(sides), size=THRESHOLD_DRAWS)
    chosen = sides[side]
    draws = rng.standard_normal((THRESHOLD_DRAWS, root.shape[1]))
    above = -ndtri(chance * (1.0 - rng.random(THRESHOLD_DRAWS)))
    draws += (above - np.einsum("nr,nr->n", draws, root[chosen]))[:, np.newaxis] * root[chosen]
    draws[
        side >= len(root)
    ] *= -1.0  # on the other side of a size, one-sided scores are those of the mirrored draw
    scores = draws @ root.T
    scores[:, ~one_sided] = np.abs(scores[:, ~one_sided])
    largest = scores.max(axis=1)
    exceeding = np.maximum(np.count_nonzero(scores > level, axis=1), 1)
    order = np.argsort(-largest)
    probability = np.cumsum(len(sides) * chance / exceeding[order]) / THRESHOLD_DRAWS
    return float(np.interp(alpha, probability, largest[order]))
