"""What processes with deadlines need next to Python: compiled code that waits, sends and wakes, and functions of Linux.

`binding` compiles functions; `calls` lists the system calls that they may make, through `library`. `mutex`, `eventfd`,
`ring` (of frames), `pacing` (of a tick) and `sending` (to a socket) use these. The other modules wrap Linux and state
what replaces it elsewhere. Virtual time, reports, the diagnosis and the panel of records run on any system; a rig in
real time needs Linux.
"""

import os
import sys
from typing import Final

LINUX: Final = sys.platform == "linux"
#: Windows neither renames nor removes a file that is open.
OPEN_FILES_MOVE: Final = sys.platform != "win32"


class NeedsLinux(RuntimeError):
    """Something that only Linux can do was asked for."""


def require_linux(what: str) -> None:
    """Raise NeedsLinux, in one sentence, if ``what`` cannot be had here."""
    if not LINUX:
        raise NeedsLinux(
            f"{what} needs Linux, and this system is {sys.platform}. Use --virtual to run the same "
            "plans in virtual time; report, runs, compare and diagnose work on kept records"
        )


def processors() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def is_root() -> bool:
    """Whether this is the user who may do everything, where there is such a one."""
    return hasattr(os, "geteuid") and os.geteuid() == 0
