"""Reads Parquet and Arrow files as sheets: every column with its type, including the index of a pandas frame."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from bench_protocol.input_limits import SAMPLES_BYTES, Unfit, check_expansion, check_shape, check_size
from bench_protocol.os_errors import file_errors
from bench_records.layout import RecordError
from bench_records.tables.sheet import Column, Sheet
from bench_records.tables.stamps import over_midnight


def read_columnar(path: Path, parquet: bool) -> Sheet:
    """Return the sheet of a Parquet file, or of an Arrow file (or Feather) or stream."""
    try:
        check_size(path, SAMPLES_BYTES)
        table = _parquet(path) if parquet else _arrow(path)
        check_shape(table.num_rows, table.num_columns)
    except Unfit as error:
        raise RecordError(f"{path} {error}") from None
    except (pa.ArrowException, OSError, ValueError, KeyError, struct.error):
        raise RecordError(
            f"{path} is not a complete {'Parquet' if parquet else 'Arrow'} file; export it again"
        ) from None
    with file_errors(path, RecordError):
        columns = [_column(path, field, table.column(i)) for i, field in enumerate(table.schema)]
    sheet = Sheet(path, columns, np.arange(1, table.num_rows + 1), row_word="row")
    sheet.clock = _index(table, columns)
    return sheet


def _parquet(path: Path) -> pa.Table:
    with pq.ParquetFile(path) as file:
        check_shape(file.metadata.num_rows, len(file.schema_arrow))
        groups = [file.metadata.row_group(number) for number in range(file.metadata.num_row_groups)]
        width = [_width(file.schema.column(number)) for number in range(len(file.schema))]
        chunks = [(one.column(k), width[k]) for one in groups for k in range(one.num_columns)]
        cells = sum(max(one.num_values * each, one.total_uncompressed_size) for one, each in chunks)
        check_expansion(path, max(cells, 8 * file.metadata.num_rows))
        # A Parquet file stores a repeated text once.
        texts = [one.name for one in file.schema_arrow if _is_text(one.type)]
        file.close()
    with pq.ParquetFile(path, read_dictionary=texts) as file:
        return file.read()


def _width(column: Any) -> int:
    """Return the bytes in memory for one value of a Parquet column. For a text, this is the size of its index."""
    return max(int(column.length), 8)


def _is_text(kind: Any) -> bool:
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_binary(kind))


def _arrow(path: Path) -> pa.Table:
    with pa.OSFile(str(path)) as file:
        # An Arrow file is a stream between a magic number and a list of its parts.
        start = 8 if file.read(8).startswith(b"ARROW1") else 0
        file.seek(start)
        check_expansion(path, _unpacked(file))
        file.seek(start)
        return pa.ipc.open_stream(file).read_all()


def _unpacked(file: Any) -> int:
    """Return how many bytes the columns of an Arrow stream need in memory. A compressed buffer begins with its size."""
    total = 0
    for message in pa.ipc.MessageReader.open_stream(file):
        if message.type not in ("record batch", "dictionary"):
            continue
        head, body = message.metadata.to_pybytes(), message.body
        batch = _pointed(head, _field(head, _pointed(head, 0), 2))
        if message.type == "dictionary":
            batch = _pointed(head, _field(head, batch, 1))
        packed = bool(_field(head, batch, 3))
        buffers = 0
        for offset, length in _pairs(head, _field(head, batch, 2)):
            own = struct.unpack("<q", body[offset : offset + 8])[0] if packed and length else -1
            buffers += length if own < 0 else own
        total += max(buffers, 8 * sum(length for length, _ in _pairs(head, _field(head, batch, 1))))
    return total


# The head of a message of Arrow is a FlatBuffer; pyarrow shows none of its fields.


def _pointed(head: bytes, place: int) -> int:
    return int(place + struct.unpack_from("<I", head, place)[0])


def _field(head: bytes, table: int, number: int) -> int:
    """Return the position of a field in a FlatBuffer table, or 0 if it is missing."""
    fields = table - struct.unpack_from("<i", head, table)[0]
    if struct.unpack_from("<H", head, fields)[0] <= 4 + 2 * number:
        return 0
    offset = struct.unpack_from("<H", head, fields + 4 + 2 * number)[0]
    return int(table + offset) if offset else 0


def _pairs(head: bytes, place: int) -> Iterator[tuple[int, int]]:
    """Yield the pairs of integers in a FlatBuffer vector."""
    vector = _pointed(head, place)
    (count,) = struct.unpack_from("<I", head, vector)
    return struct.iter_unpack("<qq", head[vector + 4 : vector + 4 + 16 * count])


def _index(table: pa.Table, columns: list[Column]) -> int | None:
    """Return the index of the column of times that was the index of a pandas frame, or None unless there is exactly
    one.
    """
    try:
        pandas_facts = json.loads((table.schema.metadata or {}).get(b"pandas", b"{}"))
        named = [one for one in pandas_facts.get("index_columns", []) if isinstance(one, str)]
    except (ValueError, AttributeError):
        return None
    places = [index for index, column in enumerate(columns) if column.name in named]
    for index in places:
        if columns[index].name.startswith("__index_level_"):
            columns[index].name = ""
    return places[0] if len(places) == 1 and columns[places[0]].kind in ("stamp", "span", "number") else None


def _column(path: Path, field: pa.Field, data: pa.ChunkedArray) -> Column:
    kind = field.type
    if pa.types.is_dictionary(kind):
        check_expansion(path, _written_out(data))
        data = data.cast(kind.value_type)
        kind = kind.value_type
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        return Column(field.name, "text", _flat(data))
    try:
        if pa.types.is_integer(kind) and not data.null_count and kind != pa.uint64():
            return Column(field.name, "number", _flat(data).to_numpy(zero_copy_only=False).astype(np.int64))
        if pa.types.is_boolean(kind):
            data = data.cast(pa.int8())
        if pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_boolean(kind):
            values = pc.cast(_flat(data), pa.float64(), safe=False).to_numpy(zero_copy_only=False)
            return Column(field.name, "number", np.asarray(values, np.float64))
        if pa.types.is_decimal(kind):
            return Column(field.name, "number", _flat(data.cast(pa.float64())).to_numpy(zero_copy_only=False))
        if pa.types.is_timestamp(kind) or pa.types.is_date(kind):
            zoned = pa.types.is_timestamp(kind) and kind.tz is not None
            return _stamps(field.name, data, zoned)
        if pa.types.is_time(kind):
            return _of_day(field.name, data)
        if pa.types.is_duration(kind):
            cells, there = _ns(data, pa.duration("ns"))
            return Column(field.name, "span", cells, there=there)
    except pa.ArrowException:
        raise RecordError(
            f"{path}: the column {field.name} has a value outside the range that can be read; export it as numbers"
        ) from None
    return Column(field.name, "other", None, what=f"values of the kind {kind}")


def _written_out(data: pa.ChunkedArray) -> int:
    """Return how many bytes all values of a dictionary-encoded column need."""
    if not _is_text(data.type.value_type):
        return 8 * len(data)
    lengths = (pc.take(pc.binary_length(one.dictionary), one.indices) for one in data.chunks)
    return sum(pc.sum(pc.cast(one, pa.int64())).as_py() or 0 for one in lengths)


def _stamps(name: str, data: pa.ChunkedArray, zoned: bool) -> Column:
    cells, there = _ns(data, pa.timestamp("ns"))
    return Column(name, "stamp", cells, zoned=zoned, there=there)


def _flat(data: pa.ChunkedArray) -> Any:
    whole = data.combine_chunks()
    return pa.concat_arrays(whole.chunks) if isinstance(whole, pa.ChunkedArray) else whole


def _ns(data: pa.ChunkedArray, kind: Any) -> tuple[Any, Any]:
    whole = _flat(data)
    zone = getattr(whole.type, "tz", None)
    cast = whole.cast(pa.timestamp("ns", zone) if zone else kind)
    there = np.asarray(pc.is_valid(cast).to_numpy(zero_copy_only=False), np.bool_)
    cells = pc.fill_null(cast.cast(pa.int64()), 0).to_numpy(zero_copy_only=False)
    return np.asarray(cells, np.int64), there


def _of_day(name: str, data: pa.ChunkedArray) -> Column:
    """Return a column of times of day as durations since the first one."""
    whole = _flat(data).cast(pa.time64("ns"))
    there = np.asarray(pc.is_valid(whole).to_numpy(zero_copy_only=False), np.bool_)
    cells = np.asarray(pc.fill_null(whole.cast(pa.int64()), 0).to_numpy(zero_copy_only=False), np.int64)
    cells, there = over_midnight(cells, there)
    begin = int(cells[there][0]) if there.any() else 0
    column = Column(name, "span", cells - begin, there=there, of_day=True, begin=begin)
    column.what = f"the times are times of day; the record begins {begin / 1e9:.9g} s after midnight"
    return column
