"""Step 9, goodness of fit: does the residual of each channel agree with the noise of that channel?

Theory of operation
-------------------
Scores compare causes under a noise that is estimated from the unexplained residual. An error that no candidate
resembles, such as a sine or a random walk, is then part of that noise. So each channel is compared with a noise that
does not depend on a model: from stretches at rest, else from the data sheet (`gates.noise_floors`).

* Size: the mean square exceeds that noise (χ² test of a variance). Correlated errors count as fewer samples, n/(1 + 2 Σ
  ρ_k²) (Bartlett). The excess must reach the limit of the report, `NOISE_RATIO_SHOWN`.
* Memory: white noise above the data sheet is no error of the model. The test of Ljung and Box must reject whiteness.
* Kind: a line (F test of an ordinate of the periodogram against its neighbours), a random walk (variance ratio of means
  of long and short blocks), or neither.

Over all channels and roles, the procedure of Benjamini and Hochberg limits the share of false positives. A misfit
contradicts a verdict of no effect.

Stretches at rest are tested before any fit: a line there comes from the sensor or its supply. It makes the data
doubtful.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2, f, false_discovery_control

from diagnosis.contracts import Array, Channel, Dataset, MeasuredRun, Role
from diagnosis.engine.config import (
    FLOOR_SLACK,
    LEAST_LINE_NEIGHBOURS,
    LEAST_OF_A_HOLD,
    LINE_NEIGHBOURS,
    LJUNG_BOX_LAGS,
    MOST_OF_EXCESS,
    NOISE_RATIO_SHOWN,
    WALK_BLOCKS,
)
from diagnosis.engine.gates import rests
from diagnosis.engine.p_values import bonferroni


class Misfit(NamedTuple):
    """A channel whose error is larger than its noise, by the factor ``ratio``, on runs of a ``role``."""

    channel: str
    role: Role
    ratio: float
    p: float
    kind: str  #: kind of the error as a phrase; "" if it is white


class Line(NamedTuple):
    """A sine in a series: ``frequency`` in Hz, ``part`` of the power, and the probability ``p`` of an equally clear
    line by chance.
    """

    frequency: float
    part: float
    p: float


def misfits(
    channels: Sequence[Channel],
    errors: Sequence[tuple[Role, Sequence[tuple[MeasuredRun, Array]]]],
    floors: Array,
    alpha: float,
) -> list[Misfit]:
    """Return the channels with an error that their noise ``floors`` (c,) do not explain, the largest first.

    White errors are not included. ``errors`` holds for each role the runs with the residuals of a model (n, c).
    """
    found = [
        one
        for role, runs in errors
        for i, channel in enumerate(channels)
        if (one := _misfit(channel.name, role, [_series(run, left, i) for run, left in runs], floors[i]))
    ]
    if not found:
        return []
    q = false_discovery_control([one.p for one in found])
    significant = (one for one, value in zip(found, q, strict=True) if value < alpha and one.kind)
    large = [one for one in significant if one.ratio > NOISE_RATIO_SHOWN]
    return sorted(large, key=lambda one: -one.ratio)


def _misfit(channel: str, role: Role, series: Sequence[tuple[Array, float]], floor: float) -> Misfit | None:
    """Compare the errors of one channel with its noise. ``series`` holds the errors of each run with the sampling
    interval. None if the series are too short or the noise is unknown.
    """
    series = [(values, step) for values, step in series if len(values) >= 2 * LJUNG_BOX_LAGS]
    if not series or not floor > 0.0:
        return None
    n = sum(len(values) for values, _ in series)
    square = sum(float(values @ values) for values, _ in series) / n
    independent = sum(len(values) / (1.0 + 2.0 * np.sum(_correlations(values) ** 2)) for values, _ in series)
    p = float(chi2.sf(independent * square / (FLOOR_SLACK * floor**2), independent))
    ratio = float(np.sqrt(square)) / floor
    return Misfit(channel, role, ratio, p, _kind(series, floor, ratio))


def _kind(series: Sequence[tuple[Array, float]], floor: float, ratio: float) -> str:
    """Return the kind of error of a channel as a phrase: a sine, a slow random drift, or an autocorrelation; "" if it
    is white.
    """
    values, step = max(series, key=lambda one: float(np.mean(one[0] ** 2)))
    excess = 1.0 - 1.0 / max(ratio, 1.0) ** 2
    line = strongest_line(values, step)
    if line.p < 1e-3 and line.part > MOST_OF_EXCESS * excess:
        return f"a sine of {line.frequency:.3g} Hz"
    if _block_means(values, WALK_BLOCKS).var() > 0.5 * MOST_OF_EXCESS * (ratio**2 - 1.0) * floor**2:
        return "a slow random drift"
    white = min(ljung_box(values) for values, _ in series) * len(series)
    return "similar in neighbouring samples (autocorrelation)" if white < 1e-3 else ""


def ljung_box(values: Array) -> float:
    """Return the p-value of Ljung and Box's test of whiteness."""
    n, lags = len(values), np.arange(1, LJUNG_BOX_LAGS + 1)
    return float(chi2.sf(n * (n + 2.0) * np.sum(_correlations(values) ** 2 / (n - lags)), len(lags)))


