"""Reading of the lines of a log, compressed or not, in any charset, and names of lines that are not frames."""

from __future__ import annotations

import codecs
import gzip
import io
import re
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple, cast

from bench_protocol.account import Account
from bench_protocol.input_limits import LINE_BYTES, SAMPLES_BYTES, Unfit, check_expansion, check_size, size
from bench_protocol.os_errors import file_errors
from drivers.can_files.frames import CanLogError

ERRORS: Final = "error frame(s)"
REMOTE: Final = "remote frame(s)"
OVERLOAD: Final = "overload frame(s)"
REQUESTS: Final = "request(s) to send, which are not frames"
EVENTS: Final = "event(s) other than CAN frames"
UNKNOWN: Final = "line(s) of unknown form"
CUT: Final = "line(s) cut off at the end of the file"
EARLY: Final = "end(s) of a file that breaks off"

_GZIP: Final = b"\x1f\x8b"
_MARKS: Final = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
_STAMP: Final = re.compile(r"(\d{1,12})(?:\.(\d{1,9})\d*)?", re.ASCII)
_SHOWN: Final = 40
_PART: Final = 1 << 20


class Line(NamedTuple):
    """One line: its number, its text without the line break, and whether it has a line break."""

    number: int
    text: str
    ended: bool

    @property
    def shown(self) -> str:
        """Return the place and the beginning of the line, as text."""
        return f"line {self.number}: {self.text.strip()[:_SHOWN]!r}"


class _Unpacked(gzip.GzipFile):
    """A gzip log. Raises Unfit if it unpacks to more than the limit for a file of its size."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "rb")
        self._path = path

    def read(self, size: int | None = -1) -> bytes:
        """Return up to ``size`` bytes, or all. They are unpacked in parts, and the limit is checked after each."""
        return b"".join(self._read_parts(SAMPLES_BYTES if size is None or size < 0 else size))

    def _read_parts(self, size: int) -> Iterator[bytes]:
        while size and (part := self.read1(min(size, _PART))):
            size -= len(part)
            yield part

    def read1(self, size: int = -1) -> bytes:
        """Return bytes from one read. Raises Unfit if the limit is exceeded."""
        part = super().read1(size)
        check_expansion(self._path, self.tell())
        return part


def opened(path: Path) -> BinaryIO:
    """Open a log for reading; gzip content is unpacked. Raises CanLogError for an unreadable or too long file."""
    with file_errors(path, CanLogError):
        check_size(path, SAMPLES_BYTES)
        with path.open("rb") as file:
            packed = file.read(2) == _GZIP
        return cast(BinaryIO, _Unpacked(path)) if packed else path.open("rb")


def lines_of(path: Path, account: Account) -> Iterator[Line]:
    """Yield the lines that are not empty. Raises CanLogError for an unreadable file, and for a line or a file that is
    too long.
    """
    with opened(path) as file:
        head = _peeked(path, file)
        mark, charset = next(((m, name) for m, name in _MARKS if head.startswith(m)), (b"", "latin-1"))
        file.seek(len(mark))
        text = io.TextIOWrapper(file, charset, errors="replace")
        number = taken = 0
        while True:
            try:
                line = text.readline(LINE_BYTES + 1)
            except EOFError:
                account.leave_out(EARLY, at=f"after line {number}, within packed data")
                return
            except Unfit as error:
                raise CanLogError(f"{path} {error}") from None
            except (OSError, zlib.error) as error:
                raise CanLogError(
                    f"{path} cannot be unpacked after line {number} ({type(error).__name__}); the file "
                    "is damaged or incomplete, so copy it again"
                ) from None
            if not line:
                return
            number, taken = number + 1, taken + len(line)
            if len(line) > LINE_BYTES or taken > SAMPLES_BYTES:
                one, limit = ("line", LINE_BYTES) if len(line) > LINE_BYTES else ("file", SAMPLES_BYTES)
                raise CanLogError(
                    f"{path}: line {number} exceeds the limit of {size(limit)} for one {one}; split the {one}"
                )
            bare = line.rstrip("\n").strip("\0")
            if bare.strip():
                yield Line(number, bare, line.endswith("\n") and bare == line.rstrip("\n"))
            elif "\0" in line:
                account.leave_out(CUT, at=f"line {number}, which is empty bytes")


def _peeked(path: Path, file: BinaryIO) -> bytes:
    try:
        return file.read(4)
    except (EOFError, OSError, zlib.error):
        raise CanLogError(
            f"{path} cannot be unpacked: it does not begin like a gzip file; remove the ending .gz if "
            "it is not compressed"
        ) from None


def nanoseconds(text: str) -> int | None:
    """Return the time in a text such as "12.345" (s) in whole ns, not rounded; None for any other text."""
    found = _STAMP.fullmatch(text)
    return int(found[1]) * 10**9 + int((found[2] or "").ljust(9, "0")) if found else None


def hex_bytes(words: list[str], count: int) -> bytes | None:
    """Return ``count`` bytes from ``words`` of two hexadecimal digits each; None if some are missing or invalid."""
    text = " ".join(words[:count])
    if len(words) < count or len(text) != max(3 * count - 1, 0) or text[2::3].strip():
        return None
    try:
        return bytes.fromhex(text)
    except ValueError:
        return None


def leave_out_line(account: Account, line: Line) -> None:
    """Count a line that is neither a frame nor another known content."""
    account.leave_out(UNKNOWN if line.ended else CUT, at=line.shown)
