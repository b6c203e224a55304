"""Decorators that compile the functions of the model with numba. Compiled code is cached on disk, and its arithmetic
is the same as in plain Python.

With ``NUMBA_DISABLE_JIT=1`` the functions stay plain Python, for comparison.
"""

from collections.abc import Callable
from typing import Any

from bench_protocol.runtime.binding import cached


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a small function, and copy its code into its callers. It must not allocate arrays."""
    # Without numba's runtime no array is counted: counting costs five times the arithmetic of a small term.
    return _compile(function, _nrt=False, forceinline=True)


def compiled_within(function: Callable[..., Any]) -> Any:
    """Compile a helper only as a part of each of its callers. The helper calls a right-hand side.

    A separate compilation would compile the complete right-hand side once more.
    """
    return _compile(function, _nrt=False, inline="always")


def compiled_once(function: Callable[..., Any]) -> Any:
    """Compile a large function with several callers, which call it instead of copying its code.

    numba compiles it with the options of its first caller. If this caller uses `compiled`, the code is copied into it.
    """
    return _compile(function, _nrt=False)


def compiled_entry(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls. It may allocate working arrays."""
    return _compile(function)


def compiled_parallel(function: Callable[..., Any]) -> Any:
    """Compile a long calculation that runs in several threads at the same time: it releases the interpreter lock.

    The tick of the rig does not use this, because it would have to wait for the interpreter lock afterwards.
    """
    return _compile(function, nogil=True)


def _compile(function: Callable[..., Any], **options: Any) -> Any:
    return cached(function, fastmath=False, error_model="numpy", **options)
