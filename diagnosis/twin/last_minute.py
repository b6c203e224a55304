"""Readings and expected values of the last minute, for display during a run."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from bench_records.twin import Compared, LastMinute
from diagnosis.contracts import Array, Channel
from diagnosis.twin.innovations import BLOCK, Innovations

#: Length (s) of the history.
_MINUTE: Final = 60.0
#: Number of stored digits: a pressure to 1 Pa, a force to 0.1 N.
_DIGITS: Final = 6


def joined(
    before: LastMinute | None, start: float, channels: Sequence[Channel], innovations: Innovations
) -> LastMinute | None:
    """Return the last minute of a run: ``before``, extended by a stretch whose blocks begin at ``start`` s. None if
    neither has a reading.
    """
    known = np.flatnonzero(np.isfinite(innovations.measured).any(axis=1))
    if not len(known):
        return before
    blocks = slice(known[0], known[-1] + 1)
    times = np.round(start + BLOCK * (np.arange(blocks.start, blocks.stop) + 0.5), 3)
    columns = np.stack((innovations.measured, innovations.expected, 2.0 * innovations.band))[:, blocks]
    if before is not None:
        gap = int(times[0] - before.times[-1] > 1.5 * BLOCK)
        nothing = np.full((3, gap, len(channels)), np.nan)
        columns = np.concatenate((_columns(before), nothing, columns), axis=1)
        times = np.concatenate((before.times, [times[0] - BLOCK] * gap, times))
    lasts = times > times[-1] - _MINUTE + 0.5 * BLOCK
    return LastMinute(
        tuple(times[lasts].tolist()),
        tuple(
            Compared(channel.name, *(_rounded(one) for one in columns[:, lasts, c]))
            for c, channel in enumerate(channels)
        ),
    )


def _columns(minute: LastMinute) -> Array:
    """Return readings, expected values and bands: (3, blocks, channels)."""
    rows = [(one.measured, one.expected, one.band) for one in minute.channels]
    return np.array(rows, np.float64).transpose(1, 2, 0)


def _rounded(values: Array) -> tuple[float | None, ...]:
    return tuple(float(f"{value:.{_DIGITS}g}") if np.isfinite(value) else None for value in values)
