"""Compiled loops over all samples, for operations that numpy does not have. They release the interpreter lock."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def filter_rows(values: Any, starts: Any, which: Any, weights: Any, reach: Any, out: Any) -> None:
    """Filter each row of ``values`` (m, n) with an autoregressive filter whose weights change between stretches. Write
    to ``out``.

    ``which`` gives for each stretch its row of ``weights``, which apply to a sample and its predecessors. The inner
    loops run along time so that the compiler vectorises them.
    """
    line = np.empty(values.shape[1])
    for k in range(values.shape[0]):
        row = values[k]
        for s in range(len(which)):
            weight, start, stop = weights[which[s]], starts[s], starts[s + 1]
            for i in range(start, stop):
                line[i] = weight[0] * row[i]
            for j in range(1, reach[which[s]] + 1):
                w = weight[j]
                for i in range(start, stop):
                    line[i] += w * row[i - j]
        out[k] = line


@numba.njit(cache=True, nogil=True)
def quotients(
    outputs: Any, predictions: Any, distance: float, instants: Any, bounds: Any, out: Any, moved: Any
) -> None:
    """Write (outputs − predictions)/distance to ``out`` (N,), only for the N samples that count.

    ``moved`` (c,) is set to True for channels in which a quotient is not 0. ``outputs`` and ``predictions`` are (c, n);
    ``instants`` (N,) are the indices of these samples, channel after channel, and ``bounds`` (c + 1,) the borders of
    the channels in ``instants`` (`diagnosis.engine.columns.Packing`).
    """
    for c in range(len(moved)):
        after, before = outputs[c], predictions[c]
        changed = np.float32(0.0)  # a number of the width of the others: the loop stays one of vectors
        for i in range(bounds[c], bounds[c + 1]):
            k = instants[i]
            quotient = np.float32((after[k] - before[k]) / distance)
            out[i] = quotient
            changed = changed if quotient == 0.0 else np.float32(1.0)
        moved[c] = changed != 0.0


@numba.njit(cache=True, nogil=True)
def block_products(values: Any, samples: Any, edges: Any, out: Any) -> None:
    """Write to ``out`` (m, b) the inner products of each row (n,) of ``values`` with ``samples`` (n,), between
    ``edges`` (b + 1,).

    Four sums in double precision are independent of each other, so that the processor computes them in parallel.
    """
    for k in range(values.shape[0]):
        row = values[k]
        for b in range(len(edges) - 1):
            start, stop = edges[b], edges[b + 1]
            even = start + (stop - start) // 4 * 4
            s0 = s1 = s2 = s3 = 0.0
            for i in range(start, even, 4):
                s0 += row[i] * samples[i]
                s1 += row[i + 1] * samples[i + 1]
                s2 += row[i + 2] * samples[i + 2]
                s3 += row[i + 3] * samples[i + 3]
            for i in range(even, stop):
                s0 += row[i] * samples[i]
            out[k, b] = (s0 + s1) + (s2 + s3)


@numba.njit(cache=True, nogil=True)
def weighted_sum(numbers: Any, values: Any, out: Any) -> None:
    """Write to ``out`` (n,) the sum of all rows of ``values`` (m, n), each multiplied by its number, in double
    precision.
    """
    out[:] = 0.0
    for k in range(values.shape[0]):
        number, row = numbers[k], values[k]
        for i in range(len(out)):
            out[i] += number * row[i]


@numba.njit(cache=True, nogil=True)
def add_rows(values: Any, chosen: Any, factors: Any, places: Any, out: Any) -> None:
    """Add the ``chosen`` (k,) rows of ``values`` (m, n), each times its factor, to the rows of ``out`` at ``places``.

    Products and sums have the precision of ``out``.
    """
    for k in range(len(chosen)):
        factor, row, line = factors[k], values[chosen[k]], out[places[k]]
        for i in range(len(row)):
            line[i] += factor * row[i]
