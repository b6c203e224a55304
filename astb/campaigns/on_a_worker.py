"""One case on a worker: prepare once, compute within a time limit, return a result in every case."""

import ctypes
import faulthandler
import os
import platform
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from pickle import loads
from typing import Any, Final

from bench_protocol.clock import RealClock
from bench_protocol.units import NS, s

#: Compiled code or a blocked call ignores the exception; after this additional time its process is ended.
GRACE: Final = 10 * s

_prepared: set[str] = set()


@dataclass(frozen=True, slots=True)
class Finished:
    """The result of a case: a value, or an error as text."""

    key: str
    value: Any  #: None if it failed
    error: str  #: "" if it succeeded
    seconds: float  #: computing time without the preparation
    worker: str = ""


class OutOfTime(BaseException):
    """The time limit of the case is reached. Not an Exception, so that a case does not catch it."""


def carry_out(key: str, packed: bytes, limit: float | None) -> Finished:
    """Return the result of a function for a case, computed within ``limit`` (s). A failure gives a result with an
    error.

    ``packed`` is the pickle of the function, the case, and a preparation or None. The preparation runs once in each
    process, and its time does not count.
    """
    clock = RealClock()
    start = clock.now()
    value, error = None, ""
    try:
        function, case, prepare = loads(packed)
        _prepare(prepare)
        start = clock.now()
        with limited(limit):
            value = function(case)
    except OutOfTime:
        error = f"stopped after its time limit of {limit:g} s"
    except BaseException as failure:  # a case that calls sys.exit must not end the worker
        error = in_words(failure)
    return Finished(key, value, error, (clock.now() - start) / NS, f"{platform.node()}:{os.getpid()}")


def in_words(error: BaseException) -> str:
    """Return type, file, line and text of an error, on one line."""
    frames = traceback.extract_tb(error.__traceback__)
    place = f" at {Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else ""
    return f"{type(error).__name__}{place}: {' '.join(str(error).split())}"


def _prepare(prepare: Callable[[], Any] | None) -> None:
    if prepare is None:
        return
    name = f"{prepare.__module__}.{prepare.__qualname__}"
    if name not in _prepared:
        prepare()
        _prepared.add(name)


@contextmanager
def limited(seconds: float | None) -> Iterator[None]:
    """Raise OutOfTime in this thread if the block lasts longer than ``seconds``. If it still does not stop, end the
    process after `GRACE`.

    The process is ended only if it computes no other case, because a process has only one such alarm.
    """
    if seconds is None:
        yield
        return
    thread, lock, over = threading.get_ident(), threading.Lock(), False

    def interrupt() -> None:
        with lock:
            if not over:
                ctypes.pythonapi.PyThreadState_SetAsyncExc(
                    ctypes.c_ulong(thread), ctypes.py_object(OutOfTime)
                )

    timer = threading.Timer(seconds, interrupt)
    timer.daemon = True
    timer.start()
    alone = _threads() == 1
    if alone:
        # It needs no interpreter, so it also ends code that never releases the GIL.
        faulthandler.dump_traceback_later(seconds + GRACE, exit=True)
    try:
        yield
    finally:
        with lock:
            over = True
        timer.cancel()
        if alone:
            faulthandler.cancel_dump_traceback_later()


def _threads() -> int:
    """Return the number of cases that this process computes at a time; 0 outside a worker."""
    from distributed import get_worker

    try:
        return int(get_worker().state.nthreads)
    except ValueError:
        return 0
