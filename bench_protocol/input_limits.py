"""Limits for files of users: bytes, columns, rows, depth, times and numbers."""

from __future__ import annotations

import re
import stat
import struct
import tomllib
import zipfile
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bench_protocol import text as file_text

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

_MiB: Final = 1 << 20
#: The error for a file that exceeds a limit.
Unfit = file_text.Unfit

#: A handwritten file, or a description: TOML, JSON, a list of registers.
DESCRIPTION_BYTES: Final = 4 * _MiB
#: A result, a note or a finding: the longest plans need some 100 KiB, and JSON takes 25 times as much memory.
RESULT_BYTES: Final = 16 * _MiB
#: A DBC: the largest known ones have some 5 MiB, and cantools takes seventy times as much memory.
DBC_BYTES: Final = 8 * _MiB
#: A quoted text of a DBC: cantools takes two hundred times as much memory.
QUOTED_BYTES: Final = 64 << 10
#: One message of a DBC (J1939 has up to 1785 bytes), and all of them: cantools makes up to 30 bytes of memory of each.
MESSAGE_BYTES: Final = 64 << 10
MESSAGES_BYTES: Final = 4 * _MiB
#: Pages of multiplexed signals that a DBC gives as ranges: cantools lists each page.
PAGES: Final = 100_000
#: One line of a table or a log as text.
LINE_BYTES: Final = _MiB
#: A table as text, which pandas takes in as a whole.
TABLE_BYTES: Final = 1024 * _MiB
#: A file of samples or of frames in binary form, or frames as lines.
SAMPLES_BYTES: Final = 4096 * _MiB
#: All files of a zip archive (an FMU, a workbook) after unpacking, and how many there may be.
UNPACKED_BYTES: Final = 512 * _MiB
UNPACKED_FILES: Final = 10_000
#: A file in an archive that is parsed as a whole, such as XML: a parser takes up to fifty times as much memory.
PARSED_BYTES: Final = 16 * _MiB
#: The directory of an archive, which is read before its files can be counted.
_DIRECTORY_BYTES: Final = 4 * _MiB
#: Unpacked size of a small packed file of samples or frames; for a larger one, a multiple of its size.
EXPANDED_BYTES: Final = 64 * _MiB
EXPANSION: Final = 50
#: Columns of a table, channels of a file, signals of a DBC.
COLUMNS: Final = 10_000
ROWS: Final = 100_000_000
#: Rows times columns: 2 GB of numbers, all in memory at once.
CELLS: Final = 250_000_000
#: Largest distance (s) of a time from zero, which may be 1970: nanoseconds in 64 bits end after 292 years.
TIME: Final = 9.0e9
#: Depth of nested tables in a file.
DEPTH: Final = 32
#: Tables that all dotted keys and headers of a TOML file may name: the parser takes 1 KiB for each.
NAMED_TABLES: Final = 200_000
#: Texts and comments of TOML. One without an end extends to the end of the line, or of the file.
_TEXT: Final = re.compile(
    r'"""(?:[^"\\]|\\.|"(?!""))*+(?:"""|\Z)' + r"|'''(?:[^']|'(?!''))*+(?:'''|\Z)"
    r'|"(?:[^"\\\n]|\\[^\n])*+"?' + r"|'[^'\n]*+'?|#[^\n]*+",
    re.DOTALL,
)
#: In a DBC: a text, with or without its end; the bytes of a message, or the first bit and the bits of a signal; pages.
_DBC_TEXT: Final = re.compile(rb'"((?:\\"|[^"])*+)"?')
_DBC_LENGTH: Final = re.compile(rb"\bBO_\s+\d+\s+\w+\s*:\s*(\d+)|:\s*(\d+)\s*\|\s*(\d+)\s*@")
_DBC_PAGES: Final = re.compile(rb"\bSG_MUL_VAL_[^;]*+")
_DBC_RANGE: Final = re.compile(rb"(\d+)\s*-\s*(\d+)")
_WHOLE: Final = 1 << 63
_NO_QUOTE: Final = "the closing quotation mark of a text is missing; add it"
_OPEN: Final = "a bracket is not closed; close it"
#: Beginnings of messages of the parser, and their replacement.
_TOML: Final = {
    "Cannot": "the key or the table occurs twice; remove one",
    "Duplicate": "the key occurs twice; remove one",
    "Expected newline": "there is text after the value; put a text between quotation marks",
    "Expected ']": _OPEN,
    "Expected '=": "the key has no value; write key = value",
    "Unclosed": _OPEN,
    "Unescaped": "the text contains \\; write \\\\, or put the text between single quotation marks",
    "Unterminated": _NO_QUOTE,
    'Expected "\'"': _NO_QUOTE,
    "Illegal character '\\n'": _NO_QUOTE,
    "Found invalid character '\\n'": _NO_QUOTE,
    "Invalid value": "the value is not valid; write a number, true, false, or a text between quotation marks",
    "Invalid date": "the date is not valid; write it like 2027-02-03",
    "": "the line is not TOML; write key = value, [table] or # comment",
}


