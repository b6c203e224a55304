"""The signals that come by themselves: what becomes of the points of a rig as they arrive."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from bench_protocol.signals import Kind
from bench_protocol.units import NS
from drivers.wiring.lines import Description, Source


class _SignalNews:
    """One signal: its points, what they were last, and which of them are news."""

    def __init__(self, row: int, source: Source, stale: Mapping[str, int]) -> None:
        self.row, self._source, self._stale = row, source, stale
        self._last: dict[str, tuple[int, float]] = {}
        self._news: set[str] = set()

    def receive(self, point: str, time: int, number: float) -> None:
        """Take news of one of the points."""
        self._last[point] = time, number
        self._news.add(point)

    def value(self, time: int) -> float | None:
        """Return the SI value once all points have news, NaN if one of them is stale by then; else None."""
        if len(self._news) < len(self._source.points):
            return None
        self._news.clear()
        last = [(point, *self._last[point]) for point in self._source.points]
        if any(time - came > self._stale[point] for point, came, _ in last):
            return math.nan
        return self._source.si([number for _, _, number in last])


class Sources:
    """The measurements and statuses of a description all of whose points come by themselves.

    ``stale`` tells of a point after how long without news (s) it is stale, 0 if it does not come by itself.
    """

    def __init__(self, description: Description, stale: Callable[[str], float]) -> None:
        #: After how many ns without news a signal is stale.
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
        """Return the SI values by table row that are new when ``points`` come, named without ``prefix``.

        A signal of several points is new when the last of them has come.
        """
        touched: dict[int, _SignalNews] = {}
        for point, number in points.items():
            for news in self._by_point.get(prefix + point, ()):
                news.receive(prefix + point, time, number)
                touched[news.row] = news
        values = {row: news.value(time) for row, news in touched.items()}
        return {row: value for row, value in values.items() if value is not None}
