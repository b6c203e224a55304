"""Criteria of the checks for numbers and series, and the text form of a series."""

from typing import Any

import numpy as np


def within(value: float, low: float, high: float) -> bool:
    """Return whether low ≤ value ≤ high; False for NaN."""
    return bool(low <= value <= high)


def near(value: float, expected: float, share: float) -> bool:
    """Return whether a value lies within ± ``share`` of the expected value."""
    return bool(abs(value - expected) <= share * abs(expected))


def maxima(values: Any) -> list[int]:
    """Return the places of the local maxima inside a series."""
    rising = np.diff(values) > 0.0
    return [int(k) + 1 for k in np.flatnonzero(rising[:-1] & ~rising[1:])]


def falls(values: Any) -> bool:
    """Return whether a series falls strictly."""
    return bool(np.all(np.diff(values) < 0.0))


def rises(values: Any) -> bool:
    """Return whether a series rises strictly."""
    return bool(np.all(np.diff(values) > 0.0))


def listed(values: Any, form: str = ".1f") -> str:
    """Return the numbers as text, separated by slashes."""
    return " / ".join(format(float(value), form) for value in values)
