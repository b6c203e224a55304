"""Search for pairs of causes that together explain a stretch which no single cause explains. It is greedy; then each
pair is refined.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from diagnosis.contracts import Array, Hypothesis
from diagnosis.twin.fitting import Fitted
from diagnosis.twin.forms import POSSIBLE, DeviatingStretch, SizedCause, interval
from diagnosis.twin.innovations import BIN, BINS
from diagnosis.twin.replays import bounded, can_be, typical
from diagnosis.twin.slices import Work

#: Number of second causes for each first one whose start is searched.
_SECONDS: Final = 3
#: Which of the two is moved next, and by which bins around its present beginning: the second one is not known yet.
_NEAR: Final = (
    (1, tuple(BINS * block for block in (-12, -8, -6, -4, -2, -1, 0, 1, 2, 4))),
    (1, (-5, -3, 0, 3, 5)),
    (0, (-10, -5, -2, 0, 2, 5, 10)),
    (1, (-10, -5, -3, -2, -1, 0, 1, 2, 3, 5, 10)),
    (0, (-3, -2, -1, 0, 1, 2, 3)),
)
#: Smallest size of each of two causes in its standard deviations: a smaller one explains nothing.
_SURE: Final = 4.0


class Acting(NamedTuple):
    """A cause at a point of its grid, with its start bin and an approximate size."""

    cause: Hypothesis
    shapes: Mapping[str, float]
    size: float
    onset: int  #: 0: before the stretch


class _Two(NamedTuple):
    """Two causes: the effect of each per unit of size (n, c), their fits, and for each the range of start bins (first,
    last) for which the fit is nearly as good as for the best start bin.
    """

    acting: tuple[Acting, Acting]
    columns: tuple[Array, Array]
    fits: tuple[Fitted, ...]
    since: tuple[tuple[int, int], tuple[int, int]]

    @property
    def left(self) -> float:
        return self.fits[0].left

    @property
    def added(self) -> Array:
        return sum_of(self.fits, self.columns)


def sum_of(fits: Sequence[Fitted], columns: Sequence[Array]) -> Array:
    """Return the sum (n, c) of the effects of causes: each column times its fitted size."""
    total = 0.0 * columns[0]
    for fit, column in zip(fits, columns, strict=True):
        total += fit.size * column
    return total


class Pairs:
    """The search for pairs of causes in one stretch."""

    def __init__(self, stretch: DeviatingStretch) -> None:
        self._stretch = stretch
        self._last = len(stretch.columns.measured) - 2 * BINS

    def pairs_with(self, first: Acting) -> Work[list[tuple[SizedCause, SizedCause]]]:
        """Return pairs of ``first`` and another cause that together explain the stretch, both with their best
        starts.
        """
        (column,) = self._stretch.replays.columns([(first.cause, first.shapes, first.size)], first.onset)
        if column is None:
            return []
        onset = self._where_it_parts(first.size, column)
        if onset is None or onset > self._last:
            return []
        pairs: list[tuple[SizedCause, SizedCause]] = []
        for second in (yield from self._seconds(first, column, onset)):
            found: _Two | None = None
            acting = (first, second)
            for which, near in _NEAR:
                better = yield from self._refined(acting, which, near, found)
                if better is not None:
                    found, acting = better, better.acting
            if found is not None and self._convinces(found):
                pairs.append(_suspects(found))
        return pairs

    def _where_it_parts(self, size: float, column: Array) -> int | None:
        """Return the bin since which the rig deviates from the twin with the effect ``column`` times ``size``; None
        without a deviation.
        """
        alarm = self._stretch.alarm_with(size * column)
        return None if alarm is None else alarm.since * BINS

    def _seconds(self, first: Acting, column: Array, onset: int) -> Work[list[Acting]]:
        """Return the causes that, together with the first one, explain most of the remainder. Each cause is listed with
        its best grid point.
        """
        ranked: list[tuple[float, Acting]] = []
        sizes = [(cause, shapes, bounded(cause, typical(cause))) for cause, shapes in self._stretch.points]
        for at in {onset, first.onset}:
            for (cause, shapes), other in zip(
                self._stretch.points, self._stretch.replays.columns(sizes, at), strict=True
            ):
                yield
                if other is None or cause.name == first.cause.name:
                    continue
                _, fit = self._stretch.fit.together([column, other])
                if can_be(cause, fit.size):
                    ranked.append((fit.left, Acting(cause, shapes, fit.size, at)))
        chosen: dict[str, Acting] = {}
        for _, one in sorted(ranked, key=lambda pair: pair[0]):
            if len(chosen) < _SECONDS:
                chosen.setdefault(one.cause.name, one)
        return list(chosen.values())

    def _refined(
        self, acting: tuple[Acting, Acting], which: int, near: Sequence[int], before: _Two | None
    ) -> Work[_Two | None]:
        """Return the pair after the start of one cause (``which``) was optimised; the other cause is not moved."""
        mover, keeper = acting[which], acting[1 - which]
        kept = before.columns[1 - which] if before else self._single_column(keeper)
        if kept is None:
            return before
        tried: list[_Two] = []
        onsets = {mover.onset + off for off in near} if mover.onset else {0}
        for onset in sorted(one for one in onsets if 0 < one <= self._last or not mover.onset):
            yield
            moved = mover._replace(size=bounded(mover.cause, mover.size), onset=onset)
            if (column := self._single_column(moved)) is None:
                continue
            both = (kept, column) if which else (column, kept)
            fits = self._stretch.fit.together(both)
            pair = (keeper, moved) if which else (moved, keeper)
            if all(can_be(one.cause, fit.size) for one, fit in zip(pair, fits, strict=True)):
                sized = tuple(one._replace(size=fit.size) for one, fit in zip(pair, fits, strict=True))
                tried.append(_Two((sized[0], sized[1]), both, fits, ((0, 0), (0, 0))))
        if not tried:
            return before
        best = min(tried, key=lambda two: two.left)
        possible = [two.acting[which].onset for two in tried if two.left <= best.left + POSSIBLE]
        other = before.since[1 - which] if before else (keeper.onset, keeper.onset)
        mine = (min(possible), max(possible))
        return best._replace(since=(other, mine) if which else (mine, other))

    def _single_column(self, acting: Acting) -> Array | None:
        (column,) = self._stretch.replays.columns(
            [(acting.cause, acting.shapes, bounded(acting.cause, acting.size))], acting.onset
        )
        return column

    def _convinces(self, two: _Two) -> bool:
        sure = all(abs(fit.size) > _SURE * fit.deviation for fit in two.fits)
        return sure and self._stretch.agrees(two.added, two.left)


def _suspects(two: _Two) -> tuple[SizedCause, SizedCause]:
    first, second = (
        SizedCause(
            acting.cause.name,
            fit.size,
            *interval([fit]),
            acting.onset * BIN,
            earliest * BIN,
            latest * BIN,
            fit.left,
            True,
        )
        for acting, fit, (earliest, latest) in zip(two.acting, two.fits, two.since, strict=True)
    )
    return (first, second) if first.since <= second.since else (second, first)
