"""The terminal that a person types at."""

import os
from contextlib import suppress
from typing import IO

try:
    import termios
except ImportError:  # not a Unix
    termios = None  # type: ignore[assignment]


def forget_typed(terminal: IO[str]) -> None:
    """Drop what was typed and not read yet, where the system can."""
    if termios is not None:
        with suppress(OSError, termios.error):
            termios.tcflush(terminal.fileno(), termios.TCIFLUSH)


def in_the_foreground(terminal: IO[str]) -> bool:
    """Whether what is typed comes to this process; always, where a terminal knows no jobs."""
    try:
        return not hasattr(os, "tcgetpgrp") or os.tcgetpgrp(terminal.fileno()) == os.getpgrp()
    except OSError:  # a terminal that is not this session's has no jobs, and stops nobody
        return True
