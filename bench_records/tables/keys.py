"""The keys that say how a foreign table is to be read, as far as the file does not say it itself."""

from __future__ import annotations

from typing import Literal

import msgspec

#: How a column is named: by its name, or by its number from 1.
ColumnName = str | int
Decimal = Literal[".", ","]


class FileKeys(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``[file]``: what is not given is recognised where it is certain, and asked for where it is not."""

    format: str | None = None  #: else the suffix says it
    delimiter: str | None = None
    header: bool = True
    decimal: Decimal | None = None
    skip_rows: int | None = None  #: lines above the head; else the head is where the names are
    encoding: str = ""
    dates: Literal["dmy", "mdy"] | None = None  #: what 03/09/2026 is
    zone: str | None = None  #: of dates that name none, such as "Europe/Berlin": summer time

    rate: float | None = None  #: rows a second (Hz) of a table without a clock

    def __post_init__(self) -> None:
        if self.rate is not None and not 0.0 < self.rate <= 1e9:
            raise ValueError(f"rate = {self.rate:g} Hz; more than 0, up to 1e9, would be right")
        if self.delimiter is not None and len(self.delimiter) != 1:
            raise ValueError(f'delimiter = "{self.delimiter}"; one character would be right')
        if self.skip_rows is not None and self.skip_rows < 0:
            raise ValueError(f"skip_rows = {self.skip_rows}; 0 or more would be right")


class Source(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Which column of a file is meant, and what is special about its cells."""

    column: ColumnName
    thousands: str | None = None  #: what stands between digits in threes
    decimal: Decimal | None = None  #: where it differs from that of the file
    group: ColumnName | None = None  #: of an MDF file: number from 0, or name, of the group
    raw: bool = False  #: of an MDF file: the numbers that stand there, not what they are converted to
    time: ColumnName | None = None  #: the column of its own clock, where it has one
    #: What stands for no value: numbers, such as 9.9e37 or -9999, and texts, such as "OVLD"; []: nothing does.
    null: list[float | str] | None = None
    ignore_head_unit: bool = False  #: the head of the column states a wrong unit, or none that is known

    @property
    def codes(self) -> list[float] | None:
        """The numbers that stand for no value; None where nothing is said of it."""
        return None if self.null is None else [one for one in self.null if not isinstance(one, str)]


class TimeSource(Source, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The column of the clock; ``unit`` is that of numbers, dates and times of day need none."""

    column: ColumnName = "time"
    unit: str | None = None  #: else the head says it, or it is s
    date: ColumnName | None = None  #: the column of the dates, where the other one holds times of day only
