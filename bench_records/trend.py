"""One check of one specimen over many runs: every value with its limits, the scatter and the drift."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import datetime
from typing import Final

import msgspec

from bench_records.index import KeptCheck

DAY: Final = 86400.0
#: Confidence of the reported intervals.
CONFIDENCE: Final = 0.95


class Drift(msgspec.Struct, frozen=True):
    """A line fitted to values over time: its slope in SI per day, and half the width of its 95 % interval."""

    per_day: float
    half_width: float

    @property
    def is_seen(self) -> bool:
        """Whether the interval of the drift excludes zero."""
        return abs(self.per_day) > self.half_width


class Trend(msgspec.Struct, frozen=True, kw_only=True):
    """The values of one check, oldest first. ``scatter`` is the standard deviation (SI) from the drift if it is
    significant, otherwise from the mean.
    """

    name: str
    checks: list[KeptCheck]
    days: list[float]  #: since the first
    mean: float | None
    scatter: float | None  #: None for a single value
    drift: Drift | None  #: None for fewer than three values, or all of one instant


def trend_of(name: str, checks: Sequence[KeptCheck]) -> Trend:
    """Return the trend of ``checks``. Checks without a value are listed, but do not count in the statistics.

    The drift is a least-squares line with Student's interval. It assumes independent values with equal scatter.
    """
    instants = [datetime.fromisoformat(one.run.began).timestamp() for one in checks]
    days = [(instant - min(instants)) / DAY for instant in instants]
    points = [
        (day, one.value)
        for day, one in zip(days, checks, strict=True)
        if one.value is not None and math.isfinite(one.value)
    ]
    values = [value for _, value in points]
    mean = sum(values) / len(values) if values else None
    drift = _drift(points)
    scatter = None
    if mean is not None and len(values) > 1:
        middle = sum(day for day, _ in points) / len(points)
        slope = drift.per_day if drift and drift.is_seen else 0.0
        left = [value - mean - slope * (day - middle) for day, value in points]
        freedom = len(values) - (2 if slope else 1)
        scatter = math.sqrt(sum(one**2 for one in left) / freedom)
    return Trend(name=name, checks=list(checks), days=days, mean=mean, scatter=scatter, drift=drift)


def _drift(points: Sequence[tuple[float, float]]) -> Drift | None:
    from scipy import stats

    if len(points) < 3 or len({day for day, _ in points}) < 2:
        return None
    line = stats.linregress(*zip(*points, strict=True))
    factor = float(stats.t.ppf((1 + CONFIDENCE) / 2, len(points) - 2))
    return Drift(float(line.slope), factor * float(line.stderr))
