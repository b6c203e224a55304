"""Step 3, noise: the filter that whitens residuals and footprints. Samples may be missing anywhere.

Theory of operation
-------------------
Whitening predicts each sample from its measured predecessors, and divides the prediction error by its standard
deviation. So the result is white even if samples are missing, and the first samples of a run have the same weight as
the last. Most samples of a channel have the same pattern of measured predecessors: weights are tabulated by pattern,
and stretches of one pattern are filtered together. In a packed column (`columns.py`) the predecessors are adjacent.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from diagnosis.contracts import Array, MeasuredRun
from diagnosis.engine.columns import (
    AnyFloats,
    Columns,
    JoinedColumns,
    Mask,
    Packing,
    Places,
    Trace,
    packing_of,
)
from diagnosis.engine.config import BRIDGED_GAP
from diagnosis.engine.kernels import filter_rows
from diagnosis.engine.memory import room
from diagnosis.engine.noise import ChannelNoise, Noise


@dataclass(frozen=True, slots=True, eq=False)
class ChannelFilter:
    """The whitening filter of one channel. The packed samples are divided into s stretches, each with one row of
    weights.

    ``starts`` (s + 1,) are the borders of the stretches, ``which`` (s,) are their rows in ``weights`` (w, p + 1). A row
    holds the weight of the sample itself, then of its packed predecessors, latest first. Only the first ``reach`` (w,)
    predecessors have weights.
    """

    starts: Places
    which: Places
    weights: Array
    reach: Places

    @property
    def deviation(self) -> float:
        """The standard deviation of white noise, by which samples are divided; 0 if the noise is not white."""
        return 0.0 if self.weights.shape != (1, 1) else 1.0 / float(self.weights[0, 0])

    def __call__(self, values: AnyFloats, out: Any) -> None:
        """Whiten rows of packed samples (m, N) into ``out`` (m, N)."""
        filter_rows(values, self.starts, self.which, self.weights, self.reach, out)


@dataclass(frozen=True, slots=True, eq=False)
class Filter:
    """The whitening filter of one run."""

    packing: Packing
    channels: tuple[ChannelFilter, ...]

    def __call__(self, values: AnyFloats) -> Array:
        """Whiten samples (n, c) and return those that count, packed (N,)."""
        packed = self.packing.pack(values)[np.newaxis]
        white = np.empty(packed.shape)
        for c, channel in enumerate(self.channels):
            inside = self.packing.channel(c)
            channel(packed[:, inside], white[:, inside])
        return white[0]

    def spread(self, values: AnyFloats) -> Array:
        """Whiten samples (n, c) and return them as an array (n, c), with 0 where a sample does not count."""
        return self.packing.spread(self(values))

    def columns(self, parts: Sequence[Columns]) -> Columns:
        """Whiten the columns of all ``parts`` in single precision, and return them joined."""
        white = [
            Columns(part.size, [_whitened(*one) for one in zip(self.channels, part.traces, strict=True)])
            for part in parts
        ]
        return white[0] if len(white) == 1 else JoinedColumns(white)


def _whitened(channel: ChannelFilter, raw: Trace) -> Trace:
    """Return one channel of columns after whitening. For white noise only the scale changes, and nothing is copied."""
    if channel.deviation:
        return raw.scaled(1.0 / channel.deviation)
    white = room(raw.values.shape)
    channel(raw.values, white)
    return Trace(raw.rows, white)


def filters(noise: Noise, runs: Iterable[MeasuredRun]) -> tuple[Filter, ...]:
    """Return the whitening filter of every run."""
    return tuple(filter_of(noise, packing_of(run)) for run in runs)


def filter_of(noise: Noise, packing: Packing) -> Filter:
    """Return the whitening filter of a run."""
    return _whitening(noise.channels, packing)


@lru_cache(maxsize=16)  # every fit under the same noise whitens the same runs
def _whitening(channels: tuple[ChannelNoise, ...], packing: Packing) -> Filter:
    return Filter(
        packing,
        tuple(_channel_filter(channel, packing.counted[:, c]) for c, channel in enumerate(channels)),
    )


def _channel_filter(noise: ChannelNoise, counted: Mask) -> ChannelFilter:
    """Return the filter of one channel, with a row of weights for each pattern of measured predecessors."""
    lags = noise.order
    lags += BRIDGED_GAP if lags and not counted.all() else 0
    rows = np.flatnonzero(counted)
    before = rows[:, np.newaxis] - np.arange(1, lags + 1)
    past = counted[before] & (before >= 0)
    codes, first, which = np.unique(past @ (1 << np.arange(lags)), return_index=True, return_inverse=True)
    weights, reach = np.zeros((len(codes), lags + 1)), np.zeros(len(codes), np.intp)
    for i, row in enumerate(first):
        predictor, variance = noise.predictor(past[row])
        reach[i] = past[row].sum()
        weights[i, 0] = 1.0
        weights[i, 1 : 1 + reach[i]] = -predictor[past[row]]
        weights[i] /= np.sqrt(variance)
    which = which.ravel()
    borders = np.flatnonzero(np.diff(which)) + 1
    starts = np.concatenate(([0], borders, [len(rows)])).astype(np.intp)
    return ChannelFilter(starts, which[starts[:-1]] if len(rows) else which, weights, reach)
