"""Reads tables from text. It detects encoding, delimiter and head. Every row must have a cell for each name in the
head.
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bench_protocol.input_limits import TABLE_BYTES, Unfit, check_text_table, read_bounded
from bench_protocol.os_errors import file_errors
from bench_protocol.text import UTF_8, WINDOWS, decode
from bench_protocol.unit_names import is_unit, unit_in_name
from bench_records.layout import RecordError
from bench_records.tables.numbers import INFINITE, MISSING
from bench_records.tables.sheet import Column, Sheet
from bench_records.tables.stamps import looks_like_a_stamp

if TYPE_CHECKING:
    from bench_protocol.account import Account
    from bench_records.tables.keys import ColumnName, FileKeys

csv.field_size_limit(TABLE_BYTES)  # input_limits already bounds lines, so a cell needs no smaller limit
_DELIMITERS: Final = (";", "\t", "|", ",", " ")
_LOOKED_AT: Final = 400  # lines, for the head
_BATCH: Final = 50_000
_LIKE_A_NUMBER: Final = re.compile(r"[-+\u2212]?[\d.,'\u2019\u00a0\u202f ]*\d[\d.,]*([eE][-+]?\d+)?")
_MISSING: Final = frozenset((*MISSING, *INFINITE))


def is_value(cell: str) -> bool:
    """Return whether a cell contains a number, a time, or a word for a missing value."""
    text = cell.strip()
    return bool(
        text and (_LIKE_A_NUMBER.fullmatch(text) or text.upper() in _MISSING or looks_like_a_stamp(text))
    )


def read_text_table(path: Path, keys: FileKeys, wanted: Sequence[ColumnName], account: Account) -> Sheet:
    """Return the sheet of a text table. The head is the line with the ``wanted`` names.

    Raises RecordError, with line, for a row with more or fewer cells than the head, and for text between the rows.
    """
    lines = text_lines(path, keys.encoding, account)
    _refuse_segments(path, lines)
    delimiter = keys.delimiter or _delimiter(lines, keys, wanted)
    with file_errors(path, RecordError):
        check_text_table(path, delimiter)
    start, head = _head(lines, keys, delimiter, wanted)
    if keys.skip_rows is None and start > bool(head):
        above = sum(bool(line.strip()) for line in lines[: start - bool(head)])
        account.leave_out("line(s) above the head", above - lines[0].lower().startswith("sep="))
    reading = _Rows(path, lines, delimiter, start, head)
    reading.read()
    return reading.sheet(account)


def _refuse_segments(path: Path, lines: Sequence[str]) -> None:
    """Raise RecordError for a LabVIEW measurement file with more than one segment."""
    if not lines[0].startswith("LabVIEW Measurement"):
        return
    ends = [number for number, line in enumerate(lines, 1) if line.startswith("***End_of_Header***")]
    if len(ends) > 2:  # the first one is that of the file
        raise RecordError(
            f"{path}: line {ends[2]} ends the head of a second segment (***End_of_Header***), but only one segment can "
            "be read; split the file before this head"
        )


def text_lines(path: Path, encoding: str, account: Account) -> list[str]:
    """Return the lines of a text file, without line ends. Raises RecordError if the file is not text."""
    with file_errors(path, RecordError):
        content = read_bounded(path, TABLE_BYTES)
        try:
            text, name = decode(content, encoding)
        except Unfit:
            if b"\0" not in content:
                raise
            text, name = decode(_without_zeros(content, account), encoding)
    if name == WINDOWS and not encoding:
        account.take('the text is not UTF-8 and is read as cp1252 (encoding = "cp1252")')
    elif name != UTF_8 and not encoding:
        account.take(f"the text is in {name}")
    if not text.strip("\x1a\r\n\t ,;"):
        raise RecordError(
            f"{path} is empty; a table needs a head with the names of the columns, and rows below it"
        )
    return io.StringIO(text.rstrip("\x1a"), newline=None).read().split("\n")


def _without_zeros(content: bytes, account: Account) -> bytes:
    """Return the content without lines that contain a byte 0, for example after a power cut. They are counted in
    ``account``. Content with many such lines is returned unchanged, because it is not text.
    """
    lines = content.split(b"\n")
    cut = [number for number, line in enumerate(lines, 1) if b"\0" in line]
    if len(cut) * 10 > len(lines):
        return content  # no text has so many
    account.leave_out("line(s) with bytes 0, as after a power cut", len(cut), f"line {cut[0]}")
    return b"\n".join(b"" if b"\0" in line else line for line in lines)


def rows_of(lines: Sequence[str], delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of the last line (from 1) and the cells of each row in a text. Raises csv.Error for invalid
    text.
    """
    if delimiter == " ":
        for number, line in enumerate(lines, 1):
            yield number, line.split()
        return
    reader = csv.reader(
        (line + "\n" for line in lines), delimiter=delimiter, skipinitialspace=True, strict=True
    )
    for row in reader:
        yield reader.line_num, row


