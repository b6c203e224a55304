"""The commander: stores all set-points, moves them along ramps or a waveform, and sends them each cycle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from bench_protocol.clock import Clock, Task, every_without_late
from bench_protocol.rates import COMMAND_RATE
from bench_protocol.runtime.mutex import Mutex
from bench_protocol.signals import Kind
from bench_protocol.units import NS
from drivers.errors import LinkLost, Misuse
from drivers.wiring.contract import CyclicStream, Wiring, refuse_absent

CYCLE: Final = round(NS / COMMAND_RATE)  # ns


class Played(NamedTuple):
    """Progress of a waveform."""

    cycle: int  #: number of cycles sent
    cycles: int  #: total number
    going: bool


class Commander:
    """Stores all set-points and sends them through the wiring in every cycle from ``start`` to ``stop``.

    Thread-safe. A set-point without a value is sent as "not available". When sending fails, ``failure`` keeps the
    reason and the stream ends. The watchdog of the rig then reacts.
    """

    def __init__(self, wiring: Wiring, clock: Clock) -> None:
        from drivers import setpoints

        self._wiring, self._table, self._clock = wiring, wiring.table, clock
        self._moving = setpoints
        self._setpoints = setpoints.Setpoints.of(len(self._table.signals))
        self._values = self._setpoints.values
        for signal in self._table.of_kind(Kind.SETPOINT):
            if signal.choices:
                self._values[self._table.index[signal.name]] = 0.0
        self._mutex = Mutex()
        self._task: Task | None = None
        self.origin = clock.now()  #: cycles are at ``origin + k * CYCLE``
        self.failure: LinkLost | None = None

    def start(self) -> None:
        """Start to stream; the first set-points are sent one cycle from now."""
        if self._task is not None:
            return
        self.failure = None
        self._change(*self._checked(self._wiring.given))
        self.origin = self._clock.now()
        self._task = self._wiring.outlet.send_cyclic(
            CyclicStream(self._setpoints, self._mutex, self._clock, self.origin, CYCLE, self._fail)
        )
        if self._task is None:
            # After a stall set-points continue from their last values, one step at a time.
            self._task = every_without_late(self._clock, CYCLE, self._cycle)

    def stop(self) -> None:
        """End the stream; nothing is sent after this returns."""
        if self._task is not None:
            self._task.cancel()
            self._task = None

    def next_cycle(self) -> int:
        """Return the time (ns) at which the next set-points are sent."""
        now = self._clock.now()
        return now + CYCLE - (now - self.origin) % CYCLE

    def value(self, name: str) -> float:
        """Return the set-point of the next cycle; NaN if none is set."""
        return float(self._values[self._row(name)])

    def set(self, name: str, value: float) -> None:
        """Set ``name`` to ``value`` (SI) from the next cycle on. Raises ValueError if the value is out of range."""
        self.set_all({name: value})

    def set_all(self, values: Mapping[str, float]) -> None:
        """Set all ``values`` (SI) together from the next cycle on. Raises ValueError, without a change, if one is out
        of range.
        """
        rows, checked = self._checked(values)
        self._wiring.begin()
        self._change(rows, checked)

    def ramp(self, name: str, to: float, rate: float) -> float:
        """Move ``name`` to ``to`` with ``rate`` (SI per second, positive); return the duration (s)."""
        return self.ramp_all({name: to}, rate)

    def ramp_all(self, targets: Mapping[str, float], rate: float) -> float:
        """Start ramps on the same cycle, each with ``rate`` (SI/s); return the longest duration (s). Raises ValueError
        for a rate or a value out of range, Misuse for a set-point without a value.
        """
        if not (rate > 0 and math.isfinite(rate)):
            raise ValueError(f"rate = {rate:g} per second is not a valid rate; use a positive number")
        rows, ends = self._checked(targets)
        self._wiring.begin()
        pace = rate * CYCLE / NS
        cycles = self._moving.start_ramps(self._setpoints, self._mutex.address, rows, ends, pace)
        if math.isnan(cycles):
            name = next(name for name in targets if math.isnan(self.value(name)))
            raise Misuse(
                f"{name} has no value yet, from which a ramp could start; arm the bench, or set {name} first"
            )
        return cycles * CYCLE / NS

    def moving(self, *names: str) -> bool:
        """Return whether one of the set-points ``names`` still moves along a ramp; without names, any set-point."""
        moving = self._setpoints.ramps["moving"]
        return bool((moving[[self._row(name) for name in names]] if names else moving).any())

    def play(self, offsets: Mapping[str, npt.NDArray[np.float64]]) -> None:
        """Move set-points by ``offsets`` (SI, each (cycles,)) from their present values, one value each cycle.

        All start on the same cycle. Setting another value for one of them ends the waveform. Raises Misuse, without a
        motion, for a value out of range, a set-point without a value, and too many set-points or cycles.
        """
        rows = np.array([self._row(name) for name in offsets], np.int64)
        table = np.array(list(offsets.values()), np.float64)
        rows_max, cycles_max = self._setpoints.track.shape
        if rows.size > rows_max or not 0 < table.shape[-1] <= cycles_max:
            raise Misuse(
                f"a waveform has up to {rows_max} set-points and {cycles_max * CYCLE / NS:g} s; "
                f"this one has {rows.size} and {table.shape[-1] * CYCLE / NS:g} s"
            )
        for name, way in zip(offsets, table, strict=True):
            signal, places = self._table[name], self.value(name) + way
            outside = (places < signal.low) | (places > signal.high)
            if outside.any():
                first = int(np.argmax(outside))
                raise Misuse(
                    f"{name} would be {signal.show(places[first])} at {first * CYCLE / NS:g} s of the "
                    f"waveform; use {signal.range_text()}"
                )
        if not self._moving.play_waveform(self._setpoints, self._mutex.address, rows, table):
            name = next(name for name in offsets if math.isnan(self.value(name)))
            raise Misuse(
                f"{name} has no value yet, from which a waveform could start; arm the bench, or set "
                f"{name} first"
            )

    @property
    def played(self) -> Played:
        """The progress of the last waveform."""
        state = self._setpoints.waveform[0]
        return Played(int(state["cycle"]), int(state["cycles"]), bool(state["playing"]))

    def recall(self, duration: float) -> tuple[str, ...]:
        """End the waveform and all ramps, and move the set-points of the waveform back to their start values in
        ``duration`` s; return their names.
        """
        count = self._setpoints.waveform[0]["count"]
        rows, starts = self._setpoints.rows[:count], self._setpoints.track[:count, 0]
        names = tuple(self._table.signals[row].name for row in rows)
        self.freeze()
        for name, start in zip(names, starts.tolist(), strict=True):
            if way := abs(start - self.value(name)):
                self.ramp(name, start, way / duration)
        return names

    def freeze(self) -> None:
        """Stop all ramps and the waveform at their present values."""
        self._moving.end_moves(self._setpoints, self._mutex.address)

    def _change(self, rows: npt.NDArray[np.int64], values: npt.NDArray[np.float64]) -> None:
        self._moving.set_values(self._setpoints, self._mutex.address, rows, values)

    def _checked(self, values: Mapping[str, float]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """Return table rows and values (SI) of set-points. Raises ValueError for a value out of range, Misuse for other
        signals.
        """
        rows = [self._row(name) for name in values]
        return np.array(rows, np.int64), np.array(
            [self._table[name].check(float(value)) for name, value in values.items()], np.float64
        )

    def _row(self, name: str) -> int:
        if self._table[name].kind is not Kind.SETPOINT:
            raise Misuse(f"{name} is a {self._table[name].kind}; only set-points can be streamed")
        refuse_absent(self._wiring, name)
        return self._table.index[name]

    def _cycle(self) -> None:
        """Move the set-points by one cycle and send them from Python; used if the outlet does not run the cycle."""
        if self.failure is not None:
            return
        with self._mutex:
            self._moving.next_cycle(self._setpoints)
            values = self._values.copy()
        try:
            self._wiring.outlet.send(values, self._clock.now())
        except LinkLost as failure:
            self._fail(failure)
        except Exception as error:  # it would end the thread of the cycle unnoticed
            self._fail(LinkLost(f"{type(error).__name__}: {error}"))

    def _fail(self, failure: LinkLost) -> None:
        self.failure = failure
