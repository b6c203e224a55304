"""A smooth surface over two states, as a tensor product of B-splines. It represents an unknown term.

`TensorSplines.value` is for states known before the simulation. During a simulation, `spline_value` evaluates the
`table`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from bench_sim.model.compiled import compiled
from diagnosis.contracts import Array, Parameter, Surface


@dataclass(frozen=True, slots=True)
class SplineAxis:
    """One state as an axis: its name, a title with the display unit (``scale`` SI), and equidistant knots in SI.

    ``compressed_from`` is x₀ (SI) if the axis is asinh(x/x₀) instead of x; the title names x.
    """

    state: str
    title: str
    knots: tuple[float, ...]
    scale: float = 1.0
    compressed_from: float = 0.0

    @property
    def shown_centres(self) -> Array:
        """Where the B-splines have their maxima (knots + 1,), in the unit of the title."""
        x_0 = self.compressed_from
        return (x_0 * np.sinh(self.centres) if x_0 else self.centres) / self.scale

    @property
    def centres(self) -> Array:
        """Where the B-splines have their maxima (knots + 1,), in SI and inside of the knots."""
        low, high = self.knots[0], self.knots[-1]
        between = np.arange(len(self.knots) + 1) - 0.5
        return np.clip(low + (self.knots[1] - low) * between, low, high)

    def basis(self, x: Array) -> Array:
        """Return the quadratic B-splines (n, knots + 1) at ``x`` (n,); they add up to 1."""
        u = (x - self.knots[0]) / (self.knots[1] - self.knots[0])
        u = np.clip(u, 0.0, len(self.knots) - 1 - 1e-12)
        away = np.abs(u[:, np.newaxis] - (np.arange(len(self.knots) + 1) - 0.5))
        return np.where(away < 0.5, 0.75 - away**2, 0.5 * np.clip(1.5 - away, 0.0, None) ** 2)


class SplineTable(NamedTuple):
    """A surface with its coefficients (rows, columns), for evaluation at one point at a time. Without rows its value is
    0.
    """

    first_low: float
    first_spacing: float
    second_low: float
    second_spacing: float
    coefficients: Array


@compiled
def _weights(x: float, low: float, spacing: float, intervals: int) -> tuple[int, float, float, float]:
    """Return the values at ``x`` of the three quadratic B-splines that are not 0 there, after the index of the first of
    them.
    """
    u = min(max((x - low) / spacing, 0.0), float(intervals))
    i = min(int(u), intervals - 1)
    t = u - i
    return i, 0.5 * (1.0 - t) ** 2, 0.5 + t * (1.0 - t), 0.5 * t * t


@compiled
def spline_value(table: SplineTable, first: float, second: float) -> float:
    """Return the value of a surface at one point. Compiled functions and plain Python may call it."""
    rows, columns = table.coefficients.shape
    if rows == 0:
        return 0.0
    i, a0, a1, a2 = _weights(first, table.first_low, table.first_spacing, rows - 2)
    j, b0, b1, b2 = _weights(second, table.second_low, table.second_spacing, columns - 2)
    c = table.coefficients
    return (
        a0 * (b0 * c[i, j] + b1 * c[i, j + 1] + b2 * c[i, j + 2])
        + a1 * (b0 * c[i + 1, j] + b1 * c[i + 1, j + 1] + b2 * c[i + 1, j + 2])
        + a2 * (b0 * c[i + 2, j] + b1 * c[i + 2, j + 1] + b2 * c[i + 2, j + 2])
    )


@dataclass(frozen=True, slots=True)
class TensorSplines:
    """Σ c_ij·B_i(first)·B_j(second) of quadratic B-splines, constant outside of the knots.

    ``spread`` is the prior standard deviation of each coefficient in ``unit``.
    """

    name: str
    title: str
    first: SplineAxis
    second: SplineAxis
    unit: str
    spread: float
    touches: frozenset[str]

    @property
    def surface(self) -> Surface:
        """These splines as a surface of the engine."""
        axes = (self.first, self.second)
        sizes = [range(len(axis.knots) + 1) for axis in axes]
        coefficients = tuple(
            Parameter(f"c_{i}_{j}", self.unit, 0.0, self.spread, step=1e-3 * self.spread)
            for i, j in product(*sizes)
        )
        centres = tuple((float(a), float(b)) for a, b in product(*(axis.shown_centres for axis in axes)))
        titles = (self.first.title, self.second.title)
        return Surface(self.name, self.title, titles, coefficients, self.touches, centres)

    def value(self, states: Mapping[str, Array], coefficients: Mapping[str, float]) -> Array:
        """Return the surface (n,) along the ``states`` (n,); a missing coefficient is 0."""
        rows, columns = (axis.basis(states[axis.state]) for axis in (self.first, self.second))
        return np.sum((rows @ self._grid(coefficients)) * columns, axis=1)

    def table(self, coefficients: Mapping[str, float] | None) -> SplineTable:
        """Return the surface as a table for `spline_value`; for None, return the table of a surface that is 0."""
        grid = np.zeros((0, len(self.second.knots) + 1)) if coefficients is None else self._grid(coefficients)
        (x, to_x), (y, to_y) = self.first.knots[:2], self.second.knots[:2]
        return SplineTable(float(x), float(to_x - x), float(y), float(to_y - y), grid)

    def _grid(self, coefficients: Mapping[str, float]) -> Array:
        """Return the coefficients (rows, columns); missing ones are 0."""
        rows, columns = (range(len(axis.knots) + 1) for axis in (self.first, self.second))
        return np.array([[coefficients.get(f"c_{i}_{j}", 0.0) for j in columns] for i in rows])
