"""Imports records from files of other programs. Columns and channels must have the names of signals."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import msgspec

from bench_protocol.misfit import misfit
from bench_protocol.unit_names import UnknownUnit, is_unit, read_unit
from bench_records.exchange import Comment
from bench_records.layout import SECOND, RecordedEvent, RecordError, SignalInfo
from bench_records.recorder import Recorder
from bench_records.tables import mdf as mdf_file
from bench_records.tables.clock import in_words
from bench_records.tables.joined import date_and_time
from bench_records.tables.keys import ColumnName, FileKeys, Source, TimeSource
from bench_records.tables.quality import Nulls, measured, without_codes
from bench_records.tables.reading import Series, of_sheet, read_sheet, refuse_falling
from bench_records.tables.stamps import looks_like_a_stamp

if TYPE_CHECKING:
    from bench_protocol.account import Account
    from bench_records.tables.sheet import Column, Sheet

TIME: Final = "time_s"
#: Permitted names of a clock that has dates or a unit.
_CLOCKS: Final = ("time", "timestamp", "datetime", "date", "date/time", "zeit", "zeitstempel", "datum", "t")
_COLUMN: Final = re.compile(r"(?P<name>\S+?)(?: ?(?:\[(?P<unit>[^\]]*)\]|\((?P<round>[^)]*)\)))?")
#: Descriptions for the record, by the name in the table of signals.
Known = Callable[[str], SignalInfo | None]


class ImportKeys(FileKeys, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The keys for the import of a file: those of ``[file]`` in a map, and the keys from other tables of a map."""

    time: ColumnName | None = None
    date: ColumnName | None = None  #: of times of day
    time_unit: str | None = None
    thousands: str | None = None
    group: ColumnName | None = None  #: of an MDF file: only this one
    raw: bool = False
    #: Codes for missing values, by signal; "" is for all columns.
    null: dict[str, list[float | str]] = msgspec.field(default_factory=dict)


def import_keys(texts: Iterable[str]) -> ImportKeys:
    """Return the keys in ``KEY=VALUE`` texts. Raises RecordError for an unknown key or an invalid value."""
    given: dict[str, Any] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals:
            raise RecordError(f'--table {text}: write KEY=VALUE, such as "decimal=,"')
        name = key.strip().replace("-", "_")
        if name == "null" or key.startswith("null."):
            codes = [_code(one) for one in value.split(";") if one.strip()]
            given.setdefault("null", {})[key.strip().partition(".")[2]] = codes
            continue
        given[name] = {"\\t": "\t", "tab": "\t"}.get(value, value)
        if value.isdigit() and key.strip() in ("time", "date", "group"):
            given[key.strip()] = int(value)
    unknown = set(given) - set(ImportKeys.__struct_fields__)
    if unknown:
        known = ", ".join(ImportKeys.__struct_fields__)
        raise RecordError(f"--table {unknown.pop()}: there is no such key; the keys are {known}")
    try:
        return msgspec.convert(given, ImportKeys, strict=False)
    except (msgspec.ValidationError, ValueError) as error:
        raise RecordError(f"--table: {misfit(error, given, ImportKeys)}") from None


