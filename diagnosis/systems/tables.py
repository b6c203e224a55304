"""Columns of the files that a map is for, by the reader of foreign tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from bench_protocol.account import Account
from bench_records.layout import RecordError
from bench_records.tables import reading
from bench_records.tables.keys import ColumnName, FileKeys, Source, TimeSource
from bench_records.tables.reading import Series
from diagnosis.contracts import DiagnosisError


def read_columns(
    path: Path, keys: FileKeys, time: TimeSource, wanted: Mapping[str, Source], account: Account
) -> dict[str, Series]:
    """Return the ``wanted`` columns, each with its own times, by the name that the map gives them.

    ``account`` is told how the file was taken and what was left out. DiagnosisError names file, key and column, and the
    columns that are there.
    """
    try:
        return reading.read_series(path, keys, time, wanted, account)
    except RecordError as error:
        raise DiagnosisError(str(error)) from None


def column_names(path: Path, wanted: Sequence[ColumnName]) -> list[str]:
    """Return the names of all columns of a file whose head holds some of the ``wanted``. DiagnosisError for none."""
    try:
        return reading.column_names(path, FileKeys(), Account(), wanted)
    except RecordError as error:
        raise DiagnosisError(str(error)) from None
