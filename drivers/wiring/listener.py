"""Common parts of all transports: ordered delivery of received points, periodic tasks, and buffers for writing."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Final

from bench_protocol.clock import Clock, Task, every_without_late
from bench_protocol.units import NS, ms
from drivers.errors import LinkLost
from drivers.wiring.contract import OnLost, OnPoints, Refusal

#: Time for which the heartbeat continues after the last streamed set-point.
_PATIENCE: Final = round(500 * ms * NS)
#: Number of heartbeats that a rig has received before its first command.
LIFE_SIGNS: Final = 3


class Listener:
    """Passes received points to the subscribers, in order and one at a time, until `close`.

    It reports the loss of the connection once. Times never decrease. An exception of a subscriber would be unnoticed
    in a background thread. The connection therefore counts as lost, with the exception as the reason.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._subscribers: tuple[OnPoints, ...] = ()
        self._lock = threading.RLock()
        self._clock: Clock | None = None
        self._on_lost: OnLost = lambda reason: None
        self._last = -1  # ns, time of the latest points
        self._came = -1  # ns, time of the latest reception
        self._lost = ""
        self._open = False
        self._tasks: list[Task] = []

    def open(self, clock: Clock, lost: OnLost) -> None:
        """Start to deliver. ``lost(reason)`` is called once if the connection is lost."""
        with self._lock:
            self._clock, self._on_lost = clock, lost
            self._last, self._came, self._lost, self._open = -1, -1, "", True

    def when_lost(self, lost: OnLost) -> None:
        """Replace the callback for a lost connection, and call it at once if the connection is lost already."""
        with self._lock:
            self._on_lost = lost
            if self._lost:
                lost(self._lost)

    def subscribe(self, receive: OnPoints) -> None:
        """Call ``receive`` with all points received from now on."""
        with self._lock:
            self._subscribers += (receive,)

    def receive(self, time: int, points: Mapping[str, float]) -> None:
        """Pass ``points``, received at ``time`` (ns of the clock), to the subscribers."""
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
        """Record the arrival of data without points."""
        with self._lock:
            if self._clock is not None:
                self._came = self._clock.now()

    def lose(self, reason: str) -> None:
        """Report the loss of the connection, unless it was reported before or the connection is closed."""
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
            raise LinkLost(f"{self._name} is not connected; connect it first")

    def silence(self) -> float:
        """Return the time (s) since anything was received; infinite before the first reception."""
        if self._clock is None or self._came < 0:
            return float("inf")
        return max(0.0, (self._clock.now() - self._came) / NS)

    def every(
        self,
        period: float,
        call: Callable[[], None],
        place: Callable[[Callable[[], None]], None] = lambda call: call(),
    ) -> None:
        """Call ``call`` every ``period`` s on absolute deadlines until `close`. ``place`` receives the call, and
        decides when it runs.

        Cycles that pass during a call are skipped. An exception would end the thread unnoticed. The connection
        therefore counts as lost, with the exception as the reason.
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
        """Whether periodic tasks exist; they are added once the connection is open."""
        return bool(self._tasks)

    def close(self) -> None:
        """Stop the delivery, also of points being received, and cancel the periodic tasks."""
        with self._lock:
            self._open = False
        tasks, self._tasks = self._tasks, []
        for task in tasks:  # without the lock, because a task may be waiting for it
            task.cancel()


class Grant:
    """Permission for periodic sending: from the first command until a stream of set-points has ended."""

    def __init__(self) -> None:
        self._begun = False
        self._renewed = -1

    def begin(self) -> None:
        """Record that commands follow from now on."""
        self._begun = True

    def renew(self, now: int) -> None:
        """Record that set-points were streamed at ``now`` (ns)."""
        self._begun, self._renewed = True, now

    def given(self, now: int) -> bool:
        """Return whether a heartbeat may be sent at ``now`` (ns)."""
        return self._begun and (self._renewed < 0 or now - self._renewed <= _PATIENCE)


class WriteBuffer:
    """The latest value of each point to be written."""

    def __init__(self) -> None:
        self.refusal: Refusal | None = None  #: rejection of the values drained last
        self._lock = threading.Lock()
        self._values: dict[str, float] = {}

    def put(self, values: Mapping[str, float]) -> None:
        """Add ``values``, which replace earlier values of the same points."""
        with self._lock:
            self._values.update(values)

    def drain(self) -> dict[str, float]:
        """Return the pending values and clear the buffer."""
        with self._lock:
            values, self._values = self._values, {}
        return values
