"""Writes records to files for other programs: a table at one rate, or MDF 4 with every sample.

The head of a column, such as ``left.height [mm]``, has the name of the signal and the unit of its numbers. An MDF file
contains the values of the record (SI), with a conversion to that unit. The comment in its header contains events and
meta data. So an MDF file can be imported again as the same record, sample for sample. A CSV file is imported as a table
at one rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec

from bench_protocol.extras import lacking
from bench_records.layout import RecordedEvent, RecordError, SignalInfo, encode
from bench_records.record import Record

if TYPE_CHECKING:
    import pandas as pd

_PROGRAM: Final = "ASTB"


class Comment(msgspec.Struct):
    """The comment in the header of an MDF file that was exported from a record."""

    program: str
    start_ns: int
    meta: dict[str, Any]
    signals: list[SignalInfo]
    events: list[RecordedEvent]


def column_of(signal: SignalInfo) -> str:
    """Return the column name for ``signal``, with its unit."""
    return f"{signal.name} [{signal.unit}]" if signal.unit else signal.name


def write_csv(record: Record, path: Path, rate: float, names: Sequence[str] = ()) -> int:
    """Write signals side by side at ``rate`` (Hz), in the units of their columns. Return the number of rows.

    Without ``names``, all signals are written. A cell is empty if the signal has no value there. Raises RecordError
    for an unknown name.
    """
    frame = table_of(record, rate, names)
    frame.to_csv(path, float_format="%.9g")
    return len(frame)


def write_arrow(record: Record, path: Path, rate: float, names: Sequence[str] = ()) -> int:
    """Write the same table as `write_csv` to a Parquet or Arrow file, depending on the suffix. Return the number of
    rows.
    """
    frame = table_of(record, rate, names)
    if path.suffix.lower() == ".parquet":
        frame.to_parquet(path)
    else:
        frame.reset_index().to_feather(path)
    return len(frame)


def table_of(record: Record, rate: float, names: Sequence[str]) -> pd.DataFrame:
    """Return signals side by side as a data frame, in the units of their columns. Raises RecordError for an unknown
    name.
    """
    chosen = list(names or record.signals)
    frame = record.frame(chosen, rate)
    for name in chosen:
        frame[name] /= record.signals[name].scale
    frame.columns = [column_of(record.signals[name]) for name in chosen]
    return frame


def write_mdf(record: Record, path: Path, names: Sequence[str] = ()) -> int:
    """Write every sample with its time to an MDF file. Return the number of samples. Without ``names``, all signals are
    written.

    Raises RecordError if asammdf is not installed, or for an unknown name.
    """
    MDF, Signal = _asammdf()
    from asammdf.blocks.conversion_utils import from_dict

    written = 0
    with MDF(version="4.10") as mdf:
        for name in names or record.signals:
            times, values = record.series(name)
            if not times.size:
                continue
            info = record.signals[name]
            mapping: dict[str, object] = {"a": 1.0 / info.scale, "b": 0.0}
            if info.names:
                mapping = {f"val_{place}": key for place, key in enumerate(info.names)}
                mapping |= {f"text_{place}": text for place, text in enumerate(info.names.values())}
                mapping["default"] = ""
            conversion = from_dict(mapping)
            mdf.append(
                [Signal(values, times, name=name, unit=info.unit, conversion=conversion, comment=info.label)],
                comment=name,
            )
            written += times.size
        mdf.header.description = encode(
            Comment(_PROGRAM, record.start_ns, record.meta, list(record.signals.values()), record.events)
        ).decode()
        mdf.save(path, overwrite=True, compression=2)
    return written


def _asammdf() -> tuple[Any, Any]:
    try:
        from asammdf import MDF, Signal
    except ImportError:
        raise RecordError(lacking("mdf", "MDF files")) from None
    return MDF, Signal
