"""Possible causes of a deviation, ranked by the part of the χ² of a stretch that they explain.

A cause may act from the start of the stretch, or from about the start of the deviation. Its effect is the difference of
two replays that begin there, with and without the cause. The initial state is uncertain because the rig is in motion,
but it is the same in both.

This search is fast, because it is linear in the size of the cause and in all parameters. A diagnosis (`astb diagnose`)
is slower and more exact. A cause explains a stretch if the twin with this cause does not deviate from the rig
(`diagnosis.twin.detector`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from diagnosis.contracts import Array, Hypothesis, MeasuredRun
from diagnosis.systems.air_spring.simulator import AirSpring
from diagnosis.twin.fitting import Fit, Fitted
from diagnosis.twin.forms import (
    POSSIBLE,
    DeviatingStretch,
    Form,
    Forms,
    Shaped,
    SizedCause,
    Steps,
    interval,
    left_by,
    places,
    suspect,
)
from diagnosis.twin.growth import Growing, Growth
from diagnosis.twin.innovations import BIN, BINS, BLOCK, Columns, Estimate
from diagnosis.twin.pairs import Acting, Pairs
from diagnosis.twin.replays import Replays, Secant, bounded, typical
from diagnosis.twin.slices import Work

#: Number of the best causes whose size and start are refined by simulations at their fitted size.
_CLOSELY: Final = 9
#: Number of simulations at a fitted size: over all possible starts, and then closely around the best start for the best
#: causes.
_ROUNDS: Final = 2
_FINE_ROUNDS: Final = 2
_FINELY: Final = 3
#: Number of causes that are tried as the first of two.
_FIRSTS: Final = 2
#: Sizes at which causes are tried, relative to the typical one. Large ones are tried only if no small one explains the
#: stretch.
_SIZES: Final = (1.0, 5.0)
#: Time (s) after the start of a stretch from which a new cause is distinguished from an earlier one.
_LATE: Final = BLOCK
#: Causes within this χ² of the best one are reported together with it.
_ALIKE: Final = 9.0


#: Bins before and after the start of the deviation at which a cause may have begun: whole blocks.
_NEAR: Final = tuple(BINS * block for block in (-30, -24, -16, -12, -8, -6, -4, -3, -2, -1, 0, 1, 2))
#: The same for the closer search.
_NEARER: Final = (-8, -5, -3, -2, -1, 0, 1, 2, 3, 5, 8)


class Explained(NamedTuple):
    """The causes that explain a stretch, best first: single ones, or pairs if no single one explains it; empty without
    any.

    ``worse`` are single causes that explain it less well as a step. They may explain it if they grow.
    """

    singles: tuple[SizedCause, ...] = ()
    pairs: tuple[tuple[SizedCause, SizedCause], ...] = ()
    worse: tuple[SizedCause, ...] = ()


def explanations(
    run: MeasuredRun,
    columns: Columns,
    estimate: Estimate,
    simulator: AirSpring,
    since: float,
    known: Callable[[], Work[Sequence[SizedCause]]],
) -> Work[Explained]:
    """Search the causes of a stretch that deviates ``since`` s after its start. This is work in slices
    (`diagnosis.twin.slices`).

    ``known`` returns causes that explain a shorter part of the stretch. One of them may still be part of a pair.
    """
    look = _Look(run, columns, estimate, simulator, since)
    onsets = (0,) if since < _LATE else (0, round(since / BIN))
    looked: list[_Closely] = []
    ranked: list[SizedCause] = []
    for times in _SIZES:
        tried: list[_Tried] = []
        for onset in onsets:
            tried += yield from look.each(onset, times)
        chosen: dict[tuple[str, int], _Tried] = {}
        for one in sorted(tried, key=lambda one: one.fit.left):
            if len(chosen) < _CLOSELY:
                chosen.setdefault((one.cause.name, one.onset), one)
        looked = yield from look.closely(list(chosen.values()))
        looked.sort(key=lambda one: one.best.left)
        ranked = yield from look.convincing(looked)
        if ranked:
            break
    ranked += yield from look.shaped(looked[:_FINELY] if ranked else looked)
    ranked.sort(key=lambda one: one.left)
    if not ranked:
        before = yield from known()
        firsts = look.acting(before)
        ranked = yield from look.growth.among(firsts)
        if not ranked:
            return Explained(pairs=(yield from look.pairs(firsts or look.at_present(looked))))
        ranked.sort(key=lambda one: one.left)
    alike = [one for one in ranked if one.left < ranked[0].left + _ALIKE]
    names = dict.fromkeys(one.name for one in alike)
    worse: dict[str, SizedCause] = {}
    for other in ranked:
        if other.name not in names:
            worse.setdefault(other.name, other)
    return Explained(
        tuple(_with_joint_interval([one for one in alike if one.name == name]) for name in names),
        worse=tuple(worse.values()),
    )


def _with_joint_interval(ranked: Sequence[SizedCause]) -> SizedCause:
    """Return the first of the ranked causes. Its intervals include those of all causes of its form that explain about
    as much (χ² within `POSSIBLE`).
    """
    best = ranked[0]
    possible = [one for one in ranked if one.left <= best.left + POSSIBLE and one.form is best.form]
    return best._replace(
        low=min(one.low for one in possible),
        high=max(one.high for one in possible),
        since_low=min(one.since_low for one in possible),
        since_high=max(one.since_high for one in possible),
    )


class _Tried(NamedTuple):
    """A cause as tested: at one point of its grid, from start bin ``onset`` on (0: before the stretch), with
    its fit.
    """

    cause: Hypothesis
    shapes: Mapping[str, float]
    onset: int
    fit: Fitted


class _Near(NamedTuple):
    """A cause with a start near the tested one: the remaining χ², its start bin, its effect (n, c), and its fit."""

    left: float
    onset: int
    column: Array
    fit: Fitted


_NOTHING: Final[Array] = np.empty((0, 0))


class _Closely:
    """A cause while its size and start are refined: its present ``size``, the start bins to try, and the results of the
    last round (``found``).
    """

    def __init__(self, tried: _Tried, near: set[int]) -> None:
        self.tried, self.near = tried, near
        self.size = bounded(tried.cause, tried.fit.size)
        self.found: list[_Near] = []
        self._all: list[_Near] = []
        self._secant = Secant()

    @property
    def best(self) -> _Near:
        """The result of the last round with the smallest remaining χ²."""
        return min(self.found, key=lambda one: one.left)

    @property
    def possible(self) -> list[_Near]:
        """The results of all rounds that explain as much as the best one."""
        return [one for one in self._all if one.left <= self.best.left + POSSIBLE]

    def learn(self, near: list[_Near]) -> None:
        """Store the results of a round, and compute the next size. The secant method searches the size at which fitted
        and simulated size agree.
        """
        if not near:
            self.size = 0.0
            return
        self.found = near
        self._all += [one._replace(column=_NOTHING) for one in near]
        found = self._secant.after(self.size, self.best.fit.size)
        self.size = bounded(self.tried.cause, found)


class _Look:
    """One search for the causes of a stretch."""

    def __init__(
        self, run: MeasuredRun, columns: Columns, estimate: Estimate, simulator: AirSpring, since: float
    ) -> None:
        self._columns, self._since = columns, round(since / BIN)
        self._fit = Fit(columns, estimate)
        self._replays = Replays(run, simulator)
        self._points: list[tuple[Hypothesis, Mapping[str, float]]] = [
            (cause, dict(zip((shape.name for shape in cause.shapes), point, strict=True)))
            for cause in simulator.catalogue.values()
            for point in cause.grid
        ]
        self._shapes: dict[str, Mapping[str, float]] = {}  # of the causes that were looked at closely
        self._stretch = DeviatingStretch(columns, estimate, self._fit, self._replays, self._points)
        self.growth = Growth(self._stretch, self._since)

    def each(self, onset: int, times: float) -> Work[list[_Tried]]:
        """Simulate all causes at all grid points from a start bin on, at ``times`` their typical size. Return those
        with a visible effect.
        """
        tried: list[_Tried] = []
        sizes = [(cause, shapes, bounded(cause, times * typical(cause))) for cause, shapes in self._points]
        for (cause, shapes), column in zip(self._points, self._replays.columns(sizes, onset), strict=True):
            yield
            if column is not None:
                fit = self._fit.with_(column, typical(cause))
                if fit.size and (not cause.one_sided or fit.size * typical(cause) > 0.0):
                    tried.append(_Tried(cause, shapes, onset, fit))
        return tried

    def closely(self, chosen: Sequence[_Tried]) -> Work[list[_Closely]]:
        """Refine size and start time of the ``chosen`` causes by simulations, and return the refined ones.

        All causes with the same start bin are simulated together.
        """
        looks = [_Closely(one, self._around(one.onset, _NEAR)) for one in chosen]
        self._shapes |= {one.cause.name: one.shapes for one in reversed(chosen)}
        for _ in range(_ROUNDS):
            yield from self._simulate(looks)
        looks = [one for one in looks if one.found]
        best = sorted(looks, key=lambda one: one.best.left)[:_FINELY]
        for _ in range(_FINE_ROUNDS):
            for one in best:
                one.near = self._around(one.best.onset, _NEARER)
            yield from self._simulate(best)
        return looks

    def convincing(self, looks: Sequence[_Closely]) -> Work[list[SizedCause]]:
        """Return those of the refined causes that explain the stretch."""
        found: list[SizedCause] = []
        for look in looks:
            yield
            if (one := self._suspect(look)).explains:
                found.append(one)
        return found

    def shaped(self, looks: Sequence[_Closely]) -> Work[list[SizedCause]]:
        """Return those of the refined causes that explain the stretch if they grow, or if they end."""
        bins = len(self._columns.measured)
        steps: list[dict[int, Array]] = [{} for _ in looks]
        asked = [_simulation_input(look) for look in looks]
        for place in (0, *places(self._since, bins)):  # a cause from before the stretch may end in it, too
            for one, column in zip(steps, self._replays.columns(asked, place), strict=True):
                yield
                if column is not None:
                    one[place] = column
        tried: list[tuple[float, _Closely, Form, Forms, list[Shaped]]] = []
        for look, one in zip(looks, steps, strict=True):
            forms = Forms(self._fit, look.tried.cause, bins, one, self._steps(look))
            for form in (Form.GROWING, Form.GONE):
                yield
                if some := forms.coarse(form):
                    tried.append((min(map(left_by, some)), look, form, forms, some))
        found: list[SizedCause] = []
        for _, look, form, forms, some in sorted(tried, key=lambda one: one[0])[:_FINELY]:
            yield
            best, alike = forms.best(form, some)
            if best.fit.left >= look.best.left - _ALIKE:  # two more numbers must be worth it
                continue
            if form is Form.GONE:
                if self._agrees(best.fit, best.column):
                    found.append(suspect(look.tried.cause.name, form, best, alike, bins))
                continue
            grown = yield from self.growth.explains(Growing(look.tried.cause, look.tried.shapes, forms, best))
            if grown is not None:
                found.append(grown)
                found += yield from self.growth.among(self.growth.mistaken_for(grown))
        return found

    def _steps(self, look: _Closely) -> Callable[[Sequence[int]], Steps]:
        """Return a function: it simulates a refined cause at its present size from each of the given bins on."""

        def steps(bins: Sequence[int]) -> Steps:
            made = {place: next(self._replays.columns([_simulation_input(look)], place)) for place in bins}
            return {place: column for place, column in made.items() if column is not None}

        return steps

    def _agrees(self, fit: Fitted, column: Array) -> bool:
        return self._stretch.agrees(fit.size * column, fit.left)

    def acting(self, known: Sequence[SizedCause]) -> list[Acting]:
        """Return known causes with the size and start that they had in the earlier part of the stretch."""
        causes: dict[str, tuple[Hypothesis, Mapping[str, float]]] = {}
        for cause, point in self._points:
            causes.setdefault(cause.name, (cause, self._shapes.get(cause.name, point)))
        return [Acting(*causes[one.name], one.size, round(one.since / BIN)) for one in known]

    def at_present(self, looks: Sequence[_Closely]) -> list[Acting]:
        """Return refined causes with their fitted sizes and best start bins."""
        return [Acting(*_simulation_input(one), one.best.onset) for one in looks]

    def pairs(self, firsts: Sequence[Acting]) -> Work[tuple[tuple[SizedCause, SizedCause], ...]]:
        """Return pairs of causes that together explain the stretch, best first. One cause of each pair is among
        ``firsts``.
        """
        search = Pairs(self._stretch)
        found: list[tuple[SizedCause, SizedCause]] = []
        for first in firsts[:_FIRSTS]:
            found += yield from search.pairs_with(first)
        found.sort(key=lambda pair: pair[0].left)
        once: dict[frozenset[str], tuple[SizedCause, SizedCause]] = {}
        for pair in found:
            if pair[0].left < found[0][0].left + _ALIKE:
                once.setdefault(frozenset(one.name for one in pair), pair)
        return tuple(once.values())

    def _simulate(self, looks: Sequence[_Closely]) -> Work[None]:
        """Simulate causes at their present sizes, with all start times near their own, and store the results in
        them.
        """
        fitted: list[list[_Near]] = [[] for _ in looks]
        for onset in sorted(set[int]().union(*(one.near for one in looks))):
            some = [k for k, one in enumerate(looks) if onset in one.near and one.size]
            asked = [(looks[k].tried.cause, looks[k].tried.shapes, looks[k].size) for k in some]
            for k, column in zip(some, self._replays.columns(asked, onset), strict=True):
                yield
                if column is not None:
                    fit = self._fit.with_(column, typical(looks[k].tried.cause))
                    fitted[k].append(_Near(fit.left, onset, column, fit))
        for one, near in zip(looks, fitted, strict=True):
            one.learn(near)

    def _around(self, onset: int, bins: Sequence[int]) -> set[int]:
        """Return the possible start bins near ``onset``, at the distances ``bins``. A start before the stretch (0) is
        not moved.
        """
        last = len(self._columns.measured) - 2 * BINS
        return {one for one in (onset + off for off in bins) if 0 < one <= last} if onset else {0}

    def _suspect(self, look: _Closely) -> SizedCause:
        best = look.best
        possible = look.possible
        low, high = interval(one.fit for one in possible)
        along = self._agrees(best.fit, best.column)
        since = (
            best.onset * BIN,
            min(one.onset for one in possible) * BIN,
            max(one.onset for one in possible) * BIN,
        )
        return SizedCause(look.tried.cause.name, best.fit.size, low, high, *since, best.left, along)


def _simulation_input(look: _Closely) -> tuple[Hypothesis, Mapping[str, float], float]:
    """Return cause, shapes and fitted size of a refined cause, as the input of a simulation."""
    tried = look.tried
    return tried.cause, tried.shapes, bounded(tried.cause, look.best.fit.size)
