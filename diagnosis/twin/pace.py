"""How often a twin looks, and how long it searches for causes between: half of a processor at most, and 2 s behind.

Theory of operation
-------------------
A look that begins at t covers the samples received by t. The next one begins no sooner than at t + 2 u, where u is the
processor time since the start of the look before. So the twin uses half of a processor at most. The result of a look is
replaced when the next one ends, at t + 2 u + l with l for that look. So the search between the two may last as long as
2 (l + s) + l stays below what a twin may be behind. A search is interrupted where it can be, some tenths of a second
later than it should: the aim is lower.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

#: A look comes so many s after the last one began at the earliest.
EVERY: Final = 0.5
#: Greatest delay (s) of the next look by a search: 2 s minus the time until a search can be interrupted.
BEHIND: Final = 1.4
#: A search gets so much of what a look takes at least, or nothing would ever come of it.
_LEAST: Final = 0.25


class Pace:
    """The pace of one twin from now on; ``now`` is a clock, ``used`` what its process has used of processors by now."""

    def __init__(self, now: Callable[[], float], used: Callable[[], float]) -> None:
        self._now, self._used = now, used
        self._began, self._counted = now(), used()

    def begin(self) -> None:
        """A look begins."""
        self._began = self._now()

    def searching(self) -> float:
        """Return for how many s of a processor causes may be looked for after the look that has just ended."""
        looked = self._used() - self._counted
        return max(0.5 * (BEHIND - 3.0 * looked), _LEAST * looked)

    def next(self) -> float:
        """Return when the next look may begin; processor time used from now on counts for that look."""
        used = self._used()
        spent, self._counted = used - self._counted, used
        return self._began + max(EVERY, 2.0 * spent)