def cells_of(lines: Sequence[str], delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Yield rows like `rows_of`, but quotation marks do not join lines, and spaces around cells are removed."""
    yield from enumerate(_lenient(lines, delimiter), 1)


def _lenient(lines: Sequence[str], delimiter: str) -> list[list[str]]:
    """Return one row of cells for each line. Quotation marks do not join lines."""
    if delimiter == " ":
        return [line.split() for line in lines]
    found = []
    for line in lines:
        row = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
        found.append([cell.strip() for cell in row])
    return found


def _delimiter(lines: Sequence[str], keys: FileKeys, wanted: Sequence[ColumnName]) -> str:
    """Return the delimiter: that of a first line ``sep=``, else the one that separates most of the ``wanted`` names. If
    several separate as many, the largest share of values decides, then the number of rows of equal width.
    """
    if lines[0].lower().startswith("sep=") and len(lines[0].strip()) == 5:
        return lines[0].strip()[-1]
    looked = lines[:_LOOKED_AT]
    names = {name for name in wanted if isinstance(name, str)}
    scores: dict[str, tuple[float, ...]] = {}
    for one in _DELIMITERS:
        rows = [row for row in _lenient(looked, one) if any(row)]
        found = max((len(names & set(row)) for row in rows), default=0) if keys.header else 0
        widths = Counter(len(row) for row in rows if len(row) > 1)
        width, count = widths.most_common(1)[0] if widths else (1, 0)
        cells = [cell for row in rows if len(row) == width for cell in row if cell]
        values = sum(map(is_value, cells)) / max(len(cells), 1)
        # A space is the last choice, because dates and names contain spaces.
        scores[one] = (found, one != " " and count > 0, count > 0, round(values, 2), count, width)
    return max(scores, key=lambda one: scores[one])


def _head(
    lines: Sequence[str], keys: FileKeys, delimiter: str, wanted: Sequence[ColumnName]
) -> tuple[int, list[str]]:
    """Return the index of the first line below the head, and the names in the head. Without a head there are no
    names.
    """
    skipped = keys.skip_rows or 0
    if keys.skip_rows is None and lines[0].lower().startswith("sep="):
        skipped = 1
    rows = _lenient(lines[: skipped + _LOOKED_AT], delimiter)
    if not keys.header:
        first = next(
            (index for index in range(skipped, len(rows)) if sum(map(is_value, rows[index])) > 1), skipped
        )
        return (skipped if keys.skip_rows is not None else first), []
    there = [index for index in range(skipped, len(rows)) if any(rows[index])]
    names = {name for name in wanted if isinstance(name, str)}
    best = there[0] if there else 0
    if keys.skip_rows is None and there:
        # Among rows with equally many of the names the first one, or the first one with more than one cell.
        best = max(
            there, key=lambda index: (len(names & set(_names(rows[index]))), len(rows[index]) > 1, -index)
        )
    return best + 1, _names(rows[best]) if rows and there else []


def _names(row: Sequence[str]) -> list[str]:
    """Return the names in a head, without a mark of a comment."""
    if row and row[0][:1] in ("#", "%"):
        first = row[0].lstrip("#% ")
        row = [first, *row[1:]] if first else row[1:]
    return list(row)


@dataclass
class _Rows:
    """The lines below a head, separated into rows of values and other lines."""

    path: Path
    lines: Sequence[str]
    delimiter: str
    start: int
    head: list[str]
    width: int = 0
    batches: list[list[Any]] = field(default_factory=list)  #: by column, Arrow arrays
    numbers: list[int] = field(default_factory=list)
    above: list[tuple[int, list[str]]] = field(default_factory=list)  #: text between head and first row
    below: list[tuple[int, list[str]]] = field(default_factory=list)  #: text, perhaps below the last row
    comments: int = 0
    empty: int = 0
    cut: int = 0
    trailing: bool = False

    def read(self) -> None:
        """Read all lines. Raises RecordError for a line that is neither a row of values nor another known line."""
        self.width = len(self.head)
        while self.width and not self.head[self.width - 1]:
            self.width -= 1
        rows = rows_of(self.lines[self.start :], self.delimiter)
        number = self.start
        try:
            while batch := list(islice(rows, _BATCH)):
                good = []
                for number, row in batch:
                    if self._is_row(self.start + number, row):
                        good.append(row)
                        self.numbers.append(self.start + number)
                self._append_rows(good)
        except csv.Error:
            raise RecordError(
                f"{self.path}: a quotation mark after line {number} is not closed; close or remove it"
            ) from None

    def _is_row(self, line: int, row: list[str]) -> bool:
        filled = sum(bool(cell.strip()) for cell in row)
        if not filled:
            self.empty += bool(row)
            return False
        if row[0][:1] in ("#", "%") and row[0].upper() not in _MISSING:
            self.comments += 1
            return False
        values = row[0][:1].isdigit() or any(map(is_value, row))
        if values and not self._is_units(row):
            self.width = self.width or len(row)
            if len(row) > self.width and not any(cell.strip() for cell in row[self.width :]):
                self.trailing = True
                del row[self.width :]
            if len(row) < self.width and line >= len(self.lines):
                self.cut = line  # no line end follows: the writer was interrupted
                return False
            if len(row) != self.width:
                raise RecordError(self._wrong_width(line, row))
            if self.below:
                raise RecordError(self._text_between())
            return True
        (self.below if self.numbers else self.above).append((line, row))
        if len(self.above) > _LOOKED_AT:
            raise RecordError(
                f"{self.path}: there are no rows of numbers below line {self.start}; correct file.delimiter or "
                "file.skip_rows"
            )
        return False

    def _is_units(self, row: list[str]) -> bool:
        """Return whether a row contains units. It is below the head, and contains no number except the unit 1."""
        if self.numbers or not self.head:
            return False
        cells = [cell.strip() for cell in row if cell.strip()]
        return _mostly_units(cells) and not any(
            is_value(cell) and cell.strip("[]()") not in ("1", "-") for cell in cells
        )

    def _wrong_width(self, line: int, row: list[str]) -> str:
        other = "the head has" if self.head else "those before it have"
        return (
            f"{self.path}: line {line} has {len(row)} cells, but {other} {self.width}; correct the line, or "
            f'file.delimiter, now "{self.delimiter}"'
        )

    def _text_between(self) -> str:
        line, row = self.below[0]
        if [cell.strip() for cell in row][: self.width] == self.head[: self.width] and self.head:
            return f"{self.path}: line {line} is the head again: these are two tables; split the file there"
        text = self.delimiter.join(row)[:40]
        return (
            f'{self.path}: line {line}, "{text}", is text between rows of values; remove the line, or split the file '
            "there"
        )

    def _append_rows(self, rows: list[list[str]]) -> None:
        import pyarrow as pa

        if not rows:
            return
        if not self.batches:
            self.batches = [[] for _ in range(self.width)]
        for index, cells in enumerate(zip(*rows, strict=True)):
            self.batches[index].append(pa.array(cells, pa.large_string()))

    def sheet(self, account: Account) -> Sheet:
        """Return the rows of values as a sheet. The other lines are counted in ``account``."""
        import numpy as np
        import pyarrow as pa

        units = self._units(account)
        self._count_left_out(account)
        empty = pa.array([], pa.large_string())
        names = self.head[: self.width] or [str(index + 1) for index in range(self.width)]
        columns = []
        for index, name in enumerate(names):
            cells = pa.concat_arrays(self.batches[index]) if self.batches else empty
            columns.append(Column(name, "text", cells, unit=units[index] if index < len(units) else ""))
        return Sheet(self.path, columns, np.array(self.numbers, np.int64), delimiter=self.delimiter)

    def _units(self, account: Account) -> list[str]:
        """Return the unit of each column, which is in a row below the head or in the names. It is "" if there is
        none.
        """
        units = [unit_in_name(name) for name in self.head[: self.width]]
        for line, row in self.above:
            if self._is_units(row) or _mostly_units([cell.strip() for cell in row if cell.strip()]):
                units = [cell.strip() or named for cell, named in zip_longest(row, units, fillvalue="")]
                self.above.remove((line, row))
                account.take(f"line {line} is read as units: {', '.join(units)[:120]}")
                break
        return units

    def _count_left_out(self, account: Account) -> None:
        for rows, where in ((self.above, "between head and values"), (self.below, "below the values")):
            if rows:
                account.leave_out(f"line(s) of text {where}", len(rows), f"line {rows[0][0]}")
        account.leave_out("comment line(s)", self.comments)
        account.leave_out("row(s) of empty cells", self.empty)
        if self.cut:
            account.leave_out("row within which the file ends", 1, f"line {self.cut}")
        if self.trailing:
            account.take("an empty field at the end of rows is ignored")


def _mostly_units(cells: Sequence[str]) -> bool:
    known = [cell for cell in cells if cell.strip("[]()") not in ("1", "-") and is_unit(cell)]
    others = [cell for cell in cells if not is_unit(cell)]
    return len(known) > 0 and len(known) >= len(others)
