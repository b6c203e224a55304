"""Work in slices, so that looks at the rig do not wait for a long search for causes.

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
    """Work that continues where it was interrupted; ``used`` returns the processor time (s)."""

    def __init__(self, work: Work[Found], used: Callable[[], float] = processor_time) -> None:
        self._work, self._used = work, used

    def go_on(self, seconds: float = inf) -> Found | None:
        """Work for ``seconds`` of processor time and until the next yield; return the result if the work has ended."""
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
    """Do all of the work at once and return its result."""
    found = Sliced(work).go_on()
    assert found is not None
    return found
