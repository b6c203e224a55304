"""Resampling of irregular samples to an equidistant grid, and cutting of one long record into runs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from diagnosis.contracts import Array


def resample(time: Array, values: Array, grid: Array, longest_gap: float) -> Array:
    """Return ``values`` (n,) at the times ``grid`` (m,), by linear interpolation.

    The result is NaN outside of the samples, and between neighbours that are more than ``longest_gap`` apart.
    """
    known = np.isfinite(values)
    t, y = time[known], values[known]
    if len(t) == 0:
        return np.full(grid.shape, np.nan)
    result = np.interp(grid, t, y, left=np.nan, right=np.nan)
    after = np.clip(np.searchsorted(t, grid, side="left"), 1, max(len(t) - 1, 1))
    before = after - 1
    if len(t) > 1:
        on_sample = (grid == t[after]) | (grid == t[before])
        result[(t[after] - t[before] > longest_gap) & ~on_sample] = np.nan
    return result


def resample_held(time: Array, values: Array, grid: Array, *, whole: bool = False) -> Array:
    """Return ``values`` (n,), each of which applies until the next sample, for each step of ``grid`` (m,).

    If they change within a step, the result is their mean; for ``whole`` values it is the value in the middle of the
    step. It is NaN before the first sample.
    """
    known = np.isfinite(values)
    t, y = time[known], values[known]
    if len(t) == 0:
        return np.full(grid.shape, np.nan)
    step = float(grid[1] - grid[0])

    def place(at: Array) -> NDArray[np.intp]:
        return np.searchsorted(t, at, side="right") - 1

    first, last = place(grid + 1e-6 * step), place(grid + (1.0 - 1e-6) * step)
    held: Array = y[np.maximum(place(grid + 0.5 * step) if whole else first, 0)]
    if not whole:
        filled = np.concatenate([[0.0], np.cumsum(y[:-1] * np.diff(t))])

        def until(at: Array) -> Array:
            k = np.maximum(place(at), 0)
            return filled[k] + y[k] * (at - t[k])

        held = np.where(first == last, held, (until(grid + step) - until(grid)) / step)
    held[last < 0] = np.nan
    return held


def bridge(values: Array) -> Array:
    """Return ``values`` (n,) with each NaN replaced by linear interpolation. Inputs need a value at every sample."""
    known = np.isfinite(values)
    index = np.arange(len(values))
    return np.interp(index, index[known], values[known])


def gaps_in(values: Array) -> list[tuple[int, int]]:
    """Return (start, stop) of each stretch of NaN between numbers in ``values`` (n,)."""
    known = np.flatnonzero(np.isfinite(values))
    ends = np.flatnonzero(np.diff(known) > 1)
    return [(int(known[i]) + 1, int(known[i + 1])) for i in ends]


def reversals(x: Array, least: float) -> NDArray[np.intp]:
    """Return the indices of the turning points of ``x`` (n,). Between two of them x changes by at least ``least``."""
    turns: list[int] = []
    highest = lowest = 0
    rising: bool | None = None
    for i, value in enumerate(x):
        if value > x[highest]:
            highest = i
        if value < x[lowest]:
            lowest = i
        if rising is not False and x[highest] - value >= least:
            if rising:
                turns.append(highest)
            rising, lowest = False, i
        elif rising is not True and value - x[lowest] >= least:
            if rising is False:
                turns.append(lowest)
            rising, highest = True, i
    return np.array(turns, dtype=np.intp)


def pieces_by_reversals(x: Array, least: float, strokes: int) -> list[tuple[int, int]]:
    """Return (start, stop) of runs of ``strokes`` whole strokes of ``x``; partial strokes are left out."""
    turns = reversals(x, least)
    return [(int(turns[i]), int(turns[i + strokes])) for i in range(0, len(turns) - strokes, strokes)]


def pieces_by_length(samples: int, length: int) -> list[tuple[int, int]]:
    """Return (start, stop) of runs of ``length`` samples; a remainder shorter than half of that is left out."""
    starts = range(0, samples, length)
    return [
        (start, min(start + length, samples))
        for start in starts
        if min(length, samples - start) * 2 >= length
    ]
