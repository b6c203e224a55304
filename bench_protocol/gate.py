"""The gate: the lock that Python takes to act between two ticks, and the tick to run without the interpreter."""

import ctypes
from typing import Final

import numpy as np

#: More than a pthread_mutex_t takes on any 64-bit Linux, and the alignment that it wants.
_WORDS: Final = 16
_RECURSIVE: Final = 1  # PTHREAD_MUTEX_RECURSIVE
_INHERIT: Final = 1  # PTHREAD_PRIO_INHERIT

# Through CDLL, whoever waits at the gate lets go of the interpreter meanwhile.
_C: Final = ctypes.CDLL(None)


class Gate:
    """A recursive mutex at ``address``, to be entered by ``with`` or by compiled code.

    Who holds it inherits the priority of the tick that waits for it: a thread that nobody hurries must not keep the
    tick waiting while others have the processor.
    """

    def __init__(self) -> None:
        self._memory = np.zeros(_WORDS, np.int64)
        self.address = int(self._memory.ctypes.data)
        attributes = np.zeros(_WORDS, np.int64)
        place = ctypes.c_void_p(attributes.ctypes.data)
        _C.pthread_mutexattr_init(place)
        _C.pthread_mutexattr_settype(place, _RECURSIVE)
        _C.pthread_mutexattr_setprotocol(place, _INHERIT)
        _C.pthread_mutex_init(ctypes.c_void_p(self.address), place)
        self._mutex = ctypes.c_void_p(self.address)

    def __enter__(self) -> None:
        _C.pthread_mutex_lock(self._mutex)

    def __exit__(self, *_: object) -> None:
        _C.pthread_mutex_unlock(self._mutex)
