"""Records as other programs want them: CSV at one rate, MDF 4 with every sample; and back.

A column is called ``left.height [mm]``: the signal's name and the unit of its numbers. MDF keeps the numbers of the
record (SI) with a conversion to that unit, and events and meta data in the comment of its header: what comes back is
the record, sample for sample. CSV is a table at one rate: what comes back is that table.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec

from bench_protocol.account import Account
from bench_protocol.extras import lacking
from bench_records.layout import SECOND, RecordedEvent, RecordError, SignalInfo, encode
from bench_records.record import Record
from bench_records.recorder import Recorder

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    Numbers = npt.NDArray[np.float64]

TIME: Final = "time_s"
_COLUMN: Final = re.compile(r"(?P<name>\S+)(?: \[(?P<unit>[^\]]*)\])?")
_PROGRAM: Final = "ASTB"
#: From names of the table of signals to how the record describes them.
Known = Callable[[str], SignalInfo | None]


class _Comment(msgspec.Struct):
    """What the header of an MDF file of ours says."""

    program: str
    start_ns: int
    meta: dict[str, Any]
    signals: list[SignalInfo]
    events: list[RecordedEvent]


def column_of(signal: SignalInfo) -> str:
    """Return what a column with numbers of ``signal`` is called."""
    return f"{signal.name} [{signal.unit}]" if signal.unit else signal.name


def write_csv(record: Record, path: Path, rate: float, names: Sequence[str] = ()) -> int:
    """Write signals side by side at ``rate`` (Hz), in the units of their columns; return the number of rows.

    Without ``names`` all of them. What was not known at an instant is empty. RecordError for an unknown name.
    """
    chosen = list(names or record.signals)
    frame = record.frame(chosen, rate)
    for name in chosen:
        frame[name] /= record.signals[name].scale
    frame.columns = [column_of(record.signals[name]) for name in chosen]
    frame.to_csv(path, float_format="%.9g")
    return len(frame)


def write_mdf(record: Record, path: Path, names: Sequence[str] = ()) -> int:
    """Write every sample with its own time stamp; return how many. RecordError without asammdf, or an unknown name."""
    MDF, Signal = _asammdf()
    from asammdf.blocks.conversion_utils import from_dict

    written = 0
    with MDF(version="4.10") as mdf:
        for name in names or record.signals:
            times, values = record.series(name)
            if not times.size:
                continue
            told = record.signals[name]
            mapping: dict[str, object] = {"a": 1.0 / told.scale, "b": 0.0}
            if told.names:
                mapping = {f"val_{place}": key for place, key in enumerate(told.names)}
                mapping |= {f"text_{place}": text for place, text in enumerate(told.names.values())}
                mapping["default"] = ""
            conversion = from_dict(mapping)
            mdf.append(
                [Signal(values, times, name=name, unit=told.unit, conversion=conversion, comment=told.label)],
                comment=name,
            )
            written += times.size
        mdf.header.description = encode(
            _Comment(_PROGRAM, record.start_ns, record.meta, list(record.signals.values()), record.events)
        ).decode()
        mdf.save(path, overwrite=True, compression=2)
    return written


def read_csv(path: Path, into: Path, known: Known, meta: dict[str, Any], account: Account) -> int:
    """Make a record in the directory ``into`` of a table with a column ``time_s``; return the number of samples.

    RecordError, with line or column, for a table that is none, or a column that is no signal or has another unit.
    """
    import numpy as np
    import pandas as pd

    try:
        table = pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise RecordError(f"{path} cannot be read as CSV: {error}") from None
    if TIME not in table.columns:
        raise RecordError(f"{path} has no column {TIME}; it has {', '.join(map(str, table.columns))}")
    numbers = table.apply(pd.to_numeric, errors="coerce")
    bad = (numbers.isna() & table.notna()).to_numpy().nonzero()
    if bad[0].size:
        row, column = int(bad[0][0]), int(bad[1][0])
        raise RecordError(
            f"{path}: line {row + 2}, {table.columns[column]} = {table.iat[row, column]!r} is no number"
        )
    columns = [name for name in table.columns if name != TIME]
    signals = [_signal(path, str(name), known) for name in columns]
    times = numbers[TIME].to_numpy(float)
    if not np.isfinite(times).all():
        row = int(np.argmin(np.isfinite(times)))
        raise RecordError(f"{path}: line {row + 2} has no time in {TIME}")
    series = []
    for name, one in zip(columns, signals, strict=True):
        values = numbers[name].to_numpy(float)
        there = ~np.isnan(values)
        series.append((times[there], values[there] * one.scale))
    return _write(into, signals, series, [], meta, 0, account)


def read_mdf(path: Path, into: Path, known: Known, meta: dict[str, Any], account: Account) -> int:
    """Make a record in the directory ``into`` of an MDF file; return the number of samples.

    A file of ours gives back the record that it was made of. In another one channels must be called as signals are, and
    are taken in their own unit. RecordError for what is no MDF file, or a channel that is no signal.
    """
    MDF, _ = _asammdf()
    try:
        mdf = MDF(path)
    except Exception as error:  # asammdf has an exception of its own and raises others, too
        raise RecordError(f"{path} is not an MDF file: {error}") from None
    with mdf:
        ours = _own_comment(mdf.header.description)
        told = {one.name: one for one in ours.signals} if ours else {}
        signals, series = [], []
        for group in range(len(mdf.groups)):
            for signal in _signals(mdf, group, raw=ours is not None):
                one = told.get(signal.name) or _signal(path, f"{signal.name} [{signal.unit}]", known)
                scale = 1.0 if ours else one.scale
                signals.append(one)
                series.append((signal.timestamps, signal.samples.astype(float) * scale))
        if ours is None:
            return _write(into, signals, series, [], meta, 0, account)
        names = {one.name for one in signals}
        signals += [one for one in ours.signals if one.name not in names]
        return _write(into, signals, series, ours.events, {**ours.meta, **meta}, ours.start_ns, account)


def _signals(mdf: Any, group: int, *, raw: bool) -> list[Any]:
    """The channels of a group but its clock; ``raw`` with the numbers that stand in the file, unconverted."""
    channels = mdf.groups[group].channels
    master = mdf.masters_db.get(group)
    return [mdf.get(group=group, index=index, raw=raw) for index in range(len(channels)) if index != master]


def _own_comment(text: str) -> _Comment | None:
    try:
        return msgspec.json.decode(text, type=_Comment)
    except (msgspec.MsgspecError, TypeError):
        return None


def _signal(path: Path, column: str, known: Known) -> SignalInfo:
    """Return the signal that a column is of; its unit has to be that in which the signal is shown."""
    found = _COLUMN.fullmatch(column.removesuffix(" []"))
    signal = known(found["name"]) if found else None
    if found is None or signal is None:
        raise RecordError(
            f"{path}: the column {column!r} is no signal of the bench; `astb signals` lists them"
        )
    if (found["unit"] or "") != signal.unit:
        raise RecordError(f"{path}: the column {column!r} is not in {signal.unit or 'a number without unit'}")
    return signal


def _write(
    into: Path,
    signals: list[SignalInfo],
    series: list[tuple[Numbers, Numbers]],
    events: list[RecordedEvent],
    meta: dict[str, Any],
    start_ns: int,
    account: Account,
) -> int:
    """Write a record, its samples in the order of their times."""
    import numpy as np

    places = [np.full(times.size, index, np.int16) for index, (times, _) in enumerate(series)]
    times = np.concatenate([times for times, _ in series]) if series else np.empty(0)
    values = np.concatenate([values for _, values in series]) if series else np.empty(0)
    index = np.concatenate(places) if series else np.empty(0, np.int16)
    order = np.argsort(times, kind="stable")
    instants = start_ns + np.rint(times[order] * SECOND).astype(np.int64)
    told = {**meta, **account.as_meta()}
    with Recorder(into, signals, told, start_ns=start_ns, in_background=False) as recorder:
        for event in events:
            recorder.event(event.time_ns, event.kind, event.text, **event.data)
        recorder.append(instants, index[order], values[order])
    return int(times.size)


def _asammdf() -> tuple[Any, Any]:
    try:
        from asammdf import MDF, Signal
    except ImportError:
        raise RecordError(lacking("mdf", "MDF files")) from None
    return MDF, Signal
