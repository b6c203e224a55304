"""candump's logs: its log form (-l, -L) and its screen output (-ta, -tA, -td, -tz, -x, -e, -a, -S, -c)."""

from __future__ import annotations

import re
from array import array
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, Literal

import numpy as np

from bench_protocol.account import Account
from bench_protocol.frames import EXTENDED_ID_MAX, STANDARD_ID_MAX
from drivers.can_files.frames import CanLogError, Frames, Kind
from drivers.can_files.text import ERRORS, REMOTE, Line, hex_bytes, leave_out_line, lines_of, nanoseconds

#: Meaning of the time stamps of a candump, if the file does not state it.
Stamps = Literal["absolute", "delta"]

_COLOUR: Final = re.compile(r"\x1b\[[0-9;]*m")
_LOG: Final = re.compile(
    r"\s*\((?P<stamp>[^()]*)\)\s+(?P<channel>\S+)\s+(?P<id>[0-9A-F]{3}|[0-9A-F]{8})#(?P<rest>[0-9A-F#R_]*)"
    r"(?P<side>\s+[RT])?\s*",
    re.IGNORECASE | re.ASCII,
)
_SHOWN: Final = re.compile(
    r"\s*(?:\((?P<stamp>[^()]*)\)\s+)?(?P<channel>\S+)\s+(?:(?:RX|TX)\s+[-B]\s+[-E]\s+)?"
    r"(?P<id>[0-9A-F]{3}|[0-9A-F]{8})\s+\[(?P<count>\d{1,2})\](?:\{[0-9A-F]+\})?(?:\s+(?P<data>.*?))?\s*",
    re.IGNORECASE | re.ASCII,
)
_ERROR_FLAG: Final = 0x2000_0000
_SWAPPED: Final = "`"
_LENGTHS: Final = frozenset({*range(9), 12, 16, 20, 24, 32, 48, 64})
#: So many rising stamps are surely times: differences rise so often in fewer than one of 5000 logs.
_SURE: Final = 8
_LARGE: Final = 10**6 * 10**9  #: ns; a larger stamp is a time of day
_MEANT: Final = "state --stamps absolute or --stamps delta"


@dataclass
class _Log:
    path: Path
    account: Account
    frames: Frames = field(default_factory=Frames)
    stamps: array[int] = field(default_factory=lambda: array("q"))  #: ns, of all lines that have one
    lines: array[int] = field(default_factory=lambda: array("q"))
    of_frame: array[int] = field(default_factory=lambda: array("q"))  #: index of the stamp of each frame
    padded: bool = False  #: a stamp has the form 000.020000, so it is not a time of day
    lengths: dict[Kind, int] = field(default_factory=dict)
    bare: str = ""  #: the first line without a stamp
    lost: str = ""  #: the first line with a stamp and an unknown form


def read_candump(path: Path, account: Account, kind: Stamps | None = None) -> Frames:
    """Return the data frames of a candump. ``kind``: the meaning of its time stamps, if known.

    Raises CanLogError if the meaning is ambiguous.
    """
    log = _Log(path, account)
    for line in lines_of(path, account):
        text = _COLOUR.sub("", line.text) if "\x1b" in line.text else line.text
        if found := _LOG.fullmatch(text):
            _log_line(log, line, found)
        elif found := _SHOWN.fullmatch(text):
            _shown_line(log, line, found)
        else:
            log.lost = log.lost or (line.shown if line.ended and "(" in text[:2] else "")
            leave_out_line(account, line)
    if log.bare:
        raise CanLogError(f"{path}: {log.bare} has no time stamp; record with candump -L or candump -ta")
    if len(log.frames):
        stamps = np.frombuffer(log.stamps, np.int64)
        if (kind or _meaning(log, stamps)) == "delta":
            if log.lost:
                raise CanLogError(
                    f"{path}: {log.lost} has an unknown form, and all later time stamps count from it; "
                    "correct the line"
                )
            account.take(
                "the time stamps count from line to line, as candump -td writes them; they are added up"
            )
            stamps = np.cumsum(stamps)
        log.frames.times = array("q", stamps[np.frombuffer(log.of_frame, np.int64)].tolist())
    return log.frames


