"""The one clock of the bench: whole nanoseconds and absolute deadlines, in real, scaled or virtual time.

No other module imports ``time``. A deadline is always ``start + k * period``, never "now plus a period". So a late
wake-up delays only one cycle.
"""

import contextlib
import ctypes
import heapq
import itertools
import os
import sys
import threading
import time
from collections.abc import Callable
from typing import Final, Protocol

from bench_protocol.runtime.library import c_function
from bench_protocol.units import NS

_prctl: Final = c_function("prctl", ctypes.c_int, ctypes.c_int, *(4 * [ctypes.c_ulong]))
_PR_SET_TIMERSLACK: Final = 29
#: Longest time (s) for which a computing thread may block another one (Python's default is 5 ms).
_SWITCH_INTERVAL: Final = 0.0005
_NICE: Final = -10
_GIVES_WAY: Final = 5
#: Priority of periodic callbacks, which are short: below the tick of a rig, above all computations.
_CYCLE_PRIORITY: Final = 5


class Task(Protocol):
    """A periodic callback that can be stopped."""

    def cancel(self) -> None:
        """Stop the callback; after the return it does not run (unless called from inside it)."""


class Clock(Protocol):
    """A source of time that threads can wait for."""

    def now(self) -> int:
        """Return the time in ns since the clock's origin; it never decreases."""

    def sleep_until(self, deadline: int) -> None:
        """Return at ``deadline`` (ns of this clock) or at once if it has passed."""

    def rest_until(self, first: int, last: int) -> None:
        """Return at ``first`` (ns). Virtual time may pass until ``last`` (ns) as long as no event occurs."""

    def every(self, period: int, callback: Callable[[], None]) -> Task:
        """Call ``callback`` every ``period`` ns, the first time one period from now."""


