"""An eventfd, by which compiled code wakes an event loop."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from bench_protocol.runtime import require_linux


@contextmanager
def open_eventfd() -> Iterator[int]:
    """Yield an eventfd, closed when the block ends."""
    require_linux("a rig in real time")
    eventfd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
    try:
        yield eventfd
    finally:
        os.close(eventfd)


def wake(eventfd: int) -> None:
    """Wake the reader of the eventfd, from Python."""
    os.eventfd_write(eventfd, 1)


def clear(eventfd: int) -> None:
    """Reset the eventfd. Raises BlockingIOError if it was not written to."""
    os.eventfd_read(eventfd)
