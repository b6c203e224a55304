"""The commander: streams the protected command messages at 50 Hz and moves set-points along ramps meanwhile."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.clock import Clock, RealClock, Task, hurry
from bench_protocol.frames import copied
from bench_protocol.gate import Gate
from bench_protocol.messages import TOKEN
from bench_protocol.rates import COMMAND_RATE
from bench_protocol.signals import Kind
from bench_protocol.units import NS, ms
from bench_protocol.wires import Table
from drivers.errors import LinkLost, Misuse

if TYPE_CHECKING:
    from drivers.beat import Beat
    from drivers.can_port import CanPort
    from drivers.wire import Wire

BEAT: Final = round(NS / COMMAND_RATE)  # ns
#: How long the stream goes on while the interpreter is stuck, and how often Python says that it is not.
AUTONOMY: Final = round(500 * ms * NS)
_GRANT: Final = round(100 * ms * NS)
_PRIORITY: Final = 5  #: above everything that computes, below a rig on the same machine


class Commander:
    """Holds all set-points and sends them, one block per beat, from ``start`` to ``stop``.

    Thread-safe. A set-point nobody has given yet travels as "not available". When sending fails, ``failure`` keeps
    the reason and the stream ends: the rig's watchdog then does what is right. In real time the stream goes on while
    the interpreter is held by what computes, for ``AUTONOMY`` at most (`drivers.beat`).
    """

    def __init__(self, table: Table, clock: Clock, port: CanPort) -> None:
        from bench_protocol.can_codec import Encoder
        from drivers import beat

        self._table, self._clock, self._port = table, clock, port
        self._encoder = Encoder(table)
        commands = [message.name for message in table.messages if not message.from_rig and message.rate]
        self._beating = beat
        self._state = beat.Beat.of(self._encoder, self._encoder.rows(commands), len(table.signals))
        self._values, self._counts = self._state.values, self._state.counts
        for signal in table.of_kind(Kind.SETPOINT):
            if signal.choices:
                self._values[table.index[signal.name]] = 0.0
        self._gate = Gate()
        self._task: Task | None = None
        self.origin = clock.now()  #: beats are at ``origin + k * BEAT``
        self.failure: LinkLost | None = None

    @property
    def beats(self) -> int:
        """Blocks sent."""
        return int(self._counts["sent"][0])

    def bear(self, token: int) -> None:
        """Let all that is sent from now on be that of the holder with ``token``."""
        with self._gate:
            self._values[self._table.index[TOKEN]] = token
            self._encoder.bind(token)

    def start(self) -> None:
        """Begin to stream; the first block goes one beat from now."""
        if self._task is not None:
            return
        self.failure = None
        self.origin = self._clock.now()
        wire = self._port.wire
        if wire is not None and self._beating.COMPILED and isinstance(self._clock, RealClock):

            def failed(error: int) -> None:
                wire.cut()  # half a line may be out
                self.failure = LinkLost(f"frames could not be sent: {os.strerror(error)}")

            self._task = _PunctualTask(self._state, self._gate, wire, self._clock, self.origin, failed)
        else:
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
        return float(self._values[self._row(name)])

    def set(self, name: str, value: float) -> None:
        """Let ``name`` be ``value`` from the next beat on; ValueError if the wire cannot carry it."""
        self.set_all({name: value})

    def set_all(self, values: Mapping[str, float]) -> None:
        """Let all ``values`` hold from the next beat on, together; ValueError, and no change, if one does not fit."""
        rows, checked = self._checked(values)
        self._beating.set_values(self._state, self._gate.address, rows, checked)

    def ramp(self, name: str, to: float, rate: float) -> float:
        """Move ``name`` to ``to`` with ``rate`` (SI per second, positive); return how long it takes (s)."""
        return self.ramp_all({name: to}, rate)

    def ramp_all(self, targets: Mapping[str, float], rate: float) -> float:
        """Start ramps on the same beat, each with ``rate`` (SI/s); return how long the longest takes (s)."""
        if not (rate > 0 and math.isfinite(rate)):
            raise ValueError(f"rate = {rate:g} per second is not a pace to move at; it must be positive")
        rows, ends = self._checked(targets)
        pace = rate * BEAT / NS
        beats = self._beating.start_ramps(self._state, self._gate.address, rows, ends, pace)
        if math.isnan(beats):
            name = next(name for name in targets if math.isnan(self.value(name)))
            raise Misuse(f"{name} has no value yet to start a ramp from; arm the bench, or set it first")
        return beats * BEAT / NS

    def moving(self, *names: str) -> bool:
        """Return whether one of the set-points (any, without names) is still on its ramp."""
        moving = self._state.ramps["moving"]
        return bool((moving[[self._row(name) for name in names]] if names else moving).any())

    def freeze(self) -> None:
        """End all ramps where they are."""
        self._beating.end_ramps(self._state, self._gate.address)

    def _checked(self, values: Mapping[str, float]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """Return rows and values of set-points that the wire can carry; ValueError or Misuse for any other."""
        rows = [self._row(name) for name in values]
        return np.array(rows, np.int64), np.array(
            [self._table[name].check(float(value)) for name, value in values.items()], np.float64
        )

    def _row(self, name: str) -> int:
        if self._table[name].kind is not Kind.SETPOINT:
            raise Misuse(f"{name} is a {self._table[name].kind}, not a set-point that could be streamed")
        return self._table.index[name]

    def _beat(self) -> None:
        """Send a block by the port: in virtual time, and on buses that only Python can write to."""
        if self.failure is not None:
            return
        with self._gate:
            self._beating.next_block(self._state, self._clock.now())
            block = copied(self._state.frames)
        try:
            self._port.send(block)
        except LinkLost as failure:
            self.failure = failure
            return
        self._counts["sent"][0] += 1


class _PunctualTask:
    """The compiled beat in a thread of its own, and Python's word from time to time that the plan lives."""

    def __init__(
        self, state: Beat, gate: Gate, wire: Wire, clock: RealClock, start: int, failed: Callable[[int], None]
    ) -> None:
        self._counts = state.counts
        begin = clock.monotonic(start)
        period = clock.monotonic(start + BEAT) - begin

        def run() -> None:
            from drivers.beat import run_beats

            hurry(_PRIORITY)
            door = wire.gate.address
            error = run_beats(state, gate.address, wire.descriptor, door, wire.lines, begin, period)
            if error:
                failed(error)

        self._counts["stop"][0] = 0
        self._grant()
        self._granting = clock.every(_GRANT, self._grant)
        self._thread = threading.Thread(target=run, name="every 20 ms", daemon=True)
        self._thread.start()

    def _grant(self) -> None:
        self._counts["granted"][0] = self._counts["sent"][0] + AUTONOMY // BEAT

    def cancel(self) -> None:
        self._counts["stop"][0] = 1
        self._granting.cancel()
        if threading.current_thread() is not self._thread:
            self._thread.join()
