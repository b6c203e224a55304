"""Timing of a twin: when it judges new samples, and how long it searches for causes. It uses half of a processor, and
its delay is at most 2 s.

Theory of operation
-------------------
A look judges the new samples. A look that begins at t covers the samples received by t. The next look begins at t + 2 u
or later, where u is the processor time since the start of the look before. So the twin uses half of a processor at
most. The result of a look is replaced when the next look ends, at t + 2 u + l, where l is the duration of a look. So
the search between the two may take a time s with 2 (l + s) + l below the allowed delay. A search ends some tenths of a
second late, because it can be interrupted only at certain places. So the target is lower.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

#: Shortest time (s) between the starts of two looks.
EVERY: Final = 0.5
#: Greatest delay (s) of the next look by a search: 2 s minus the time until a search can be interrupted.
BEHIND: Final = 1.4
#: Smallest share of time for a search, relative to a look, so that it makes progress.
_LEAST: Final = 0.25


class Pace:
    """The timing of one twin. ``now`` is a clock, and ``used`` returns the processor time of the process."""

    def __init__(self, now: Callable[[], float], used: Callable[[], float]) -> None:
        self._now, self._used = now, used
        self._began, self._counted = now(), used()

    def begin(self) -> None:
        """Store the time at which a look begins."""
        self._began = self._now()

    def searching(self) -> float:
        """Return how much processor time (s) a search for causes may use after the look that has just ended."""
        looked = self._used() - self._counted
        return max(0.5 * (BEHIND - 3.0 * looked), _LEAST * looked)

    def next(self) -> float:
        """Return the earliest time of the next look, and start to count the processor time for it."""
        used = self._used()
        spent, self._counted = used - self._counted, used
        return self._began + max(EVERY, 2.0 * spent)
