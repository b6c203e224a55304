"""Compilation and calls of functions: a cache that is renewed if any of their sources changes, and calls without type
checks.
"""

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

#: Printed once if neither the installation nor a cache folder of the user is writable.
NOT_KEPT: Final = (
    "compiled functions cannot be kept, because neither the installation nor your cache folder is "
    "writable. Every start takes about a minute longer. Set NUMBA_CACHE_DIR to a writable folder"
)
#: File in the cache folder of a package, locked while a function is saved or loaded.
LOCK: Final = "astb.lock"
#: The line number of a function in numba's file names.
_LINE: Final = re.compile(r"-\d+(?=\.py\d)")
#: Errors of loading from a cache with outdated or incomplete content.
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
    """Return ``function``, compiled at its first call, and cached for other processes until its sources change.

    numba's cache checks only the file of the outermost function, and would use an outdated inner function.
    `digest_of` covers all sources. File names do not contain the line number of a function.
    """
    try:
        dispatcher = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # numba finds no writable cache folder
        warnings.warn(NOT_KEPT, RuntimeWarning, stacklevel=2)
        return numba.njit(**options)(function)
    if (cache_file := _cache_file(dispatcher)) is not None:
        lock_cache(cache_file)
        if (digest := digest_of(function.__module__)) is not None:
            cache_file._source_stamp = digest
            cache_file._index_name = _LINE.sub("", cache_file._index_name)
            cache_file._index_path = _LINE.sub("", cache_file._index_path)
            cache_file._data_name_pattern = _LINE.sub("", cache_file._data_name_pattern)
    return dispatcher


def inlined(function: Callable[..., Any]) -> Any:
    """Compile ``function`` and copy it into its callers, without numba's runtime: it must not create arrays."""
    return cached(function, forceinline=True, _nrt=False)


def folder_of(function: Any) -> str:
    """Return the folder in which a compiled function is cached; "" if it is not."""
    return str(getattr(_cache_file(function), "_cache_path", ""))


def _cache_file(dispatcher: Any) -> Any:
    """Return numba's cache file of a compiled function; None in plain Python."""
    return getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)


def lock_cache(cache_file: Any) -> None:
    """Allow one process at a time to save or load compiled functions.

    numba first writes the place of a function into its index, and then the function. Without the lock, two processes
    may choose the same place for two functions, and a process that loads may get an outdated function.
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
    """Return the cached function for ``key``. If the cache cannot be read, clear it and return None.

    numba reads the whole index before it compares the sources. An index that names a class of an earlier release,
    since renamed, would raise an error after every update.
    """
    try:
        return load(key)
    except UNREADABLE:
        cache_file.flush()
        return None


def bind(function: Any, *arguments: Any) -> Callable[..., Any]:
    """Return ``function`` compiled for the types of ``arguments``, to be called with arguments of these types only.

    numba's check of the types takes up to 25 µs a call. With ``NUMBA_DISABLE_JIT=1`` the plain function is returned. It
    receives record arrays whose fields are attributes, as in compiled code.
    """
    if not hasattr(function, "get_overload"):
        return lambda *given: function(*(_with_attributes(argument) for argument in given))
    signature = tuple(numba.typeof(argument) for argument in arguments)  # type: ignore[no-untyped-call]
    with _without_linear_algebra():
        function.compile(signature)
    bound: Callable[..., Any] = function.get_overload(signature)
    return bound


def _with_attributes(argument: Any) -> Any:
    """Return ``argument`` with its record arrays, also in named tuples, as arrays with attributes on the same
    memory.
    """
    if isinstance(argument, tuple):
        return type(argument)(*(_with_attributes(part) for part in argument))
    if isinstance(argument, np.ndarray) and argument.dtype.names:
        return argument.view(np.recarray)
    return argument


@contextmanager
def _without_linear_algebra() -> Iterator[None]:
    """Start numba without scipy's BLAS, which it imports for products of matrices and which takes 0.15 s.

    No compiled function here multiplies matrices; the compilation of one that does would fail. ``None`` in
    ``sys.modules`` marks a module as missing; scipy can be imported afterwards. Other threads may import it at the same
    time. The module is therefore hidden only if there are no other threads.
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
