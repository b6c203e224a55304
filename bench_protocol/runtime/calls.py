"""Calls of the operating system and the interpreter in compiled loops: sleep, clock, mutex, eventfd.

Compiled code finds a function by the name under which its address is registered here. It can therefore be cached and
runs in any process. Addresses are plain integers. With ``NUMBA_DISABLE_JIT=1`` the same functions are called through
ctypes. Constants are those of Linux on 64 bits.
"""

import ctypes
from collections.abc import Callable
from typing import Any, Final

from llvmlite.binding import add_symbol
from numba import config, types

from bench_protocol.runtime.binding import inlined
from bench_protocol.runtime.library import c_function, interpreter_function
from bench_protocol.units import NS

_CLOCK_MONOTONIC: Final = 1
_ABSOLUTE: Final = 1  # TIMER_ABSTIME
_SECOND: Final = int(NS)
#: Limit of repetitions of a wait that signals interrupt.
_INTERRUPTIONS: Final = 100
#: 64-bit words of the work space that clock and sleep need: a struct timespec.
SPEC_WORDS: Final = 2

INT: Final = ctypes.c_int, types.int32
ADDRESS: Final = ctypes.c_ssize_t, types.intp


#: Keeps references to functions that compiled code may call.
_entered: Final[list[Any]] = []


def external(
    name: str, result: Any, *arguments: Any, find: Callable[..., Any] = c_function
) -> Callable[..., Any]:
    """Return the C function ``name``; each type is a pair, for ctypes and for numba."""
    function: Any = find(name, result[0], *(one[0] for one in arguments))
    if config.DISABLE_JIT:  # type: ignore[attr-defined]
        return function
    _entered.append(function)
    own_name = f"astb_{name}"
    add_symbol(own_name, ctypes.cast(function, ctypes.c_void_p).value)
    return types.ExternalFunction(own_name, result[1](*(one[1] for one in arguments)))


_clock_nanosleep: Final = external("clock_nanosleep", INT, INT, INT, ADDRESS, ADDRESS)
_clock_gettime: Final = external("clock_gettime", INT, INT, ADDRESS)
_write: Final = external("write", ADDRESS, INT, ADDRESS, ADDRESS)
_read: Final = external("read", ADDRESS, INT, ADDRESS, ADDRESS)
_poll: Final = external("poll", INT, ADDRESS, ADDRESS, INT)
_try_mutex: Final = external("pthread_mutex_trylock", INT, ADDRESS)
lock_mutex: Final = external("pthread_mutex_lock", INT, ADDRESS)
unlock_mutex: Final = external("pthread_mutex_unlock", INT, ADDRESS)

if config.DISABLE_JIT:  # type: ignore[attr-defined]

    def leave_interpreter() -> int:
        """Do nothing: plain Python cannot run without the interpreter."""
        return 0

    def enter_interpreter(thread: int) -> None:
        """Do nothing."""
        del thread

else:
    #: Release the interpreter for other threads; the result is the argument of `enter_interpreter`.
    leave_interpreter = external("PyEval_SaveThread", ADDRESS, find=interpreter_function)
    enter_interpreter = external(
        "PyEval_RestoreThread", (None, types.void), ADDRESS, find=interpreter_function
    )


@inlined
def lock_yielding(mutex: int) -> int:
    """Lock the mutex at address ``mutex`` from a thread that has the interpreter; return the argument ``thread`` of
    `unlock_yielding`.

    The interpreter is released while waiting, because the holder of the mutex may need it.
    """
    if _try_mutex(mutex) == 0:
        return 0
    thread = leave_interpreter()
    lock_mutex(mutex)
    return thread


@inlined
def unlock_yielding(mutex: int, thread: int) -> None:
    """Unlock the mutex and take the interpreter back, if `lock_yielding` released it. ``thread`` is the result of
    `lock_yielding`.
    """
    unlock_mutex(mutex)
    if thread != 0:
        enter_interpreter(thread)


@inlined
def now(spec: Any) -> int:
    """Return the monotonic time in ns; ``spec``: int64[2]."""
    _clock_gettime(_CLOCK_MONOTONIC, spec.ctypes.data)
    return spec[0] * _SECOND + spec[1]


@inlined
def sleep_until(deadline: int, spec: Any) -> None:
    """Return at ``deadline`` (monotonic, ns), or at once if it has passed; a signal does not shorten the sleep.
    ``spec``: int64[2].
    """
    spec[0], spec[1] = deadline // _SECOND, deadline % _SECOND
    while _clock_nanosleep(_CLOCK_MONOTONIC, _ABSOLUTE, spec.ctypes.data, 0) != 0:
        pass


@inlined
def wake(descriptor: int, one: Any) -> None:
    """Wake the reader of the eventfd ``descriptor``; ``one``: uint64[1] with a 1 in it."""
    _write(descriptor, one.ctypes.data, 8)


@inlined
def send_word(descriptor: int, place: int) -> bool:
    """Write the 8 bytes that begin at the address ``place`` to ``descriptor``; return False if no process reads any
    more.
    """
    return bool(_write(descriptor, place, 8) == 8)


@inlined
def receive_word(descriptor: int, place: int) -> bool:
    """Wait for 8 bytes from ``descriptor`` and store them from the address ``place`` on; return False if no process
    writes any more.
    """
    return bool(_read(descriptor, place, 8) == 8)


@inlined
def readable(descriptor: int, patience: int, place: int, spare: Any) -> bool:
    """Return whether input or the end of the stream comes in ``patience`` ms; ``spare[place]``: int64 work space."""
    spare[place] = descriptor | 1 << 32  # struct pollfd: the descriptor, and POLLIN
    for _ in range(_INTERRUPTIONS):
        ready = _poll(spare.ctypes.data + 8 * place, 1, patience)
        if ready >= 0:
            return bool(ready > 0)
    return False
