"""Receive times of frames: the time stamps of the kernel and of the interface, and their conversion to another
clock.
"""

import struct
from typing import Final, Literal

from bench_protocol.clock import Clock as BenchClock
from bench_protocol.frames import Block

Clock = Literal["hardware", "system"]

#: linux/socket.h, linux/net_tstamp.h: numbers Python's socket module does not name.
SO_TIMESTAMPNS: Final = 35
SO_TIMESTAMPING: Final = 37
#: Flags: use the stamps of the interface without conversion, and those of the kernel if it has none.
TIMESTAMPING: Final = 1 << 2 | 1 << 3 | 1 << 4 | 1 << 6
_TIMESPEC: Final = struct.Struct("@ll")
_NS: Final = 1_000_000_000
#: Largest relative drift between two clocks: the error of a crystal is below 100 ppm.
_DRIFT: Final = 1e-4
#: Stamps of one bus may be out of order by this (ns): a hub stamps frames of clients on arrival, and frames of the rig
#: with the time of their tick.
_DISORDER: Final = _NS // 50
#: The offset is too small if no frame within this time (ns), of at least so many, has a lag near the offset.
_WINDOW: Final = _NS
_FRAMES: Final = 10
#: A smaller error of the offset (ns) is accepted.
_NEAR: Final = _NS // 2000

#: Interfaces of python-can that report the time stamps of the adapter. The others report those of the operating system.
HARDWARE_STAMPS: Final = frozenset(
    {"pcan", "kvaser", "vector", "ixxat", "neovi", "nican", "nixnet", "canalystii", "gs_usb", "etas"}
)
#: Largest difference between a stamp and the time of the frame on the bus (s), half-width.
UNCERTAINTY: Final[dict[Clock, float]] = {"hardware": 5e-6, "system": 900e-6}


def of_notes(notes: list[tuple[int, int, bytes]]) -> tuple[int, int]:
    """Return the receive time (ns) by the kernel's clock and by the interface's, from ancillary data; 0 if missing."""
    system = hardware = 0
    for _, kind, note in notes:
        if kind == SO_TIMESTAMPNS and len(note) >= _TIMESPEC.size:
            system = system or _nanoseconds(note, 0)
        elif kind == SO_TIMESTAMPING and len(note) >= 3 * _TIMESPEC.size:
            system, hardware = _nanoseconds(note, 0) or system, _nanoseconds(note, 2)
    return system, hardware


def _nanoseconds(note: bytes, place: int) -> int:
    seconds, rest = _TIMESPEC.unpack_from(note, place * _TIMESPEC.size)
    return int(seconds * _NS + rest)


class StampClock:
    """Converts time stamps of another clock to our clock. The other clock has any origin, drifts, and may be set.

    No frame arrives before its stamp, so the smallest observed lag is the offset between the two clocks. A stamp that
    is older than the one before, or a lag that stays too large, shows that the other clock was set back. A stamp in the
    future shows that it was set forward. No clock is compared with the time of day.

    An offset with an error below `_NEAR` is kept, so that equidistant stamps stay equidistant. With ``drifts`` the
    offset follows the drift of the other clock instead. This is for the hardware of an interface, whose stamps are
    exact to microseconds.
    """

    def __init__(self, *, drifts: bool = False) -> None:
        self._drift, self._slack = (_DRIFT, 0) if drifts else (0.0, _NEAR)
        self.steps = 0  #: number of times that the other clock was set, by more than `_DISORDER`
        self._offset: int | None = None  # ns, from the other clock to ours
        self._newest = 0
        self._begin, self._frames, self._least = 0, 0, 0  # of the window: arrival, frames, smallest lag

    def time(self, stamp: int, arrived: int) -> int:
        """Convert a ``stamp`` of the other clock to our clock (ns); ``arrived`` is its arrival by our clock (ns)."""
        lag = arrived - stamp
        offset = self._offset
        if offset is None or stamp < self._newest - _DISORDER:
            self.steps += offset is not None
            offset, self._newest = lag, stamp
            self._begin, self._frames, self._least = arrived, 1, lag
        else:
            self.steps += lag < offset - _DISORDER
            offset += round(self._drift * max(0, stamp - self._newest))
            if lag < offset - self._slack:
                offset = lag
            self._newest = max(self._newest, stamp)
            offset = self._raised(offset, lag, arrived)
        self._offset = offset
        return stamp + offset

    def times(self, block: Block, clock: BenchClock) -> Block:
        """Return a copy of ``block``, which arrives now, with times of ``clock``."""
        arrived, dated = clock.now(), block.copy()
        dated["time"] = [self.time(stamp, arrived) for stamp in block["time"].tolist()]
        return dated

    def _raised(self, offset: int, lag: int, arrived: int) -> int:
        """Return ``offset`` (ns), or a larger one if all lags in the window before ``arrived`` (ns) were larger."""
        self._frames += 1
        self._least = min(self._least, lag)
        if arrived - self._begin < _WINDOW or self._frames < _FRAMES:
            return offset
        least = self._least
        self._begin, self._frames, self._least = arrived, 0, lag
        if least > offset + _DISORDER:
            return least
        return offset + round(_DRIFT * _WINDOW) if least > offset + _NEAR else offset  # slowly, as a drift
