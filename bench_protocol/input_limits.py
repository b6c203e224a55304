"""How much of somebody else's file is taken in: its bytes, columns, rows and depth, its times and its numbers."""

from __future__ import annotations

import re
import stat
import struct
import tomllib
import zipfile
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bench_protocol import text as file_text

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

_MiB: Final = 1 << 20
#: What is raised of a file that goes beyond what is taken in.
Unfit = file_text.Unfit

#: A file that people write, or that describes something: TOML, JSON, a list of registers.
DESCRIPTION_BYTES: Final = 4 * _MiB
#: A result or a finding: those of the longest plans have some 100 KiB.
RESULT_BYTES: Final = 64 * _MiB
#: A DBC: the largest that are known have some 5 MiB, and cantools takes seventy times as much memory.
DBC_BYTES: Final = 8 * _MiB
#: What stands between two quotation marks of a DBC: cantools takes two hundred times as much memory.
QUOTED_BYTES: Final = 64 << 10
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
#: Columns of a table, channels of a file, signals of a DBC.
COLUMNS: Final = 10_000
ROWS: Final = 100_000_000
#: Rows times columns: 2 GB of them are in memory at once.
CELLS: Final = 250_000_000
#: How far (s) a time may lie from zero, which may be 1970: nanoseconds in 64 bits end after 292 years.
TIME: Final = 9.0e9
#: Tables in tables, as a file for people may have them.
DEPTH: Final = 32
_WHOLE: Final = 1 << 63
#: What the parser's sentences begin with, and what is meant.
_TOML: Final = {
    "Cannot": "the key or the table is there twice",
    "Duplicate": "the key is there twice",
    "Expected newline": "something stands behind the value; a text stands between quotation marks",
    "Expected ']": "a bracket does not close",
    "Expected '=": "a key without a value; key = value would be right",
    "Unclosed": "a bracket does not close",
    "Unescaped": "a \\ in a text; \\\\, or single quotation marks around the text, would be right",
    "Unterminated": "a text does not end",
    "Invalid value": "no value; a number, true, false, or a text between quotation marks would be right",
    "Invalid date": "no date",
    "": "no TOML; key = value, [table] or # comment would be right",
}


def size(count: float) -> str:
    """Return a number of bytes in words."""
    for unit in ("bytes", "KiB", "MiB"):
        if count < 1024:
            return f"{count:.4g} {unit}"
        count /= 1024
    return f"{count:.4g} GiB"


def check_size(path: Path, limit: int) -> None:
    """Refuse what is no ordinary file, or is longer than ``limit``: Unfit. OSError if there is none."""
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        raise Unfit("is no ordinary file")
    if found.st_size > limit:
        raise Unfit(f"has {size(found.st_size)}; at most {size(limit)} are read")


