"""Converts the stream of a record to a Parquet file, even if the recording process was killed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from bench_records.disk import give_room, kept
from bench_records.layout import (
    FORMAT,
    META,
    PARQUET,
    PREFIX,
    STREAM,
    RecordedEvent,
    RecordError,
    SignalInfo,
    encode,
    flat,
    put,
    whole,
)
from bench_records.stream import Recovery, read_stream, refuse_held

if TYPE_CHECKING:
    import pyarrow as pa

ROW_GROUP = 1 << 20


def recover(directory: Path | str) -> Recovery:
    """Make the Parquet record from the stream of a killed process. Return how much was recovered.

    Raises ``RecordError`` if there is no stream, if it has another format, or if a run is still writing it.
    """
    stream = Path(directory) / STREAM
    if not stream.is_file():
        raise RecordError(
            f"{directory} holds no {STREAM} to recover; use the folder of a run that was killed"
        )
    refuse_held(stream.parent)
    give_room(stream.parent)  # reserved by the killed run
    return convert(stream, {}, recovering=True)


def convert(stream: Path, meta: dict[str, Any], *, recovering: bool = False) -> Recovery:
    """Write a Parquet file and ``meta.json`` next to a stream, and remove the stream. ``meta`` is added to the facts of
    the record; with ``recovering`` they state how much was recovered.

    Raises ``RecordError`` if the file is not a stream of this format. Raises ``NotKept`` if the files cannot be
    written; the stream then remains.
    """
    with kept(stream):
        streamed = read_stream(stream)
    facts, recovery = {**streamed.facts, **meta}, streamed.recovery
    if recovering:
        facts["recovered"] = str(recovery)
    target = stream.with_name(PARQUET)
    with kept(target):
        _write_parquet(
            target,
            streamed.table,
            streamed.signals,
            streamed.events,
            {**facts, "start_ns": streamed.start_ns},
        )
    summary = {
        **facts,
        "samples": recovery.samples,
        "duration_s": recovery.seconds,
        "events": streamed.events,
    }
    del streamed  # its table lies in the memory of the file, which Windows does not remove meanwhile
    with kept(stream.with_name(META)):
        put(stream.with_name(META), msgspec.json.format(encode(summary), indent=2) + b"\n")
        stream.unlink()
    return recovery


def _write_parquet(
    target: Path,
    table: pa.Table,
    signals: list[SignalInfo],
    events: list[RecordedEvent],
    facts: dict[str, Any],
) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    builder = pa.lib.StringBuilder()  # as in `_drain`: pa.array would import pandas
    builder.append_values([signal.name for signal in signals])
    names = builder.finish()
    schema = pa.schema(
        [
            pa.field("time_ns", pa.int64(), nullable=False),
            pa.field("signal", pa.dictionary(pa.int16(), pa.string()), nullable=False),
            pa.field("value", pa.float64(), nullable=False),
        ]
    )
    facts = {**facts, "format": FORMAT, "signals": signals, "events": events}
    # Under another name until it is complete, so that every record.parquet is valid.
    unfinished = target.with_name(target.name + ".part")
    with (
        whole(unfinished, target),
        unfinished.open("wb") as file,
        pq.ParquetWriter(
            file,
            schema,
            compression="zstd",
            use_dictionary=["signal", "value"],
            column_encoding={"time_ns": "DELTA_BINARY_PACKED"},
            write_statistics=["time_ns"],
            write_page_checksum=True,
        ) as writer,
    ):
        for first in range(0, table.num_rows, ROW_GROUP):
            # One chunk per row group, so that the bytes of the file do not depend on the limits of the batches.
            part = table.slice(first, ROW_GROUP).combine_chunks()
            column = pa.DictionaryArray.from_arrays(flat(part.column("signal")), names)
            writer.write_table(
                pa.Table.from_arrays(
                    [flat(part.column("time_ns")), column, flat(part.column("value"))], schema=schema
                )
            )
        writer.add_key_value_metadata({PREFIX + key: encode(facts[key]).decode() for key in sorted(facts)})
