"""How functions are compiled and called: a cache that knows all sources, calls without a look at every argument."""

import os
import pickle
import re
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

import numba
import numpy as np

from bench_protocol.runtime.file_locks import hold
from bench_protocol.runtime.sources import digest_of

#: Said once where an installation is not ours to write to, and the user has no folder for caches either.
NOT_KEPT: Final = (
    "compiled functions cannot be kept, as neither this installation nor your folder for caches can be written to: "
    "every start compiles for a minute; NUMBA_CACHE_DIR may name a folder that can be"
)
#: Beside the cached functions of a package: who saves or loads one holds it locked.
LOCK: Final = "astb.lock"
#: The line on which a function begins, in numba's names of files.
_LINE: Final = re.compile(r"-\d+(?=\.py\d)")
#: What reading a cache raises that holds what is no longer there, or half of it.
UNREADABLE: Final = (
    pickle.UnpicklingError,
    AttributeError,
    ImportError,
    IndexError,
    EOFError,
    TypeError,
    ValueError,
)


def cached(function: Callable[..., Any], **options: Any) -> Any:
    """Return ``function`` compiled when it is first called, and kept for other processes while its sources stay.

    numba's cache looks at the file of the outermost function only, and would use yesterday's orifice in today's
    kernel. `digest_of` covers all sources. Files are named without the line on which a function begins.
    """
    try:
        dispatcher = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # numba finds neither a place beside the function nor one of the user's own
        warnings.warn(NOT_KEPT, RuntimeWarning, stacklevel=2)
        return numba.njit(**options)(function)
    if (cache_file := _cache_file(dispatcher)) is not None:
        take_turns(cache_file)
        if (digest := digest_of(function.__module__)) is not None:
            cache_file._source_stamp = digest
            cache_file._index_name = _LINE.sub("", cache_file._index_name)
            cache_file._index_path = _LINE.sub("", cache_file._index_path)
            cache_file._data_name_pattern = _LINE.sub("", cache_file._data_name_pattern)
    return dispatcher


def inlined(function: Callable[..., Any]) -> Any:
    """Compile ``function`` and copy it into its callers, without numba's runtime: it must not make arrays."""
    return cached(function, forceinline=True, _nrt=False)


def folder_of(function: Any) -> str:
    """Return the folder in which a compiled function is kept; "" where it is not."""
    return str(getattr(_cache_file(function), "_cache_path", ""))


def _cache_file(dispatcher: Any) -> Any:
    """Return where numba keeps what it has compiled; None in plain Python."""
    return getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)


def take_turns(cache_file: Any) -> None:
    """Let one process at a time save or load what it compiled.

    numba first writes into its index where a function will lie, and then the function: two processes that compile at
    once may choose one place for two functions, and one that loads meanwhile finds there what yesterday's sources made.
    """
    place = f"{cache_file._cache_path}/{LOCK}"
    load = cache_file.load

    def in_turn(act: Callable[..., Any]) -> Callable[..., Any]:
        def acted(*given: Any) -> Any:
            lock = os.open(place, os.O_RDONLY | os.O_CREAT, 0o666)
            try:
                hold(lock, wait=True)
                return act(*given)
            finally:
                os.close(lock)

        return acted

    cache_file.save = in_turn(cache_file.save)
    cache_file.load = in_turn(lambda key: _load(cache_file, load, key))


def _load(cache_file: Any, load: Callable[[Any], Any], key: Any) -> Any:
    """Return what is kept under ``key``; None, and an empty cache, where it cannot be read.

    numba reads the whole index before it looks whether the sources are still the same: one that names a class of
    last week's release, which has another name today, would stop everything after an update.
    """
    try:
        return load(key)
    except UNREADABLE:
        cache_file.flush()
        return None


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
    the modules is Python's way to say that there is none; afterwards scipy can be imported as ever. Other threads may
    import it meanwhile, so that it is only kept away where there are none.
    """
    name = "scipy.linalg.cython_blas"
    if name in sys.modules or threading.active_count() > 1:
        yield
        return
    sys.modules[name] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        del sys.modules[name]
