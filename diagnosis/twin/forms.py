"""Time course of a cause: a step, growth, or a limited time; composed of simulated steps.

The effect of a cause is nearly linear in its size. So a growing cause is a sum of small ones with successive starts,
and a cause that ends is one minus a later one. Steps are simulated from a grid of start times. Half of the growth
between two grid times is a step at the first of them, half a step at the second. In an interval that has not ended, all
of the growth so far is a step at its start. So a cause with an immediate effect (a sensor) is exact, and one that
accumulates (a leak) nearly exact.

A cause may grow to a size with a nonlinear effect (a chamber that loses four fifths of its volume). Its growth is
replayed repeatedly. The difference between such a replay and the sum of the steps is added to that sum before the next
replay.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from diagnosis.contracts import Array, Hypothesis
from diagnosis.twin.detector import Alarm, Detector
from diagnosis.twin.fitting import Fit, Fitted
from diagnosis.twin.innovations import BIN, BINS, BLOCK, Columns, Estimate, judge, rough
from diagnosis.twin.replays import Replays, can_be, typical

#: A start is possible (k = 2) if its χ² exceeds that of the best start by at most this.
POSSIBLE: Final = 4.0
#: Growth is searched from this many bins before the deviation on; and the number of start bins for which steps are
#: simulated.
_BEFORE: Final = 600
_PLACES: Final = 20
#: Steps (in bins) of the search for starts and ends, from coarse to fine.
_CLOSER: Final = (40, 20, 10, 5, 2)
#: The same for causes that end, because each place must be simulated.
_SHARPER: Final = (20, 5)
#: With more than this χ² per reading, a twin certainly deviates.
_FAR: Final = 2.0
#: Shortest growth in bins; a shorter one counts as a step.
_GROWS: Final = 40


class DeviatingStretch(NamedTuple):
    """A stretch with a deviation: its readings and their model, the estimate of the parameters, and the replays for the
    effects of causes.
    """

    columns: Columns
    estimate: Estimate
    fit: Fit
    replays: Replays
    points: Sequence[tuple[Hypothesis, Mapping[str, float]]]  #: all causes at all points of their grids

    def agrees(self, added: Array, left: float) -> bool:
        """Return whether the rig agrees with the twin if the effect ``added`` (n, c) of causes is included; ``left`` is
        the remaining χ².
        """
        if left > _FAR * np.count_nonzero(self.columns.samples):  # clearly deviates
            return False
        return self.alarm_with(added) is None

    def alarm_with(self, added: Array) -> Alarm | None:
        """Return the alarm of the detector if the effect ``added`` (n, c) of causes is included; None if there is no
        deviation.
        """
        explained = self.columns._replace(simulated=self.columns.simulated + added)
        white = judge(explained, self.estimate, rough(self.columns)).white
        return Detector(white.shape[1], BLOCK).look(white)


class Form(StrEnum):
    """The time course of a cause."""

    AT_ONCE = "at once"
    GROWING = "growing"
    GONE = "gone again"


class SizedCause(NamedTuple):
    """A cause with its size (SI). The interval of the size (k = 2) covers all possible starts."""

    name: str
    size: float  #: where it grows, the last one
    low: float
    high: float
    since: float  #: s of the stretch from which on it acts, 0 from before its start
    since_low: float  #: interval of that (k = 2)
    since_high: float
    left: float  #: χ² that it leaves
    explains: bool  #: whether the twin with it agrees with the rig
    form: Form = Form.AT_ONCE
    #: s of the stretch at which it has grown to its size, or is gone; None: not yet.
    until: float | None = None


#: Effects of steps by start bin: the contribution of a cause per unit of its size (n, c).
Steps = Mapping[int, Array]


def interval(fits: Iterable[Fitted]) -> tuple[float, float]:
    """Return the interval (k = 2) of a size that covers all ``fits``."""
    every = list(fits)
    return (
        min(one.size - 2.0 * one.deviation for one in every),
        max(one.size + 2.0 * one.deviation for one in every),
    )


def share_grown(at: Array | float, begins: float, ends: float) -> Array:
    """Return which share (0 to 1) of a linear growth from ``begins`` to ``ends`` is reached at the bins ``at``."""
    return np.asarray(np.clip((np.asarray(at) - begins) / (ends - begins), 0.0, 1.0))


def growing(steps: Steps, begins: float, ends: float) -> Array:
    """Return the effect (n, c) of a cause that grows linearly from bin ``begins`` to bin ``ends``, per unit of its
    final size.
    """
    places = sorted(steps)
    bins = np.arange(len(steps[places[0]]), dtype=np.float64) + 0.5

    def grown(at: Array | float) -> Array:
        return share_grown(at, begins, ends)

    edges = [*places, np.inf]
    total = np.zeros_like(steps[places[0]])
    for k, place in enumerate(places):
        here = grown(np.minimum(bins, edges[k + 1])) - grown(place)
        weight = np.where(bins >= edges[k + 1], 0.5 * here, np.where(bins >= place, here, 0.0))
        if k:
            before = grown(place) - grown(places[k - 1])
            weight = weight + np.where(bins >= place, 0.5 * before, 0.0)
        else:  # growth before the first place
            weight = weight + np.where(bins >= place, grown(place), 0.0)
        if weight.any():
            total += weight[:, None] * steps[place]
    return total


class Shaped(NamedTuple):
    """A tested time course of a cause: its first and last bin, its effect (n, c), and its fit."""

    begins: int
    ends: int
    column: Array
    fit: Fitted


def places(since: int, bins: int) -> list[int]:
    """Return the start bins for which steps are simulated, in a stretch with this number of ``bins`` that deviates
    since bin ``since``.
    """
    first = max(since - _BEFORE, BINS)
    return sorted({int(one) for one in np.linspace(first, bins - 2 * BINS, _PLACES)})


class Forms:
    """The possible time courses of one ``cause`` in a stretch with this number of ``bins``.

    ``steps`` are the effects of steps that start at each of `places`. ``steps_at`` simulates steps from other bins on.
    """

    def __init__(
        self,
        fit: Fit,
        cause: Hypothesis,
        bins: int,
        steps: Steps,
        steps_at: Callable[[Sequence[int]], Steps],
    ) -> None:
        self._fit, self._cause, self._last = fit, cause, bins
        self._steps, self._steps_at = dict(steps), steps_at
        self._tried: dict[tuple[Form, int, int], Shaped] = {}
        self._more: Array | float = 0.0  # effect per unit of a growing form that is not a sum of steps

    def grown(self, begins: int, ends: int, size: float, added: Array) -> Shaped:
        """Return the growing form after its replay: the effect ``added`` (n, c) at ``size``.

        The difference between the replay and the sum of steps is used for all similar forms from now on.
        """
        made = added / size
        self._more = made - growing(self._steps, begins, ends)
        self._tried = {}
        return Shaped(begins, ends, made, self._fit.with_(made, typical(self._cause)))

    def coarse(self, form: Form) -> list[Shaped]:
        """Return the fits of a form for all pairs of start and end on the grid of places."""
        at = [place for place in sorted(self._steps) if place or form is Form.GONE]
        tried = (self._shaped(form, a, b) for i, a in enumerate(at) for b in (*at[i + 1 :], self._last))
        return [one for one in tried if one]

    def best(self, form: Form, tried: Sequence[Shaped]) -> tuple[Shaped, list[Shaped]]:
        """Refine the ``tried`` fits of a form. Return the best fit, and all fits with a χ² at most `POSSIBLE` above
        that of the best one.
        """
        every = list(tried)
        for reach in _CLOSER if form is Form.GROWING else _SHARPER:
            every += self._closer(form, min(every, key=left_by), reach)
        best = min(every, key=left_by)
        return best, [one for one in every if one.fit.left <= best.fit.left + POSSIBLE]

    def _closer(self, form: Form, best: Shaped, reach: int) -> Iterator[Shaped]:
        near = [
            (a, b)
            for a in ((-reach, 0, reach) if best.begins else (0,))
            for b in (-reach, 0, reach)
            if a or b
        ]
        asked = [(best.begins + a, min(best.ends + b, self._last)) for a, b in near]
        asked = [
            (begins, ends) for begins, ends in asked if (begins >= BINS or not best.begins) and begins < ends
        ]
        if form is Form.GONE:
            wanted = {place for pair in asked for place in pair if place <= self._last - 2 * BINS}
            self._steps.update(self._steps_at(sorted(wanted - set(self._steps))))
        for begins, ends in asked:
            if one := self._shaped(form, begins, ends):
                yield one

    def _shaped(self, form: Form, begins: int, ends: int) -> Shaped | None:
        key = form, begins, ends
        if key not in self._tried:
            if form is Form.GROWING:
                if ends - begins < _GROWS:
                    return None
                made = growing(self._steps, begins, ends) + self._more
            else:
                if begins not in self._steps or ends not in self._steps:
                    return None
                made = self._steps[begins] - self._steps[ends]
            self._tried[key] = Shaped(begins, ends, made, self._fit.with_(made, typical(self._cause)))
        found = self._tried[key]
        return found if can_be(self._cause, found.fit.size) else None


def left_by(one: Shaped) -> float:
    """Return the remaining χ² of a form."""
    return one.fit.left


def suspect(name: str, form: Form, best: Shaped, alike: Sequence[Shaped], last: int) -> SizedCause:
    """Return a cause with the best form. Its intervals cover the forms ``alike``, which explain about as much."""
    return SizedCause(
        name,
        best.fit.size,
        *interval(one.fit for one in alike),
        best.begins * BIN,
        min(one.begins for one in alike) * BIN,
        max(one.begins for one in alike) * BIN,
        best.fit.left,
        True,
        form,
        None if best.ends >= last else best.ends * BIN,
    )
