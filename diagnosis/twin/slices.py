"""Work in slices: a search for causes takes long, and looks at the rig do not wait for it.

Anyone who works yields wherever it may be interrupted, at least every few tenths of a second.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from math import inf
from typing import Generic, TypeAlias, TypeVar

from bench_protocol.clock import processor_time

Found = TypeVar("Found")
#: What yields now and then, and returns what it has found.
Work: TypeAlias = Generator[None, None, Found]


class Sliced(Generic[Found]):
    """Work that goes on where it was interrupted; ``used`` shows how many s of a processor were used by now."""

    def __init__(self, work: Work[Found], used: Callable[[], float] = processor_time) -> None:
        self._work, self._used = work, used

    def go_on(self, seconds: float = inf) -> Found | None:
        """Work for so many s of a processor, and until the next place to stop; return the result at the end."""
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
    """Do all of it at once."""
    found = Sliced(work).go_on()
    assert found is not None
    return found
