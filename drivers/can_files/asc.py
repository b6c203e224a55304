"""ASC, the text log of CANalyzer, CANoe and many others.

The format is that of Vector's "CAN Logging Files, ASCII format"; a table in the tests has the variants in users' files.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from bench_protocol.account import Account
from bench_protocol.frames import EXTENDED_ID_MAX, STANDARD_ID_MAX
from drivers.can_files.frames import CanLogError, Frames, Kind
from drivers.can_files.text import (
    ERRORS,
    EVENTS,
    OVERLOAD,
    REMOTE,
    REQUESTS,
    Line,
    hex_bytes,
    leave_out_line,
    lines_of,
    nanoseconds,
)

_BASE: Final = re.compile(r"\s*base\s+(hex|dec)(?:\s+timestamps\s+(absolute|relative))?\b.*", re.IGNORECASE)
_BESIDE: Final = re.compile(
    r"\s*(date\b|internal\s|no\s+internal\s|begin\s+trigger|end\s+trigger|//)", re.IGNORECASE
)
_BLOCK: Final = re.compile(r"\s*begin\s+trigger", re.IGNORECASE)
_STAMPED: Final = re.compile(r"\s*-?\d")
_OWN_ID: Final = re.compile(r"\bID\s*=\s*(\d+)(x?)", re.IGNORECASE)
_START: Final = ("start", "of")
_NAMED: Final = "frame(s) with a name instead of the identifier"
_BASE_MEANT: Final = (
    "a line like `base hex  timestamps absolute` before the first frame, as it applies to the file"
)
_LENGTHS: Final = "CAN FD frame(s) whose columns DLC and data length do not agree"
_FDF, _REMOTE_FLAG = 0x1000, 0x10
_SIZES: Final = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)


@dataclass
class _Log:
    path: Path
    account: Account
    frames: Frames = field(default_factory=Frames)
    base: int = 0  #: 10 or 16; 0 before the line that states it
    relative: bool = False
    clock: int = 0  #: ns
    blocks: int = 0
    names: str = ""  #: the first name instead of an identifier
    letters: str = ""  #: the first identifier that may be a name


def read_asc(path: Path, account: Account) -> Frames:
    """Return the data frames of an ASC file. Raises CanLogError, with the line, for ambiguous content."""
    log = _Log(path, account)
    for line in lines_of(path, account):
        if _STAMPED.match(line.text):
            _timed(log, line)
        elif found := _BASE.fullmatch(line.text):
            if log.base:
                raise CanLogError(
                    f"{path}: a second log begins in {line.shown}; save each log in its own file"
                )
            log.base = 16 if found[1].lower() == "hex" else 10
            log.relative = (found[2] or "").lower() == "relative"
        elif _BESIDE.match(line.text):
            log.blocks += bool(_BLOCK.match(line.text))
            if log.blocks > 1 and log.relative:
                raise CanLogError(
                    f"{path}: a second block begins in {line.shown}, and relative time stamps do not "
                    "state its time; save each block in its own file"
                )
        else:
            _unknown(log, line)
    if log.names and log.letters:
        raise CanLogError(
            f"{path} has names instead of identifiers ({log.names}), and {log.letters} may be names or "
            "numbers; export the log with numeric identifiers"
        )
    if log.names and not log.frames:
        raise CanLogError(
            f"{path} has names instead of identifiers ({log.names}), without numbers (ID = 256); export "
            "the log with numeric identifiers"
        )
    if log.relative:
        account.take("the time stamps count from line to line, as the file says; they are added up")
    return log.frames


def _unknown(log: _Log, line: Line) -> None:
    if log.relative and line.ended:
        raise CanLogError(
            f"{log.path}: {line.shown} has an invalid time stamp, and all later ones count from it; "
            "correct the line"
        )
    leave_out_line(log.account, line)


def _timed(log: _Log, line: Line) -> None:
    words = line.text.split()
    stamp = nanoseconds(words[0].removeprefix("-"))
    if stamp is not None and words[0].startswith("-"):
        stamp = None if log.relative else -stamp  # before the trigger
    if stamp is None:
        _unknown(log, line)
        return
    if not log.base:
        raise CanLogError(f"{log.path} does not state whether its numbers are hexadecimal; add {_BASE_MEANT}")
    log.clock = log.clock + stamp if log.relative else stamp
    if len(words) > 2 and words[1].lower() == "canfd":
        _fd(log, line, words[2:])
    elif len(words) > 2 and words[1].isdigit():
        _classic(log, line, words[1:])
    elif tuple(word.lower() for word in words[1:3]) != _START:
        if len(words) < 3 and not line.ended:
            leave_out_line(log.account, line)
        else:
            log.account.leave_out(EVENTS, at=line.shown)


def _count_other_line(log: _Log, line: Line, word: str) -> bool:
    """Count a line with an error, overload or event instead of a frame; return False for any other line."""
    low = word.lower()
    known = {"errorframe": ERRORS, "overloadframe": OVERLOAD, "statistic:": EVENTS}
    for begin, what in known.items():
        if low.startswith(begin):
            log.account.leave_out(what, at=line.shown if what == EVENTS else "")
            return True
    return False


def _classic(log: _Log, line: Line, words: list[str]) -> None:
    """Add a frame ``1  100x  Rx  d 8 00 01 …``: channel, identifier, direction, kind, length, data."""
    if _count_other_line(log, line, words[1]):
        return
    direction, kind = [*words[2:4], "", ""][:2]
    if direction.lower() not in ("rx", "tx", "txrq") or kind.lower() not in ("d", "r"):
        if len(words) > 2 and words[1].lower() in ("can", "status", "status:", "chip"):
            log.account.leave_out(EVENTS, at=line.shown)
        else:
            leave_out_line(log.account, line)
        return
    if direction.lower() == "txrq":
        log.account.leave_out(REQUESTS)
        return
    if kind.lower() == "r":
        log.account.leave_out(REMOTE)
        return
    length = _number(words[4] if len(words) > 4 else "", 16)
    data = None if length is None or length > 15 else _data(log, line, words[5:], min(length, 8))
    _add(log, line, words[0], words[1], False, data)


def _fd(log: _Log, line: Line, words: list[str]) -> None:
    """Add a frame ``1 Rx  101  [name]  1 0 8  8 00 …  duration bits flags``.

    The four numbers before the data are BRS, ESI, DLC and length.
    """
    if any(_count_other_line(log, line, word) for word in words[2:3]):
        return
    if len(words) > 1 and words[1].lower() == "txrq":
        log.account.leave_out(REQUESTS)
        return
    rest = words[3:]
    if rest and rest[0] not in ("0", "1"):
        rest = rest[1:]  # the name of the message
    if len(rest) < 4 or words[1].lower() not in ("rx", "tx") or {rest[0], rest[1]} - {"0", "1"}:
        leave_out_line(log.account, line)
        return
    code, length = _number(rest[2], 16), _number(rest[3], 10)
    if code is None or length is None:
        leave_out_line(log.account, line)
        return
    if code > 15:  # some write the code as a decimal number
        code = _number(rest[2], 10) or code
    if code > 15 or length not in (0, _SIZES[code]):
        log.account.leave_out(
            _LENGTHS,
            at=f"line {line.number}: DLC {rest[2]} before data length {rest[3]}"
            if line.ended
            else line.shown,
        )
        return
    behind = rest[4 + length :]
    flags = _number(behind[2], 16) if len(behind) > 2 else None
    if (flags or 0) & _REMOTE_FLAG or (code and not length):
        log.account.leave_out(REMOTE)
        return
    fd = length > 8 or not flags or bool(flags & _FDF)  # some write no flags, or 0 for all of them
    _add(log, line, words[0], words[2], fd, _data(log, line, rest[4:], length))


def _add(log: _Log, line: Line, channel: str, name: str, fd: bool, data: bytes | None) -> None:
    if data is None:
        leave_out_line(log.account, line)
        return
    extended = name[-1:].lower() == "x"
    identifier = _number(name[:-1] if extended else name, log.base)
    identifier_text = _OWN_ID.search(line.text) if "=" in line.text else None
    if identifier is None or (identifier_text and name[:1].isalpha()):
        if identifier_text is None:
            log.names = log.names or f"{name} in line {line.number}"
            log.account.leave_out(_NAMED, at=line.shown)
            return
        identifier, extended = int(identifier_text[1]), bool(identifier_text[2])
    elif name[:1].isalpha():
        log.letters = log.letters or f"{name} in line {line.number}"
    if identifier > (EXTENDED_ID_MAX if extended else STANDARD_ID_MAX):
        leave_out_line(log.account, line)
        return
    log.frames.add(log.clock, Kind(channel, identifier, extended, fd), data, line.number)


def _data(log: _Log, line: Line, words: list[str], count: int) -> bytes | None:
    if log.base == 16:
        return hex_bytes(words, count)
    numbers = [_number(word, 10) for word in words[:count]]
    whole = len(numbers) == count and all(one is not None and one < 256 for one in numbers)
    # A truncated decimal number is also a number.
    if not whole or (count and not line.ended and len(words) == count):
        return None
    return bytes(one for one in numbers if one is not None)


def _number(text: str, base: int) -> int | None:
    digits = "0123456789abcdef"[:base]
    return int(text, base) if text and not set(text.lower()) - set(digits) and len(text) < 12 else None
