"""Step 9, goodness of fit: does the residual of each channel agree with the noise of that channel?

Theory of operation
-------------------
Scores compare causes under a noise that is estimated from the unexplained residual. An error that no candidate
resembles, such as a sine or a random walk, is then part of that noise. So each channel is compared with a noise that
does not depend on a model: from stretches at rest, else from the data sheet (`gates.noise_floors`).

* Size: the mean square exceeds that noise (F test of two variances). Correlated samples count as fewer,
  n/(1 + 2 Σ ρ_k²) (Bartlett). The excess must reach the limit of the report, `NOISE_RATIO_SHOWN`.
* Memory: white noise above the data sheet is no error of the model. The test of Ljung and Box must reject whiteness.
* Kind: a line (Thomson's multitaper F test), a random walk (variance ratio of means of long and short blocks), or
  neither.

Over all channels and roles, the procedure of Benjamini and Hochberg limits the share of false positives. A misfit
contradicts a verdict of no effect.

Stretches at rest are tested before any fit: a line there comes from the sensor or its supply. It makes the data
doubtful.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.signal import windows
from scipy.stats import false_discovery_control

from diagnosis.contracts import Array, Channel, Dataset, MeasuredRun, Role
from diagnosis.engine.config import (
    FLOOR_SLACK,
    LEAST_OF_A_HOLD,
    LEAST_OF_A_SINE,
    LJUNG_BOX_LAGS,
    MOST_OF_EXCESS,
    NOISE_RATIO_SHOWN,
    TIME_BANDWIDTH,
    WALK_BLOCKS,
)
from diagnosis.engine.gates import rests
from diagnosis.engine.p_values import bonferroni, independent_samples, p_of_chi2, p_of_variances


class Misfit(NamedTuple):
    """A channel whose error is larger than its noise, by the factor ``ratio``, on runs of a ``role``."""

    channel: str
    role: Role
    ratio: float
    p: float
    kind: str  #: kind of the error as a phrase; "" if it is white


class Line(NamedTuple):
    """A sine in a series: ``frequency`` in Hz, ``amplitude``, ``part`` of the power, and the probability ``p`` of an
    equally clear line by chance.
    """

    frequency: float
    amplitude: float
    part: float
    p: float


def misfits(
    channels: Sequence[Channel],
    errors: Sequence[tuple[Role, Sequence[tuple[MeasuredRun, Array]]]],
    floors: Array,
    at_rest: Array,
    alpha: float,
) -> list[Misfit]:
    """Return the channels with an error that their noise ``floors`` (c,) do not explain, the largest first.

    White errors are not included. ``errors`` holds for each role the runs with the residuals of a model (n, c).
    ``at_rest`` (c,) is the number of independent samples of each floor, infinite for a floor of the data sheet.
    """
    found = [
        one
        for role, runs in errors
        for i, channel in enumerate(channels)
        if (
            one := _misfit(
                channel.name, role, [_series(run, left, i) for run, left in runs], floors[i], at_rest[i]
            )
        )
    ]
    if not found:
        return []
    q = false_discovery_control([one.p for one in found])
    significant = (one for one, value in zip(found, q, strict=True) if value < alpha and one.kind)
    large = [one for one in significant if one.ratio > NOISE_RATIO_SHOWN]
    return sorted(large, key=lambda one: -one.ratio)


def _misfit(
    channel: str, role: Role, series: Sequence[tuple[Array, float]], floor: float, at_rest: float
) -> Misfit | None:
    """Compare the errors of one channel with its noise. ``series`` holds the errors of each run, NaN for lost samples,
    with the sampling interval. None if the series are too short or the noise is unknown.
    """
    series = [(values, step) for values, step in series if np.isfinite(values).sum() >= 2 * LJUNG_BOX_LAGS]
    if not series or not floor > 0.0:
        return None
    known = [values[np.isfinite(values)] for values, _ in series]
    n = sum(map(len, known))
    square = sum(float(values @ values) for values in known) / n
    independent = sum(independent_samples(len(values), _correlations(values)) for values in known)
    p = p_of_variances(square / (FLOOR_SLACK * floor**2), independent, at_rest)
    ratio = float(np.sqrt(square)) / floor
    return Misfit(channel, role, ratio, p, _kind(series, floor, ratio))


def _kind(series: Sequence[tuple[Array, float]], floor: float, ratio: float) -> str:
    """Return the kind of error of a channel as a phrase: a sine, a slow random drift, or an autocorrelation; "" if it
    is white.
    """
    values, step = max(series, key=lambda one: float(np.nanmean(one[0] ** 2)))
    excess = 1.0 - 1.0 / max(ratio, 1.0) ** 2
    line = strongest_line(values, step)
    if line.p < 1e-3 and line.part > MOST_OF_EXCESS * excess:
        return f"a sine of {line.frequency:.3g} Hz"
    known = [one[np.isfinite(one)] for one, _ in series]
    largest = values[np.isfinite(values)]
    if _block_means(largest, WALK_BLOCKS).var() > 0.5 * MOST_OF_EXCESS * (ratio**2 - 1.0) * floor**2:
        return "a slow random drift"
    white = min(map(ljung_box, known)) * len(known)
    return "similar in neighbouring samples (autocorrelation)" if white < 1e-3 else ""


def ljung_box(values: Array) -> float:
    """Return the p-value of Ljung and Box's test of whiteness."""
    n, lags = len(values), np.arange(1, LJUNG_BOX_LAGS + 1)
    return p_of_chi2(n * (n + 2.0) * np.sum(_correlations(values) ** 2 / (n - lags)), len(lags))


