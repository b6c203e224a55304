"""Compilation of the model's functions: before use, cached, with the same arithmetic as in plain Python.

With ``NUMBA_DISABLE_JIT=1`` functions stay plain Python: the same equations, for comparison.
"""

from collections.abc import Callable
from typing import Any

from bench_protocol.runtime.binding import cached


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a term or a helper, and copy it into its callers. It must not allocate arrays."""
    # Without numba's runtime no array is counted: counting costs five times the arithmetic of a small term.
    return _compile(function, _nrt=False, forceinline=True)


def compiled_within(function: Callable[..., Any]) -> Any:
    """Compile a helper around a right-hand side, only as a part of each of its callers.

    A separate compilation would compile everything in the right-hand side once more.
    """
    return _compile(function, _nrt=False, inline="always")


def compiled_once(function: Callable[..., Any]) -> Any:
    """Compile a large function with several callers, which is called, not copied.

    numba compiles it with the options of its first caller. If that caller is `compiled`, the function is copied into
    it.
    """
    return _compile(function, _nrt=False)


def compiled_entry(function: Callable[..., Any]) -> Any:
    """Compile one of the few functions that allocate working arrays and call the others."""
    return _compile(function)


def compiled_parallel(function: Callable[..., Any]) -> Any:
    """Compile a long calculation that several threads run at once, without the interpreter lock.

    The rig's tick does not use this, because it would have to wait to get the interpreter lock back.
    """
    return _compile(function, nogil=True)


def _compile(function: Callable[..., Any], **options: Any) -> Any:
    return cached(function, fastmath=False, error_model="numpy", **options)
