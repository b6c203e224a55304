"""A rig that knows nothing of our table, as points of transports in memory: for the tests of a described wiring."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from bench_protocol.clock import Clock, Task
from drivers.errors import LinkLost, WiringError
from drivers.wiring.contract import Refusal, Transport


class PointsInMemory(Transport):
    """A ``Transport`` whose far end is a mapping of numbers; writes call ``react``."""

    def __init__(self, points: dict[str, float], every: float = 0.05, asked: Sequence[str] = ()) -> None:
        self.points, self._period, self.asked = points, every, set(asked)
        self.writes: list[dict[str, float]] = []
        self.streams: list[tuple[int, dict[str, float]]] = []
        self.react: Callable[[str, float], None] = lambda point, number: None
        self.locked: set[str] = set()  # what cannot be written
        self.silent = self.refusing = False
        self.connections = 0
        self._receive: Callable[[int, Mapping[str, float]], None] | None = None
        self._lost: Callable[[str], None] | None = None
        self._clock: Clock | None = None
        self._task: Task | None = None
        self._heard = -1

    refusal: Refusal | None = None

    @property
    def period(self) -> float:
        return self._period

    def require(self, name: str, *, writable: bool = False) -> None:
        if name not in self.points:
            raise WiringError(f"there is no point {name!r}")
        if writable and name in self.locked:
            raise WiringError(f"{name} can only be read")

    def stale(self, name: str) -> float:
        return 0.0 if name in self.asked else 3 * self.period

    def connect(self, clock: Clock, lost: Callable[[str], None], *, within: float) -> None:
        if self.refusing:
            raise LinkLost(f"nobody answers within {within:g} s")
        self._clock, self._lost = clock, lost
        self.connections += 1
        self._task = clock.every(round(self.period * 1e9), self.publish)

    def subscribe(self, receive: Callable[[int, Mapping[str, float]], None]) -> None:
        self._receive = receive

    def publish(self, *names: str) -> None:
        """Let points come now: the named ones, or all that come by themselves."""
        assert self._clock is not None
        if self.silent or self._receive is None:
            return
        self._heard = self._clock.now()
        told = names or [name for name in self.points if name not in self.asked]
        self._receive(self._heard, {name: self.points[name] for name in told})

    def read(self, names: Sequence[str]) -> dict[str, float]:
        if self.silent:
            raise LinkLost("no answer")
        return {name: self.points[name] for name in names}

    def write(self, points: Mapping[str, float]) -> None:
        self.writes.append(dict(points))
        for point, number in points.items():
            self.points[point] = number
            self.react(point, number)

    def stream(self, points: Mapping[str, float], time: int) -> None:
        self.streams.append((time, dict(points)))
        self.points.update(points)

    def alive(self) -> float:
        assert self._clock is not None
        return math.inf if self._heard < 0 else (self._clock.now() - self._heard) / 1e9

    def lose(self, reason: str) -> None:
        """Cut the connection."""
        assert self._lost is not None
        self._lost(reason)

    def close(self) -> None:
        if self._task is not None:
            self.connections -= 1
            self._task.cancel()
            self._task = self._receive = None