def _correlations(values: Array) -> Array:
    """Return the autocorrelations of a series at the lags of Ljung and Box's test."""
    e = values - values.mean()
    power = e @ e
    if not power > 0.0:  # a constant error has no scatter
        return np.zeros(LJUNG_BOX_LAGS)
    return np.array([e[:-k] @ e[k:] for k in range(1, LJUNG_BOX_LAGS + 1)]) / power


def strongest_line(values: Array, step: float) -> Line:
    """Return the clearest sine in a series (n,), by Thomson's multitaper F test, after subtraction of slow drift.

    The test compares a frequency with its close neighbours only, so coloured noise gives no more lines than white
    noise. NaN are lost samples. p = 1 for a constant series, and for one of fewer than `LEAST_OF_A_SINE` samples.

    Source: D. J. Thomson, Spectrum estimation and harmonic analysis, Proceedings of the IEEE 70 (1982), 1055–1096.
    """
    n, seen = len(values), np.isfinite(values)
    if seen.sum() < LEAST_OF_A_SINE:
        return Line(0.0, 0.0, 0.0, 1.0)
    time = np.linspace(-1.0, 1.0, n)
    drift = np.polynomial.Polynomial.fit(time[seen], values[seen], 2)(time)
    left = np.where(seen, values - drift, 0.0)
    power = float(left @ left) / seen.sum()
    if not power > 0.0:
        return Line(0.0, 0.0, 0.0, 1.0)
    tapers = _tapers(n) * seen
    freedom = 2 * len(tapers) - 2
    gains = tapers.sum(axis=1)

    def fit(spectra: NDArray[np.complex128]) -> tuple[Array, NDArray[np.complex128]]:
        """Return the F ratios, and the complex amplitudes of half the sines."""
        halves = gains @ spectra / (gains @ gains)
        errors = np.sum(np.abs(spectra - np.multiply.outer(gains, halves)) ** 2, axis=0)
        powers = np.abs(halves) ** 2 * (gains @ gains)
        return 0.5 * freedom * powers / np.maximum(errors, np.finfo(float).tiny), halves

    def at(frequency: float) -> tuple[Array, NDArray[np.complex128]]:
        return fit(tapers @ (left * np.exp(-2j * np.pi * frequency * np.arange(n))))

    slowest = 6  # fewer than three periods are a drift; there are two ordinates to each period
    ratios, _ = fit(np.fft.rfft(tapers * left, 2 * n)[:, slowest:-2])
    best = int(np.argmax(ratios)) + slowest
    between = ((best - 1) / (2 * n), (best + 1) / (2 * n))
    frequency = minimize_scalar(lambda one: -at(one)[0], bounds=between, options={"xatol": 1e-3 / n}).x
    ratio, half = at(frequency)
    # The search between the ordinates finds about three times as many lines by chance as the ordinates alone.
    p = bonferroni(p_of_variances(float(ratio), 2, freedom), 3 * len(ratios))
    amplitude = 2.0 * float(np.abs(half))
    return Line(frequency / step, amplitude, min(1.0, 0.5 * amplitude**2 / power), p)


@lru_cache(maxsize=16)
def _tapers(samples: int) -> Array:
    """Return the Slepian sequences (k, n) of unit power whose spectra are within `TIME_BANDWIDTH` ordinates."""
    return windows.dpss(samples, TIME_BANDWIDTH, 2 * TIME_BANDWIDTH - 1)


def _lasts(values: Array, step: float, frequency: float) -> bool:
    """Return whether a sine is about as strong in the second half of a series as in the first. A free vibration decays
    instead.
    """
    half = len(values) // 2
    phase = np.exp(-2j * np.pi * frequency * step * np.arange(half))
    left = np.nan_to_num(values - np.nanmean(values))
    first, second = (abs(phase @ (part - part.mean())) for part in (left[:half], left[half : 2 * half]))
    return bool(min(first, second) > MOST_OF_EXCESS * max(first, second))


def humming(data: Dataset, alpha: float) -> list[str]:
    """Return a sentence for each channel that shows a sine at rest, with its amplitude."""
    sentences = []
    for i, channel in enumerate(data.channels):
        parts = [
            (values, run.experiment.step) for run in data.runs for values in rests(run, i, LEAST_OF_A_HOLD)
        ]
        lines = [(strongest_line(values, step), values, step) for values, step in parts]
        clear = [
            line
            for line, values, step in lines
            if bonferroni(line.p, len(parts) * len(data.channels)) < alpha
            and line.part > 0.5
            and _lasts(values, step, line.frequency)
        ]
        if clear:
            line = max(clear, key=lambda one: one.amplitude)
            size = line.amplitude / channel.scale
            unit = channel.display or channel.unit
            sentences.append(
                f"{channel.name} shows a sine of {size:.3g} {unit} and {line.frequency:.3g} Hz while the rig is at "
                "rest: check the sensor, its supply and its cable"
            )
    return sentences


def as_sentence(one: Misfit, roles: Mapping[Role, str]) -> str:
    """Return a misfit as a sentence."""
    return (
        f"{roles[one.role]}, the error of {one.channel} is {one.ratio:.3g} times its noise. "
        f"This error is {one.kind or 'white noise'}."
    )


def _series(run: MeasuredRun, left: Array, channel: int) -> tuple[Array, float]:
    """Return the errors of a channel, NaN where they do not count, and the sampling interval in s."""
    return np.where(run.counted[:, channel], left[:, channel], np.nan), run.experiment.step


def _block_means(values: Array, blocks: int) -> Array:
    starts = (np.arange(blocks) * len(values)) // blocks
    return np.add.reduceat(values, starts) / np.diff(np.append(starts, len(values)))
