"""What every transport needs beside its wires: who receives what comes, in order and until when, and what recurs."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Final

from bench_protocol.clock import Clock, Task, every_without_late
from bench_protocol.units import NS, ms
from drivers.errors import LinkLost
from drivers.wiring.contract import OnLost, OnPoints, Refusal

#: How long signs of life go on once nobody streams set-points any more.
_PATIENCE: Final = round(500 * ms * NS)
#: How many signs of life a rig has received before it is given a first command.
LIFE_SIGNS: Final = 3


class Listener:
    """Receives what comes over a connection and hands it to its subscribers, in order and one at a time, until `close`.

    It tells the loss of the connection once. Times never go back. A subscriber that raises is a fault that nobody would
    notice in a background thread: the connection counts as lost, with the exception as the reason.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._subscribers: tuple[OnPoints, ...] = ()
        self._lock = threading.RLock()
        self._clock: Clock | None = None
        self._on_lost: OnLost = lambda reason: None
        self._last = -1  # ns, of what was received
        self._came = -1  # ns, when anything came
        self._lost = ""
        self._open = False
        self._tasks: list[Task] = []

    def open(self, clock: Clock, lost: OnLost) -> None:
        """Begin to hand on; ``lost(reason)`` is called once if the connection is lost."""
        with self._lock:
            self._clock, self._on_lost = clock, lost
            self._last, self._came, self._lost, self._open = -1, -1, "", True

    def when_lost(self, lost: OnLost) -> None:
        """Call ``lost`` from now on, at once if the connection is lost already."""
        with self._lock:
            self._on_lost = lost
            if self._lost:
                lost(self._lost)

    def subscribe(self, receive: OnPoints) -> None:
        """Call ``receive`` with all that is received from now on."""
        with self._lock:
            self._subscribers += (receive,)

    def receive(self, time: int, points: Mapping[str, float]) -> None:
        """Hand ``points`` to the subscribers, which came at ``time`` (ns of the clock)."""
        with self._lock:
            if not self._open or self._lost or self._clock is None:
                return
            self._last = max(self._last, time)
            self._came = max(self._last, self._clock.now())
            try:
                for subscriber in self._subscribers:
                    subscriber(self._last, points)
            except Exception as error:
                self.lose(f"a subscriber of {self._name} failed: {type(error).__name__}: {error}")

    def touch(self) -> None:
        """Note that something came, though nothing to hand on."""
        with self._lock:
            if self._clock is not None:
                self._came = self._clock.now()

    def lose(self, reason: str) -> None:
        """Tell that the connection is lost, unless that is known or it was closed."""
        with self._lock:
            if not self._open or self._lost:
                return
            self._lost = reason
            self._on_lost(reason)

    def check(self) -> None:
        """Raise LinkLost if the connection is lost, closed, or was never opened."""
        if self._lost:
            raise LinkLost(self._lost)
        if not self._open:
            raise LinkLost(f"{self._name} is not connected")

    def silence(self) -> float:
        """Return how long ago anything came (s); infinite before the first."""
        if self._clock is None or self._came < 0:
            return float("inf")
        return max(0.0, (self._clock.now() - self._came) / NS)

    def every(
        self,
        period: float,
        call: Callable[[], None],
        place: Callable[[Callable[[], None]], None] = lambda call: call(),
    ) -> None:
        """Call ``call`` every ``period`` s on absolute deadlines, by way of ``place``, until `close`.

        Cycles that pass while it still works are left out. What it raises would end its thread, and nobody would know:
        the connection counts as lost, with the exception as the reason.
        """
        assert self._clock is not None, "opened"

        def guarded() -> None:
            try:
                call()
            except Exception as error:
                self.lose(f"{self._name} failed: {type(error).__name__}: {error}")

        self._tasks.append(every_without_late(self._clock, round(period * NS), lambda: place(guarded)))

    @property
    def busy(self) -> bool:
        """Whether anything recurs: not before the connection stands."""
        return bool(self._tasks)

    def close(self) -> None:
        """Hand on nothing any more, also not what is just arriving, and end what recurs."""
        with self._lock:
            self._open = False
        tasks, self._tasks = self._tasks, []
        for task in tasks:  # without the lock, for which one of them may be waiting
            task.cancel()


class Grant:
    """Whether somebody commands: before, nothing goes out by itself, nor once a stream of set-points has ended."""

    def __init__(self) -> None:
        self._begun = False
        self._renewed = -1

    def begin(self) -> None:
        """Note that somebody commands from now on."""
        self._begun = True

    def renew(self, now: int) -> None:
        """Note that set-points were streamed ``now`` (ns)."""
        self._begun, self._renewed = True, now

    def given(self, now: int) -> bool:
        """Return whether signs of life may be sent ``now`` (ns)."""
        return self._begun and (self._renewed < 0 or now - self._renewed <= _PATIENCE)


class WriteBuffer:
    """The latest value of each point that waits to be written."""

    def __init__(self) -> None:
        self.refusal: Refusal | None = None  #: what the rig had against what was last drained from here
        self._lock = threading.Lock()
        self._values: dict[str, float] = {}

    def put(self, values: Mapping[str, float]) -> None:
        """Let ``values`` take the place of those that still wait."""
        with self._lock:
            self._values.update(values)

    def drain(self) -> dict[str, float]:
        """Return what waits, which then waits no more."""
        with self._lock:
            values, self._values = self._values, {}
        return values
