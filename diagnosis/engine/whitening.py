"""Step 3, noise: the filter that whitens residuals and footprints alike, whatever samples are missing.

Theory of operation
-------------------
Whitening predicts each sample from those of its predecessors that were measured, and divides the error by its standard
deviation. So it is white whatever is missing, and a run's first samples count as much as its last. Which predecessors
are known is the same for most samples of a channel: the weights are tabulated by that pattern, and stretches of one
pattern are filtered in one go. A packed column (`columns.py`) has its predecessors next to each other.
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
    """What whitens one channel: stretches of the packed samples, each with its row of weights.

    ``starts`` (s + 1,) bound the stretches, ``which`` (s,) are their rows of ``weights`` (w, p + 1): of the sample
    itself, then of its packed predecessors, latest first, 0 beyond ``reach`` (w,) of them.
    """

    starts: Places
    which: Places
    weights: Array
    reach: Places

    @property
    def deviation(self) -> float:
        """The standard deviation by which white noise is divided; 0 where predecessors count."""
        return 0.0 if self.weights.shape != (1, 1) else 1.0 / float(self.weights[0, 0])

    def __call__(self, values: AnyFloats, out: Any) -> None:
        """Whiten rows of packed samples (m, N) into ``out`` (m, N)."""
        filter_rows(values, self.starts, self.which, self.weights, self.reach, out)


@dataclass(frozen=True, slots=True, eq=False)
class Filter:
    """What whitens one run."""

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
        """Whiten samples (n, c) and leave them in their places; what does not count becomes 0."""
        return self.packing.spread(self(values))

    def columns(self, parts: Sequence[Columns]) -> Columns:
        """Whiten columns in single precision, those of all ``parts`` one after the other."""
        white = [
            Columns(part.size, [_whitened(*one) for one in zip(self.channels, part.traces, strict=True)])
            for part in parts
        ]
        return white[0] if len(white) == 1 else JoinedColumns(white)


def _whitened(channel: ChannelFilter, raw: Trace) -> Trace:
    """Whiten one channel of columns; under white noise nothing is copied."""
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
    """Tabulate the weights of one channel by which of its predecessors were measured."""
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
