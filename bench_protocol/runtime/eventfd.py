"""An eventfd: compiled code writes to it, and a loop of events wakes."""

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
    """Wake whoever waits for it, from Python."""
    os.eventfd_write(eventfd, 1)


def clear(eventfd: int) -> None:
    """Let it wake nobody any more; BlockingIOError if nobody had written to it."""
    os.eventfd_read(eventfd)
