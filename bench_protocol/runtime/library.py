"""The C library of this process, and replacements of its functions on systems other than Linux.

Compiled code cannot be loaded if one of the functions that it names is missing. In virtual time it calls only those
of the mutex.
"""

import ctypes
import threading
from collections.abc import Callable
from typing import Any, Final

from bench_protocol.runtime import LINUX

_C: Final = ctypes.CDLL(None) if LINUX else None
_locks: Final[dict[int, threading.RLock]] = {}


def _new(address: int, *_: int) -> int:
    _locks[address] = threading.RLock()
    return 0


def _lock(address: int) -> int:
    _locks[address].acquire()
    return 0


def _try_lock(address: int) -> int:
    return 0 if _locks[address].acquire(blocking=False) else 1


def _unlock(address: int) -> int:
    _locks[address].release()
    return 0


def _return_zero(*_: int) -> int:
    return 0


_STAND_INS: Final[dict[str, Callable[..., int]]] = {
    "pthread_mutex_init": _new,
    "pthread_mutex_lock": _lock,
    "pthread_mutex_trylock": _try_lock,
    "pthread_mutex_unlock": _unlock,
}


def c_function(name: str, result: Any, *arguments: Any) -> Any:
    """Return the function ``name``, to be called from Python or, by its address, from compiled code.

    A call releases the interpreter while it waits. On systems other than Linux, a lock of Python replaces a mutex,
    and a function that returns 0 replaces any other.
    """
    if _C is None:
        return ctypes.CFUNCTYPE(result, *arguments)(_STAND_INS.get(name, _return_zero))
    function = _C[name]  # a new object each time, so that the types of other users are not changed
    function.restype, function.argtypes = result, arguments
    return function


def interpreter_function(name: str, result: Any, *arguments: Any) -> Any:
    """Return a function of Python's C interface, as `c_function` does."""
    function = ctypes.pythonapi[name]
    function.restype, function.argtypes = result, arguments
    return function
