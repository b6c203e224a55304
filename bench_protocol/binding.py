"""How functions are compiled and called: a cache that knows all sources, calls without a look at every argument."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numba
import numpy as np


def cached(function: Callable[..., Any], digest: str, **options: Any) -> Any:
    """Return ``function`` compiled when it is first called, and cached as long as ``digest`` stays.

    numba's cache looks at the file of the outermost function only and would run yesterday's orifice in today's
    kernel: ``digest`` is that of all sources which the function may contain.
    """
    dispatcher = numba.njit(cache=True, **options)(function)
    cache_file = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    if cache_file is not None:
        cache_file._source_stamp = (cache_file._source_stamp, digest)
    return dispatcher


def inlined(function: Callable[..., Any]) -> Any:
    """Compile ``function`` and copy it into its callers, without numba's runtime: it must not make arrays."""
    options: dict[str, Any] = {"_nrt": False}
    return numba.njit(cache=True, forceinline=True, **options)(function)


def bind(function: Any, *arguments: Any) -> Callable[..., Any]:
    """Return ``function`` compiled for the types of ``arguments``, to be called with such arguments only.

    Finding out anew what its arguments are costs numba up to 25 µs a call. With ``NUMBA_DISABLE_JIT=1`` there is
    nothing to bind: the plain function comes back, and sees records whose fields are attributes, as in compiled code.
    """
    if not hasattr(function, "get_overload"):
        return lambda *given: function(*(_with_attributes(argument) for argument in given))
    signature = tuple(numba.typeof(argument) for argument in arguments)  # type: ignore[no-untyped-call]
    with _without_linear_algebra():
        function.compile(signature)
    bound: Callable[..., Any] = function.get_overload(signature)
    return bound


def _with_attributes(argument: Any) -> Any:
    """Return ``argument`` with its arrays of records, in named tuples too, as record arrays of the same memory."""
    if isinstance(argument, tuple):
        return type(argument)(*(_with_attributes(part) for part in argument))
    if isinstance(argument, np.ndarray) and argument.dtype.names:
        return argument.view(np.recarray)
    return argument


@contextmanager
def _without_linear_algebra() -> Iterator[None]:
    """Let numba start without scipy's BLAS, which it imports in advance for products of matrices: 0.15 s.

    No compiled function here multiplies matrices; one that did would be refused when it is compiled. A ``None`` among
    the modules is Python's way to say that there is none; afterwards scipy can be imported as ever.
    """
    name = "scipy.linalg.cython_blas"
    if name in sys.modules:
        yield
        return
    sys.modules[name] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        del sys.modules[name]
