"""P-values: the probability of an equally large statistic by chance."""

from __future__ import annotations

import math

from scipy.special import chdtrc, fdtrc, stdtr

from diagnosis.contracts import Array


def p_of_chi2(value: float, freedom: float) -> float:
    """Return the probability of χ² ≥ ``value``."""
    return float(chdtrc(freedom, max(value, 0.0))) if freedom > 0 else 1.0


def p_of_t(value: float, freedom: int) -> float:
    """Return the two-sided p-value of Student's t: the probability of |t| ≥ |``value``| by chance."""
    return float(2.0 * stdtr(freedom, -abs(value)))


def p_of_variances(ratio: float, freedom: float, reference: float) -> float:
    """Return the probability of an F ratio of at least ``ratio`` of two variances with these degrees of freedom.

    The ``reference`` variance may be known exactly, with infinitely many.
    """
    if math.isinf(reference):
        return p_of_chi2(ratio * freedom, freedom)
    return float(fdtrc(freedom, reference, ratio))


def independent_samples(count: int, correlations: Array) -> float:
    """Return the number of independent samples with the same information on a variance as ``count`` samples with these
    autocorrelations from lag 1 on (Bartlett).
    """
    return count / (1.0 + 2.0 * float(correlations @ correlations))


def bonferroni(p: float, looks: int) -> float:
    """Return the smallest p-value ``p`` of several tests, corrected for their number ``looks`` (Bonferroni)."""
    return min(1.0, p * max(looks, 1))