def read_bounded(path: Path, limit: int = DESCRIPTION_BYTES) -> bytes:
    """Return the content of a file that has ``limit`` bytes at most, else Unfit. OSError if it cannot be read."""
    check_size(path, limit)
    with path.open("rb") as file:
        content = file.read(limit + 1)  # it may be growing
    if len(content) > limit:
        raise Unfit(f"has more than {size(limit)}; that is what is read at most")
    return content


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file, as `parse_toml` does. OSError if it cannot be read."""
    return parse_toml(read_bounded(path))


def parse_toml(content: bytes) -> dict[str, Any]:
    """Return the tables of a TOML file of which every number is finite. Unfit for what is none, or too deep.

    The byte order mark that some editors write is no part of it.
    """
    text = file_text.only_utf_8(content)
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        raise Unfit(f"is nested too deep; {DEPTH} tables or lists in one another are enough") from None
    except ValueError as error:  # also of Python itself, for whole numbers with thousands of digits
        raise Unfit(f"is not TOML: {_in_words(str(error), text)}") from None
    _check_value("", tables, DEPTH)
    return tables


def _in_words(error: str, text: str) -> str:
    """What the parser says of a text, with the line that it speaks of."""
    place = re.search(r"\(at (?:line (\d+), column \d+|end of document)\)$", error)
    if place is None:
        return "a number has too many digits"
    lines = text.rstrip().splitlines() or [""]
    number = min(int(place[1] or len(lines)), len(lines))
    why = next((words for start, words in _TOML.items() if error.startswith(start)), _TOML[""])
    return f"line {number}, {lines[number - 1].strip()[:60]}: {why}"


def _check_value(name: str, value: object, depth: int) -> None:
    if isinstance(value, dict | list):
        if not depth:
            raise Unfit(
                f"is nested too deep in {name[:60]}; {DEPTH} tables or lists in one another are enough"
            )
        inner = value.items() if isinstance(value, dict) else enumerate(value, 1)
        for key, one in inner:
            _check_value(f"{name}.{key}" if name else str(key), one, depth - 1)
    elif isinstance(value, float) and not abs(value) < float("inf"):
        raise Unfit(f"says {name} = {value}; a finite number would be right")
    elif isinstance(value, int) and not -_WHOLE <= value < _WHOLE:
        raise Unfit(f"says {name} = a whole number of more than 64 bits")


def check_dbc(path: Path) -> None:
    """Refuse a DBC that costs more memory than it is worth: Unfit. OSError if it cannot be read."""
    content = read_bounded(path, DBC_BYTES)
    for found in re.finditer(rb'"(?:\\"|[^"])*+', content):
        if found.end() - found.start() > QUOTED_BYTES:
            line = content.count(b"\n", 0, found.start()) + 1
            raise Unfit(
                f"has a text of {size(found.end() - found.start())} in line {line}; at most {size(QUOTED_BYTES)} are "
                "read between quotation marks"
            )


def open_archive(path: Path, parsed: Collection[str] = ()) -> zipfile.ZipFile:
    """Open a zip archive, unless it is none or unpacks to too much: Unfit. OSError if it cannot be read.

    Files named in ``parsed`` may have `PARSED_BYTES` each. `zipfile` unpacks no more of a file than its size here.
    """
    check_size(path, UNPACKED_BYTES)
    _check_directory(path)
    try:
        archive = zipfile.ZipFile(path)
    except (zipfile.BadZipFile, ValueError, NotImplementedError, struct.error) as error:
        raise Unfit(f"is no zip archive that can be read: {error}") from None
    try:
        files = archive.infolist()
        total = sum(one.file_size for one in files)
        if len(files) > UNPACKED_FILES:
            raise Unfit(f"holds {len(files)} files; at most {UNPACKED_FILES} are unpacked")
        if total > UNPACKED_BYTES:
            raise Unfit(f"unpacks to {size(total)}; at most {size(UNPACKED_BYTES)} are unpacked")
        for one in files:
            if one.filename in parsed and one.file_size > PARSED_BYTES:
                raise Unfit(
                    f"holds {one.filename} with {size(one.file_size)}; at most {size(PARSED_BYTES)} of it are read"
                )
    except Unfit:
        archive.close()
        raise
    return archive


def _check_directory(path: Path) -> None:
    """Refuse what is no zip archive, and an archive of which the directory alone is too long: Unfit."""
    with path.open("rb") as file:
        length = file.seek(0, 2)
        file.seek(max(length - (1 << 16) - 42, 0))
        tail = file.read()
    place = tail.rfind(b"PK\5\6")
    if place < 0 or place + 22 > len(tail):
        raise Unfit("is no zip archive")
    (directory,) = struct.unpack_from("<I", tail, place + 12)
    # ZIP64, which has its sizes elsewhere, is for more than 65 535 files or 4 GiB.
    if directory > _DIRECTORY_BYTES or tail[max(place - 20, 0) : place].startswith(b"PK\6\7"):
        raise Unfit(f"lists more than {UNPACKED_FILES} files; at most so many are unpacked")


def check_text_table(path: Path, delimiter: str | None = None) -> None:
    """Refuse a table of text, or a log, that is too long or too wide: Unfit. OSError if it cannot be read.

    Without ``delimiter`` its lines have no columns.
    """
    check_size(path, TABLE_BYTES if delimiter else SAMPLES_BYTES)
    separator = (delimiter or "").encode()
    number = cells = 0
    with path.open("rb") as file:
        while line := file.readline(LINE_BYTES + 1):
            number += 1
            if len(line) > LINE_BYTES:
                raise Unfit(
                    f"has more than {size(LINE_BYTES)} in line {number}, which is what is read at most"
                )
            if separator:
                columns = line.count(separator) + 1
                cells += columns
                if columns > COLUMNS:
                    raise Unfit(f"has {columns} columns in line {number}; at most {COLUMNS} are read")
    check_shape(number, 1, cells)


def check_shape(rows: int, columns: int, cells: int | None = None) -> None:
    """Refuse a table with more rows, columns or cells than are taken in: Unfit."""
    found = rows * columns if cells is None else cells
    for count, limit, what in ((columns, COLUMNS, "columns"), (rows, ROWS, "rows"), (found, CELLS, "cells")):
        if count > limit:
            raise Unfit(f"has {count} {what}; at most {limit} are read")


def check_times(seconds: npt.NDArray[np.float64], what: str = "time") -> None:
    """Refuse times (s) that are no numbers, or that nanoseconds in 64 bits do not hold: Unfit."""
    import numpy as np

    wrong = ~(np.abs(seconds) <= TIME)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise Unfit(
            f"has {what} = {float(seconds[row]):g} s in row {row + 1}; from {-TIME:g} to {TIME:g} s would be right"
        )


def check_finite(values: npt.NDArray[np.float64], what: str) -> None:
    """Refuse infinite numbers: Unfit. What is no number (NaN) was not measured, and passes."""
    import numpy as np

    wrong = np.isinf(values)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise Unfit(f"has {what} = {float(values[row]):g} in row {row + 1}; a finite number would be right")
