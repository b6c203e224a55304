"""The receiver: stores every sample from a wiring, in order, also while the plan computes.

``receive`` runs in the threads of the wiring (or, in virtual time, while the clock advances), so a plan that computes
for seconds loses no sample.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Final, Self

import numpy as np

from bench_protocol.arrays import Floats, Ints
from bench_protocol.clock import Clock
from bench_protocol.units import NS
from drivers.errors import Misuse, Stale
from drivers.wiring.contract import Wiring, refuse_absent

#: Called with three arrays of equal length: times (ns), table rows, SI values.
Sink = Callable[[Ints, Ints, Floats], object]

#: Two hours of every signal. A capture is for one measurement; the recorder stores whole runs.
CAPTURE_SAMPLES_MAX: Final = 50_000_000


class Receiver:
    """Stores the latest value of every signal, and passes samples to captures and one ``sink``."""

    def __init__(self, wiring: Wiring, clock: Clock) -> None:
        self.wiring, self.table, self.clock = wiring, wiring.table, clock
        self._latest = np.full(len(self.table.signals), np.nan)
        self._fresh = np.full(len(self.table.signals), -1, np.int64)
        self._lock = threading.Lock()
        self._captures: tuple[Capture, ...] = ()
        self.sink: Sink | None = None
        self.failure: Exception | None = None  #: exception of the sink, which is then not called again
        self.needed = True  #: whether a plan must be informed of ``failure``
        #: Hz, by signal: its receive rate in the last capture that was aligned or averaged.
        self.rates: dict[str, float] = {}

    def receive(self, times: Ints, rows: Ints, values: Floats, fresh: Ints | int) -> None:
        """Store samples (times in ns, table rows, SI values), and pass them to captures and the sink.

        The age of a sample counts from the time ``fresh`` (ns), one for each sample or one for all.
        """
        with self._lock:
            self._latest[rows] = values
            self._fresh[rows] = fresh
            for capture in self._captures:
                capture.receive(times, rows, values)
        if self.sink is not None and times.size:
            try:
                self.sink(times, rows, values)
            except Exception as failure:  # the receiving thread must survive errors of the sink
                self.failure, self.sink = failure, None

    def latest(self, row: int) -> tuple[float, int]:
        """Return the last value of a table row and its time (ns); NaN and -1 before the first."""
        with self._lock:
            return self._latest.item(row), self._fresh.item(row)

    def start(self, capture: Capture) -> None:
        """Pass samples to ``capture`` from now on."""
        with self._lock:
            self._captures = (*self._captures, capture)

    def stop(self, capture: Capture) -> None:
        """Stop passing samples to ``capture``."""
        with self._lock:
            self._captures = tuple(other for other in self._captures if other is not capture)


class Capture:
    """All samples of some signals in an interval of time; a context manager, readable inside the block and after it.

    Times are in seconds from the start of the capture, values in SI.
    """

    def __init__(self, receiver: Receiver, names: Sequence[str]) -> None:
        self._receiver, self._table = receiver, receiver.table
        self._limits = receiver.wiring.freshness
        self.names = tuple(names)
        for name in self.names:
            row = self._row(name)
            refuse_absent(receiver.wiring, name)
            if self._limits[row] == 0:
                raise Misuse(
                    f"the rig does not send {name} by itself, so there are no samples to capture; read "
                    "the value instead"
                )
        self._captured = np.zeros(len(self._table.signals), np.bool_)
        self._captured[[self._row(name) for name in self.names]] = True
        self._blocks: list[tuple[Ints, Ints, Floats]] = []  # times, rows, values
        self._joined_blocks = -1
        self._joined: tuple[Ints, Ints, Floats] = np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
        self._size = 0
        self.start = 0  #: ns of the bench's clock

    def __enter__(self) -> Self:
        self.start = self._receiver.clock.now()
        self._receiver.start(self)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._receiver.stop(self)

    def receive(self, times: Ints, rows: Ints, values: Floats) -> None:
        """Store samples (times in ns, table rows, SI values) of the captured signals. The receiver calls this with
        samples of any signals.
        """
        self._size += times.size
        if self._size <= CAPTURE_SAMPLES_MAX:
            self._blocks.append((times, rows, values))

    def times(self, name: str) -> Floats:
        """Return the times of the samples of ``name`` (s since the start)."""
        return self._series(name)[0]

    def values(self, name: str) -> Floats:
        """Return the samples of ``name`` (SI); NaN if the rig had no value."""
        return self._series(name)[1]

    def aligned(self, rate: float = 200.0) -> tuple[Floats, dict[str, Floats]]:
        """Return common times (s, ``rate`` per second) and the values of all signals at these times.

        Numbers are interpolated linearly, choices keep their last value. A gap in the samples longer than the signal's
        stale limit becomes NaN. Raises Misuse without any sample, Stale if only some signals have one.
        """
        if not 0.001 <= rate <= 10_000:
            raise Misuse(f"rate = {rate:g} Hz is outside 0.001 to 10000 Hz")
        series = {name: self._series(name) for name in self.names}
        empty = [name for name, (times, _) in series.items() if times.size == 0]
        if empty:
            text = f"{', '.join(empty)}: no samples in this capture, so it cannot be aligned"
            raise Misuse(text) if len(empty) == len(series) else Stale(text)  # others have samples
        first = max(times[0] for times, _ in series.values())
        last = min(times[-1] for times, _ in series.values())
        # Half a nanosecond of slack: a grid that ends exactly on the last sample includes it.
        grid = first + np.arange(max(0, int((last - first + 0.5e-9) * rate) + 1)) / rate
        for name, (times, _) in series.items():
            if times.size > 1 and times[-1] > times[0]:
                self._receiver.rates[name] = float((times.size - 1) / (times[-1] - times[0]))
        return grid, {name: self._resample(name, grid, *series[name]) for name in self.names}

    def _resample(self, name: str, grid: Floats, times: Floats, values: Floats) -> Floats:
        row = self._row(name)
        after = np.clip(np.searchsorted(times, grid - 0.5e-9), 0, times.size - 1)
        before = np.maximum(np.where(times[after] > grid + 0.5e-9, after - 1, after), 0)
        if self._table[name].choices:
            result = values[before].copy()
        else:
            span = times[after] - times[before]
            share = np.divide(grid - times[before], span, out=np.zeros_like(grid), where=span > 0)
            result = np.where(
                share > 0, values[before] + share * (values[after] - values[before]), values[before]
            )
        result[(times[after] - times[before]) * NS > self._limits[row]] = np.nan
        return result

    def _row(self, name: str) -> int:
        self._table[name]  # raises an error with a suggestion
        return self._table.index[name]

    def _series(self, name: str) -> tuple[Floats, Floats]:
        if name not in self.names:
            raise Misuse(f"{name} is not in this capture, which has {', '.join(self.names)}")
        if self._size > CAPTURE_SAMPLES_MAX:
            raise Misuse(
                f"this capture has {self._size:,} samples of all signals, more than the limit of "
                f"{CAPTURE_SAMPLES_MAX:,}; measure for a shorter time, or use the record of the run"
            )
        row = self._row(name)
        blocks = list(self._blocks)
        if not blocks:
            return np.zeros(0), np.zeros(0)
        if len(blocks) != self._joined_blocks:  # joined once for all names, until new samples arrive
            self._joined_blocks = len(blocks)
            times, rows, values = (np.concatenate(column) for column in zip(*blocks, strict=True))
            mine = self._captured[rows]
            self._joined = times[mine], rows[mine], values[mine]
        all_times, rows, all_values = self._joined
        mine = rows == row
        times, values = all_times[mine], all_values[mine]
        # Frames sent before the start of the capture are excluded.
        inside = times >= self.start
        return (times[inside] - self.start) / NS, values[inside]
