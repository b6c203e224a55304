"""Least squares with confidence intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares
from scipy.stats import t

from bench_protocol.units import mbar

Floats = npt.NDArray[np.float64]

#: Zeros of two pressure transducers by their data sheet, evenly spread within 25 mbar.
PRESSURE_ZERO: Final = 25 * mbar / 6**0.5


class NotIdentified(ValueError):
    """Curves or a parameter file that do not hold what the identification needs."""


@dataclass(frozen=True, slots=True)
class Fit:
    """Fitted values (SI) with their covariance; named as in the parameter files where they stand there."""

    names: tuple[str, ...]
    values: Floats
    covariance: Floats  #: shape (n, n)
    misfit: float  #: rms of the residuals over their expected scatter
    freedom: int  #: residuals less parameters

    def __getitem__(self, name: str) -> float:
        return float(self.values[self._place(name)])

    def sigma(self, name: str) -> float:
        """Return the standard deviation of a value."""
        place = self._place(name)
        return float(np.sqrt(self.covariance[place, place]))

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Return the confidence interval of a value (Student's t)."""
        reach = float(t.ppf(0.5 * (1 + level), max(self.freedom, 1))) * self.sigma(name)
        return self[name] - reach, self[name] + reach

    def _place(self, name: str) -> int:
        if name not in self.names:
            raise NotIdentified(f"{name} was not fitted; there is {', '.join(self.names)}")
        return self.names.index(name)


def fit(residuals: Callable[[Mapping[str, float]], Floats], start: Mapping[str, float]) -> Fit:
    """Minimise the sum of squares of ``residuals`` (each over its expected scatter) from ``start`` on.

    The covariance is (JᵀJ)⁻¹ at the minimum, times the square of the misfit where that exceeds 1: what was expected too
    small counts as it came. NotIdentified if there are too few residuals or the minimum is not found.
    """
    names = tuple(start)
    scale = np.array([abs(value) or 1.0 for value in start.values()])

    def scaled(x: Floats) -> Floats:
        return residuals(dict(zip(names, (x * scale).tolist(), strict=True)))

    solution = least_squares(
        scaled, np.array(list(start.values())) / scale, x_scale="jac", xtol=1e-12, ftol=1e-12
    )
    freedom = solution.fun.size - len(names)
    if not solution.success or freedom < 0:
        raise NotIdentified(f"{', '.join(names)} from {solution.fun.size} residuals: {solution.message}")
    misfit = float(np.sqrt(np.sum(solution.fun**2) / max(freedom, 1)))
    try:
        covariance = np.linalg.inv(solution.jac.T @ solution.jac) * max(misfit, 1.0) ** 2
    except np.linalg.LinAlgError:
        raise NotIdentified(f"the curves do not tell {', '.join(names)} apart") from None
    return Fit(names, solution.x * scale, covariance * np.outer(scale, scale), misfit, freedom)


def in_units(found: Fit, scale: Mapping[str, float]) -> Fit:
    """Return ``found`` in SI where values were fitted as multiples of ``scale``."""
    factors = np.array([scale.get(name, 1.0) for name in found.names])
    covariance = found.covariance * np.outer(factors, factors)
    return Fit(found.names, found.values * factors, covariance, found.misfit, found.freedom)
