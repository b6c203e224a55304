"""Parity signals: combinations of outputs that isolate a subsystem, if the simulator has any."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.signal import lfilter
from scipy.special import fdtrc

from diagnosis.contracts import Array, CompleteSimulator
from diagnosis.engine.config import PARITY_BLOCKS, PARITY_BURN_IN, PARITY_DRAWS
from diagnosis.engine.noise import ChannelNoise, Noise
from diagnosis.engine.residual.residuals import Evidence, NotApplicable, Residuals
from diagnosis.estimates import numbers
from diagnosis.finding import Figure, Series


def parities(
    residuals: Residuals, noise: Noise, source: CompleteSimulator, seed: int
) -> dict[str, Evidence | NotApplicable]:
    """Test each parity signal, measured minus predicted, by means of blocks.

    Noise of the channels is drawn and passed through the same combination. An F test compares the measured means with
    the drawn ones.
    """
    known = np.isfinite(residuals.residual)
    predicted = np.where(known, residuals.predicted, np.nan)
    expected = source.parity(residuals.experiment, predicted)
    seen = source.parity(residuals.experiment, np.where(known, residuals.measured, np.nan))
    rng = np.random.default_rng(seed)
    chance: dict[str, list[Array]] = {name: [] for name in expected}
    for _ in range(PARITY_DRAWS):
        drawn = source.parity(residuals.experiment, predicted + draw(noise, predicted.shape[0], rng))
        for name, signal in drawn.items():
            chance[name].append(_means(signal - expected[name])[0])
    return {
        name: _against_chance(
            residuals, name, _means(seen[name] - expected[name]), np.concatenate(chance[name])
        )
        for name in expected
    }


def _against_chance(
    residuals: Residuals, name: str, means: tuple[Array, Array], floor: Array
) -> Evidence | NotApplicable:
    seen, time = means
    if seen.size < 4 or not np.any(floor):
        return NotApplicable("too few samples in which every channel of the combination was measured")
    ratio = float(np.mean(seen**2) / np.mean(floor**2))
    return Evidence(
        statistic=ratio,
        p=float(fdtrc(seen.size, floor.size, ratio)),
        sentence=f"the error of a combined signal ({name}) is {np.sqrt(ratio):.3g} times its noise",
        points_to=name.partition(",")[0],
        draw=lambda: Figure(
            kind="points",
            x_label="time in s",
            y_label="measured minus predicted",
            series=[Series(name=name, x=numbers(time * residuals.step), y=numbers(seen))],
        ),
    )


def _means(values: Array) -> tuple[Array, Array]:
    """Return the means of the blocks that have a measured sample, and the sample index in the middle of each block."""
    starts = (np.arange(PARITY_BLOCKS + 1) * values.size) // PARITY_BLOCKS
    inside = [
        (float(np.nanmean(values[a:b])), 0.5 * (a + b))
        for a, b in pairwise(starts)
        if np.isfinite(values[a:b]).any()
    ]
    means, middles = np.array(inside).reshape(-1, 2).T
    return means, middles


def draw(noise: Noise, n: int, rng: np.random.Generator) -> Array:
    """Return random noise (n, c) of the channels."""
    return np.column_stack([_draw(channel, n, rng) for channel in noise.channels])


def _draw(noise: ChannelNoise, n: int, rng: np.random.Generator) -> Array:
    weights, variance = noise.predictor(np.ones(noise.order, dtype=bool))
    driven = np.sqrt(variance) * rng.standard_normal(n + PARITY_BURN_IN)
    drawn: Array = lfilter([1.0], np.concatenate(([1.0], -weights)), driven)[PARITY_BURN_IN:]
    return drawn
