"""Memory that was used once goes back to the system: a diagnosis makes hundreds of megabytes of columns and drops them.

The C library keeps freed memory between used blocks, in a heap for each thread, and requests new memory elsewhere:
after a few rounds a process is half as large again as its data. So columns have separate pages (`room`), which go with
them, and all threads share one heap (`share_heap`). Free memory is returned where much was dropped (`give_back`), and
not after every simulation, because it must be allocated again, page by page. Memory that Arrow keeps of read files is
returned too: 150 MB for a record of seven minutes.
"""

from __future__ import annotations

import ctypes
import math
import mmap
import sys
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from diagnosis.engine.config import OWN_PAGES


def room(shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> NDArray[np.floating]:
    """Return zeros, those of a large array in pages that go back with it, and that take nothing until written to."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if not _has_own_pages(size):
        return np.zeros(shape, dtype)
    return np.frombuffer(mmap.mmap(-1, size, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS), dtype).reshape(shape)


def first_rows(values: NDArray[np.floating], count: int) -> NDArray[np.floating]:
    """Return so many rows of what `room` gave (m, n); the pages of the others go back, whatever is in them."""
    kept = values[:count]
    start = -(-(values.ctypes.data + kept.nbytes) // mmap.PAGESIZE) * mmap.PAGESIZE
    size = (values.ctypes.data + values.nbytes - start) // mmap.PAGESIZE * mmap.PAGESIZE
    if _has_own_pages(values.nbytes) and size > 0:
        _call("madvise", ctypes.c_void_p(start), ctypes.c_size_t(size), mmap.MADV_DONTNEED)
    return kept


def _has_own_pages(size: int) -> bool:
    return sys.platform == "linux" and size >= OWN_PAGES * mmap.PAGESIZE


def share_heap() -> None:
    """Let threads that begin from now on share one heap, where the C library can (glibc)."""
    largest_number_of_heaps = -8  # M_ARENA_MAX of malloc.h
    _call("mallopt", largest_number_of_heaps, 1)


def give_back() -> None:
    """Return memory that is free to the system, where the C library can (glibc), and what Arrow keeps if it is used."""
    _call("malloc_trim", 0)
    if arrow := sys.modules.get("pyarrow"):
        arrow.default_memory_pool().release_unused()


def _call(function: str, *arguments: Any) -> None:
    """Call a function of the C library, if it has that."""
    found = getattr(ctypes.CDLL(None), function, None) if sys.platform == "linux" else None
    if found is not None:
        found(*arguments)