def _code(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text.strip()


class _Found(NamedTuple):
    """The samples of one signal from a file."""

    signal: SignalInfo
    series: Series
    scale: float  #: SI value of the unit of its numbers
    zero: float = 0.0  #: SI value of their 0


def read_table(
    path: Path, into: Path, known: Known, meta: dict[str, Any], account: Account, keys: ImportKeys
) -> int:
    """Make a record in the directory ``into`` from a table with a clock. Return the number of samples. ``known``
    returns the description of a signal, or None; ``meta`` is added to the meta data.

    Raises RecordError, with line or column, if the file is not a table, or if a column is not a signal or has another
    unit.
    """
    _refuse_idle_keys(path, keys, ("group", "raw"), "an MDF file")
    names = [keys.time if keys.time is not None else TIME]
    sheet = read_sheet(path, keys, names, account)
    time = _clock_of(sheet, keys)
    clock = [
        time.column,
        *([] if time.date is None else [sheet.place(time.date, f"{path}: --table date") + 1]),
    ]
    chosen: dict[str, tuple[int, Source]] = {}
    signals: dict[str, SignalInfo] = {}
    units: dict[str, tuple[float, float]] = {}
    for index, column in enumerate(sheet.columns):
        if index + 1 in clock:
            continue
        if not column.name and _is_empty(column):
            account.leave_out("column(s) without name and values")
            continue
        signal, units[column.name] = _signal(path, column.name, column.unit, known)
        twice = [one for one, other in signals.items() if other.name == signal.name]
        if twice:
            first = chosen[twice[0]][0] + 1
            raise RecordError(
                f"{path}: the columns {first} and {index + 1} are both {signal.name}; remove one of them from the file"
            )
        signals[column.name] = signal
        chosen[column.name] = (index, _source(index, signal.name, keys))
    found = of_sheet(sheet, keys, time, chosen, account)
    nulls = {signals[key].name: source.codes for key, (_, source) in chosen.items()}
    found = _without_codes(path, {signals[key].name: one for key, one in found.items()}, nulls, account)
    by_name = {signal.name: key for key, signal in signals.items()}
    there = []
    for name, one in found.items():
        key = by_name[name]
        there.append(_Found(signals[key], measured(one), *units[key]))
    return _write(into, there, meta, account, path)


def _source(index: int, signal: str, keys: ImportKeys) -> Source:
    null = keys.null.get(signal, keys.null.get(""))
    return Source(column=index + 1, thousands=keys.thousands, null=null)


def _without_codes(
    path: Path, columns: Mapping[str, Series], nulls: Nulls, account: Account
) -> dict[str, Series]:
    """Return the columns with NaN for codes of missing values. Remarks on these codes are added to ``account``."""
    found, remarks = without_codes(path.name, columns, nulls)
    for one in remarks:
        account.take(f"{'doubtful: ' * one.doubt}{one.sentence()}")
        account.quality.append(asdict(one))
    return found


def _is_empty(column: Column) -> bool:
    return column.kind == "text" and not column.example


def _clock_of(sheet: Sheet, keys: ImportKeys) -> TimeSource:
    """Return the description of the clock column. Raises RecordError if no key, name or date identifies the clock."""
    decimal = keys.decimal
    if keys.time is not None:
        place = sheet.place(keys.time, f"{sheet.path}: --table time")
        return TimeSource(column=place + 1, unit=keys.time_unit, decimal=decimal, date=keys.date)
    if keys.date is not None:
        raise RecordError(
            f"--table date={keys.date} is a column of dates; also name the column of the times of day: "
            "--table time=COLUMN"
        )
    if sheet.places(TIME):
        return TimeSource(column=sheet.place(TIME, f"{sheet.path}: time") + 1, unit=keys.time_unit)
    if sheet.clock is None and (both := date_and_time(sheet)):
        return TimeSource(column=both[1] + 1, date=both[0] + 1)
    able = [index for index, column in enumerate(sheet.columns) if _base(column.name).lower() in _CLOCKS]
    if sheet.clock is not None:
        able = [sheet.clock]
    if len(able) == 1:
        column = sheet.columns[able[0]]
        unit = keys.time_unit or (column.unit if is_unit(column.unit) else "")
        if unit or _dated(column):
            return TimeSource(column=able[0] + 1, unit=unit or None, decimal=decimal)
    hint = f"--table time={sheet.columns[able[0]].name or able[0] + 1}" if able else "--table time=COLUMN"
    raise RecordError(
        f"{sheet.path} has no column {TIME}, but {', '.join(map(str, sheet.names))}; name the clock with {hint}, and "
        "its unit, if it has numbers, with --table time_unit=s (or ms, us, ns, d)"
    )


def _base(name: str) -> str:
    found = _COLUMN.fullmatch(name)
    return found["name"] if found else name


def _dated(column: Column) -> bool:
    if column.kind != "text":
        return column.kind in ("stamp", "span")
    return looks_like_a_stamp(column.example)


def read_mdf(
    path: Path, into: Path, known: Known, meta: dict[str, Any], account: Account, keys: ImportKeys
) -> int:
    """Make a record in the directory ``into`` from an MDF file. Return the number of samples. ``known`` and ``meta``
    are those of `read_table`.

    A file that was exported from a record gives the same record. In other files the channels must have the names of
    signals, and their units are those of the file. Raises RecordError for a file that is not MDF, or a channel that is
    not a signal.
    """
    others = [key for key in ImportKeys.__struct_fields__ if key not in ("group", "raw", "format", "null")]
    _refuse_idle_keys(path, keys, others, "a table")
    with mdf_file.opened(path) as mdf:
        ours = _own_comment(mdf.header.description)
        exported = {one.name: one for one in ours.signals} if ours else {}
        places = mdf_file.places(path, mdf, account)
        if not places and account.counts:
            raise RecordError(f"{path} holds bus frames without signals; decode them with --dbc FILE")
        if keys.group is not None:
            places = [one for one in places if keys.group in (one.group, one.called)]
        found = []
        for place in places:
            mdf_file.find(places, place.name, None, f"{path}: the channel")  # a name in two groups
            own = exported.get(place.name)
            unit = str(mdf.groups[place.group].channels[place.index].unit or "")
            signal, si = (own, (1.0, 0.0)) if own else _signal(path, place.name, unit, known)
            texts = {text: number for number, text in signal.names.items()}
            raw = own is not None or keys.raw
            times, values, _ = mdf_file.samples(path, mdf, place, raw, account, texts)
            refuse_falling(path, times, f"{place.name}, {place.title}")
            series = Series(place.name, times, values)
            if own is None:
                codes = {signal.name: _source(0, signal.name, keys).codes}
                series = measured(_without_codes(path, {signal.name: series}, codes, account)[signal.name])
            found.append(_Found(signal, series, *si))  # an exported record is in SI
        if ours is None:
            if start := mdf_file.start_of(mdf):
                account.take(f"the file begins at {in_words(start, True)}")
            return _write(into, found, meta, account, path, start or 0)
    names = {one.signal.name for one in found}
    silent = [one for one in ours.signals if one.name not in names]
    return _write(
        into, found, {**ours.meta, **meta}, account, path, ours.start_ns, events=ours.events, silent=silent
    )


def _refuse_idle_keys(path: Path, keys: ImportKeys, idle: Iterable[str], of: str) -> None:
    for key in idle:
        if getattr(keys, key) != getattr(ImportKeys(), key):
            raise RecordError(f"--table {key}={getattr(keys, key)} is only for {of}; omit it for {path}")


def _own_comment(text: str) -> Comment | None:
    try:
        return msgspec.json.decode(text, type=Comment)
    except (msgspec.MsgspecError, TypeError):
        return None


def _signal(path: Path, name: str, unit: str, known: Known) -> tuple[SignalInfo, tuple[float, float]]:
    """Return the signal of a column, and the factor and zero that convert the column's unit to SI.

    Raises RecordError if the column is not a signal, or if its unit is missing, unknown, of another quantity, or an
    absolute pressure.
    """
    found = _COLUMN.fullmatch(name)
    signal = known(found["name"]) if found else None
    if found is None or signal is None:
        raise RecordError(
            f"{path}: the column {name!r} is not a signal of the bench; write SIGNAL [UNIT], "
            "with a name of `astb rig signals`"
        )
    stated = found["unit"] or found["round"] or unit
    if stated.strip() in ("", "-", "1") and signal.unit in ("", "1"):
        return signal, (signal.scale, 0.0)
    right = (
        f"write {signal.name} [{signal.unit}], or another unit of the same quantity"
        if signal.unit
        else f"{signal.name} has no unit"
    )
    if not stated:
        raise RecordError(f"{path}: the column {name!r} states no unit; {right}")
    try:
        read = read_unit(stated)
    except UnknownUnit as error:
        raise RecordError(f"{path}: the column {name!r}: {error}; {right}") from None
    if not signal.unit or not read.measures(read_unit(signal.unit).unit.si):
        raise RecordError(
            f"{path}: the column {name!r} is in {stated}, which {signal.name} cannot have; {right}"
        )
    if read.reading == "absolute":
        raise RecordError(
            f"{path}: the column {name!r} is in {stated}, but {signal.name} is a gauge pressure; convert the column"
        )
    return signal, (read.unit.factor, read.unit.zero)


def _write(
    into: Path,
    found: list[_Found],
    meta: dict[str, Any],
    account: Account,
    path: Path,
    start_ns: int | None = None,
    *,
    events: Iterable[RecordedEvent] = (),
    silent: Iterable[SignalInfo] = (),
) -> int:
    """Write a record to the folder ``into`` with its samples in order of time. Return the number of samples.
    ``start_ns`` (since 1970) is the start of the clock if no series states one.
    """
    import numpy as np

    series = [(one.series.times, one.series.values * one.scale + one.zero) for one in found]
    places = [np.full(times.size, index, np.int16) for index, (times, _) in enumerate(series)]
    times = np.concatenate([times for times, _ in series]) if series else np.empty(0)
    if not times.size:
        raise RecordError(f"{path} holds no samples; it needs a time column and a column of numbers")
    values = np.concatenate([values for _, values in series])
    order = np.argsort(times, kind="stable")
    start = next((one.series.start for one in found if one.series.start is not None), start_ns or 0)
    begins = min(0, int(np.floor(times[order[0]] * SECOND)))
    if begins:
        account.take(f"the record begins {-begins / SECOND:.9g} s before its clock is at 0")
    instants = start + np.rint(times[order] * SECOND).astype(np.int64)
    content = {**meta, **account.as_meta()}
    signals = [*(one.signal for one in found), *silent]
    with Recorder(into, signals, content, start_ns=start + begins, in_background=False) as recorder:
        for event in events:
            recorder.event(event.time_ns, event.kind, event.text, **event.data)
        recorder.receive(instants, np.concatenate(places)[order], values[order])
    return int(times.size)
