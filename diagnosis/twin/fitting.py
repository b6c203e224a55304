"""Least squares on a stretch, with all estimated parameters and the effects of causes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from diagnosis.contracts import Array
from diagnosis.twin.innovations import BINS, Columns, Estimate, rough


class Fitted(NamedTuple):
    """Result of least squares for one cause: its size, the standard deviation of the size, and the remaining χ²."""

    size: float
    deviation: float
    left: float


class Fit:
    """Least squares on the errors of a stretch. All parameters with their priors are fitted together with further
    columns.
    """

    def __init__(self, columns: Columns, estimate: Estimate) -> None:
        variance = columns.noise / np.maximum(columns.samples, 1) + BINS * rough(columns) ** 2
        weight = np.where(columns.samples > 0, 1.0 / variance, 0.0)
        errors = columns.measured - columns.simulated
        H = columns.parameters.reshape(-1, columns.parameters.shape[-1])
        w = weight.reshape(-1)
        self._w, self._weighted = w, np.ascontiguousarray((H * w[:, None]).T)
        information = np.linalg.inv(estimate.covariance)
        self._inverse = np.linalg.inv(information + self._weighted @ H)
        e = np.where(columns.samples > 0, errors, 0.0).reshape(-1) - H @ estimate.mean
        self._pull = w * (e - H @ (self._inverse @ (self._weighted @ e)))  # of a column on the residual
        self._chi2 = float(e @ self._pull)

    def with_(self, column: Array, typical: float) -> Fitted:
        """Return the fit of a ``column`` (n, c). The size is 0 if a cause of the size ``typical`` would not be
        visible.
        """
        x = column.reshape(-1)
        imitated = self._weighted @ x
        strength = float(x @ (self._w * x) - imitated @ self._inverse @ imitated)
        if strength * typical**2 < 1.0:
            return Fitted(0.0, np.inf, self._chi2)
        size = float(x @ self._pull) / strength
        return Fitted(size, strength**-0.5, self._chi2 - size**2 * strength)

    def together(self, columns: Sequence[Array]) -> tuple[Fitted, ...]:
        """Fit several columns (n, c) together. Return a result for each; all have the same remaining χ²."""
        x = np.stack([column.reshape(-1) for column in columns], axis=1)
        unit = np.sqrt(np.maximum(x.T**2 @ self._w, 1e-300))  # a hole has 1e-6 m² where a force has 1e3 N
        x = x / unit
        imitated = self._weighted @ x
        strength = x.T @ (x * self._w[:, None]) - imitated.T @ self._inverse @ imitated
        pull = x.T @ self._pull
        # Two causes with the same effect count as one: least squares would give each a half, with a large uncertainty.
        covariance = np.linalg.pinv(strength, hermitian=True)
        sizes = covariance @ pull
        left = self._chi2 - float(pull @ sizes)
        deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        each = zip(sizes / unit, deviations / unit, strict=True)
        return tuple(Fitted(float(a), float(d), left) for a, d in each)
