"""P-values: how likely chance alone makes a statistic at least as large."""

from __future__ import annotations

from scipy.special import chdtrc, stdtr


def p_of_chi2(value: float, freedom: int) -> float:
    """The chance of a χ² at least as large."""
    return float(chdtrc(freedom, max(value, 0.0))) if freedom > 0 else 1.0


def p_of_t(value: float, freedom: int) -> float:
    """The chance of a Student t at least as far from 0."""
    return float(2.0 * stdtr(freedom, -abs(value)))


def bonferroni(p: float, looks: int) -> float:
    """Bonferroni: the chance of the smallest of so many p-values."""
    return min(1.0, p * max(looks, 1))
