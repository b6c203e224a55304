"""Difference quotients of a model that jumps: use the two that agree best.

Theory of operation
-------------------
Friction remembers its points of reversal. A small step of a parameter can add or remove a reversal. Then forces differ
by newtons until the next large motion, and the difference divided by the step is not the derivative.

Every score and every fit of an effect is a remainder after projection on the nuisances. One column of the nuisances may
be wrong, for example that of a spring's effective area in one run. Then effects that resemble the true column get high
scores, such as those of gauges, gains and volumes. So the nuisances have differences on both sides. The two differ by
the curvature of the model, which is small, or by a jump. If they differ by more than ``SPOILT``, differences with half
the step are computed as well, and the two of the four that agree best are used.

The footprint of a candidate is one difference on one side. A score above the threshold may come from a jump, if the
bench reversed and the model did not. Such a footprint is computed again with shorter steps (`footprints.confirmed`). A
jump within all of the steps is not found.
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
    """Return k quotients, each the mean of p ``parts`` with ``weights`` (p, k).

    Quotients that are ``spoilt`` (k,) use the mean of the two parts that agree best. Channels are scaled by ``errors``
    (c,).
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
    """Return for each run the steps along its ``places``; None where ``which`` is False."""
    return [
        [steps[i] if mine else None for i, mine in zip(own, asked, strict=True)]
        for own, asked in zip(places, which, strict=True)
    ]


def root_mean_squares(residuals: Sequence[Array]) -> Array:
    """Return the root mean square of each channel (c,) over all runs; 1 if no sample counts or all are 0."""
    both = np.concatenate(residuals)
    counted = np.isfinite(both)
    square = np.sum(np.where(counted, both, 0.0) ** 2, axis=0) / np.maximum(counted.sum(axis=0), 1)
    return np.sqrt(np.where(square > 0.0, square, 1.0))
