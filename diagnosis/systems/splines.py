"""A smooth surface over two states, as a tensor product of B-splines: the form of an unknown term."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from diagnosis.contracts import Array, Parameter, Surface


@dataclass(frozen=True, slots=True)
class SplineAxis:
    """One state: its name, a title with the unit that people read (``scale`` SI), and equidistant knots in SI."""

    state: str
    title: str
    knots: tuple[float, ...]
    scale: float = 1.0

    @property
    def centres(self) -> Array:
        """Where the B-splines are largest (knots + 1,), inside of the knots."""
        low, high = self.knots[0], self.knots[-1]
        between = np.arange(len(self.knots) + 1) - 0.5
        return np.clip(low + (self.knots[1] - low) * between, low, high)

    def basis(self, x: Array) -> Array:
        """Return the quadratic B-splines (n, knots + 1) at ``x`` (n,); they add up to 1."""
        u = (x - self.knots[0]) / (self.knots[1] - self.knots[0])
        u = np.clip(u, 0.0, len(self.knots) - 1 - 1e-12)
        away = np.abs(u[:, np.newaxis] - (np.arange(len(self.knots) + 1) - 0.5))
        return np.where(away < 0.5, 0.75 - away**2, 0.5 * np.clip(1.5 - away, 0.0, None) ** 2)


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
        """The surface as the engine knows it."""
        axes = (self.first, self.second)
        sizes = [range(len(axis.knots) + 1) for axis in axes]
        coefficients = tuple(
            Parameter(f"c_{i}_{j}", self.unit, 0.0, self.spread, step=1e-3 * self.spread)
            for i, j in product(*sizes)
        )
        centres = tuple(
            (float(a), float(b)) for a, b in product(*(axis.centres / axis.scale for axis in axes))
        )
        titles = (self.first.title, self.second.title)
        return Surface(self.name, self.title, titles, coefficients, self.touches, centres)

    def value(self, states: Mapping[str, Array], coefficients: Mapping[str, float]) -> Array:
        """Return the surface (n,) along the ``states`` (n,); a coefficient that is missing is 0."""
        rows, columns = (axis.basis(states[axis.state]) for axis in (self.first, self.second))
        grid = np.array(
            [
                [coefficients.get(f"c_{i}_{j}", 0.0) for j in range(columns.shape[1])]
                for i in range(rows.shape[1])
            ]
        )
        return np.sum((rows @ grid) * columns, axis=1)
