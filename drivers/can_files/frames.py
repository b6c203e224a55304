"""The data frames of a log in order of time, in arrays of a few bytes per frame."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

import numpy as np

from bench_protocol.frames import FRAME, LENGTH_MAX, Block

_BATCH: Final = 4096


class CanLogError(Exception):
    """A file of CAN frames cannot be read or written; the text names it and the reason."""


class Kind(NamedTuple):
    """Common properties of frames: the channel as named in the log, the identifier, and the format."""

    channel: str
    identifier: int
    extended: bool
    fd: bool


class Frames:
    """The frames of one log. ``places`` are numbers of lines or of frames in the file, as ``unit`` states."""

    def __init__(self, unit: str = "line") -> None:
        self.unit = unit
        self.local = False  #: the times are local ones, in a zone that the log does not name
        self.kinds: dict[Kind, int] = {}
        self.times = array("q")  #: ns
        self.places = array("q")
        self.which = array("l")  #: index of the kind of each frame
        self._lengths = array("H")  # J1939 puts up to 1785 bytes together
        self._data = bytearray()
        self._order: np.ndarray | None = None

    def add(self, time: int, kind: Kind, data: bytes, place: int) -> None:
        """Append a frame received at ``time`` (ns). ``place`` is the number of its line or frame in the file."""
        self.times.append(time)
        self.places.append(place)
        self.which.append(self.kinds.setdefault(kind, len(self.kinds)))
        self._lengths.append(len(data))
        self._data += data

    def __len__(self) -> int:
        return len(self.times)

    def sort(self) -> None:
        """Sort the frames by time; frames with equal times stay in the order of the file."""
        self._order = np.argsort(np.frombuffer(self.times, np.int64), kind="stable")

    def counts(self) -> dict[Kind, int]:
        """Return the number of frames of each kind."""
        numbers = np.bincount(np.frombuffer(self.which, np.dtype("l")), minlength=len(self.kinds))
        return {kind: int(numbers[index]) for kind, index in self.kinds.items()}

    def __iter__(self) -> Iterator[tuple[int, Kind, bytes]]:
        kinds = list(self.kinds)
        ends = np.cumsum(np.frombuffer(self._lengths, np.uint16), dtype=np.int64)
        for index in range(len(self)) if self._order is None else self._order.tolist():
            end = int(ends[index])
            data = bytes(self._data[end - self._lengths[index] : end])
            yield self.times[index], kinds[self.which[index]], data

    def blocks(self, kept: Callable[[Kind], bool]) -> Iterator[Block]:
        """Yield blocks of the classic frames with a kind for which ``kept`` is True."""
        rows = []
        for time, kind, data in self:
            if kind.fd or not kept(kind):
                continue
            padded = np.frombuffer(data.ljust(LENGTH_MAX, b"\0"), np.uint8)
            rows.append((time, kind.identifier, kind.extended, len(data), padded))
            if len(rows) == _BATCH:
                yield np.array(rows, FRAME)
                rows = []
        if rows:
            yield np.array(rows, FRAME)
