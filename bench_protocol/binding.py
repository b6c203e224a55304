"""Calls of compiled functions without numba's look at every argument."""

from collections.abc import Callable
from typing import Any

import numba


def bind(function: Any, *arguments: Any) -> Callable[..., Any]:
    """Return ``function`` compiled for the types of ``arguments``, to be called with such arguments only.

    Finding out anew what its arguments are costs numba up to 25 µs a call. With ``NUMBA_DISABLE_JIT=1`` there is
    nothing to bind and the plain function comes back.
    """
    if not hasattr(function, "get_overload"):
        return function
    signature = tuple(numba.typeof(argument) for argument in arguments)  # type: ignore[no-untyped-call]
    function.compile(signature)
    bound: Callable[..., Any] = function.get_overload(signature)
    return bound
