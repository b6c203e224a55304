"""Return unused memory to the system: a diagnosis allocates and drops hundreds of megabytes of columns.

The C library keeps freed memory between used blocks, in a heap per thread, and requests new memory elsewhere. After a
few rounds a process uses 1.5 times the size of its data. So columns have separate pages, which are freed with them
(`room`), and all threads share one heap (`share_heap`). Free memory is returned only after much was freed
(`give_back`), because new allocation costs time. Memory that Arrow keeps after reading files is returned too: 150 MB
for a record of seven minutes.
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
    """Return an array of zeros. A large array has its own memory pages: they use no memory until written, and are freed
    with the array.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if not _has_own_pages(size):
        return np.zeros(shape, dtype)
    return np.frombuffer(mmap.mmap(-1, size, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS), dtype).reshape(shape)


def first_rows(values: NDArray[np.floating], count: int) -> NDArray[np.floating]:
    """Return the first ``count`` rows of an array (m, n) of `room`. The pages of the other rows are freed."""
    kept = values[:count]
    start = -(-(values.ctypes.data + kept.nbytes) // mmap.PAGESIZE) * mmap.PAGESIZE
    size = (values.ctypes.data + values.nbytes - start) // mmap.PAGESIZE * mmap.PAGESIZE
    if _has_own_pages(values.nbytes) and size > 0:
        _call("madvise", ctypes.c_void_p(start), ctypes.c_size_t(size), mmap.MADV_DONTNEED)
    return kept


def _has_own_pages(size: int) -> bool:
    return sys.platform == "linux" and size >= OWN_PAGES * mmap.PAGESIZE


def share_heap() -> None:
    """Let threads that start from now on share one heap, if the C library supports this (glibc)."""
    largest_number_of_heaps = -8  # M_ARENA_MAX of malloc.h
    _call("mallopt", largest_number_of_heaps, 1)


def give_back() -> None:
    """Return free memory to the system, if the C library supports this (glibc), and unused memory of Arrow."""
    _call("malloc_trim", 0)
    if arrow := sys.modules.get("pyarrow"):
        arrow.default_memory_pool().release_unused()


def _call(function: str, *arguments: Any) -> None:
    """Call a function of the C library if it exists."""
    found = getattr(ctypes.CDLL(None), function, None) if sys.platform == "linux" else None
    if found is not None:
        found(*arguments)