def size(count: float) -> str:
    """Return a number of bytes as text with a unit."""
    for unit in ("bytes", "KiB", "MiB"):
        if count < 1024:
            return f"{count:.4g} {unit}"
        count /= 1024
    return f"{count:.4g} GiB"


def check_size(path: Path, limit: int) -> None:
    """Raise Unfit for a file that is not an ordinary one or exceeds ``limit`` bytes, OSError if it is missing."""
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        raise Unfit("is not an ordinary file; use the path of a file")
    if found.st_size > limit:
        raise Unfit(f"has {size(found.st_size)}; use a file of at most {size(limit)}")


def read_bounded(path: Path, limit: int = DESCRIPTION_BYTES) -> bytes:
    """Return the content of a file. Raises Unfit if it exceeds ``limit`` bytes, OSError if it cannot be read."""
    check_size(path, limit)
    with path.open("rb") as file:
        content = file.read(limit + 1)  # one byte more, because the file may grow
    if len(content) > limit:
        raise Unfit(f"has more than {size(limit)}; use a smaller file")
    return content


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file, as `parse_toml` does. Raises OSError if it cannot be read."""
    return parse_toml(read_bounded(path))


def parse_toml(content: bytes) -> dict[str, Any]:
    """Return the tables of a TOML file. Raises Unfit for invalid TOML, infinite numbers or too deep nesting.

    A leading byte order mark, as some editors write it, is ignored.
    """
    text = file_text.only_utf_8(content)
    _check_keys(text)
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        raise Unfit(f"is nested too deep; use at most {DEPTH} levels of tables or lists") from None
    except ValueError as error:  # also raised by Python for integers with thousands of digits
        raise Unfit(f"is not TOML: {_in_words(str(error), text)}") from None
    _check_value("", tables, DEPTH)
    return tables


def _check_keys(text: str) -> None:
    """Raise Unfit, before memory is allocated, for keys and headers that are too deep or name too many tables."""
    bare = re.sub(r"[ \t]+", "", _TEXT.sub('"', text))
    tables = 0
    for found in re.finditer(r"[^\s\[\]{}=,]+", bare):
        name = found[0]
        dots = name.count(".")
        if dots >= DEPTH:
            raise Unfit(f"is nested too deep in {name[:60]}; use at most {DEPTH} levels of tables or lists")
        tables += dots if dots > 1 else 0  # a number has one dot
    if tables > NAMED_TABLES:
        raise Unfit(f"names {tables} tables in dotted keys; use at most {NAMED_TABLES}, with shorter keys")


def _in_words(error: str, text: str) -> str:
    """Return the message of the parser as text, with the line it refers to."""
    place = re.search(r"\(at (?:line (\d+), column \d+|end of document)\)$", error)
    if place is None:
        return "a number has too many digits"
    lines = text.rstrip().splitlines() or [""]
    number = min(int(place[1] or len(lines)), len(lines))
    why = next((words for start, words in _TOML.items() if error.startswith(start)), _TOML[""])
    if error.startswith("Invalid value") and _is_open(text) and _is_open("\n".join(lines[:number])):
        why = _OPEN
    return f"line {number}, {lines[number - 1].strip()[:60]}: {why}"


def _is_open(text: str) -> bool:
    """Return whether a bracket of a TOML file is not closed."""
    bare = _TEXT.sub("", text)
    return any(bare.count(begin) > bare.count(end) for begin, end in ("[]", "{}"))


def _check_value(name: str, value: object, depth: int) -> None:
    if isinstance(value, dict | list):
        if not depth:
            raise Unfit(f"is nested too deep in {name[:60]}; use at most {DEPTH} levels of tables or lists")
        inner = value.items() if isinstance(value, dict) else enumerate(value, 1)
        for key, one in inner:
            _check_value(f"{name}.{key}" if name else str(key), one, depth - 1)
    elif isinstance(value, float) and not abs(value) < float("inf"):
        raise Unfit(f"has {name} = {value}; use a finite number")
    elif isinstance(value, int) and not -_WHOLE <= value < _WHOLE:
        raise Unfit(f"has {name} with an integer of more than 64 bits; use a smaller number")


def check_dbc(path: Path) -> None:
    """Raise Unfit for a DBC that needs too much memory, OSError if it cannot be read."""
    content = read_bounded(path, DBC_BYTES)
    for found in _DBC_TEXT.finditer(content):
        if len(found[1]) >= QUOTED_BYTES:
            raise Unfit(
                f"has a text of {size(len(found[1]))} in line {_line(content, found)}; use at most "
                f"{size(QUOTED_BYTES)} between quotation marks"
            )
    bare = _DBC_TEXT.sub(lambda found: b'"' + b"\n" * found[0].count(b"\n"), content)
    total = pages = 0
    for found in _DBC_LENGTH.finditer(bare):
        count = _bounded(found[1]) if found[1] else (_bounded(found[2]) + _bounded(found[3]) + 7) // 8
        if count > MESSAGE_BYTES:
            raise Unfit(
                f"has a message of {size(count)} in line {_line(bare, found)}; use at most "
                f"{size(MESSAGE_BYTES)}"
            )
        total += count if found[1] else 0
    for found in (one for said in _DBC_PAGES.finditer(bare) for one in _DBC_RANGE.finditer(said[0])):
        pages += max(0, _bounded(found[2]) - _bounded(found[1]))
    if total > MESSAGES_BYTES:
        raise Unfit(f"has messages of {size(total)} in all; use at most {size(MESSAGES_BYTES)}")
    if pages > PAGES:
        raise Unfit(f"has {pages} pages of multiplexed signals (SG_MUL_VAL_); use at most {PAGES}")


def _bounded(digits: bytes) -> int:
    """Return an integer, limited to 12 digits."""
    return int(digits[:12])


def _line(content: bytes, found: re.Match[bytes]) -> int:
    return content.count(b"\n", 0, found.start()) + 1


def check_expansion(path: Path, expanded: int) -> None:
    """Raise Unfit for a file whose samples take ``expanded`` bytes after unpacking, far more than its size."""
    packed = path.stat().st_size
    if expanded > max(EXPANDED_BYTES, EXPANSION * packed):
        raise Unfit(
            f"has {size(packed)} and unpacks to {size(expanded)} or more; the limit is {EXPANSION} "
            f"times its size, or {size(EXPANDED_BYTES)}. Save it without compression, or in parts"
        )


def check_mdf(path: Path, groups: Iterable[Any]) -> None:
    """Raise Unfit for an MDF file, opened by asammdf, whose samples take far more memory than its size."""
    total = 0
    for group in groups:
        told = group.channel_group
        record = told.samples_byte_nr + getattr(told, "invalidation_bytes_nr", 0)
        blocks = [*group.get_data_blocks()]
        blocks += [one for index in range(len(group.channels)) for one in group.get_signal_data_blocks(index)]
        total += max(told.cycles_nr * max(record, 8), sum(one.original_size or 0 for one in blocks))
        for channel in group.channels:
            texts = getattr(channel.conversion, "referenced_blocks", None) or {}
            total += told.cycles_nr * max(
                (len(one) for one in texts.values() if isinstance(one, bytes)), default=0
            )
    check_expansion(path, total)


def open_archive(path: Path, parsed: Collection[str] = ()) -> zipfile.ZipFile:
    """Open a zip archive. Raises Unfit if it is invalid or unpacks to too much, OSError if it cannot be read.

    Files named in ``parsed`` may have `PARSED_BYTES` each. `zipfile` unpacks no more of a file than its stated size.
    """
    check_size(path, UNPACKED_BYTES)
    _check_directory(path)
    try:
        archive = zipfile.ZipFile(path)
    except (zipfile.BadZipFile, ValueError, NotImplementedError, struct.error) as error:
        raise Unfit(f"is not a readable zip archive ({error}); export it again") from None
    try:
        files = archive.infolist()
        total = sum(one.file_size for one in files)
        if len(files) > UNPACKED_FILES:
            raise Unfit(f"holds {len(files)} files; use at most {UNPACKED_FILES}")
        if total > UNPACKED_BYTES:
            raise Unfit(f"unpacks to {size(total)}; use at most {size(UNPACKED_BYTES)}")
        for one in files:
            if one.filename in parsed and one.file_size > PARSED_BYTES:
                raise Unfit(
                    f"holds {one.filename} with {size(one.file_size)}; use at most "
                    f"{size(PARSED_BYTES)} for it"
                )
    except Unfit:
        archive.close()
        raise
    return archive


def _check_directory(path: Path) -> None:
    """Raise Unfit for a file that is not a zip archive, or whose directory alone is too long."""
    with path.open("rb") as file:
        length = file.seek(0, 2)
        file.seek(max(length - (1 << 16) - 42, 0))
        tail = file.read()
    place = tail.rfind(b"PK\5\6")
    if place < 0 or place + 22 > len(tail):
        raise Unfit("is not a zip archive; export it again")
    (directory,) = struct.unpack_from("<I", tail, place + 12)
    # ZIP64 has its sizes in another place. It is for more than 65 535 files or 4 GiB.
    if directory > _DIRECTORY_BYTES or tail[max(place - 20, 0) : place].startswith(b"PK\6\7"):
        raise Unfit(f"lists too many files; use at most {UNPACKED_FILES}")


def check_text_table(path: Path, delimiter: str | None = None) -> None:
    """Raise Unfit for a text table or log that is too long or too wide, OSError if it cannot be read.

    Without ``delimiter`` its lines have no columns.
    """
    check_size(path, TABLE_BYTES if delimiter else SAMPLES_BYTES)
    separator = (delimiter or "").encode()
    number = cells = 0
    with path.open("rb") as file:
        while line := file.readline(LINE_BYTES + 1):
            number += 1
            if len(line) > LINE_BYTES:
                raise Unfit(f"has more than {size(LINE_BYTES)} in line {number}; shorten the line")
            if separator:
                columns = line.count(separator) + 1
                cells += columns
                if columns > COLUMNS:
                    raise Unfit(f"has {columns} columns in line {number}; use at most {COLUMNS}")
    check_shape(number, 1, cells)


def check_shape(rows: int, columns: int, cells: int | None = None) -> None:
    """Raise Unfit for a table with too many rows, columns or cells."""
    found = rows * columns if cells is None else cells
    for count, limit, what in ((columns, COLUMNS, "columns"), (rows, ROWS, "rows"), (found, CELLS, "cells")):
        if count > limit:
            raise Unfit(f"has {count} {what}; use at most {limit}")


def check_times(seconds: npt.NDArray[np.float64], what: str = "time") -> None:
    """Raise Unfit for times (s) that are NaN or exceed nanoseconds in 64 bits."""
    import numpy as np

    wrong = ~(np.abs(seconds) <= TIME)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise Unfit(
            f"has {what} = {float(seconds[row]):g} s in row {row + 1}; use times from {-TIME:g} to {TIME:g} s"
        )
