"""The mutex that Python locks to act between two ticks; the tick locks it without the interpreter."""

import ctypes
from typing import Final

import numpy as np

from bench_protocol.runtime.library import c_function

#: More than a pthread_mutex_t takes on any 64-bit Linux, and the alignment that it wants.
_WORDS: Final = 16
_RECURSIVE: Final = 1  # PTHREAD_MUTEX_RECURSIVE
_INHERIT: Final = 1  # PTHREAD_PRIO_INHERIT

_PLACE: Final = ctypes.c_ssize_t
_init: Final = c_function("pthread_mutex_init", ctypes.c_int, _PLACE, _PLACE)
_lock: Final = c_function("pthread_mutex_lock", ctypes.c_int, _PLACE)
_unlock: Final = c_function("pthread_mutex_unlock", ctypes.c_int, _PLACE)
_begin: Final = c_function("pthread_mutexattr_init", ctypes.c_int, _PLACE)
_set_type: Final = c_function("pthread_mutexattr_settype", ctypes.c_int, _PLACE, ctypes.c_int)
_set_protocol: Final = c_function("pthread_mutexattr_setprotocol", ctypes.c_int, _PLACE, ctypes.c_int)


class Mutex:
    """A recursive mutex at ``address``, locked by ``with`` or by compiled code.

    Its holder inherits the priority of a waiting tick: otherwise a thread with low priority could delay the tick while
    other threads use the processor.
    """

    def __init__(self) -> None:
        self._memory = np.zeros(_WORDS, np.int64)
        self.address = int(self._memory.ctypes.data)
        attributes = np.zeros(_WORDS, np.int64)
        place = int(attributes.ctypes.data)
        _begin(place)
        _set_type(place, _RECURSIVE)
        _set_protocol(place, _INHERIT)
        _init(self.address, place)

    def __enter__(self) -> None:
        _lock(self.address)

    def __exit__(self, *_: object) -> None:
        _unlock(self.address)
