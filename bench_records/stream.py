"""The stream that a run writes: its lock, and its contents, even if the file ends at any byte.

The head of the stream is written first. The writer holds a lock, which the operating system releases when the process
ends for any reason. So a stream without a lock belongs to an interrupted run.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import msgspec

from bench_protocol.runtime.file_locks import hold
from bench_records.layout import (
    FORMAT,
    PREFIX,
    SECOND,
    STREAM,
    RecordedEvent,
    RecordError,
    SignalInfo,
    as_array,
    encode,
)

if TYPE_CHECKING:
    import pyarrow as pa

_END: Final = b"\xff\xff\xff\xff\x00\x00\x00\x00"


class Recovery(msgspec.Struct, frozen=True):
    """How much of a stream could be read after its writer had ended."""

    samples: int
    events: int
    seconds: float
    unreadable_bytes: int
    complete: bool

    def __str__(self) -> str:
        kept = f"{self.samples} samples and {self.events} events over {self.seconds:.3f} s were recovered"
        if self.complete:
            return f"{kept}; nothing was lost"
        return f"{kept}; {self.unreadable_bytes} bytes are unreadable; at most the last second before the end is lost"


class Streamed(NamedTuple):
    """The contents of a stream. The table has the columns ``time_ns``, ``signal`` (index of the signal) and
    ``value``.
    """

    facts: dict[str, Any]
    signals: list[SignalInfo]
    table: pa.Table
    events: list[RecordedEvent]
    start_ns: int
    recovery: Recovery


def is_held(directory: Path) -> bool:
    """Return whether a run is writing to ``directory`` now."""
    with suppress(OSError), (directory / STREAM).open("rb") as file:
        return not hold(file, shared=True)
    return False


def refuse_held(directory: Path) -> None:
    """Raise ``RecordError`` if a run is writing to ``directory`` now."""
    if is_held(directory):
        raise RecordError(f"the run is still writing {directory / STREAM}; wait until it has ended")


def read_head(stream: Path) -> dict[str, Any]:
    """Return the meta data of a stream, with ``start_ns`` and ``signals``. The stream may still be in use by its
    writer.

    Raises ``RecordError`` if the file is not a stream of this format.
    """
    import pyarrow as pa

    with pa.memory_map(str(stream)) as source:
        return _facts(_opened(source, stream).schema, stream)


def read_stream(stream: Path) -> Streamed:
    """Return the contents of a stream whose writer has ended.

    Raises ``RecordError`` if the file is not a stream of this format.
    """
    import pyarrow as pa

    batches: list[pa.RecordBatch] = []
    events: list[RecordedEvent] = []
    with pa.memory_map(str(stream)) as source:
        reader = _opened(source, stream)
        facts = _facts(reader.schema, stream)
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
        source.seek(max(0, size - len(_END)))
        complete = bytes(source.read()) == _END and good + len(_END) >= size
    start_ns, end_ns = _span(facts.pop("start_ns"), table, events)
    recovery = Recovery(
        samples=table.num_rows,
        events=len(events),
        seconds=(end_ns - start_ns) / SECOND,
        unreadable_bytes=0 if complete else size - good,
        complete=complete,
    )
    return Streamed(facts, facts.pop("signals"), table, events, start_ns, recovery)


def _opened(source: Any, stream: Path) -> Any:
    import pyarrow as pa

    try:
        return pa.ipc.open_stream(source)
    except (pa.ArrowException, OSError) as error:
        raise RecordError(
            f"{stream} ends before its first sample, or is not an Arrow stream ({error}); repeat the run"
        ) from error


def _facts(schema: pa.Schema, stream: Path) -> dict[str, Any]:
    raw = {key.decode(errors="replace"): value for key, value in (schema.metadata or {}).items()}
    if raw.get(PREFIX + "format") != encode(FORMAT):
        raise RecordError(
            f"{stream} is an Arrow stream, but not in the format {FORMAT}; use a run of this version"
        )
    with metadata_errors(stream):
        facts = {key.removeprefix(PREFIX): msgspec.json.decode(value) for key, value in raw.items()}
        del facts["format"]
        facts["signals"] = msgspec.convert(facts["signals"], list[SignalInfo], strict=False)
        facts["start_ns"] = msgspec.convert(facts["start_ns"], int | None)
    return facts


@contextmanager
def metadata_errors(path: Path) -> Iterator[None]:
    """Convert errors in the ``with`` block to RecordError, which states that the meta data of the file are damaged."""
    try:
        yield
    except (msgspec.MsgspecError, KeyError, UnicodeError, RecursionError):
        raise RecordError(
            f"{path} is damaged: the data of its run cannot be read; use a copy, or repeat the run"
        ) from None


def _span(start_ns: int | None, table: pa.Table, events: list[RecordedEvent]) -> tuple[int, int]:
    instants = [event.time_ns for event in events]
    for chunk in table.column("time_ns").chunks:
        if len(chunk):
            times = as_array(chunk)
            instants += [int(times.min()), int(times.max())]
    start = start_ns if start_ns is not None else min(instants, default=0)
    return start, max([start, *instants])
