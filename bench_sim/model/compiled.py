"""How the model's functions are compiled: ahead of use, cached, with the arithmetic of the plain-Python twin.

With ``NUMBA_DISABLE_JIT=1`` functions stay plain Python: the same equations, the model's oracle.
"""

from collections.abc import Callable
from typing import Any

from bench_protocol.runtime.binding import cached


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a term or a helper, and copy it into its callers; it must not make arrays."""
    # Without numba's runtime no array is counted: counting costs five times the arithmetic of a small term.
    return _compile(function, _nrt=False, forceinline=True)


def compiled_within(function: Callable[..., Any]) -> Any:
    """As `compiled`, for a helper around a right-hand side: compiled only as a part of each of its callers.

    On its own it would be compiled with everything that the right-hand side contains, and that once more.
    """
    return _compile(function, _nrt=False, inline="always")


def compiled_once(function: Callable[..., Any]) -> Any:
    """As `compiled`, for large functions with several callers: compiled once and called, not copied.

    numba compiles it with the options of its first caller. If that caller is `compiled`, the function is copied into
    it.
    """
    return _compile(function, _nrt=False)


def compiled_entry(function: Callable[..., Any]) -> Any:
    """As `compiled`, for the few functions that make their own working arrays and call the others."""
    return _compile(function)


def compiled_parallel(function: Callable[..., Any]) -> Any:
    """As `compiled_entry`, for long calculations that several threads do at once: Python goes on meanwhile.

    The rig's tick is not one: to get Python back it would have to wait for anyone who has it then.
    """
    return _compile(function, nogil=True)


def _compile(function: Callable[..., Any], **options: Any) -> Any:
    return cached(function, fastmath=False, error_model="numpy", **options)
