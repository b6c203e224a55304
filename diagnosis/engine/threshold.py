"""Step 5: the threshold."""

from __future__ import annotations

from typing import Final

import numpy as np

from diagnosis.contracts import Array
from diagnosis.engine.noise import Mask

DRAWS: Final = 20_000  #: of the maximum of all scores under chance


def threshold(cosines: Array, one_sided: Mask, alpha: float, seed: int) -> float:
    """Return the score that the largest of N(0, cosines) exceeds with probability alpha; two-sided ones by size."""
    if len(cosines) == 0:
        return float("inf")
    values, vectors = np.linalg.eigh(cosines)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    draws = np.random.default_rng(seed).standard_normal((DRAWS, len(cosines))) @ root.T
    draws[:, ~one_sided] = np.abs(draws[:, ~one_sided])
    return float(np.quantile(draws.max(axis=1), 1.0 - alpha))
