"""The supported file formats of tables: name, file suffixes, reader and writer of each."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bench_protocol.file_forms import FileForm
from bench_records.exchange import write_arrow, write_csv, write_mdf
from bench_records.layout import RESULT
from bench_records.result import read_result
from bench_records.tables.text_table import read_text_table
from bench_records.workbook import write_run

if TYPE_CHECKING:
    from bench_records.record import Record
    from bench_records.tables.sheet import Sheet


def _columnar(path: Path, *_: Any, parquet: bool) -> Sheet:
    from bench_records.tables.columnar import read_columnar  # it imports pyarrow

    return read_columnar(path, parquet)


def _write_mdf(record: Record, path: Path, _: float, names: Sequence[str]) -> int:
    return write_mdf(record, path, names)


def _write_workbook(record: Record, path: Path, rate: float, names: Sequence[str]) -> int:
    folder = record.path.parent
    result = read_result(folder) if (folder / RESULT).exists() else None
    return write_run(record, result, path, rate, names)


#: Programs that convert other forms to a table.
EXPORTS: Final = {
    ".tdms": "after `pip install nptdms`, "
    "python -c \"import nptdms; nptdms.TdmsFile('{0}').as_dataframe().to_csv('{1}.csv')\"",
    ".xlsx": "`ssconvert {0} {1}.csv`, or *Save as* CSV UTF-8 in Excel",
    ".xls": "`ssconvert {0} {1}.csv`, or *Save as* CSV UTF-8 in Excel",
    ".mat": "parquetwrite('{1}.parquet', struct2table(load('{0}'))) in MATLAB",
}
#: A reader takes a path, keys, the names of the wanted columns and an account, and returns a sheet. A writer takes a
#: record, a path, a rate (Hz) and the names of signals, and returns the number of rows.
FORMS: Final = (
    FileForm("csv", (".csv", ".txt", ".tsv", ".dat"), read_text_table, write_csv),
    FileForm("parquet", (".parquet",), partial(_columnar, parquet=True), write_arrow),
    FileForm("arrow", (".arrow", ".feather"), partial(_columnar, parquet=False), write_arrow),
    FileForm("mdf", (".mf4", ".mdf"), None, _write_mdf),  # it is read by channel: each has its own clock
    FileForm("xlsx", (".xlsx",), None, _write_workbook),
)


def export_of(path: Path) -> str:
    """Return a command that converts an unsupported file to a table, or "" if none is known."""
    return EXPORTS.get(path.suffix.lower(), "").format(path.name, path.stem)
