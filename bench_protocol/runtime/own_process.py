"""Functions for this process and its terminal: keyboard input, signals, threads of linear algebra."""

import os
import signal
from contextlib import suppress
from typing import IO

try:
    import termios
except ImportError:  # not a Unix
    termios = None  # type: ignore[assignment]


def forget_typed(terminal: IO[str]) -> None:
    """Discard pending keyboard input, if the system supports it."""
    if termios is not None:
        with suppress(OSError, termios.error):
            termios.tcflush(terminal.fileno(), termios.TCIFLUSH)


def in_the_foreground(terminal: IO[str]) -> bool:
    """Return whether keyboard input goes to this process; True if the terminal has no job control."""
    try:
        return not hasattr(os, "tcgetpgrp") or os.tcgetpgrp(terminal.fileno()) == os.getpgrp()
    except OSError:  # a terminal of another session has no job control
        return True


def keep_algebra_to_one_core() -> None:
    """Limit numpy to one core, unless OPENBLAS_NUM_THREADS is set; must be called before numpy is loaded.

    On a machine with other work, two threads of OpenBLAS wait for each other: a product takes fifty times as long.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def available_signals(*names: str) -> list[signal.Signals]:
    """Return the signals among ``names`` that exist on this system; Windows has only a few."""
    return [getattr(signal, name) for name in names if hasattr(signal, name)]
