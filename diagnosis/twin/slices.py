"""Long work in slices, so that a long search for causes does not delay the judgement of new samples.

Work is a generator that yields wherever it may be interrupted, at least every few tenths of a second.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from math import inf
from typing import Generic, TypeAlias, TypeVar

from bench_protocol.clock import processor_time

Found = TypeVar("Found")
#: A generator that yields now and then, and returns its result.
Work: TypeAlias = Generator[None, None, Found]


class Sliced(Generic[Found]):
    """Work that can be interrupted and continued. ``used`` returns the processor time (s)."""

    def __init__(self, work: Work[Found], used: Callable[[], float] = processor_time) -> None:
        self._work, self._used = work, used

    def go_on(self, seconds: float = inf) -> Found | None:
        """Continue the work for ``seconds`` of processor time, then until the next yield. Return the result if the work
        has ended, else None.
        """
        began = self._used()
        try:
            while True:
                next(self._work)
                if self._used() - began >= seconds:
                    return None
        except StopIteration as end:
            found: Found = end.value
            return found


def finished(work: Work[Found]) -> Found:
    """Do all of the work without interruption, and return its result."""
    found = Sliced(work).go_on()
    assert found is not None
    return found
