"""P-values: the probability of an equally large statistic by chance."""

from __future__ import annotations

from scipy.special import chdtrc, stdtr


def p_of_chi2(value: float, freedom: int) -> float:
    """Return the probability of χ² ≥ ``value``."""
    return float(chdtrc(freedom, max(value, 0.0))) if freedom > 0 else 1.0


def p_of_t(value: float, freedom: int) -> float:
    """Return the two-sided p-value of Student's t: the probability of |t| ≥ |``value``| by chance."""
    return float(2.0 * stdtr(freedom, -abs(value)))


def bonferroni(p: float, looks: int) -> float:
    """Return the smallest p-value ``p`` of several tests, corrected for their number ``looks`` (Bonferroni)."""
    return min(1.0, p * max(looks, 1))
