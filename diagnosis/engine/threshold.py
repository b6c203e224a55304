"""Step 5, threshold: the score that chance alone exceeds in one of so many diagnoses, all candidates together.

Theory of operation
-------------------
Many candidates are tried, and one of them matches chance best. If nothing is hidden, the scores are jointly normal
with unit variances, and their correlations are the cosines between the projected footprints: two candidates that do
the same have the same score, whatever the noise. The threshold is the (1 − α) quantile of the *largest* of all
scores, taken from draws of that normal distribution. It needs no simulation and is exact to first order: candidates
that are alike cost less than candidates that are not, points of a shape grid next to nothing.

A one-sided effect counts with its physical sign only, any other by its size.
"""

from __future__ import annotations

import numpy as np

from diagnosis.contracts import Array
from diagnosis.engine.config import THRESHOLD_DRAWS
from diagnosis.engine.noise import Mask


def threshold(cosines: Array, one_sided: Mask, alpha: float, seed: int) -> float:
    """Return the score that the largest of N(0, cosines) exceeds with probability alpha; two-sided ones by size."""
    if len(cosines) == 0:
        return float("inf")
    values, vectors = np.linalg.eigh(cosines)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    draws = np.random.default_rng(seed).standard_normal((THRESHOLD_DRAWS, len(cosines))) @ root.T
    draws[:, ~one_sided] = np.abs(draws[:, ~one_sided])
    return float(np.quantile(draws.max(axis=1), 1.0 - alpha))
