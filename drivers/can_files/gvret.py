"""SavvyCAN's logs in GVRET format: a table with time in µs, identifier, length and a column for each byte."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from bench_protocol.account import Account
from bench_protocol.frames import EXTENDED_ID_MAX, LENGTH_MAX, STANDARD_ID_MAX
from drivers.can_files.frames import CanLogError, Frames, Kind
from drivers.can_files.text import hex_bytes, leave_out_line, lines_of

_NEEDED: Final = ("Time Stamp", "ID", "Extended", "Bus", "LEN", "D1")
HEAD: Final = ",".join(_NEEDED[:3])
_FLAGS: Final = {"true": True, "1": True, "false": False, "0": False}


def is_gvret(path: Path) -> bool:
    """Return whether a file begins with the head of a GVRET log; its name does not matter."""
    try:
        first = next(lines_of(path, Account()), None)
    except CanLogError:
        return False
    return first is not None and first.text.startswith(HEAD)


def read_gvret(path: Path, account: Account) -> Frames:
    """Return the data frames of a log. Raises CanLogError if a column is missing."""
    lines, frames = lines_of(path, account), Frames()
    head = next(lines, None)
    names = [] if head is None else [name.strip() for name in head.text.split(",")]
    if lacking := [name for name in _NEEDED if name not in names]:
        raise CanLogError(
            f"{path}: line 1 has no column {', '.join(lacking)}; SavvyCAN writes {', '.join(_NEEDED)}"
        )
    time_at, name_at, extended_at, bus_at, length_at, data_at = (names.index(one) for one in _NEEDED)
    for line in lines:
        cells = [cell.strip() for cell in line.text.split(",")]
        cells += [""] * (len(names) - len(cells))
        time, name, length = cells[time_at], cells[name_at], cells[length_at]
        extended = _FLAGS.get(cells[extended_at].lower())
        if not (time.isdigit() and length.isdigit()) or extended is None or int(length) > LENGTH_MAX:
            leave_out_line(account, line)
            continue
        identifier = (
            hex_bytes([name.zfill(8)[k : k + 2] for k in (0, 2, 4, 6)], 4) if len(name) <= 8 else None
        )
        data = hex_bytes(cells[data_at : data_at + int(length)], int(length))
        highest = EXTENDED_ID_MAX if extended else STANDARD_ID_MAX
        if identifier is None or data is None or int.from_bytes(identifier, "big") > highest:
            leave_out_line(account, line)
            continue
        kind = Kind(cells[bus_at], int.from_bytes(identifier, "big"), extended, False)
        frames.add(int(time) * 1000, kind, data, line.number)
    return frames
