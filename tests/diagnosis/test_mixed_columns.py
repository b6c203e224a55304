"""Sums of columns, each with its own weight, are those of whole arrays, digit for digit."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.engine.columns import Columns, Trace, apart, mixed, squares

SAMPLES = (40, 0, 25)


def _columns(rng: np.random.Generator, size: int) -> Columns:
    """Columns of which each moves some channels only."""
    traces = []
    for samples in SAMPLES:
        rows = np.flatnonzero(rng.random(size) < 0.7)
        values = rng.standard_normal((len(rows), samples)).astype(np.float32)
        traces.append(Trace(rows, values, scale=rng.choice((1.0, 0.3))))
    return Columns(size, traces)


def _whole(columns: Columns, weights: np.ndarray) -> list[np.ndarray]:
    """Each channel with all rows, times their weights, in single precision."""
    channels = []
    for trace in columns.traces:
        dense = np.zeros((columns.size, trace.values.shape[1]), np.float32)
        factors = (trace.scale * weights[trace.rows]).astype(np.float32)
        dense[trace.rows] = factors[:, None] * trace.values
        channels.append(dense)
    return channels


@pytest.mark.parametrize("seed", range(5))
def test_a_sum_is_that_of_whole_arrays(seed):
    rng = np.random.default_rng(seed)
    parts = [_columns(rng, 6) for _ in range(3)]
    weights = rng.choice((0.0, 0.5, 1.0, -1.0, 0.3), size=(3, 6))
    dense = [_whole(part, own) for part, own in zip(parts, weights, strict=True)]
    for c, trace in enumerate(mixed(parts, weights).traces):
        expected = dense[0][c] + dense[1][c] + dense[2][c]
        assert trace.values.dtype == np.float32
        assert (trace.values == expected[trace.rows]).all()
        others = np.setdiff1d(np.arange(6), trace.rows)
        assert not expected[others].any()


def test_how_far_columns_are_apart_is_what_their_difference_squares_to():
    rng = np.random.default_rng(0)
    first, second, scales = _columns(rng, 6), _columns(rng, 6), np.array((1.0, 2.0, 0.5))
    difference = mixed((first, second), np.outer((1.0, -1.0), np.ones(6)))
    assert (apart(first, second, scales) == squares(difference, scales)).all()
