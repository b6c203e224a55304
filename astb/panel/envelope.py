"""The last minutes of many signals in bounded memory: smallest and largest value of each interval."""

import threading
from typing import Final

import numpy as np
import numpy.typing as npt

from bench_protocol.arrays import Ints
from bench_protocol.units import NS, hours, minutes, ms

Floats32 = npt.NDArray[np.float32]

#: Resolution and length of the history: all samples at 200 Hz for two minutes, then one value per column of a plot.
LEVELS: Final = ((5 * ms, 2 * minutes), (100 * ms, 1 * hours))


class Level:
    """Smallest and largest value of every interval of ``width`` s over the last ``span`` s; rows are signals."""

    def __init__(self, rows: int, width: float, span: float) -> None:
        self.width, self.span = width, span
        self._width = round(width * NS)
        self._slots = round(span / width)
        self.head = -1  #: the number of the newest interval; interval k begins at k · width
        self._low = np.full((rows, self._slots), np.nan, np.float32)
        self._high = np.full((rows, self._slots), np.nan, np.float32)

    def take(self, times: Ints, rows: Ints, values: Floats32) -> None:
        """Take samples at ``times`` (ns); samples before the stored range are left out."""
        slots = times // self._width
        newest = int(slots.max())
        if newest > self.head:
            new = np.arange(max(self.head + 1, newest - self._slots + 1), newest + 1) % self._slots
            self._low[:, new] = np.nan
            self._high[:, new] = np.nan
            self.head = newest
        kept = slots > self.head - self._slots
        at = (rows[kept], slots[kept] % self._slots)
        np.fmin.at(self._low, at, values[kept])
        np.fmax.at(self._high, at, values[kept])

    def read(self, rows: Ints, first: int, count: int, together: int) -> tuple[Floats32, Floats32]:
        """Return lows and highs of ``count`` intervals from number ``first`` on, arrays of (rows, count).

        Each interval joins ``together`` intervals of this level.
        """
        slots = np.arange(first * together, (first + count) * together)
        known = (slots > self.head - self._slots) & (slots <= self.head) & (slots >= 0)
        columns = slots % self._slots
        shape = (len(rows), count, together)
        low = np.where(known, self._low[np.ix_(rows, columns)], np.nan).reshape(shape)
        high = np.where(known, self._high[np.ix_(rows, columns)], np.nan).reshape(shape)
        return np.fmin.reduce(low, axis=2), np.fmax.reduce(high, axis=2)


class Envelope:
    """All levels of all signals. One thread stores samples while another one reads."""

    def __init__(self, rows: int) -> None:
        self._levels = [Level(rows, width, span) for width, span in LEVELS]
        self._lock = threading.Lock()

    def take(self, times: Ints, rows: Ints, values: Floats32) -> None:
        """Take samples at ``times`` (ns) in the order of arrival."""
        if times.size:
            with self._lock:
                for level in self._levels:
                    level.take(times, rows, values)

    def scale(self, span: float, columns: int) -> "Scale":
        """Return the scale for the last ``span`` s in about ``columns`` intervals."""
        level = next((one for one in self._levels if one.span >= span), self._levels[-1])
        together = max(1, round(min(span, level.span) / columns / level.width))
        return Scale(level, together, self._lock)


class Scale:
    """A view of the envelope: intervals of one length, numbered from time 0."""

    def __init__(self, level: Level, together: int, lock: threading.Lock) -> None:
        self._level, self._together, self._lock = level, together, lock
        self.width = level.width * together  #: s
        self.most = int(level.span / self.width)  #: number of stored intervals

    @property
    def head(self) -> int:
        """The number of the newest interval, which may still be incomplete; -1 before the first sample."""
        return self._level.head // self._together

    def read(self, rows: Ints, first: int) -> tuple[Floats32, Floats32]:
        """Return lows and highs from interval ``first`` to the newest: arrays of len(rows) × intervals."""
        with self._lock:
            return self._level.read(rows, first, max(0, self.head + 1 - first), self._together)
