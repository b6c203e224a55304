"""The commander: streams the protected command messages at 50 Hz and moves set-points along ramps meanwhile."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench_protocol.clock import Clock, Task
from bench_protocol.messages import TOKEN
from bench_protocol.rates import COMMAND_RATE
from bench_protocol.signals import Kind
from bench_protocol.units import NS
from bench_protocol.wires import Table
from drivers.errors import LinkLost, Misuse

if TYPE_CHECKING:
    from drivers.can_port import CanPort

BEAT: Final = round(NS / COMMAND_RATE)  # ns


@dataclass(slots=True)
class _Ramp:
    """A set-point on its way: ``start + k * step`` after ``k`` beats, and exactly ``end`` at last."""

    start: float
    end: float
    step: float  # SI per beat, with its sign
    beats: int = 0

    def advance(self) -> tuple[float, bool]:
        """Return the value of the next beat and whether it is the last."""
        self.beats += 1
        value = self.start + self.beats * self.step
        done = (value - self.end) * math.copysign(1.0, self.step) >= 0
        return (self.end if done else value), done


class Commander:
    """Holds all set-points and sends them, one block per beat, from ``start`` to ``stop``.

    Thread-safe. A set-point nobody has given yet travels as "not available". When sending fails, ``failure`` keeps
    the reason and the stream ends: the rig's watchdog then does what is right.
    """

    def __init__(self, table: Table, clock: Clock, port: CanPort) -> None:
        from bench_protocol.can_codec import Encoder

        self._table, self._clock, self._port = table, clock, port
        self._encoder = Encoder(table)
        commands = [message.name for message in table.messages if not message.from_rig and message.rate]
        self._rows = self._encoder.rows(commands)
        self._values = np.full(len(table.signals), np.nan)
        for signal in table.of_kind(Kind.SETPOINT):
            if signal.choices:
                self._values[table.index[signal.name]] = 0.0
        self._ramps: dict[int, _Ramp] = {}
        self._lock = threading.Lock()
        self._task: Task | None = None
        self.origin = clock.now()  #: beats are at ``origin + k * BEAT``
        self.beats = 0  #: blocks sent
        self.failure: LinkLost | None = None

    def bear(self, token: int) -> None:
        """Let all that is sent from now on be that of the holder with ``token``."""
        with self._lock:
            self._values[self._table.index[TOKEN]] = token
            self._encoder.bind(token)

    def start(self) -> None:
        """Begin to stream; the first block goes one beat from now."""
        if self._task is None:
            self.failure = None
            self.origin = self._clock.now()
            self._task = self._clock.every(BEAT, self._beat)

    def stop(self) -> None:
        """End the stream; nothing is sent after this has returned."""
        if self._task is not None:
            self._task.cancel()
            self._task = None

    def next_beat(self) -> int:
        """Return when the next block goes out (ns)."""
        now = self._clock.now()
        return now + BEAT - (now - self.origin) % BEAT

    def value(self, name: str) -> float:
        """Return the set-point that the next block will carry at the latest; NaN if none was given."""
        row = self._row(name)
        with self._lock:
            return float(self._values[row])

    def set(self, name: str, value: float) -> None:
        """Let ``name`` be ``value`` from the next beat on; ValueError if the wire cannot carry it."""
        self.set_all({name: value})

    def set_all(self, values: Mapping[str, float]) -> None:
        """Let all ``values`` hold from the next beat on, together; ValueError, and no change, if one does not fit."""
        checked = {self._row(name): self._table[name].check(float(value)) for name, value in values.items()}
        with self._lock:
            for row, value in checked.items():
                self._ramps.pop(row, None)
                self._values[row] = value

    def ramp(self, name: str, to: float, rate: float) -> float:
        """Move ``name`` to ``to`` with ``rate`` (SI per second, positive); return how long it takes (s)."""
        return self.ramp_all({name: to}, rate)

    def ramp_all(self, targets: Mapping[str, float], rate: float) -> float:
        """Start ramps on the same beat, each with ``rate`` (SI/s); return how long the longest takes (s)."""
        if not (rate > 0 and math.isfinite(rate)):
            raise ValueError(f"rate = {rate:g} per second is not a pace to move at; it must be positive")
        checked = {name: self._table[name].check(float(to)) for name, to in targets.items()}
        longest = 0
        with self._lock:
            ramps = {}
            for name, to in checked.items():
                row = self._row(name)
                start = float(self._values[row])
                if math.isnan(start):
                    raise Misuse(
                        f"{name} has no value yet to start a ramp from; arm the bench, or set it first"
                    )
                step = math.copysign(rate * BEAT / NS, to - start)
                ramps[row] = _Ramp(start, to, step)
                longest = max(longest, math.ceil(abs(to - start) / abs(step)))
            self._ramps.update(ramps)
        return longest * BEAT / NS

    def moving(self, *names: str) -> bool:
        """Return whether one of the set-points (any, without names) is still on its ramp."""
        with self._lock:
            return bool(self._ramps) if not names else any(self._row(name) in self._ramps for name in names)

    def freeze(self) -> None:
        """End all ramps where they are."""
        with self._lock:
            self._ramps.clear()

    def _row(self, name: str) -> int:
        if self._table[name].kind is not Kind.SETPOINT:
            raise Misuse(f"{name} is a {self._table[name].kind}, not a set-point that could be streamed")
        return self._table.index[name]

    def _beat(self) -> None:
        if self.failure is not None:
            return
        with self._lock:
            for row, ramp in list(self._ramps.items()):
                self._values[row], done = ramp.advance()
                if done:
                    del self._ramps[row]
            block = self._encoder.encode(self._values, self._rows, self._clock.now())
        try:
            self._port.send(block)
            self.beats += 1
        except LinkLost as failure:
            self.failure = failure
