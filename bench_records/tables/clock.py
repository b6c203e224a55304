"""The clock of a table: seconds from its start, computed from numbers, dates, times of day, or counts
since an epoch.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from bench_protocol.input_limits import Unfit, check_times
from bench_protocol.unit_names import ReadUnit, UnknownUnit, read_unit
from bench_protocol.units import UNITS
from bench_records.layout import SECOND, RecordError
from bench_records.tables.numbers import DecimalPoint, in_plain_digits, numbers, without_missing
from bench_records.tables.stamps import DAY, NotAStamp, looks_like_a_stamp, read_stamps

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from bench_protocol.account import Account
    from bench_records.tables.keys import FileKeys, TimeSource
    from bench_records.tables.sheet import Column, Sheet

    Seconds = npt.NDArray[np.float64]

#: Counts of time that begin long ago: from, to (both in the unit), the unit in s, its 0 in days from 1970, its name.
_EPOCHS: Final = (
    (3.1e8, 2.9e9, 1.0, 0, "Unix times"),
    (3.0e9, 4.2e9, 1.0, -24_107, "counts since 1904, as LabVIEW has them"),
    (2.9e4, 7.3e4, 86_400.0, -25_569, "days of Excel"),
    (7.1e5, 7.7e5, 86_400.0, -719_529, "days of MATLAB"),
)
_YEAR: Final = 3.2e7
#: A step is reported if it is longer than this number of usual steps and this number of seconds.
_LEAP, _LONG = 100.0, 1.0


class Clock(NamedTuple):
    """The times of the rows: seconds (n,) since ``start`` (ns since 1970, or None if unknown). A row without a time
    has NaN.
    """

    seconds: Seconds
    start: int | None = None
    zoned: bool = False


def read_clock(
    sheet: Sheet,
    index: int,
    source: TimeSource,
    keys: FileKeys,
    point: DecimalPoint,
    account: Account,
    where: str,
) -> Clock:
    """Return the clock from a column. Raises RecordError, with line, for a cell that is not a time, or for a wrong
    unit.
    """
    column = sheet.columns[index]
    if column.kind == "stamp":
        return _from_stamps(column.cells, column.there, column.zoned, keys, account, where)
    if column.kind == "span":
        return _from_spans(column, account)
    if column.kind == "other":
        raise RecordError(
            f"{where}: the column holds {column.what}; choose a column of numbers, dates or times of day"
        )
    if column.kind == "text" and looks_like_a_stamp(column.example):
        return _from_text(sheet, index, keys, account, where)
    shown_unit = source.unit or column.unit or "s"
    unit = _of_time(shown_unit, f"{where}: time.unit" if source.unit else f"{where}: the unit in the head")
    if source.unit and column.unit and source.ignore_head_unit:
        account.take(f"the clock is read in {source.unit}, not in {column.unit} as its head says")
    elif (
        source.unit and column.unit and not _of_time(column.unit, f"{where}: the unit in the head").same(unit)
    ):
        raise RecordError(
            f'{where}: the column is in {column.unit} by its head, but time.unit = "{source.unit}"; if the head is '
            "wrong, give ignore_head_unit = true"
        )
    values = _exact(sheet, index, source, point, where)
    return _from_numbers(values, unit.unit.factor, shown_unit, account, where, sheet)


def _of_time(text: str, where: str) -> ReadUnit:
    try:
        unit = read_unit(text)
    except UnknownUnit as error:
        raise RecordError(
            f"{where}: {error}; use a unit of time, such as s, ms or min (if the head is wrong, give time.unit and "
            "ignore_head_unit = true)"
        ) from None
    if not unit.measures("s"):
        raise RecordError(f'{where} = "{text}" is not a unit of time; use one such as s, ms or min')
    return unit


def _exact(sheet: Sheet, index: int, source: TimeSource, point: DecimalPoint, where: str) -> Any:
    """Return the numbers of a column. Numbers with too many digits for a double are integers or long doubles."""
    import numpy as np

    column = sheet.columns[index]
    if column.kind == "number":
        return column.cells
    values = numbers(sheet, index, source, point, None, where)
    if not np.nanmax(np.abs(values), initial=0.0) > 1e7:
        return values
    cells = in_plain_digits(without_missing(sheet, index, None), sheet, index, source, point, where)
    texts = ["nan" if cell is None else cell for cell in cells.to_pylist()]
    if all(text.isdigit() and len(text) < 19 for text in texts):
        return np.array(texts, np.int64)
    return np.array(texts).astype(np.longdouble)


def _from_numbers(values: Any, factor: float, unit: str, account: Account, where: str, sheet: Sheet) -> Clock:
    import numpy as np

    plain = np.asarray(values, dtype=np.float64)
    known = np.flatnonzero(np.isfinite(plain))
    if not known.size:
        return Clock(plain * factor)
    begin = float(plain[known[0]])
    for low, high, size, zero, name in _EPOCHS:
        if (size == 1.0) != (factor < 86_400.0):
            continue
        if low <= begin * factor / size < high:
            first = values[known[0]]
            seconds = np.asarray((values - first).astype(np.float64) * factor, dtype=np.float64)
            start = zero * 86_400 * SECOND + _ns(first, factor)
            zoned = size == 1.0
            account.take(f"the times are {name}; the record begins at {in_words(start, zoned)}")
            return Clock(seconds, start, zoned)
    seconds = plain * factor
    try:
        check_times(seconds[known])
    except Unfit:
        better = [name for name in ("ms", "us", "ns") if 3.1e8 <= begin * UNITS[name].factor < 2.9e9]
        hint = f'if these are Unix times, give time.unit = "{better[0]}"' if better else "correct time.unit"
        raise RecordError(
            f"{where}: {begin:.17g} {unit} in {sheet.at(int(known[0]))} is not a valid time of a record; {hint}"
        ) from None
    return Clock(seconds)


def _ns(number: Any, factor: float) -> int:
    """Return a number of time units in whole nanoseconds. ``factor`` is the unit in s. The integer part is converted
    exactly.
    """
    whole = int(number)
    size = round(factor * SECOND)
    return whole * size + round(float(number - whole) * size)


def _from_text(sheet: Sheet, index: int, keys: FileKeys, account: Account, where: str) -> Clock:
    import numpy as np

    cells = without_missing(sheet, index, None).to_pylist()
    try:
        found = read_stamps(cells, keys.dates)
    except NotAStamp as error:
        raise RecordError(f"{where}: {error.text(cells, sheet.at)}") from None
    for sentence in found.remarks:
        account.take(sentence)
    if found.dated:
        return _from_stamps(found.ns, found.there, found.zoned, keys, account, where)
    if not found.there.any():
        return Clock(np.full(len(cells), np.nan))
    begin = int(found.ns[found.there][0])
    if not found.remarks:
        account.take(f"the times are times of day; the record begins at {in_words(begin)[11:]}")
    steps = np.diff(found.ns[found.there] // (86_400 * SECOND))
    if steps.any():
        row = int(np.flatnonzero(found.there)[int(np.argmax(steps != 0)) + 1])
        account.take(f"the clock passes midnight before {sheet.at(row)}")
    return Clock(np.where(found.there, (found.ns - begin) / SECOND, np.nan))


def _from_stamps(ns: Any, there: Any, zoned: bool, keys: FileKeys, account: Account, where: str) -> Clock:
    import numpy as np

    if not there.any():
        return Clock(np.full(len(ns), np.nan))
    if not (ns[there] % DAY).any() and len(np.unique(ns[there])) < np.count_nonzero(there):
        raise RecordError(
            f"{where}: the column holds dates without times of day, and many rows have the same date; use the column "
            "with the times of day as the clock, and this column as its date (the key date)"
        )
    if keys.zone is not None and not zoned:
        ns, zoned = _in_utc(ns, keys.zone, where), True
    begin = int(ns[there][0])
    account.take(f"the record begins at {in_words(begin, zoned)}")
    return Clock(np.where(there, (ns - begin) / SECOND, np.nan), begin, zoned)


def _in_utc(ns: Any, zone: str, where: str) -> Any:
    """Return local times (ns) in UTC. In the hour that is repeated in autumn, the order of the rows decides, or else it
    is summer time.
    """
    import pandas as pd

    local = pd.DatetimeIndex(ns)
    try:
        local = local.tz_localize(zone, ambiguous="infer")
    except Exception:  # pandas and the zones of Python have many names for it
        try:
            local = local.tz_localize(zone, ambiguous=[True] * len(local))
        except Exception:
            raise RecordError(f'{where}: file.zone = "{zone}" {_invalid_in(local, zone)}') from None
    return local.tz_convert("UTC").asi8 if local.unit == "ns" else local.tz_convert("UTC").as_unit("ns").asi8


def _invalid_in(local: Any, zone: str) -> str:
    """Return the reason why local times are not valid in a time zone."""
    try:
        lost = local.tz_localize(zone, ambiguous=[True] * len(local), nonexistent="NaT").isna()
    except Exception:  # pandas and the zones of Python have many names for it
        return 'is not a time zone; use one such as "Europe/Berlin"'
    return (
        f"has no {local[lost][0]:%Y-%m-%d %H:%M:%S}: summer time skips that hour, but the clock was not set forward; "
        'use a zone without summer time, such as "Etc/GMT-1" for UTC+1'
    )


def _from_spans(column: Column, account: Account) -> Clock:
    import numpy as np

    assert column.there is not None
    if column.what:  # times of day, without a date
        account.take(column.what)
    return Clock(np.where(column.there, column.cells / SECOND, np.nan))


def in_words(ns: int, zoned: bool = False) -> str:
    """Return an instant (ns since 1970) as text."""
    text = datetime.fromtimestamp(ns // SECOND, UTC).strftime("%Y-%m-%d %H:%M:%S")
    return f"{text}.{ns % SECOND // 1_000_000:03d}{' UTC' if zoned else ''}"


def many(rows: int) -> str:
    """Return a number of rows as text, such as "3 rows"."""
    return f"{rows} row{'s' * (rows != 1)}"


def check_order(sheet: Sheet, seconds: Seconds, account: Account, where: str) -> None:
    """Raise RecordError for a clock that decreases, never advances, or jumps by more than a year. Add a remark to
    ``account`` for one that stops or jumps.

    Rows without a time are ignored.
    """
    import numpy as np

    rows = np.flatnonzero(np.isfinite(seconds))
    times = seconds[rows]
    steps = np.diff(times)
    if (steps < 0).any():
        at = int(np.argmax(steps < 0))
        raise RecordError(
            f"{where}: the clock falls from {times[at]:.9g} s to {times[at + 1]:.9g} s in "
            f"{sheet.at(int(rows[at + 1]))}; times must not fall; if these are two recordings, split the file there"
            + ("; if summer time ends there, give file.zone" if abs(steps[at] + 3600.0) < 60.0 else "")
        )
    if (steps > _YEAR).any():
        at = int(np.argmax(steps > _YEAR))
        raise RecordError(
            f"{where}: before {sheet.at(int(rows[at + 1]))} the clock leaps by {steps[at] / _YEAR:.3g} years; if the "
            "clock was set there, split the file at this line"
        )
    if steps.size and not steps.any():
        raise RecordError(
            f"{where}: the clock is at {times[0]:.9g} s in all rows; choose another column as the clock"
        )
    stands = steps == 0
    if stands.any():
        at = int(rows[int(np.argmax(stands)) + 1])
        account.take(f"the clock does not advance in {many(int(stands.sum()))}, first in {sheet.at(at)}")
    moving = steps[steps > 0]
    usual = float(np.median(moving)) if moving.size else 0.0
    leaps = (steps > _LEAP * usual) & (steps > _LONG)
    if leaps.any():
        at = int(np.argmax(leaps))
        account.take(
            f"the clock leaps {'once' if leaps.sum() == 1 else f'{int(leaps.sum())} times'}, first by {steps[at]:.6g} "
            f"s before {sheet.at(int(rows[at + 1]))}"
        )
