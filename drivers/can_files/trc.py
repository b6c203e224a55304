"""PEAK's trace files, ``.trc`` from version 1.0 to 2.1; the columns depend on the version or are listed in the file."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from bench_protocol.account import Account
from bench_protocol.frames import EXTENDED_ID_MAX, STANDARD_ID_MAX
from drivers.can_files.frames import CanLogError, Frames, Kind
from drivers.can_files.text import ERRORS, EVENTS, REMOTE, Line, hex_bytes, leave_out_line, lines_of

#: Columns: Number, time Offset, Type, Bus, Identifier, direction, Reserved, L: length as a code, l: in bytes, Data.
_COLUMNS: Final = {
    "1.0": "NOIlD",
    "1.1": "NOdIlD",
    "1.2": "NOBdIlD",
    "1.3": "NOBdIRlD",
}
_VERSIONS: Final = (*_COLUMNS, "2.0", "2.1")
_LETTERS: Final = frozenset("NOTBIdRLlD")
_DATA_TYPES: Final = {"DT": False, "FD": True, "FB": True, "FE": True, "BI": True}
_SIZES: Final = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
_KEY: Final = re.compile(r";\$(\w+)\s*=\s*(.*?)\s*")
_NO_BUS: Final = "1"
_DAY: Final = 86_400 * 10**9
_EPOCH: Final = 25_569  #: days from 30 December 1899, from which STARTTIME counts, to 1970


@dataclass
class _Log:
    path: Path
    account: Account
    columns: str = ""
    start: int = 0  #: ns since 1970
    version: str = ""
    frames: Frames = field(default_factory=Frames)


def read_trc(path: Path, account: Account) -> Frames:
    """Return the data frames of a trace. Raises CanLogError for an unknown version or column."""
    log = _Log(path, account)
    log.frames.local = True
    for line in lines_of(path, account):
        text = line.text.strip()
        if found := _KEY.fullmatch(text):
            _head(log, line, found[1].upper(), found[2])
        elif not text.startswith(";"):
            _frame(log, line)
    return log.frames


def _head(log: _Log, line: Line, key: str, value: str) -> None:
    if key == "FILEVERSION":
        if log.version:
            raise CanLogError(
                f"{log.path}: a second log begins in {line.shown}; save each log in its own file"
            )
        if value not in _VERSIONS:
            raise CanLogError(f"{log.path} is of version {value}; use one of {', '.join(_VERSIONS)}")
        log.version, log.columns = value, _COLUMNS.get(value, "")
    elif key == "STARTTIME":
        try:
            log.start = round((float(value) - _EPOCH) * _DAY)
        except (ValueError, OverflowError):
            raise CanLogError(
                f"{log.path}: the start time in {line.shown} is not a number of days; write it like 43474.5"
            ) from None
        if not 0 <= log.start < 10**19 // 2:
            log.start = 0
            log.account.take(f"STARTTIME = {value} is not a date, and is not used")
    elif key == "COLUMNS":
        letters = value.split(",")
        if unknown := [one for one in letters if one not in _LETTERS]:
            raise CanLogError(
                f"{log.path}: column {unknown[0]!r} in {line.shown} is unknown; use only "
                f"{', '.join(sorted(_LETTERS))}"
            )
        lacking = [one for one in "OTI" if one not in letters]
        if lacking or not {"L", "l"} & set(letters):
            raise CanLogError(
                f"{log.path}: {line.shown} lacks the column {', '.join(lacking) or 'L or l'}; export "
                "the log again with it"
            )
        log.columns = "".join(letters)


def _frame(log: _Log, line: Line) -> None:
    if not log.columns:
        if log.version:
            raise CanLogError(
                f"{log.path}: there is no line ;$COLUMNS before the first frame; add it, because "
                f"version {log.version} needs it"
            )
        log.columns = _COLUMNS["1.0"]
    words = line.text.split()
    at = {letter: place for place, letter in enumerate(log.columns)}
    data_at = at.get("D", len(log.columns))
    if len(words) <= max(at["O"], at["I"]):
        leave_out_line(log.account, line)
        return
    time, name, fd = _milliseconds(words[at["O"]]), words[at["I"]], False
    if "T" in at:
        kind = words[at["T"]]
        if kind not in _DATA_TYPES:
            _count_other_type(log, line, kind)
            return
        fd = _DATA_TYPES[kind]
    elif "d" in at and words[at["d"]].lower() not in ("rx", "tx"):
        _count_other_type(log, line, words[at["d"]])
        return
    elif name == "FFFFFFFF":
        _count_other_type(log, line, name)
        return
    size = at["l"] if "l" in at else at["L"]
    if len(words) <= size or not words[size].isdigit() or time is None:
        leave_out_line(log.account, line)
        return
    length = int(words[size])
    if "l" not in at or (not fd and length > 8):
        length = (_SIZES[length] if fd else min(length, 8)) if length < len(_SIZES) else -1
    if words[data_at : data_at + 1] == ["RTR"]:
        log.account.leave_out(REMOTE)
        return
    _add(log, line, words[at["B"]] if "B" in at else _NO_BUS, name, fd, time, words[data_at:], length)


def _add(
    log: _Log, line: Line, bus: str, name: str, fd: bool, time: int, words: list[str], length: int
) -> None:
    extended = len(name) > 4
    identifier = int(name, 16) if re.fullmatch("[0-9A-Fa-f]{1,8}", name) else -1
    data = hex_bytes(words, length) if length in _SIZES else None
    if data is None or not 0 <= identifier <= (EXTENDED_ID_MAX if extended else STANDARD_ID_MAX):
        leave_out_line(log.account, line)
        return
    log.frames.add(log.start + time, Kind(bus, identifier, extended, fd), data, line.number)


def _count_other_type(log: _Log, line: Line, kind: str) -> None:
    """Count a line that is not a data frame, by its type."""
    low = kind.lower()
    if low == "rr":
        log.account.leave_out(REMOTE)
    elif low in ("er", "error", "ffffffff"):
        log.account.leave_out(ERRORS)
    elif low in ("st", "ec", "ev", "warng", "event", "status"):
        log.account.leave_out(EVENTS, at=line.shown)
    else:
        leave_out_line(log.account, line)


def _milliseconds(text: str) -> int | None:
    """Return the time in a text such as "12.345" (ms) in whole ns, not rounded; None for any other text."""
    whole, _, rest = text.partition(".")
    if not whole.isdigit() or (rest and not rest.isdigit()):
        return None
    return int(whole) * 10**6 + int(rest[:6].ljust(6, "0"))
