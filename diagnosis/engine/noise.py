"""Step 3, noise: an autoregression for each channel.

Theory of operation
-------------------
The autocovariances of the unexplained part (`noise_estimate.py`) at lags 0…p are computed from pairs of samples that
were both measured in the same run. The equations of Yule and Walker give an autoregression of order p ≤ 10, selected by
BIC. It whitens residuals and footprints (`whitening.py`). Without whitening, noise with AR(1) coefficients of 0.3, 0.6
and 0.9 gives a test 9, 35 and 61 % of false alarms instead of 1 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from diagnosis.contracts import Array, Channel
from diagnosis.engine.config import AR_ORDER, FORGOTTEN, LEAST_OF_DATA_SHEET, PAIRS_PER_ORDER

Mask = NDArray[np.bool_]


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
        """Standard deviation of the error when a sample is predicted from its predecessors."""
        return float(np.sqrt(self.predictor(np.ones(self.order, bool))[1]))

    def predictor(self, measured: Mask) -> tuple[Array, float]:
        """Return the best weights (m,) of the last m samples, latest first, and the variance of the prediction error.

        A weight is 0 if its sample was not measured.
        """
        weights = np.zeros(len(measured))
        lags = np.flatnonzero(measured) + 1
        if self.order == 0 or lags.size == 0:
            return weights, self.autocovariance[0]
        covariance = self._extended(int(lags[-1]))
        right = covariance[lags]
        weights[lags - 1] = np.linalg.solve(covariance[np.abs(lags[:, None] - lags)], right)
        return weights, float(covariance[0] - weights[lags - 1] @ right)

    def correlations(self, lag: int) -> Array:
        """Return the autocorrelations at lags 0 to ``lag``, or to the lag where they have vanished."""
        reach = self.order
        while True:
            known = self._extended(min(reach, lag)) / self.autocovariance[0]
            if reach == 0 or reach >= lag or np.abs(known[-self.order :]).max() < FORGOTTEN:
                return known[: lag + 1]
            reach *= 2

    def _extended(self, lag: int) -> Array:
        """Return the autocovariances up to ``lag``; those beyond p follow from the autoregression."""
        known = np.array(self.autocovariance)
        if lag <= self.order:
            return known
        p = self.order
        coefficients = np.linalg.solve(known[np.abs(np.subtract.outer(range(p), range(p)))], known[1:])
        extended = list(known)
        for k in range(p + 1, lag + 1):
            extended.append(float(coefficients @ extended[k - 1 : k - p - 1 : -1]))
        return np.array(extended)


@dataclass(frozen=True, slots=True)
class Noise:
    """The noise of all channels.

    ``dispersion`` φ ≥ 1 is the factor by which the variance of the scores exceeds that of this noise, because the model
    is not exact: χ² and precisions are divided by φ. Filters do not include it, so that single samples stay white.
    """

    channels: tuple[ChannelNoise, ...]
    dispersion: float = 1.0


def white(deviations: Sequence[float]) -> Noise:
    """Return white noise with a standard deviation for each channel."""
    return Noise(tuple(ChannelNoise((float(d) ** 2,)) for d in deviations))


def estimate(
    channels: Sequence[Channel], leftovers: Sequence[Array], counted: Sequence[Mask], spent: float = 0.0
) -> Noise:
    """Estimate the noise from ``leftovers`` (n, c) of each run: the residuals after all possible terms were fitted.

    ``spent`` is the number of coefficients of that fit.
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
    """Return the least standard deviation of a channel's noise, from its resolution and its data sheet."""
    return float(np.hypot(channel.resolution / np.sqrt(12.0), LEAST_OF_DATA_SHEET * channel.noise))


def _autoregression(
    errors: Sequence[Array], counted: Sequence[Mask], freedom: float, least: float
) -> ChannelNoise:
    pairs, products, squares = np.zeros(AR_ORDER + 1), np.zeros(AR_ORDER + 1), np.zeros(AR_ORDER + 1)
    for error, mask in zip(errors, counted, strict=True):
        for lag in range(min(AR_ORDER + 1, len(error))):
            both = mask[lag:] & mask[: len(mask) - lag]
            late, early = error[lag:][both], error[: len(error) - lag][both]
            pairs[lag] += len(late)
            products[lag] += late @ early
            squares[lag] += 0.5 * (late @ late + early @ early)
    power = max(freedom * squares[0] / max(pairs[0], 1.0), least**2, 1e-300)
    # Correlations over the power of the same samples in each pair, so that missing samples affect both equally.
    covariance = power * np.divide(products, squares, out=np.zeros(AR_ORDER + 1), where=squares > 0.0)
    covariance[0] = power
    # Levinson and Durbin; stops where the next reflection would not be one (too few pairs, or a perfect line).
    best, order = 0.0, 0
    coefficients, variance = np.zeros(0), float(covariance[0])
    for p in range(1, AR_ORDER + 1):
        reflection = float(covariance[p] - coefficients @ covariance[p - 1 : 0 : -1]) / variance
        if not abs(reflection) < 1.0 - 1e-9 or pairs[p] < PAIRS_PER_ORDER * AR_ORDER:
            break
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        variance *= 1.0 - reflection**2
        criterion = pairs[0] * np.log(variance / covariance[0]) + p * np.log(pairs[0])
        if criterion < best:
            best, order = criterion, p
    return ChannelNoise(tuple(float(value) for value in covariance[: order + 1]))
