"""Keys that describe the format of a table from another program, if the file itself does not define it."""

from __future__ import annotations

from typing import Literal

import msgspec

#: How a column is named: by its name, or by its number from 1.
ColumnName = str | int
Decimal = Literal[".", ","]


class FileKeys(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The keys of ``[file]``. If a key is missing, the reader derives it from the file, or requests it for an
    ambiguous file.
    """

    format: str | None = None  #: default: by the suffix
    delimiter: str | None = None
    header: bool = True
    decimal: Decimal | None = None
    skip_rows: int | None = None  #: lines above the head; default: the head is the line with the names
    encoding: str = ""
    dates: Literal["dmy", "mdy"] | None = None  #: order of day and month in dates such as 03/09/2026
    zone: str | None = None  #: of dates without a zone, such as "Europe/Berlin", with summer time

    rate: float | None = None  #: rows a second (Hz) of a table without a clock

    def __post_init__(self) -> None:
        if self.rate is not None and not 0.0 < self.rate <= 1e9:
            raise ValueError(f"rate = {self.rate:g} Hz; the rate must be more than 0 Hz and at most 1e9 Hz")
        if self.delimiter is not None and len(self.delimiter) != 1:
            raise ValueError(f'delimiter = "{self.delimiter}"; the delimiter must be one character')
        if self.skip_rows is not None and self.skip_rows < 0:
            raise ValueError(f"skip_rows = {self.skip_rows}; the number must be 0 or more")


class Source(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A column of a file, and the format of its cells."""

    column: ColumnName
    thousands: str | None = None  #: separator of thousands
    decimal: Decimal | None = None  #: if it differs from that of the file
    group: ColumnName | None = None  #: of an MDF file: number from 0, or name, of the group
    raw: bool = False  #: of an MDF file: read the raw numbers, without conversion
    time: ColumnName | None = None  #: its own column clock, if it has one
    #: Codes for a missing value: numbers, such as 9.9e37 or -9999, and texts, such as "OVLD"; []: no codes.
    null: list[float | str] | None = None
    ignore_head_unit: bool = False  #: the head of the column has a wrong or unknown unit

    @property
    def codes(self) -> list[float] | None:
        """Return the numeric codes for a missing value, or None if ``null`` is not given."""
        return None if self.null is None else [one for one in self.null if not isinstance(one, str)]


class TimeSource(Source, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The column of the clock. ``unit`` applies only to numbers, not to dates and times of day."""

    column: ColumnName = "time"
    unit: str | None = None  #: default: the unit in the head, else s
    date: ColumnName | None = None  #: the column of the dates, if ``column`` has times of day only
