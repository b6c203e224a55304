"""Conformity of values with limits under uncertainty: coverage factor, probability, and number of decimals.

The error of a value is the sum of two parts (model of EA-4/02, S9), with the standard uncertainty ``u``. One part has
a rectangular distribution with the standard deviation ``even``, which is the largest rectangular contribution. The
other part has a normal distribution. If ``even`` is 0, the error is normally distributed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

#: Coverage of ± 2 u by a normal distribution, which calibration laboratories state.
COVERAGE = math.erf(math.sqrt(2.0))
#: A value passes if it conforms with this probability at least: the guard band of JCGM 106, 8.3.2.
SURE = 0.975


def cumulative(x: float, u: float, even: float = 0.0) -> float:
    """Return the probability of an error below ``x``. The error is the sum of a rectangular and a normal part with
    total variance u².

    F(x) = [(x+a) Φ((x+a)/σ) − (x−a) Φ((x−a)/σ) + σ φ((x+a)/σ) − σ φ((x−a)/σ)] / 2a with a = √3 even, σ² = u² − even².
    """
    half = math.sqrt(3.0) * min(even, u)
    sigma = math.sqrt(max(u**2 - even**2, 0.0))
    if half <= 1e-6 * u:
        return _normal(x / u) if u > 0.0 else float(x > 0.0) + 0.5 * (x == 0.0)
    if sigma <= 1e-6 * half:
        return min(max(0.5 + 0.5 * x / half, 0.0), 1.0)

    def inner(y: float) -> float:
        t = y / sigma
        return y * _normal(t) + sigma * math.exp(-0.5 * t * t) / math.sqrt(2.0 * math.pi)

    return min(max((inner(x + half) - inner(x - half)) / (2.0 * half), 0.0), 1.0)


def conformity(value: float, u: float, low: float | None, high: float | None, even: float = 0.0) -> float:
    """Return the probability that the true value of a quantity is within its limits (JCGM 106, 7.2). ``value`` is the
    measured value.
    """
    above = 1.0 if high is None else cumulative(high - value, u, even)
    below = 0.0 if low is None else cumulative(low - value, u, even)
    return max(above - below, 0.0)


@lru_cache(maxsize=4096)
def coverage_factor(share: float) -> float:
    """Return k in U = k u for ``share`` = even / u. It is 2 for a normal error and 1.65 for a rectangular one."""
    return _inverse(0.5 + 0.5 * COVERAGE, min(share, 1.0))


@lru_cache(maxsize=4096)
def guard_factor(share: float) -> float:
    """Return the distance from a limit, in units of u, at which a value conforms with the probability `SURE`."""
    return _inverse(SURE, min(share, 1.0))


def _inverse(probability: float, share: float) -> float:
    low, high = 0.0, 10.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if cumulative(middle, 1.0, share) < probability else (low, middle)
    return 0.5 * (low + high)


def decimals(value: float, expanded: float, limits: Sequence[float]) -> int:
    """Return the number of decimals for a value with its expanded uncertainty.

    The uncertainty is shown with one digit, or with two if they are below 35. There are more decimals if rounding
    would move the value onto a limit or across it.
    """
    shown = 0
    if expanded > 0.0:
        exponent = math.floor(math.log10(expanded))
        shown = max(0, -exponent + (expanded / 10.0**exponent < 3.5))
    while shown < 12 and any(
        value != limit and (round(value, shown) - limit) * (value - limit) <= 0.0 for limit in limits
    ):
        shown += 1
    return shown


def percent(probability: float) -> str:
    """Return a probability as text in percent. Beyond 0.1 % and 99.9 % only the bound is stated."""
    if probability > 0.999:
        return "> 99.9 %"
    return "< 0.1 %" if probability < 0.001 else f"{100 * probability:.1f} %"


def _normal(t: float) -> float:
    return 0.5 * math.erfc(-t / math.sqrt(2.0))
