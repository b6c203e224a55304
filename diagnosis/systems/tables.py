"""Columns of numbers from a file that somebody else wrote: CSV, Parquet or MDF 4."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, Literal

import msgspec
import numpy as np

from bench_protocol.account import Account
from bench_protocol.extras import lacking
from diagnosis.contracts import Array, DiagnosisError

#: How a column is named in a map: by its name, or by its number from 1 where the file has no header.
ColumnName = str | int

_SUFFIXES: Final[Mapping[str, Literal["csv", "parquet", "mdf"]]] = {
    ".csv": "csv",
    ".txt": "csv",
    ".tsv": "csv",
    ".dat": "csv",
    ".parquet": "parquet",
    ".mf4": "mdf",
    ".mdf": "mdf",
}


class Source(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Which column of a file is meant, and the separator of thousands in its numbers."""

    column: ColumnName
    thousands: str = ""


class FileFormat(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """``[file]`` of a map: the format of the files, as far as their suffix does not say it."""

    format: Literal["csv", "parquet", "mdf"] | None = None
    delimiter: str = ","
    header: bool = True
    decimal: str = "."
    skip_rows: int = 0
    encoding: str = "utf-8-sig"


def read_columns(
    path: Path, form: FileFormat, wanted: Mapping[str, Source], account: Account
) -> dict[str, Array]:
    """Return the ``wanted`` columns (n,) by the name that the map gives them, NaN where a cell is empty.

    ``account`` is told how the file was taken and what was left out. DiagnosisError names file, key and column, and the
    columns that are there.
    """
    kind = _kind(path, form)
    if kind == "mdf":
        return _read_mdf(path, wanted)
    frame = _read_csv(path, form) if kind == "csv" else _read_parquet(path)
    return {key: _numbers(frame, source, f"{path}: {key}.column", form) for key, source in wanted.items()}


def column_names(path: Path, form: FileFormat) -> tuple[str, ...]:
    """Return the names of all columns of a file."""
    kind = _kind(path, form)
    if kind == "mdf":
        with _mdf(path) as mdf:
            return _channels(mdf)
    frame = _read_csv(path, form, rows=0) if kind == "csv" else _read_parquet(path)
    return tuple(str(name) for name in frame.columns)


def _kind(path: Path, form: FileFormat) -> Literal["csv", "parquet", "mdf"]:
    kind = form.format or _SUFFIXES.get(path.suffix.lower())
    if not path.is_file():
        raise DiagnosisError(f"{path}: no such file")
    if kind is None:
        raise DiagnosisError(
            f'{path}: the suffix "{path.suffix}" says no format; give file.format = "csv", "parquet" or "mdf"'
        )
    return kind


def _read_csv(path: Path, form: FileFormat, rows: int | None = None) -> Any:
    """Read a table as text: a point may be decimal in one column and separate thousands in the next."""
    import pandas as pd

    try:
        return pd.read_csv(
            path,
            sep=form.delimiter,
            header=0 if form.header else None,
            skiprows=form.skip_rows,
            encoding=form.encoding,
            dtype=str,
            skipinitialspace=True,
            nrows=rows,
        )
    except (ValueError, pd.errors.ParserError) as error:
        raise DiagnosisError(f"{path}: not a table as [file] describes it: {error}") from None


def _read_parquet(path: Path) -> Any:
    import pandas as pd
    import pyarrow as pa

    try:
        return pd.read_parquet(path)
    except (pa.ArrowInvalid, OSError) as error:
        raise DiagnosisError(f"{path}: not a Parquet file: {error}") from None


def _numbers(frame: Any, source: Source, where: str, form: FileFormat) -> Array:
    import pandas as pd

    column = source.column
    names = [str(name) for name in frame.columns]
    if isinstance(column, int):
        if not 1 <= column <= len(names):
            raise DiagnosisError(f"{where} = {column}: the file has the columns 1 to {len(names)}")
        series = frame.iloc[:, column - 1]
    elif column in names:
        series = frame.iloc[:, names.index(column)]
    else:
        raise DiagnosisError(f'{where} = "{column}": the file has the columns {", ".join(names)}')
    if series.dtype.kind == "M":  # a calendar: seconds from its first row on
        return np.asarray((series - series.iloc[0]).dt.total_seconds(), dtype=np.float64)
    if series.dtype.kind not in "iufb":
        text = series.astype(str).str.strip()
        if source.thousands:
            text = text.str.replace(source.thousands, "", regex=False)
        if form.decimal != ".":
            text = text.str.replace(form.decimal, ".", regex=False)
        number = pd.to_numeric(text, errors="coerce")
        wrong = np.flatnonzero(number.isna() & ~series.isna() & ~text.str.lower().isin(("", "nan")))
        if len(wrong):
            raise DiagnosisError(
                f'{where} = {column!r}: "{series.iloc[wrong[0]]}" in row {wrong[0] + 1} of the table is no number; '
                f'file.decimal is "{form.decimal}", file.delimiter "{form.delimiter}", thousands "{source.thousands}"'
            )
        series = number
    return np.asarray(series.to_numpy(dtype=np.float64, na_value=np.nan), dtype=np.float64)


def _mdf(path: Path) -> Any:
    try:
        from asammdf import MDF
    except ImportError:
        raise DiagnosisError(f"{path}: {lacking('mdf', 'MDF files')}") from None
    try:
        return MDF(path)
    except Exception as error:  # asammdf has an exception of its own and raises others, too
        raise DiagnosisError(f"{path}: not an MDF file: {error}") from None


def _channels(mdf: Any) -> tuple[str, ...]:
    return tuple(sorted(name for name in mdf.channels_db if name not in mdf.masters_db))


def _read_mdf(path: Path, wanted: Mapping[str, Source]) -> dict[str, Array]:
    """Read channels by name on the union of their time stamps; the key ``time`` is the file's own clock."""
    channels = {key: source.column for key, source in wanted.items() if key != "time"}
    with _mdf(path) as mdf:
        available = _channels(mdf)
        for key, column in channels.items():
            if column not in mdf.channels_db:
                raise DiagnosisError(
                    f"{path}: {key}.column = {column!r}: the file has the channels {', '.join(available)}"
                )
        signals = {key: mdf.get(column) for key, column in channels.items()}
    time = np.unique(np.concatenate([signal.timestamps for signal in signals.values()]))
    columns: dict[str, Array] = {"time": time}
    for key, signal in signals.items():
        values = np.full(time.shape, np.nan)
        values[np.searchsorted(time, signal.timestamps)] = signal.samples
        columns[key] = values
    return columns
