"""Signals from points that arrive without request."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from bench_protocol.signals import Kind
from bench_protocol.units import NS
from drivers.wiring.lines import Description, Source


class _SignalNews:
    """One signal: its points, their latest values, and which of them are new."""

    def __init__(self, row: int, source: Source, stale: Mapping[str, int]) -> None:
        self.row, self._source, self._stale = row, source, stale
        self._last: dict[str, tuple[int, float]] = {}
        self._news: set[str] = set()

    def receive(self, point: str, time: int, number: float) -> None:
        """Store a new value of one of the points."""
        self._last[point] = time, number
        self._news.add(point)

    def value(self, time: int) -> float | None:
        """Return the SI value once all points are new, NaN if one of them is stale by then; else None."""
        if len(self._news) < len(self._source.points):
            return None
        self._news.clear()
        last = [(point, *self._last[point]) for point in self._source.points]
        if any(time - came > self._stale[point] for point, came, _ in last):
            return math.nan
        return self._source.si([number for _, _, number in last])


class Sources:
    """The measurements and statuses of a description of which all points arrive without request.

    ``stale`` returns for a point the age (s) above which it is stale, 0 if it is polled on request.
    """

    def __init__(self, description: Description, stale: Callable[[str], float]) -> None:
        #: Age (ns) above which a signal is stale.
        self.limits: dict[str, int] = {}
        self._by_point: dict[str, list[_SignalNews]] = {}
        for name, source in description.sources.items():
            limits = {point: round(stale(point) * NS) for point in source.points}
            if description.table[name].kind is Kind.INTERLOCK or not all(limits.values()):
                continue
            self.limits[name] = max(limits.values())
            news = _SignalNews(description.table.index[name], source, limits)
            for point in limits:
                self._by_point.setdefault(point, []).append(news)

    def samples(self, prefix: str, time: int, points: Mapping[str, float]) -> dict[int, float]:
        """Return the new SI values by table row when ``points`` arrive, named without ``prefix``.

        A signal of several points is new when the last of them has arrived.
        """
        touched: dict[int, _SignalNews] = {}
        for point, number in points.items():
            for news in self._by_point.get(prefix + point, ()):
                news.receive(prefix + point, time, number)
                touched[news.row] = news
        values = {row: news.value(time) for row, news in touched.items()}
        return {row: value for row, value in values.items() if value is not None}
