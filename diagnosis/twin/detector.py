"""When a rig and its model part: a sequential test whose false alarms are bounded over time, not per look.

Theory of operation
-------------------
While the model holds, the whitened innovations z of a channel (n bins in a block) are standard normal. Against that
stand alternatives: their mean is δ (√n of it in a block), or their variance is κ². The likelihood ratio of a block,

    L = exp(δ m − δ²/2) with m = Σz/√n,   L = κ⁻ⁿ exp((1 − κ⁻²) Σz²/2)

has mean 1 while the model holds, so M_k = (M_{k−1} + 1) L_k is an e-detector (J. Shin, A. Ramdas, A. Rinaldo,
E-detectors: a nonparametric framework for sequential change detection, 2023): an alarm at M ≥ A comes after A blocks or
more on average, however often one looks. The mean over all channels and alternatives is an e-detector as well.
No single block counts for more than `MOST`, which leaves the mean of L below 1: one odd block is no alarm.

The change is taken to have begun where two levels fit the loudest channel best, before and since (D. V. Hinkley, 1970).
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from diagnosis.contracts import Array

#: Mean length of a sound run between two alarms, in s: 100 h.
BETWEEN: Final = 100 * 3600.0
#: What a block adds to log M of one alternative at most.
MOST: Final = 4.0
#: Errors of the model's form last. An error of one allowed standard deviation supports none of these.
_MEANS: Final = (-4.0, -2.0, 2.0, 4.0)
_VARIANCES: Final = (2.0, 8.0)
#: χ² by which two levels must fit better than one.
_ANOTHER: Final = 9.0


class Alarm(NamedTuple):
    """A deviation from the model: detected at block ``at``, begun with block ``since``, largest in ``channel``."""

    at: int
    since: int
    channel: int


class Detector:
    """Carries its evidence from stretch to stretch; a block lasts ``block`` s."""

    def __init__(self, channels: int, block: float) -> None:
        self._evidence = np.full((channels, len(_MEANS) + len(_VARIANCES)), -np.inf)
        self._threshold = np.log(BETWEEN / block)

    def copy(self) -> Detector:
        """Return another one with the same evidence: a stretch that grows is judged again from its start."""
        other = object.__new__(Detector)
        other._evidence, other._threshold = self._evidence.copy(), self._threshold
        return other

    def look(self, white: NDArray[np.float64]) -> Alarm | None:
        """Take in blocks (b, c, n) and return the first alarm; NaN stand where nothing was read."""
        ratios = likelihood_ratios(white)
        for b, ratio in enumerate(ratios):
            self._evidence = np.logaddexp(self._evidence, 0.0) + ratio
            if np.logaddexp.reduce(self._evidence, axis=None) - np.log(ratio.size) >= self._threshold:
                channel, way = np.unravel_index(np.argmax(self._evidence), ratio.shape)
                seen = white[: b + 1, channel]
                level = _means(seen) if way < len(_MEANS) else _means(seen**2 - 1.0)
                return Alarm(b, beginning(level), int(channel))
        return None


def beginning(level: Array) -> int:
    """Return from which block on ``level`` (b,) is another one; 0 where two levels fit hardly better than one."""
    blocks = len(level)
    before, total = np.cumsum(level)[:-1], level.sum()
    k = np.arange(1, blocks)
    gain = before**2 / k + (total - before) ** 2 / (blocks - k) - total**2 / blocks
    return int(np.argmax(gain)) + 1 if blocks > 1 and gain.max() > _ANOTHER else 0


def _means(white: NDArray[np.float64]) -> Array:
    """Means (…) over bins (…, n), of variance 1; 0 where nothing was read."""
    there = np.isfinite(white)
    return np.asarray(np.where(there, white, 0.0).sum(axis=-1) / np.sqrt(np.maximum(there.sum(axis=-1), 1)))


def likelihood_ratios(white: NDArray[np.float64]) -> Array:
    """Return log L (b, c, a) of blocks (b, c, n) for the a alternatives; 0 where a channel has no reading."""
    there = np.isfinite(white)
    count = there.sum(axis=2)
    mean = _means(white)
    square = np.where(there, white**2, 0.0).sum(axis=2)
    shifted = [np.where(count > 0, delta * mean - 0.5 * delta**2, 0.0) for delta in _MEANS]
    louder = [0.5 * (square * (1.0 - 1.0 / kappa) - count * np.log(kappa)) for kappa in _VARIANCES]
    return np.minimum(np.stack([*shifted, *louder], axis=2), MOST)
