"""BLF, Vector's binary log: it is read by python-can, and objects that python-can skips are counted."""

from __future__ import annotations

import gzip
import struct
import zlib
from collections.abc import Generator, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final

from can.io import blf
from can.message import Message

from bench_protocol.account import Account
from bench_protocol.input_limits import Unfit, check_expansion, size
from drivers.can_files.frames import CanLogError, Frames, Kind
from drivers.can_files.text import EARLY, ERRORS, OVERLOAD, REMOTE, opened

_NS: Final = 10**9
_HEAD: Final = blf.OBJ_HEADER_BASE_STRUCT
_READ: Final = frozenset(
    {blf.CAN_MESSAGE, blf.CAN_MESSAGE2, blf.CAN_ERROR_EXT, blf.CAN_FD_MESSAGE, blf.CAN_FD_MESSAGE_64}
)
#: Objects that are not frames, by their number in the format, and the name under which they are counted.
_BESIDE: Final = {2: ERRORS, 104: ERRORS, 3: OVERLOAD}
_OTHERS: Final = "object(s) of other kinds than CAN frames"
_LOGG: Final = b"LOGG"
#: Limit for one object. A container has 128 KiB, a message less.
_OBJECT_BYTES: Final = 64 << 20


# Frames before the start of the log have a negative time; python-can reads all times as positive.
blf.OBJ_HEADER_V1_STRUCT = struct.Struct("<LHHq")
blf.OBJ_HEADER_V2_STRUCT = struct.Struct("<LBxHq8x")


class _Reader(blf.BLFReader):
    """python-can's reader, which also reports skipped objects."""

    def __init__(self, path: Path, account: Account) -> None:
        self.path, self.account = path, account
        self.unpacked = 0
        file = opened(path)
        try:
            head = blf.FILE_HEADER_STRUCT.unpack(file.read(blf.FILE_HEADER_STRUCT.size))
            file.seek(0)
            super().__init__(file)
            self.start_timestamp = _start(head[14:22])
        except BaseException:
            file.close()
            raise

    def __iter__(self) -> Generator[Message, None, None]:
        while True:
            try:
                head = self.file.read(_HEAD.size)
                if not head:
                    break
                signature, _, _, length, kind = _HEAD.unpack(head)
                if signature != b"LOBJ":
                    raise CanLogError(
                        f"{self.path}: the data after the last readable object are damaged; the "
                        "program that wrote it may repair it"
                    )
                if length > _OBJECT_BYTES:
                    raise CanLogError(
                        f"{self.path} is damaged: one object has {size(length)}, more than "
                        f"{size(_OBJECT_BYTES)}; the program that wrote it may repair it"
                    )
                content = self.file.read(length - _HEAD.size)
                self.file.read(length % 4)
            except (struct.error, EOFError, zlib.error, gzip.BadGzipFile):
                self._early()
                return
            if len(content) < length - _HEAD.size:
                self._early()
            if kind != blf.LOG_CONTAINER:
                yield from self._parse_container(head + content)
            else:
                yield from self._parse_container(self._unpacked(content))
        if self._tail.strip(b"\0"):
            self._early()

    def _unpacked(self, content: bytes) -> bytes:
        if len(content) < blf.LOG_CONTAINER_STRUCT.size:
            return b""
        method, length = blf.LOG_CONTAINER_STRUCT.unpack_from(content)
        packed = content[blf.LOG_CONTAINER_STRUCT.size :]
        if method == blf.NO_COMPRESSION:
            return packed
        if method != blf.ZLIB_DEFLATE:
            raise CanLogError(
                f"{self.path} is compressed by the method {method}, which is not supported; save it "
                "again without compression"
            )
        self.unpacked += length
        check_expansion(self.path, self.unpacked)
        try:
            return zlib.decompressobj().decompress(packed, max(length, 1))
        except zlib.error:
            self._early()
            return b""

    def _early(self) -> None:
        if EARLY not in self.account.counts:
            self.account.leave_out(EARLY)

    def _parse_data(self, data: bytes) -> Iterator[Message]:
        """Yield the messages that python-can reads from ``data``, and count the objects that it skips."""
        place = data.find(b"LOBJ")
        while 0 <= place <= len(data) - _HEAD.size:
            _, _, version, length, kind = _HEAD.unpack_from(data, place)
            if length < _HEAD.size or place + length > len(data):
                break
            if kind not in _READ:
                self.account.leave_out(
                    _BESIDE.get(kind, _OTHERS), at="" if kind in _BESIDE else f"kind {kind}"
                )
            elif version not in (1, 2):
                self.account.leave_out(f"frame(s) with a head of version {version}")
            place = data.find(b"LOBJ", place + length, place + length + 8)
        yield from super()._parse_data(data)


def _start(date: tuple[int, ...]) -> float:
    """Return the start time of a log (s since 1970); 0 if missing. Some programs write 1000 milliseconds, which is
    accepted.
    """
    year, month, _, day, hour, minute, second, milliseconds = date
    try:
        start = datetime(year, month, day, hour, minute, second, tzinfo=UTC)
    except ValueError:
        return 0.0
    return (start + timedelta(milliseconds=milliseconds)).timestamp()


def read_blf(path: Path, account: Account) -> Frames:
    """Return the data frames of a BLF file. Raises CanLogError for another file."""
    frames = Frames("frame")
    frames.local = True
    with opened(path) as file:
        try:
            begins = file.read(len(_LOGG))
        except (EOFError, OSError, zlib.error):
            begins = b""
    if begins != _LOGG:
        raise CanLogError(
            f"{path} is not a BLF file: it does not begin with {_LOGG.decode()}; give it the ending of "
            "its format"
        )
    try:
        with _Reader(path, account) as reader:
            for number, message in enumerate(reader, 1):
                _add(frames, message, number, account)
    except CanLogError:
        raise
    except Unfit as error:
        raise CanLogError(f"{path} {error}") from None
    except Exception:  # python-can raises its own exceptions, and struct others
        raise CanLogError(
            f"{path} is damaged after frame {len(frames)}; the program that wrote it may repair it"
        ) from None
    return frames


def _add(frames: Frames, message: Any, number: int, account: Account) -> None:
    if message.is_error_frame:
        account.leave_out(ERRORS)
    elif message.is_remote_frame:
        account.leave_out(REMOTE)
    else:
        channel = "1" if message.channel is None else str(int(message.channel) + 1)
        kind = Kind(channel, message.arbitration_id, message.is_extended_id, message.is_fd)
        frames.add(round(message.timestamp * _NS), kind, bytes(message.data), number)
