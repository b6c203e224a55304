"""The end of a record: its stream becomes a Parquet file, also the stream that a killed process left behind."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from bench_records.layout import (
    FORMAT,
    META,
    PARQUET,
    PREFIX,
    SECOND,
    STREAM,
    RecordedEvent,
    RecordError,
    SignalInfo,
    as_array,
    encode,
    flat,
)

if TYPE_CHECKING:
    import pyarrow as pa

ROW_GROUP = 1 << 20
END_OF_STREAM = b"\xff\xff\xff\xff\x00\x00\x00\x00"


class Recovery(msgspec.Struct, frozen=True):
    """What a cut-off stream still held."""

    samples: int
    events: int
    seconds: float
    unreadable_bytes: int
    complete: bool

    def __str__(self) -> str:
        kept = f"{self.samples} samples and {self.events} events over {self.seconds:.3f} s were recovered"
        if self.complete:
            return f"{kept}; nothing was lost"
        return f"{kept}; {self.unreadable_bytes} bytes were cut off; at most the last second before the end is lost"


def recover(directory: Path | str) -> Recovery:
    """Make the Parquet record of a stream that a killed process left behind, and say how much of it there was.

    Raises ``RecordError`` where there is no stream, or none of ours.
    """
    stream = Path(directory) / STREAM
    if not stream.is_file():
        raise RecordError(f"{directory} holds no {STREAM}: there is nothing to recover")
    return convert(stream, {}, recovering=True)


def convert(stream: Path, meta: dict[str, Any], *, recovering: bool = False) -> Recovery:
    """Write Parquet file and ``meta.json`` beside a stream, with ``meta`` added to its facts, and remove the stream.

    Raises ``RecordError`` for a stream that is none of ours.
    """
    import pyarrow as pa

    with pa.memory_map(str(stream)) as source:
        try:
            reader = pa.ipc.open_stream(source)
        except (pa.ArrowException, OSError) as error:
            raise RecordError(
                f"{stream} is cut off before its first sample, or no Arrow stream: {error}"
            ) from error
        facts = _facts(reader.schema, stream)
        batches: list[pa.RecordBatch] = []
        events: list[RecordedEvent] = []
        good = source.tell()
        while True:
            try:
                batch, custom = reader.read_next_batch_with_custom_metadata()
                batch.validate()
                if custom is not None:
                    events += msgspec.json.decode(custom[b"events"], type=list[RecordedEvent])
            except (StopIteration, pa.ArrowException, OSError, msgspec.MsgspecError):
                break
            batches.append(batch)
            good = source.tell()
        table = pa.Table.from_batches(batches, reader.schema)
        size = source.size()
        source.seek(max(0, size - len(END_OF_STREAM)))
        complete = bytes(source.read()) == END_OF_STREAM and good + len(END_OF_STREAM) >= size
        start_ns, end_ns = _span(facts.pop("start_ns"), table, events)
        recovery = Recovery(
            samples=table.num_rows,
            events=len(events),
            seconds=(end_ns - start_ns) / SECOND,
            unreadable_bytes=0 if complete else size - good,
            complete=complete,
        )
        signals = facts.pop("signals")
        facts.update(meta)
        if recovering:
            facts["recovered"] = str(recovery)
        _write_parquet(stream.with_name(PARQUET), table, signals, events, {**facts, "start_ns": start_ns})
    summary = {**facts, "samples": recovery.samples, "duration_s": recovery.seconds, "events": events}
    stream.with_name(META).write_bytes(msgspec.json.format(encode(summary), indent=2) + b"\n")
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
    # Under another name until it is whole: who finds a record.parquet finds a good one.
    unfinished = target.with_name(target.name + ".part")
    with pq.ParquetWriter(
        unfinished,
        schema,
        compression="zstd",
        use_dictionary=["signal", "value"],
        column_encoding={"time_ns": "DELTA_BINARY_PACKED"},
        write_statistics=["time_ns"],
        write_page_checksum=True,
    ) as writer:
        for first in range(0, table.num_rows, ROW_GROUP):
            # One chunk per row group, so that the pages do not follow the accidents of batching.
            part = table.slice(first, ROW_GROUP).combine_chunks()
            column = pa.DictionaryArray.from_arrays(flat(part.column("signal")), names)
            writer.write_table(
                pa.Table.from_arrays(
                    [flat(part.column("time_ns")), column, flat(part.column("value"))], schema=schema
                )
            )
        writer.add_key_value_metadata({PREFIX + key: encode(facts[key]).decode() for key in sorted(facts)})
    unfinished.replace(target)


def _facts(schema: pa.Schema, stream: Path) -> dict[str, Any]:
    raw = {key.decode(): value for key, value in (schema.metadata or {}).items()}
    if raw.get(PREFIX + "format") != encode(FORMAT):
        raise RecordError(f"{stream} is an Arrow stream, but not one of this recorder's ({FORMAT})")
    facts = {key.removeprefix(PREFIX): msgspec.json.decode(value) for key, value in raw.items()}
    del facts["format"]
    facts["signals"] = msgspec.convert(facts["signals"], list[SignalInfo], strict=False)
    return facts


def _span(start_ns: int | None, table: pa.Table, events: list[RecordedEvent]) -> tuple[int, int]:
    instants = [event.time_ns for event in events]
    for chunk in table.column("time_ns").chunks:
        if len(chunk):
            times = as_array(chunk)
            instants += [int(times.min()), int(times.max())]
    start = start_ns if start_ns is not None else min(instants, default=0)
    return start, max([start, *instants])
