"""The noise of each channel, estimated from what no model can explain, and the filter that whitens it.

Noise is autoregressive: its autocovariances at lags 0…p by Yule and Walker, p ≤ 10 by BIC, over pairs of samples that
were both measured in the same run. A sample is predicted from those of its predecessors that were measured; its error
over its standard deviation is white whatever is missing, and a run's first samples count as much as its last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.contracts import Array, Channel

Mask = NDArray[np.bool_]

ORDER: Final = 10  #: highest order of the autoregression
BRIDGE: Final = 4  #: so many further predecessors help where some are missing
BELIEF: Final = 0.5  #: no channel is believed to be quieter than this part of what its data sheet says


@dataclass(frozen=True, slots=True)
class ChannelNoise:
    """Autoregressive noise of order p: ``autocovariance`` (p + 1,) in the channel's unit squared."""

    autocovariance: tuple[float, ...]

    @property
    def order(self) -> int:
        """Order p; 0 is white."""
        return len(self.autocovariance) - 1

    @property
    def deviation(self) -> float:
        """Standard deviation of a sample."""
        return float(np.sqrt(self.autocovariance[0]))

    @property
    def innovation(self) -> float:
        """Standard deviation of a sample whose predecessors are known."""
        return float(np.sqrt(self.predictor(np.ones(self.order, bool))[1]))

    def predictor(self, measured: Mask) -> tuple[Array, float]:
        """Return the best weights (m,) of the last m samples, latest first, 0 where not measured; and the variance."""
        weights = np.zeros(len(measured))
        lags = np.flatnonzero(measured) + 1
        if self.order == 0 or lags.size == 0:
            return weights, self.autocovariance[0]
        covariance = self._extended(int(lags[-1]))
        right = covariance[lags]
        weights[lags - 1] = np.linalg.solve(covariance[np.abs(lags[:, None] - lags)], right)
        return weights, float(covariance[0] - weights[lags - 1] @ right)

    def _extended(self, lag: int) -> Array:
        """Autocovariances up to a lag; those beyond p follow from the autoregression."""
        known = np.array(self.autocovariance)
        if lag <= self.order:
            return known
        p = self.order
        coefficients = np.linalg.solve(known[np.abs(np.subtract.outer(range(p), range(p)))], known[1:])
        extended = list(known)
        for k in range(p + 1, lag + 1):
            extended.append(float(coefficients @ extended[k - 1 : k - p - 1 : -1]))
        return np.array(extended)


@dataclass(frozen=True, slots=True, eq=False)
class Filter:
    """What whitens the channels of one run: ``taps`` (c, m + 1, n) weigh each sample and its m predecessors.

    ``counted`` (n, c) marks the samples that are measured and scored.
    """

    taps: Array
    counted: Mask

    def __call__(self, values: Array) -> Array:
        """Whiten (n, c) or (n, c, k); what does not count becomes 0."""
        columns = values.reshape(*values.shape[:2], -1)
        white = np.zeros_like(columns)
        for channel, taps in enumerate(self.taps):
            counted = self.counted[:, channel]
            signal = np.where(counted[:, None], columns[:, channel], 0.0)
            total = taps[0][:, None] * signal
            for lag in range(1, len(taps)):
                if taps[lag].any():
                    total[lag:] += taps[lag, lag:, None] * signal[:-lag]
            white[:, channel] = total
        return white.reshape(values.shape)


@dataclass(frozen=True, slots=True)
class Noise:
    """The noise of every channel."""

    channels: tuple[ChannelNoise, ...]

    def filter(self, counted: Mask) -> Filter:
        """Return the whitening filter of a run in which the samples ``counted`` (n, c) count."""
        lags = max(c.order for c in self.channels)
        lags += BRIDGE if lags and not counted.all() else 0
        taps = np.zeros((counted.shape[1], lags + 1, len(counted)))
        for channel, noise in enumerate(self.channels):
            taps[channel] = _taps(noise, counted[:, channel], lags)
        return Filter(taps, counted)


def white(deviations: Sequence[float]) -> Noise:
    """Return white noise with a standard deviation for each channel."""
    return Noise(tuple(ChannelNoise((float(d) ** 2,)) for d in deviations))


def estimate(
    channels: Sequence[Channel], leftovers: Sequence[Array], counted: Sequence[Mask], spent: float = 0.0
) -> Noise:
    """Estimate the noise from what a model that explains everything explainable leaves, (n, c) of each run.

    ``spent`` is the number of coefficients which that model has fitted.
    """
    total = sum(int(c.sum()) for c in counted)
    freedom = total / max(total - spent, 0.5 * total)
    return Noise(
        tuple(
            _autoregression(
                [np.where(c[:, i], e[:, i], 0.0) for e, c in zip(leftovers, counted, strict=True)],
                [c[:, i] for c in counted],
                freedom,
                quietest(channel),
            )
            for i, channel in enumerate(channels)
        )
    )


def quietest(channel: Channel) -> float:
    """Return the standard deviation below which no noise of a channel is believed: its resolution, its data sheet."""
    return float(np.hypot(channel.resolution / np.sqrt(12.0), BELIEF * channel.noise))


def _autoregression(
    errors: Sequence[Array], counted: Sequence[Mask], freedom: float, least: float
) -> ChannelNoise:
    pairs, products = np.zeros(ORDER + 1), np.zeros(ORDER + 1)
    for error, mask in zip(errors, counted, strict=True):
        for lag in range(min(ORDER + 1, len(error))):
            pairs[lag] += np.count_nonzero(mask[lag:] & mask[: len(mask) - lag])
            products[lag] += error[lag:] @ error[: len(error) - lag]
    covariance = freedom * products / np.maximum(pairs, 1.0)
    covariance[0] = max(covariance[0], least**2, 1e-300)
    # Levinson and Durbin; stops where the next reflection would not be one (too few pairs, or a perfect line).
    best, order = 0.0, 0
    coefficients, variance = np.zeros(0), float(covariance[0])
    for p in range(1, ORDER + 1):
        reflection = float(covariance[p] - coefficients @ covariance[p - 1 : 0 : -1]) / variance
        if not abs(reflection) < 1.0 - 1e-9 or pairs[p] < 20 * ORDER:
            break
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        variance *= 1.0 - reflection**2
        criterion = pairs[0] * np.log(variance / covariance[0]) + p * np.log(pairs[0])
        if criterion < best:
            best, order = criterion, p
    return ChannelNoise(tuple(float(value) for value in covariance[: order + 1]))


def _taps(noise: ChannelNoise, counted: Mask, lags: int) -> Array:
    """Return the weights (lags + 1, n) of a sample and its predecessors."""
    past = np.zeros((lags, len(counted)), bool)
    for lag in range(1, lags + 1):
        past[lag - 1, lag:] = counted[:-lag]
    if counted.all():
        past[noise.order :] = False
    taps = np.zeros((lags + 1, len(counted)))
    patterns, which = np.unique(past, axis=1, return_inverse=True)
    for number, pattern in enumerate(patterns.T):
        weights, variance = noise.predictor(pattern)
        here = which.ravel() == number
        taps[:, here] = (np.concatenate(([1.0], -weights)) / np.sqrt(variance))[:, None]
    taps[:, ~counted] = 0.0
    return taps
