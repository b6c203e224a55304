"""Step 5, threshold: the largest score of all candidates exceeds it by chance only with the probability α.

Theory of operation
-------------------
Many candidates are tested, and one of them matches the noise best. Without a hidden effect the scores are jointly
normal with unit variances, and their correlations are the cosines between the projected footprints: two candidates with
the same footprint have the same score, whatever the noise. The threshold is the (1 − α) quantile of the *largest* of
all scores. It needs no simulation and is exact to first order. Similar candidates increase it less than different ones,
and points of one shape grid hardly at all.

The score of a one-sided effect counts with its physical sign only, any other by its size.

The event is rare: of plain draws of the normal distribution, only the part α is informative. So only draws are made in
which some score exceeds a level: one of the M sides of the scores is selected at random, its score is drawn above the
level, and the others conditionally on it. A draw with S exceeding scores can be selected S times, so its weight is M/S
times the probability of one of them (importance sampling "at least one rare event": Owen, Maximov and Chertkov 2019,
Electronic Journal of Statistics 13, 231-279). A first round with a low level locates the quantile; the level of the
second round is just below it.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr, ndtri

from diagnosis.contracts import Array
from diagnosis.engine.columns import Mask
from diagnosis.engine.config import THRESHOLD_DRAWS, THRESHOLD_MARGIN


def threshold(cosines: Array, one_sided: Mask, alpha: float, seed: int) -> float:
    """Return the limit that the largest of the scores exceeds by chance with the probability ``alpha``.

    The scores are normal with unit variances and the correlations ``cosines``. A score that is not ``one_sided`` counts
    by its size. The limit is infinite if there are no scores.
    """
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
    """Return the quantile of the largest score from draws in which a score exceeds ``level``. Scores are ``root`` (m,
    r) times N(0, 1).
    """
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