def _correlations(values: Array) -> Array:
    """Return the autocorrelations of a series at the lags of Ljung and Box's test."""
    e = values - values.mean()
    power = e @ e
    if not power > 0.0:  # a constant error has no scatter
        return np.zeros(LJUNG_BOX_LAGS)
    return np.array([e[:-k] @ e[k:] for k in range(1, LJUNG_BOX_LAGS + 1)]) / power


def strongest_line(values: Array, step: float) -> Line:
    """Return the clearest sine in a series (n,), by F tests of its periodogram, after subtraction of slow drift.

    p = 1 for a constant series, and for one too short for an estimate of the background.
    """
    time = np.linspace(-1.0, 1.0, len(values))
    left = values - np.polynomial.Polynomial.fit(time, values, 2)(time)
    power = np.abs(np.fft.rfft(left))[1:-1] ** 2
    neighbours = min(LINE_NEIGHBOURS, (len(power) - 5) // 2)
    if neighbours < LEAST_LINE_NEIGHBOURS or not power.sum() > 0.0:
        return Line(0.0, 0.0, 1.0)
    kernel = np.ones(2 * neighbours + 5)
    kernel[neighbours : neighbours + 5] = 0.0
    around = np.convolve(power, kernel, "same") / np.convolve(np.ones_like(power), kernel, "same")
    ratio = power[2:] / around[2:]  # fewer than three periods are a drift
    best = int(np.argmax(ratio)) + 2
    p = bonferroni(float(f.sf(ratio[best - 2], 2, 4 * neighbours)), len(ratio))
    inside = power[max(best - 2, 0) : best + 3].sum()
    return Line((best + 1) / (len(values) * step), float(inside / power.sum()), p)


def _lasts(values: Array, step: float, frequency: float) -> bool:
    """Return whether a sine is about as strong in the second half of a series as in the first. A free vibration decays
    instead.
    """
    half = len(values) // 2
    phase = np.exp(-2j * np.pi * frequency * step * np.arange(half))
    first, second = (abs(phase @ (part - part.mean())) for part in (values[:half], values[half : 2 * half]))
    return bool(min(first, second) > MOST_OF_EXCESS * max(first, second))


def humming(data: Dataset, alpha: float) -> list[str]:
    """Return a sentence for each channel that shows a sine at rest, with its amplitude."""
    sentences = []
    for i, channel in enumerate(data.channels):
        parts = list(_rests(data.runs, i))
        lines = [(strongest_line(values, step), values, step) for values, step in parts]
        clear = [
            (line, values.std())
            for line, values, step in lines
            if bonferroni(line.p, len(parts) * len(data.channels)) < alpha
            and line.part > 0.5
            and _lasts(values, step, line.frequency)
        ]
        if clear:
            line, deviation = max(clear, key=lambda one: one[0].part * one[1] ** 2)
            size = deviation * np.sqrt(2.0 * line.part) / channel.scale
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


def _rests(runs: Sequence[MeasuredRun], channel: int) -> Iterator[tuple[Array, float]]:
    for run in runs:
        for part in rests(run, channel):
            if part.stop - part.start >= LEAST_OF_A_HOLD:
                yield run.outputs[part, channel], run.experiment.step


def _series(run: MeasuredRun, left: Array, channel: int) -> tuple[Array, float]:
    """Return the samples of an error that count, in order of time, and the sampling interval in s."""
    return left[run.counted[:, channel], channel], run.experiment.step


def _block_means(values: Array, blocks: int) -> Array:
    starts = (np.arange(blocks) * len(values)) // blocks
    return np.add.reduceat(values, starts) / np.diff(np.append(starts, len(values)))
