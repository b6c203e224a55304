"""Reads tables from other programs: the samples of each column with their times, from CSV, Parquet, Arrow and MDF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from bench_protocol.file_forms import FileForm, form_of
from bench_protocol.unit_names import unit_in_name
from bench_records.layout import SECOND, RecordError
from bench_records.tables import mdf as mdf_file
from bench_records.tables.clock import Clock, check_order, read_clock
from bench_records.tables.forms import FORMS, export_of
from bench_records.tables.joined import joined, refuse_halves
from bench_records.tables.keys import ColumnName, FileKeys, Source, TimeSource
from bench_records.tables.numbers import DecimalPoint, numbers, of_the_file
from bench_records.tables.sheet import Column

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from bench_protocol.account import Account
    from bench_records.tables.sheet import Sheet

    Numbers = npt.NDArray[np.float64]

MDF: Final = next(one for one in FORMS if one.name == "mdf")


class Series(NamedTuple):
    """The samples of a column: times (n,) in s, and values (n,) in the unit of the file. An empty cell has NaN."""

    name: str
    times: Numbers
    values: Numbers
    unit: str = ""  #: as in the file, "" if it is not there
    start: int | None = None  #: time of 0 s, in ns since 1970, if the file states it
    rows: npt.NDArray[np.int64] | None = None  #: the row of each sample in the file
    row_word: str = "sample"

    def at(self, index: int) -> str:
        """Return a text on the position of a sample in the file, and its time."""
        row = index + 1 if self.rows is None else self.rows[index]
        return f"{self.row_word} {row}, {self.times[index]:.6g} s"


def format_of(path: Path, keys: FileKeys) -> FileForm:
    """Return the file format of a table. Raises RecordError if there is no file, or if its suffix is unknown."""
    if not path.is_file():
        raise RecordError(f"{path} does not exist; check the path")
    named = [one for one in FORMS if one.name == keys.format]
    form = named[0] if named else None if keys.format else form_of(path, FORMS)
    if form is None or (form.read is None and form is not MDF):
        known = ", ".join(f'"{one.name}"' for one in FORMS if one.read is not None or one is MDF)
        choice = f'file.format = "{keys.format}"' if keys.format else f'the suffix "{path.suffix}"'
        if not keys.format and (how := export_of(path)):
            raise RecordError(
                f"{path}: files of this format are not read; convert the file to a table with: {how}"
            )
        raise RecordError(f"{path}: {choice} is not a known format; give file.format = one of {known}")
    return form


def read_sheet(path: Path, keys: FileKeys, wanted: Sequence[ColumnName], account: Account) -> Sheet:
    """Return the sheet of a file. Raises RecordError for an MDF file, which is not a table."""
    form = format_of(path, keys)
    if form.read is None:
        raise RecordError(
            f"{path} is an MDF file, but a table is needed; convert it to CSV, Parquet or Arrow"
        )
    sheet: Sheet = form.read(path, keys, wanted, account)
    if keys.rate is not None:
        _add_clock(sheet, keys.rate)
    return sheet


def _add_clock(sheet: Sheet, rate: float) -> None:
    """Append a clock column for ``rate`` rows per second. Raises RecordError if the file already has a clock."""
    if sheet.clock is not None or any(sheet.places(name) for name in (TimeSource().column, "time_s")):
        raise RecordError(
            f"{sheet.path} has a time column, and file.rate is for tables without one; remove file.rate"
        )
    sheet.clock = len(sheet.columns)
    seconds = ((sheet.rows * 0 + 1).cumsum() - 1) / rate
    sheet.columns.append(Column(f"of {rate:g} rows a second, by file.rate,", "number", seconds, unit="s"))


def column_names(
    path: Path, keys: FileKeys, account: Account, wanted: Sequence[ColumnName] = ()
) -> list[str]:
    """Return the names of all columns of a file, or of all channels of an MDF file."""
    if format_of(path, keys) is MDF:
        with mdf_file.opened(path) as mdf:
            return sorted({place.name for place in mdf_file.places(path, mdf, account)})
    return read_sheet(path, keys, wanted, account).names


def read_series(
    path: Path, keys: FileKeys, time: TimeSource, wanted: Mapping[str, Source], account: Account
) -> dict[str, Series]:
    """Return the ``wanted`` columns, under the names that the caller gives them.

    Raises RecordError, which states the file, the key, line or group, and the correction. Other remarks are added to
    ``account``.
    """
    if format_of(path, keys) is MDF:
        return _of_mdf(path, wanted, account)
    names = [time.column, *(source.column for source in wanted.values())]
    sheet = read_sheet(path, keys, names, account)
    places = {key: sheet.place(source.column, f"{path}: {key}.column") for key, source in wanted.items()}
    return of_sheet(
        sheet, keys, time, {key: (places[key], source) for key, source in wanted.items()}, account
    )


def of_sheet(
    sheet: Sheet,
    keys: FileKeys,
    time: TimeSource,
    chosen: Mapping[str, tuple[int, Source]],
    account: Account,
) -> dict[str, Series]:
    """Return the ``chosen`` columns of a sheet with their times."""
    clocks: dict[int, tuple[TimeSource, str]] = {}
    places = {}
    joins: dict[int, int] = {}
    for key, (_, source) in chosen.items():
        own = source.time is not None
        given = TimeSource(column=source.time, unit=time.unit, decimal=time.decimal) if own else time  # type: ignore[arg-type]
        where = f"{sheet.path}: {key}.time" if own else f"{sheet.path}: time.column"
        places[key] = clock_place(sheet, given, where, account)
        if given.date is not None:
            at = places[key]
            if at not in joins:
                joins[at] = joined(sheet, given.date, at, keys, account, where)
            places[key] = joins[at]
        clocks.setdefault(places[key], (given, where))
    texts = [(index, source) for index, source in chosen.values() if sheet.columns[index].kind == "text"]
    texts += [(index, given) for index, (given, _) in clocks.items() if sheet.columns[index].kind == "text"]
    point = of_the_file(sheet, keys, texts)
    read = {
        index: read_clock(sheet, index, given, keys, point, account, where)
        for index, (given, where) in clocks.items()
    }
    for index, clock in read.items():
        refuse_halves(sheet, index, clocks[index][1])
        check_order(sheet, clock.seconds, account, clocks[index][1])
    read = _from_one_start(sheet, read)
    return {
        key: _series(sheet, index, source, read[places[key]], clocks[places[key]][1], point, account, key)
        for key, (index, source) in chosen.items()
    }


def clock_place(sheet: Sheet, time: TimeSource, where: str, account: Account) -> int:
    """Return the index of the clock column. Without a column of the default name, it is the column that pandas has
    stored as the index of its frame.
    """
    if sheet.clock is not None and not sheet.places(time.column) and time.column == TimeSource().column:
        name = sheet.columns[sheet.clock].name
        account.take(f"the index{f' {name}' if name else ''} is the clock")
        return sheet.clock
    return sheet.place(time.column, where)


def _from_one_start(sheet: Sheet, clocks: Mapping[int, Clock]) -> dict[int, Clock]:
    """Return the clocks of one file relative to a common start. Raises RecordError if this is not possible."""
    starts = [clock.start for clock in clocks.values() if clock.start is not None]
    if not starts:
        return dict(clocks)
    if len(starts) < len(clocks) or len({clock.zoned for clock in clocks.values()}) > 1:
        raise RecordError(
            f"{sheet.path}: one clock has dates or a zone, and another has none; use clocks of the same form"
        )
    first = min(starts)
    return {
        index: clock._replace(seconds=clock.seconds + ((clock.start or first) - first) / SECOND, start=first)
        for index, clock in clocks.items()
    }


def _series(
    sheet: Sheet,
    index: int,
    source: Source,
    clock: Clock,
    clock_where: str,
    point: DecimalPoint,
    account: Account,
    key: str,
) -> Series:
    import numpy as np

    column = sheet.columns[index]
    where = f"{sheet.path}: {key}"
    if column.kind == "text":
        values = numbers(sheet, index, source, point, account, where)
    elif column.kind == "number":
        values = np.asarray(column.cells, np.float64)
        infinite = np.isinf(values)
        if infinite.any():
            at = int(np.argmax(infinite))
            account.leave_out("infinite value(s)", int(infinite.sum()), f"{sheet.at(at)}, {column.name}")
            values = np.where(infinite, np.nan, values)
    else:
        what = column.what or "times"
        raise RecordError(f'{where}: the column "{column.name}" holds {what}; choose a column of numbers')
    known = np.isfinite(clock.seconds)
    lost = ~known & np.isfinite(values)
    if lost.any():
        raise RecordError(
            f"{clock_where}: {sheet.at(int(np.argmax(lost)))} has a value, but no time; add the time, or remove the row"
        )
    return Series(
        column.name,
        clock.seconds[known],
        values[known],
        column.unit or unit_in_name(column.name),
        clock.start,
        sheet.rows[known],
        sheet.row_word,
    )


def _of_mdf(path: Path, wanted: Mapping[str, Source], account: Account) -> dict[str, Series]:
    import numpy as np

    found = {}
    with mdf_file.opened(path) as mdf:
        known = mdf_file.places(path, mdf, account)
        start = mdf_file.start_of(mdf)
        for key, source in wanted.items():
            place = mdf_file.find(known, source.column, source.group, f"{path}: {key}.column")
            times, values, unit = mdf_file.samples(path, mdf, place, source.raw, account)
            refuse_falling(path, times, f"{place.name}, {place.title}")
            found[key] = Series(place.name, times, np.where(np.isinf(values), np.nan, values), unit, start)
    return found


def refuse_falling(path: Path, times: Numbers, what: str) -> None:
    """Raise RecordError if the times of the samples decrease."""
    import numpy as np

    falls = np.flatnonzero(np.diff(times) < 0)
    if falls.size:
        at = int(falls[0])
        raise RecordError(
            f"{path}: {what}: the clock falls from {times[at]:.9g} s to {times[at + 1]:.9g} s in sample {at + 2}; "
            "times must not fall; if these are two recordings, split the file there"
        )
