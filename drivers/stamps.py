"""When frames came: time stamps of the kernel and of the interface's own clock, which is brought to that of the day."""

import struct
from typing import Final, Literal

Clock = Literal["hardware", "system"]

#: linux/socket.h, linux/net_tstamp.h: numbers Python's socket module does not name.
SO_TIMESTAMPNS: Final = 35
SO_TIMESTAMPING: Final = 37
#: Stamps of the interface as they are, and those of the kernel where it has none.
TIMESTAMPING: Final = 1 << 2 | 1 << 3 | 1 << 4 | 1 << 6
_TIMESPEC: Final = struct.Struct("@ll")
_NS: Final = 1_000_000_000
#: What two clocks may drift apart by in a second, ns: a crystal is good for 100 millionths.
_DRIFT: Final = 1e-4
#: A stamp so far from where it is expected is of a clock that was set, ns.
_LEAP: Final = _NS

#: Interfaces of python-can whose stamps are those of the adapter. Of the others the operating system's are taken.
HARDWARE_STAMPS: Final = frozenset(
    {"pcan", "kvaser", "vector", "ixxat", "neovi", "nican", "nixnet", "canalystii", "gs_usb", "etas"}
)
#: How far a stamp may be from when the frame was on the bus (s), half-width.
UNCERTAINTY: Final[dict[Clock, float]] = {"hardware": 5e-6, "system": 900e-6}


def of_notes(notes: list[tuple[int, int, bytes]]) -> tuple[int, int]:
    """Return when a frame came (ns) by the kernel's clock and by the interface's, from ancillary data; 0 for none."""
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


class HardwareClock:
    """Brings stamps of an interface's clock, which begins anywhere and drifts, to the time of the day.

    No frame comes before it was on the bus, so the least lag that was seen is what lies between the clocks; it may
    grow by as much as they drift apart.
    """

    def __init__(self) -> None:
        self._apart: int | None = None  # ns, from the hardware's clock to that of the day
        self._last = 0

    def time(self, stamp: int, arrived: int) -> int:
        """Return the time of the day (ns) of a hardware ``stamp`` that ``arrived`` then."""
        lag = arrived - stamp
        if self._apart is None or abs(lag - self._apart) > _LEAP or stamp < self._last - _LEAP:
            self._apart = lag
        else:
            passed = max(0, stamp - self._last)
            self._apart = min(lag, self._apart + round(_DRIFT * passed))
        self._last = max(stamp, self._last) if stamp > self._last - _LEAP else stamp
        return stamp + self._apart
