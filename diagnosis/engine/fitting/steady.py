"""Difference quotients of a model that jumps: of several, the two that agree.

Theory of operation
-------------------
Friction remembers where it turned. A small step of a parameter can make a turn come or go, and forces then differ by
newtons until the next large motion wipes that out: divided by the step, a column that has little to do with the
derivative.

Every score and every fit of an effect is what the nuisances leave of it. One spoilt column among those of the
nuisances, say of a spring's effective area in one run, takes the place of the true one, and everything that resembles
the true one is accused: gauges, gains, volumes. So the nuisances have differences on both sides. They are apart by the
curvature of the model, which is small, or by a jump. Where they are apart by more than ``SPOILT``, those of half the
step are made as well, and of all four the two that are nearest to each other count.

The footprint of a candidate has one step. A score that exceeds the threshold may do so by a jump, where the bench
turned and the model did not: such a footprint is made again with shorter steps (`footprints.confirmed`). A jump within
all of the steps stays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from diagnosis.contracts import Array
from diagnosis.engine.columns import Columns, apart, mixed
from diagnosis.engine.fitting.point import Point

Step = tuple[Point, float]


def steady(parts: Sequence[Columns], weights: Array, spoilt: NDArray[np.bool_], errors: Array) -> Columns:
    """Return k quotients, each the mean of several ``parts`` by its ``weights`` (p, k).

    Of those that are ``spoilt`` (k,) the two parts that are nearest to each other count. Channels are as large as their
    ``errors`` (c,).
    """
    if spoilt.any():
        pairs = list(combinations(range(len(parts)), 2))
        nearest = np.argmin([apart(parts[i], parts[j], errors) for i, j in pairs], axis=0)
        weights = weights.copy()
        for k in np.flatnonzero(spoilt):
            weights[:, k] = 0.0
            weights[list(pairs[nearest[k]]), k] = 0.5
    return mixed(parts, weights)


def chosen(
    steps: Mapping[int, Step],
    places: Sequence[Sequence[int]],
    which: Sequence[Sequence[bool] | NDArray[np.bool_]],
) -> list[list[Step | None]]:
    """Return each run's steps along its ``places``, None where they are not asked for."""
    return [
        [steps[i] if mine else None for i, mine in zip(own, asked, strict=True)]
        for own, asked in zip(places, which, strict=True)
    ]


def root_mean_squares(residuals: Sequence[Array]) -> Array:
    """Return the root mean square of each channel (c,) over all runs; 1 where nothing counts or nothing is left."""
    both = np.concatenate(residuals)
    counted = np.isfinite(both)
    square = np.sum(np.where(counted, both, 0.0) ** 2, axis=0) / np.maximum(counted.sum(axis=0), 1)
    return np.sqrt(np.where(square > 0.0, square, 1.0))
