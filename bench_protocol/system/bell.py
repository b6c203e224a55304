"""The bell: an eventfd that compiled code rings and a loop of events hears."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from bench_protocol.system import require_linux


@contextmanager
def open_bell() -> Iterator[int]:
    """Yield a bell, closed when the block ends."""
    require_linux("a rig in real time")
    bell = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
    try:
        yield bell
    finally:
        os.close(bell)


def ring(bell: int) -> None:
    """Ring it from Python."""
    os.eventfd_write(bell, 1)


def answer(bell: int) -> None:
    """Take note that it rang; BlockingIOError if it did not."""
    os.eventfd_read(bell)
