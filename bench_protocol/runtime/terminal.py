"""Functions for an interactive terminal."""

import os
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
    """Whether keyboard input goes to this process; True if the terminal has no job control."""
    try:
        return not hasattr(os, "tcgetpgrp") or os.tcgetpgrp(terminal.fileno()) == os.getpgrp()
    except OSError:  # a terminal of another session has no job control
        return True