def _meaning(log: _Log, stamps: np.ndarray) -> Stamps:
    """Return "absolute" for times, "delta" for time differences. Times only increase; differences also decrease. Raises
    CanLogError if this cannot be decided.
    """
    if len(stamps) < 2 or int(stamps.max()) >= _LARGE:
        return "absolute"
    steps = np.diff(stamps)
    rises, stands, falls = int((steps > 0).sum()), int((steps == 0).sum()), int((steps < 0).sum())
    if falls:
        to_zero = bool((stamps[1:][steps < 0] == 0).all())
        if to_zero or 4 * falls < len(steps):
            line = log.lines[int(np.argmax(steps < 0)) + 1]
            raise CanLogError(
                f"{log.path}: in line {line} the time stamps go back: the file contains two logs, or "
                f"they are differences; split the file, or {_MEANT}"
            )
        return "delta"
    if rises <= 1 and stands > 1 and int(stamps.max()) > 0:
        return "delta"  # all intervals alike: as times they would be one instant
    if log.padded and len(stamps) > 2 and rises < _SURE:
        raise CanLogError(
            f"{log.path}: {len(stamps)} lines are too few to see whether their stamps are times; {_MEANT}"
        )
    return "absolute"


def _stamped(log: _Log, line: Line, text: str | None) -> bool:
    """Store the time stamp of a line; return whether it is valid."""
    if text is None:
        log.bare = log.bare or line.shown
        return False
    time = _time(log, text)
    if time is None:
        leave_out_line(log.account, line)
        return False
    log.stamps.append(time)
    log.lines.append(line.number)
    return True


def _time(log: _Log, text: str) -> int | None:
    if "-" in text[1:]:
        try:
            day = datetime.fromisoformat(text.partition(".")[0]).replace(tzinfo=UTC)
        except ValueError:
            return None
        log.account.take("dates without a zone are taken as UTC")
        rest = nanoseconds("0." + (text.partition(".")[2] or "0"))
        return None if rest is None else int(day.timestamp()) * 10**9 + rest
    whole = text.partition(".")[0]
    log.padded |= len(whole) == 3 and whole.startswith("0")
    return nanoseconds(text)


def _log_line(log: _Log, line: Line, found: re.Match[str]) -> None:
    rest, fd = found["rest"], False
    if not _stamped(log, line, found["stamp"]):
        return
    if int(found["id"], 16) & _ERROR_FLAG:
        log.account.leave_out(ERRORS)
        return
    if rest[:1] in ("R", "r"):
        log.account.leave_out(REMOTE)
        return
    if rest.startswith("#"):
        fd, rest = True, rest[2:]
    rest = re.sub(r"_[0-9A-F]$", "", rest, flags=re.IGNORECASE)
    words = [rest[k : k + 2] for k in range(0, len(rest), 2)]
    _add(log, line, found, fd, hex_bytes(words, len(words)))


def _shown_line(log: _Log, line: Line, found: re.Match[str]) -> None:
    if not _stamped(log, line, found["stamp"]):
        return
    text, count = found["data"] or "", int(found["count"])
    if int(found["id"], 16) & _ERROR_FLAG:
        log.account.leave_out(ERRORS)
        return
    if text.lower().startswith("remote"):
        log.account.leave_out(REMOTE)
        return
    words = text.split()[:count]
    if words and _SWAPPED in words[0]:
        words = words[0].split(_SWAPPED)[::-1]
        if len(words) != count:
            words = []
    fd = len(found["count"]) == 2
    _add(log, line, found, fd, hex_bytes(words, count))


def _add(log: _Log, line: Line, found: re.Match[str], fd: bool, data: bytes | None) -> None:
    extended = len(found["id"]) == 8
    identifier = int(found["id"], 16)
    fits = identifier <= (EXTENDED_ID_MAX if extended else STANDARD_ID_MAX)
    if data is None or not fits or len(data) not in _LENGTHS or (len(data) > 8 and not fd):
        leave_out_line(log.account, line)
        return
    kind = Kind(found["channel"], identifier, extended, fd)
    if not line.ended and "#" in line.text and log.lengths.get(kind) != len(data):
        leave_out_line(log.account, line)  # the last line may be truncated
        return
    log.lengths[kind] = len(data)
    log.of_frame.append(len(log.stamps) - 1)
    log.frames.add(0, kind, data, line.number)
