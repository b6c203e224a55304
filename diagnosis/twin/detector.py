"""Detection of a deviation of rig and model: a sequential test with a limited rate of false alarms over time.

Theory of operation
-------------------
While the model is valid, the whitened innovations z of a channel (n bins in a block) are standard normal. The
alternatives are: the block mean of z is shifted by δ times its standard deviation, or the variance of z is κ². The
likelihood ratio of a block,

    L = exp(δ m − δ²/2) with m = Σz/√n,   L = κ⁻ⁿ exp((1 − κ⁻²) Σz²/2)

has mean 1 while the model is valid, so M_k = (M_{k−1} + 1) L_k is an e-detector (J. Shin, A. Ramdas, A. Rinaldo,
E-detectors: a nonparametric framework for sequential change detection, 2023): on average A blocks or more pass before a
false alarm at M ≥ A, however often the test is evaluated. The mean over all channels and alternatives is an e-detector
as well. The contribution of a single block is limited to `MOST`, which keeps the mean of L below 1, so one unusual
block is no alarm.

The start of the change is the instant at which two levels, before and after, fit the clearest channel best (D. V.
Hinkley, 1970).
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from diagnosis.contracts import Array

#: Mean time (s) between two false alarms: 100 h.
BETWEEN: Final = 100 * 3600.0
#: Largest contribution of a block to log M of one alternative.
MOST: Final = 4.0
#: Errors of the model's form last. An error of one allowed standard deviation supports none of these.
_MEANS: Final = (-4.0, -2.0, 2.0, 4.0)
_VARIANCES: Final = (2.0, 8.0)
#: Two levels count as different if they fit better than one level by this χ².
_ANOTHER: Final = 9.0


class Alarm(NamedTuple):
    """A deviation from the model: detected at block ``at``, started with block ``since``, largest in channel
    ``channel``.
    """

    at: int
    since: int
    channel: int


class Detector:
    """The sequential test. Its evidence continues from one stretch to the next. A block lasts ``block`` s."""

    def __init__(self, channels: int, block: float) -> None:
        self._evidence = np.full((channels, len(_MEANS) + len(_VARIANCES)), -np.inf)
        self._threshold = np.log(BETWEEN / block)

    def copy(self) -> Detector:
        """Return a detector with the same evidence. A growing stretch needs a copy, because each look judges the
        stretch again from its start.
        """
        other = object.__new__(Detector)
        other._evidence, other._threshold = self._evidence.copy(), self._threshold
        return other

    def look(self, white: NDArray[np.float64]) -> Alarm | None:
        """Process blocks (b, c, n), and return the first alarm or None. A value is NaN where a channel has no
        reading.
        """
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
    """Return the index of the block at which ``level`` (b,) changes; 0 if two levels fit hardly better than one."""
    blocks = len(level)
    before, total = np.cumsum(level)[:-1], level.sum()
    k = np.arange(1, blocks)
    gain = before**2 / k + (total - before) ** 2 / (blocks - k) - total**2 / blocks
    return int(np.argmax(gain)) + 1 if blocks > 1 and gain.max() > _ANOTHER else 0


def _means(white: NDArray[np.float64]) -> Array:
    """Return the means over bins (…, n), scaled to variance 1; 0 without readings."""
    there = np.isfinite(white)
    return np.asarray(np.where(there, white, 0.0).sum(axis=-1) / np.sqrt(np.maximum(there.sum(axis=-1), 1)))


def likelihood_ratios(white: NDArray[np.float64]) -> Array:
    """Return log L (b, c, a) of blocks (b, c, n) for each of the a alternatives, at most `MOST`; 0 if a channel has no
    reading.
    """
    there = np.isfinite(white)
    count = there.sum(axis=2)
    mean = _means(white)
    square = np.where(there, white**2, 0.0).sum(axis=2)
    shifted = [np.where(count > 0, delta * mean - 0.5 * delta**2, 0.0) for delta in _MEANS]
    louder = [0.5 * (square * (1.0 - 1.0 / kappa) - count * np.log(kappa)) for kappa in _VARIANCES]
    return np.minimum(np.stack([*shifted, *louder], axis=2), MOST)
