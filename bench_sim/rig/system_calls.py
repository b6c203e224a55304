"""The calls of the operating system and of the interpreter that the compiled tick makes: sleep, clock, lock, bell.

Compiled code finds them by their names in the running process; addresses are plain integers. With
``NUMBA_DISABLE_JIT=1`` the same functions are called through ctypes. Linux on 64 bits.
"""

import ctypes
from collections.abc import Callable
from typing import Any, Final

from numba import config, types

from bench_protocol.units import NS
from bench_sim.model.compiled import compiled

_CLOCK_MONOTONIC: Final = 1
_ABSOLUTE: Final = 1  # TIMER_ABSTIME
_SECOND: Final = int(NS)
#: 64-bit words of the work space that clock and sleep need: a struct timespec.
SPEC_WORDS: Final = 2

_INT: Final = ctypes.c_int, types.int32
_ADDRESS: Final = ctypes.c_ssize_t, types.intp


def _external(name: str, result: Any, *arguments: Any) -> Callable[..., Any]:
    """Return the C function ``name``; each type is a pair, for ctypes and for numba."""
    if not config.DISABLE_JIT:  # type: ignore[attr-defined]
        return types.ExternalFunction(name, result[1](*(one[1] for one in arguments)))
    function = getattr(ctypes.CDLL(None), name, None)
    assert function is not None, name
    function.restype, function.argtypes = result[0], [one[0] for one in arguments]
    return function


_clock_nanosleep: Final = _external("clock_nanosleep", _INT, _INT, _INT, _ADDRESS, _ADDRESS)
_clock_gettime: Final = _external("clock_gettime", _INT, _INT, _ADDRESS)
_write: Final = _external("write", _ADDRESS, _INT, _ADDRESS, _ADDRESS)
_try_mutex: Final = _external("pthread_mutex_trylock", _INT, _ADDRESS)
lock_mutex: Final = _external("pthread_mutex_lock", _INT, _ADDRESS)
unlock_mutex: Final = _external("pthread_mutex_unlock", _INT, _ADDRESS)

if config.DISABLE_JIT:  # type: ignore[attr-defined]

    def leave_interpreter() -> int:
        """Do nothing: plain Python cannot go on without the interpreter."""
        return 0

    def enter_interpreter(thread: int) -> None:
        """Do nothing."""
        del thread

else:
    #: Gives the interpreter to other threads; what it returns is for `enter_interpreter`.
    leave_interpreter = _external("PyEval_SaveThread", _ADDRESS)
    enter_interpreter = _external("PyEval_RestoreThread", (None, types.void), _ADDRESS)


@compiled
def enter_gate(gate: int) -> int:
    """Lock the mutex at address ``gate``, from a thread that has the interpreter; what it returns is for `leave_gate`.

    Whoever is in there may be waiting for the interpreter: so it is not kept by who has to wait.
    """
    if _try_mutex(gate) == 0:
        return 0
    thread = leave_interpreter()
    lock_mutex(gate)
    return thread


@compiled
def leave_gate(gate: int, thread: int) -> None:
    """Unlock the mutex and take the interpreter back, if it was let go."""
    unlock_mutex(gate)
    if thread != 0:
        enter_interpreter(thread)


@compiled
def now(spec: Any) -> int:
    """Return the monotonic time in ns; ``spec``: int64[2]."""
    _clock_gettime(_CLOCK_MONOTONIC, spec.ctypes.data)
    return spec[0] * _SECOND + spec[1]


@compiled
def sleep_until(deadline: int, spec: Any) -> None:
    """Return at ``deadline`` (monotonic, ns), or at once if it has passed; a signal does not cut it short."""
    spec[0], spec[1] = deadline // _SECOND, deadline % _SECOND
    while _clock_nanosleep(_CLOCK_MONOTONIC, _ABSOLUTE, spec.ctypes.data, 0) != 0:
        pass


@compiled
def ring_bell(descriptor: int, one: Any) -> None:
    """Wake whoever waits for the eventfd ``descriptor``; ``one``: uint64[1] with a 1 in it."""
    _write(descriptor, one.ctypes.data, 8)
