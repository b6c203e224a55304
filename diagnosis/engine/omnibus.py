"""Step 7, unknown terms: the score test of a smooth surface over two states, as a whole and along each of them.

Theory of operation
-------------------
The coefficients of a surface are tested together, like one candidate with many amplitudes: χ² = sᵀ G⁺ s of their
projected scores s, in the directions that the data can show. G is their Gram matrix per prior spread. If one of its
eigenvalues is below 1, a surface of the expected size is below the noise in this direction, so the direction is left
out. χ² is divided by the excess scatter of the scores (Rao and Scott). Of all views, the one with the smallest p-value
counts, multiplied by their number. `unknown.py` uses the result of the test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, islice

import numpy as np

from diagnosis.contracts import Array, Surface
from diagnosis.engine.columns import Columns
from diagnosis.engine.fitting.linear import Linearisation, Projection, solve
from diagnosis.engine.noise_estimate import overdispersion
from diagnosis.engine.p_values import bonferroni, p_of_chi2
from diagnosis.engine.threads import in_threads


@dataclass(frozen=True, slots=True, eq=False)
class Omnibus:
    """The score test of one surface: χ² of all its coefficients together, or of the sums along one coordinate.

    ``p`` is the probability of an equally large χ² by chance in any of these views. ``projection`` holds the
    inner products of the columns of its m coefficients, from which the part that the model can imitate is subtracted.
    ``start`` (m,) are the coefficients estimated from the score, in units of their prior spread. ``cosines`` are those
    between each candidate and the surface with the coefficients ``start``.
    """

    surface: Surface
    projection: Projection
    statistic: float
    freedom: int
    p: float
    start: Array
    cosines: Array

    @property
    def excess(self) -> float:
        """The excess of χ² over chance."""
        return self.statistic - self.freedom


def score_tests(
    linearisation: Linearisation,
    surfaces: Sequence[Surface],
    columns: Sequence[Columns],
    projection: Projection,
    candidates: int,
    workers: int = 1,
) -> tuple[Omnibus, ...]:
    """Test every surface, with ``workers`` threads, and return the results.

    The whitened ``columns`` of each run, and their ``projection``, hold first those of the ``candidates``, then those
    of the surfaces.
    """

    def test(one: tuple[Surface, int]) -> Omnibus:
        surface, stop = one
        inside = slice(stop - len(surface.coefficients), stop)
        own = [of_run.chosen(range(inside.start, inside.stop)) for of_run in columns]
        return _score_test(linearisation, surface, own, projection, candidates, inside)

    ends = accumulate((len(surface.coefficients) for surface in surfaces), initial=candidates)
    return tuple(in_threads(workers, test, zip(surfaces, islice(ends, 1, None), strict=True)))


def _score_test(
    linearisation: Linearisation,
    surface: Surface,
    columns: Sequence[Columns],
    everything: Projection,
    candidates: int,
    inside: slice,
) -> Omnibus:
    projection = everything.of(inside)
    seen = []
    for view in _views(surface):
        values, vectors = np.linalg.eigh(view @ projection.information @ view.T)
        shown = values > 1.0
        along = vectors[:, shown].T @ view @ projection.score
        scatter = overdispersion(linearisation, columns, projection, view)
        statistic = float(np.sum(along**2 / values[shown]) / np.mean(scatter))
        freedom = int(shown.sum())
        seen.append((p_of_chi2(statistic, freedom), statistic, freedom))
    p, statistic, freedom = min(seen, key=lambda view: view[0])
    start = solve(projection.information + np.eye(len(surface.coefficients)), projection.score)
    directions = np.zeros((candidates + 1, len(everything.score)))
    directions[:-1, :candidates] = np.eye(candidates)
    directions[-1, inside] = start
    return Omnibus(
        surface=surface,
        projection=projection,
        statistic=statistic,
        freedom=freedom,
        p=bonferroni(p, len(seen)),
        start=start,
        cosines=everything.along(directions).cosines[-1, :-1],
    )


def _views(surface: Surface) -> list[Array]:
    """Return orthonormal directions (k, m): all m coefficients, then for each coordinate the functions of it alone."""
    views = [np.eye(len(surface.coefficients))]
    for axis in np.array(surface.centres).T:
        alone = (axis == np.unique(axis)[:, np.newaxis]).astype(np.float64)
        views.append(alone / np.linalg.norm(alone, axis=1, keepdims=True))
    return views
