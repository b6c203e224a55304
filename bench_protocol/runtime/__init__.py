"""Functions for processes with deadlines: compiled waiting, sending and waking, and functions of Linux.

`binding` compiles functions; `calls` lists the system calls that they may make, through `library`. `mutex`, `eventfd`,
`ring` (of frames), `pacing` (of a tick) and `sending` (to a socket) use these. The other modules wrap functions of
Linux, and replace them on other systems. Virtual time, reports, the diagnosis and the panel of records run on any
system; a rig in real time needs Linux.
"""

import os
import sys
from typing import Final

LINUX: Final = sys.platform == "linux"
#: Windows neither renames nor removes a file that is open.
OPEN_FILES_MOVE: Final = sys.platform != "win32"


class NeedsLinux(RuntimeError):
    """A function was requested that needs Linux."""


def require_linux(what: str) -> None:
    """Raise NeedsLinux, with a sentence about ``what``, on other systems."""
    if not LINUX:
        raise NeedsLinux(
            f"{what} needs Linux, and this system is {sys.platform}. Use --virtual to run the same "
            "plans in virtual time; report, runs, compare and diagnose work on kept records"
        )


def processors() -> int:
    """Return the number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def is_root() -> bool:
    """Return whether the user is root; False on systems without root."""
    return hasattr(os, "geteuid") and os.geteuid() == 0
