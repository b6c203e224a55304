"""Memory that was used once goes back to the system: a diagnosis makes hundreds of megabytes of columns and drops them.

The C library keeps what is freed between what is still in use, in a heap for each thread, and asks for more elsewhere:
after a few rounds a process is half as large again as what it holds. What goes back has to be got again, page by page:
so it does where much was dropped, and not after every simulation.
"""

from __future__ import annotations

import ctypes
import sys


def give_back() -> None:
    """Return memory that is free to the system, where the C library can (glibc)."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)