class _ThreadTask:
    """A thread that calls back on absolute deadlines."""

    def __init__(self, clock: "RealClock", period: int, callback: Callable[[], None]) -> None:
        self._stopped = threading.Event()
        self._clock, self._period, self._callback = clock, period, callback
        self._thread = threading.Thread(target=self._run, name=f"every {period / 1e6:g} ms", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        hurry(_CYCLE_PRIORITY)
        start = self._clock.now()
        for cycle in itertools.count(1):
            self._clock.sleep_until(start + cycle * self._period)
            if self._stopped.is_set():
                return
            self._callback()

    def cancel(self) -> None:
        self._stopped.set()
        if threading.current_thread() is not self._thread:
            self._thread.join()


class RealClock:
    """Monotonic time of this machine, ``scale`` times as fast as the wall clock: 2 is double speed, 0.5 half speed."""

    def __init__(self, scale: float = 1.0) -> None:
        if not 0.001 <= scale <= 1000:
            raise ValueError(f"scale = {scale:g} is outside the range of this clock; use 0.001 to 1000")
        self._scale = scale
        self._origin = time.monotonic_ns()

    def now(self) -> int:
        elapsed = time.monotonic_ns() - self._origin
        return elapsed if self._scale == 1.0 else int(elapsed * self._scale)

    def monotonic(self, instant: int) -> int:
        """Convert ``instant`` (ns of this clock) to the machine's monotonic clock (ns)."""
        return self._origin + (instant if self._scale == 1.0 else round(instant / self._scale))

    def sleep_until(self, deadline: int) -> None:
        while (remaining := deadline - self.now()) > 0:
            time.sleep(remaining / self._scale / NS)

    def rest_until(self, first: int, last: int) -> None:
        del last
        self.sleep_until(first)

    def every(self, period: int, callback: Callable[[], None]) -> Task:
        return _ThreadTask(self, period, callback)


class _VirtualTask:
    def __init__(self, period: int, callback: Callable[[], None]) -> None:
        self.period, self.callback, self.cancelled = period, callback, False

    def cancel(self) -> None:
        self.cancelled = True


class VirtualClock:
    """Time that advances only while a thread sleeps; the simulation runs in between, as fast as possible.

    ``attach`` connects the simulation. The function ``advance(until_ns)`` advances it to that time. The optional
    function ``rest(first_ns, last_ns)`` advances it to ``first``, and up to ``last`` as long as no event occurs.
    Callbacks due at the same instant run in the order in which they were registered.
    """

    def __init__(self) -> None:
        self._now = 0
        self._order = itertools.count()
        self._due: list[tuple[int, int, _VirtualTask]] = []
        self._worlds: list[Callable[[int], None]] = []
        self._rest: Callable[[int, int], None] | None = None

    def attach(self, advance: Callable[[int], None], rest: Callable[[int, int], None] | None = None) -> None:
        """Connect a simulation: call ``advance(until_ns)`` for every interval of time, or ``rest`` if more time may
        pass. With several simulations ``rest`` is not used.
        """
        self._worlds.append(advance)
        self._rest = rest if len(self._worlds) == 1 else None

    def now(self) -> int:
        return self._now

    def sleep_until(self, deadline: int) -> None:
        while self._due and self._due[0][0] <= deadline:
            due, order, task = heapq.heappop(self._due)
            if task.cancelled:
                continue
            try:
                self._pass_to(due)
                task.callback()
            except KeyboardInterrupt:  # the caller needs the task afterwards
                heapq.heappush(self._due, (due + task.period, order, task))
                raise
            if not task.cancelled:
                heapq.heappush(self._due, (due + task.period, order, task))
        self._pass_to(deadline)

    def rest_until(self, first: int, last: int) -> None:
        while self._due and self._due[0][2].cancelled:
            heapq.heappop(self._due)
        limit = min(last, self._due[0][0]) if self._due else last
        if self._rest is None or limit <= first:
            self.sleep_until(first)
            return
        self._rest(first, limit)
        self.sleep_until(self._now)  # runs the events that are due now

    def reach(self, instant: int) -> None:
        """Set the time to ``instant`` (ns). A simulation calls it if it passes several instants in one call."""
        self._now = max(self._now, instant)

    def every(self, period: int, callback: Callable[[], None]) -> Task:
        task = _VirtualTask(period, callback)
        heapq.heappush(self._due, (self._now + period, next(self._order), task))
        return task

    def _pass_to(self, instant: int) -> None:
        if instant <= self._now:
            return
        for advance in self._worlds:
            advance(instant)
        self._now = instant


def every_without_late(clock: Clock, period: int, callback: Callable[[], None]) -> Task:
    """Call ``callback`` every ``period`` ns as ``clock.every`` does, but skip calls that a stall has delayed."""
    last = clock.now()

    def cycle() -> None:
        nonlocal last
        now = clock.now()
        if now - last >= period // 2:
            last = now
            callback()

    return clock.every(period, cycle)


def wall_time_ns() -> int:
    """Return the time of day (Unix epoch, ns). Used only for time stamps of CAN frames."""
    return time.time_ns()


def utc_date() -> str:
    """Return today's date and time in UTC, ISO 8601, for the metadata of a run in real time."""
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())


def hurry(priority: int) -> None:
    """Reduce the wake-up latency of this thread as far as the machine permits.

    1 ns of timer slack, which needs no privilege, reduces the median lateness from 78 to 27 µs. Real-time scheduling
    with ``priority`` (1 to 99) keeps the lateness low under load, if the user has the permission.
    """
    _prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    with contextlib.suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))


def processor_time() -> float:
    """Return the processor time (s) that this process has used."""
    return time.process_time()


def give_way() -> None:
    """Lower the priority of this whole process below those with deadlines."""
    with contextlib.suppress(OSError, AttributeError):
        os.setpriority(os.PRIO_PROCESS, 0, _GIVES_WAY)


def hurry_process() -> None:
    """Raise the priority of this whole process, if the user has the permission, and switch threads more often.

    A punctual thread is late if another thread of its process holds the interpreter and waits for a processor.
    """
    sys.setswitchinterval(_SWITCH_INTERVAL)
    with contextlib.suppress(OSError, AttributeError):
        os.setpriority(os.PRIO_PROCESS, 0, _NICE)
