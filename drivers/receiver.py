"""The receiver: every frame from the rig becomes samples, in order, whatever the plan is doing meanwhile.

``accept`` runs in the CAN port's own thread (or, in virtual time, while the clock passes), so a plan that computes
for seconds loses nothing. Commands that a bus echoes back are not readings: only messages *from the rig* are decoded.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Final, Self

import numpy as np
import numpy.typing as npt

from bench_protocol.clock import Clock
from bench_protocol.frames import Block, copied
from bench_protocol.units import NS, ms
from bench_protocol.wires import Table
from drivers.errors import Misuse

if TYPE_CHECKING:
    from bench_protocol.can_codec import Samples

Floats = npt.NDArray[np.float64]
#: Called with (times in ns, table rows, SI values), three arrays of one length.
Sink = Callable[[npt.NDArray[np.int64], npt.NDArray[np.int64], Floats], object]

STALE_AFTER: Final = 100 * ms
STALE_PERIODS: Final = 3
NEVER: Final = 2**62
#: Two hours of every signal: a capture is for a measurement, the recorder is for the rest.
CAPTURE_SAMPLES_MAX: Final = 50_000_000


def stale_limits(table: Table) -> npt.NDArray[np.int64]:
    """Return for every table row after how many ns without a frame it is stale.

    0 for what CAN does not carry; never for what is sent on events only, whose last news stays true.
    """
    limits = np.zeros(len(table.signals), np.int64)
    for message in table.messages:
        age = max(STALE_AFTER, STALE_PERIODS / message.rate) if message.rate else None
        for place in message.fields:
            limits[table.index[place.signal]] = NEVER if age is None else round(age * NS)
    return limits


class Receiver:
    """Decodes what the rig sends, keeps the latest values, and feeds captures and one ``sink``.

    ``epoch`` (ns) is subtracted from the time stamps of the frames to make them times of ``clock``. With an epoch the
    stamps come from somebody else's clock, so the age of a reading counts from its arrival instead.
    """

    def __init__(self, table: Table, clock: Clock, epoch: int = 0) -> None:
        from bench_protocol.can_codec import Decoder

        self.table, self.clock, self.epoch = table, clock, epoch
        self._decoder = Decoder(table, from_rig=True)
        self._latest = self._decoder.latest
        self._fresh = np.full(len(table.signals), -1, np.int64) if epoch else self._decoder.latest_times
        self._lock = threading.Lock()
        self._captures: tuple[Capture, ...] = ()
        self.sink: Sink | None = None
        self.failure: Exception | None = None  #: what the sink raised, if it did; it is not called again

    def accept(self, block: Block) -> None:
        """Take a block of frames in order of arrival."""
        if self.epoch:
            block = copied(block)
            block["time"] -= self.epoch
        with self._lock:
            samples = self._decoder.decode(block)
            if self.epoch:
                self._fresh[samples.signals] = self.clock.now()
            captures = self._captures
            for capture in captures:
                capture.append(samples)
        if self.sink is not None and samples.times.size:
            try:
                self.sink(samples.times, samples.signals, samples.values)
            except Exception as failure:  # the thread that receives must outlive whatever it feeds
                self.failure, self.sink = failure, None

    def latest(self, row: int) -> tuple[float, int]:
        """Return the last value of a table row and when it came (ns); NaN and -1 before the first."""
        with self._lock:
            return self._latest.item(row), self._fresh.item(row)

    def tally(self) -> dict[str, int]:
        """Return how many frames were accepted, lost, repeated, malformed… since the start."""
        from bench_protocol.can_codec import Tally

        with self._lock:
            return {kind.name.lower(): int(self._decoder.tally[kind]) for kind in Tally}

    def start(self, capture: Capture) -> None:
        """Feed ``capture`` from now on."""
        with self._lock:
            self._captures = (*self._captures, capture)

    def stop(self, capture: Capture) -> None:
        """Feed ``capture`` no longer."""
        with self._lock:
            self._captures = tuple(other for other in self._captures if other is not capture)


class Capture:
    """All samples of some signals between two moments; a context manager, read while it runs or afterwards.

    Times are seconds since the capture began, values SI.
    """

    def __init__(self, receiver: Receiver, names: Sequence[str]) -> None:
        self._receiver, self._table = receiver, receiver.table
        self._limits = stale_limits(self._table)
        self.names = tuple(names)
        for name in self.names:
            if self._limits[self._row(name)] == 0:
                raise Misuse(
                    f"{name} does not travel on CAN, so it has no samples to capture; read it instead"
                )
        self._wanted = np.zeros(len(self._table.signals), np.bool_)
        self._wanted[[self._row(name) for name in self.names]] = True
        self._blocks: list[Samples] = []
        self._joined_blocks = -1
        self._joined = np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
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

    def append(self, samples: Samples) -> None:
        """Take samples of any signals; the receiver calls this."""
        self._size += samples.times.size
        if self._size <= CAPTURE_SAMPLES_MAX:
            self._blocks.append(samples)

    def times(self, name: str) -> Floats:
        """Return when the samples of ``name`` came (s since the start)."""
        return self._series(name)[0]

    def values(self, name: str) -> Floats:
        """Return the samples of ``name`` (SI), NaN where the rig had none."""
        return self._series(name)[1]

    def aligned(self, rate: float = 200.0) -> tuple[Floats, dict[str, Floats]]:
        """Return common times (s, ``rate`` per second) and the values of all signals at these times.

        Numbers are interpolated linearly, choices keep their last value. A gap in the samples wider than the signal's
        stale limit is NaN, not a straight line.
        """
        if not 0.001 <= rate <= 10_000:
            raise Misuse(f"rate = {rate:g} Hz is not a rate to align at (0.001 to 10000 Hz)")
        series = {name: self._series(name) for name in self.names}
        empty = [name for name, (times, _) in series.items() if times.size == 0]
        if empty:
            raise Misuse(f"{', '.join(empty)}: no samples in this capture, so there is nothing to align")
        first = max(times[0] for times, _ in series.values())
        last = min(times[-1] for times, _ in series.values())
        # Half a nanosecond of slack: a grid that ends exactly on the last sample includes it.
        grid = first + np.arange(max(0, int((last - first + 0.5e-9) * rate) + 1)) / rate
        return grid, {name: self._at(name, grid, *series[name]) for name in self.names}

    def _at(self, name: str, grid: Floats, times: Floats, values: Floats) -> Floats:
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
        self._table[name]  # raises with the words that help
        return self._table.index[name]

    def _series(self, name: str) -> tuple[Floats, Floats]:
        if name not in self.names:
            raise Misuse(f"{name} is not in this capture, which has {', '.join(self.names)}")
        row = self._row(name)
        blocks = list(self._blocks)
        if not blocks:
            return np.zeros(0), np.zeros(0)
        if len(blocks) != self._joined_blocks:  # joined once for all names, while nothing new has come
            self._joined_blocks = len(blocks)
            signals = np.concatenate([block.signals for block in blocks])
            mine = self._wanted[signals]
            self._joined = (
                signals[mine],
                np.concatenate([block.times for block in blocks])[mine],
                np.concatenate([block.values for block in blocks])[mine],
            )
        rows, all_times, all_values = self._joined
        mine = rows == row
        times, values = all_times[mine], all_values[mine]
        # Frames in flight when the capture began belong to the time before it.
        inside = times >= self.start
        return (times[inside] - self.start) / NS, values[inside]
