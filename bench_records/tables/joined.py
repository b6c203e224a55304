"""Joins two columns, with dates and with times of day, to one clock column."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from bench_records.layout import RecordError
from bench_records.tables.numbers import without_missing
from bench_records.tables.sheet import Column
from bench_records.tables.stamps import (
    DAY,
    NotAStamp,
    Stamps,
    looks_like_a_date,
    looks_like_a_stamp,
    looks_like_a_time_of_day,
    read_stamps,
)

if TYPE_CHECKING:
    from bench_protocol.account import Account
    from bench_records.tables.keys import ColumnName, FileKeys
    from bench_records.tables.sheet import Sheet

_RIGHT: Final = "use adjacent columns with dates as 2026-03-19 and times of day as hh:mm:ss"


def date_and_time(sheet: Sheet) -> tuple[int, int] | None:
    """Return the indices of the columns of dates and of times of day, or None unless there is exactly one of each."""
    dates = [index for index, one in enumerate(sheet.columns) if _holds_dates(one)]
    times = [index for index, one in enumerate(sheet.columns) if _holds_times(one)]
    return (dates[0], times[0]) if len(dates) == 1 and len(times) == 1 else None


def joined(sheet: Sheet, date: ColumnName, time: int, keys: FileKeys, account: Account, where: str) -> int:
    """Append a clock column, made from a column of dates and a column of times of day. Return its index.

    Raises RecordError, whose text begins with ``where``, if a column does not contain dates or times of day.
    """
    columns = sheet.columns[sheet.place(date, f"{where}: date")], sheet.columns[time]
    for column, holds in zip(columns, (_holds_dates, _holds_times), strict=True):
        if not holds(column):
            what = "dates" if column is columns[0] else "times of day"
            raise RecordError(f'{where}: the column "{column.name}" does not hold {what}; {_RIGHT}')
    days = _of_text(sheet, columns[0], keys, where) if columns[0].kind == "text" else _of_type(columns[0])
    times = _of_text(sheet, columns[1], keys, where) if columns[1].kind == "text" else _of_type(columns[1])
    if (days.ns % DAY).any() or days.zoned:
        raise RecordError(
            f'{where}: the column of dates "{columns[0].name}" has times of day or zones, too; {_RIGHT}'
        )
    for sentence in days.remarks:
        account.take(sentence)
    account.take(f"the columns {columns[0].name} and {columns[1].name} are one clock")
    there = days.there & times.there
    cells = (days.ns + times.ns % DAY) * there
    if not days.dated and there.any():  # the order of day and month is unknown
        cells = (cells - cells[there][0]) * there
    name = f"{columns[0].name} {columns[1].name}"
    sheet.columns.append(Column(name, "stamp" if days.dated else "span", cells, there=there))
    return len(sheet.columns) - 1


def refuse_halves(sheet: Sheet, clock: int, where: str) -> None:
    """Raise RecordError if a separate column contains the a.m. or p.m. of the times of day."""
    column = sheet.columns[clock]
    if column.kind == "number" or (column.kind == "text" and not looks_like_a_stamp(column.example)):
        return
    for other in sheet.columns:
        if other.kind == "text" and re.fullmatch(r"[ap]\.?\s?m\.?", other.example, re.IGNORECASE):
            raise RecordError(
                f'{where}: a.m. and p.m. are in a separate column, "{other.name}"; write them behind the times in '
                "the same column"
            )


def _holds_dates(column: Column) -> bool:
    if column.kind == "text":
        return looks_like_a_date(column.example)
    return column.kind == "stamp" and not (column.cells[column.there] % DAY).any()


def _holds_times(column: Column) -> bool:
    return looks_like_a_time_of_day(column.example) if column.kind == "text" else bool(column.of_day)


def _of_type(column: Column) -> Stamps:
    assert column.there is not None
    return Stamps(column.cells + column.begin, column.there, True, column.zoned, ())


def _of_text(sheet: Sheet, column: Column, keys: FileKeys, where: str) -> Stamps:
    cells = without_missing(sheet, sheet.columns.index(column), None).to_pylist()
    try:
        return read_stamps(cells, keys.dates)
    except NotAStamp as error:
        raise RecordError(f"{where}: {column.name}: {error.text(cells, sheet.at)}") from None
