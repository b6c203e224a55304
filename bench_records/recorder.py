"""The writer of a record. It accepts samples from the receiver's thread, and stores them even if the process is
killed.

During the run, no caller waits for the disk: ``receive`` only copies to memory. A thread of the recorder writes a
batch every half second of the run's clock or of real time, whichever is earlier. In virtual time callers may wait, so
``receive`` writes each batch, which saves two changes of thread. At the end, the stream is converted to a Parquet
file. Its bytes do not depend on where the batches began.
"""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from io import FileIO
from pathlib import Path
from shutil import copyfileobj
from types import TracebackType
from typing import TYPE_CHECKING, Any, BinaryIO, Final, Self

from bench_protocol.runtime import OPEN_FILES_MOVE
from bench_protocol.runtime.file_locks import hold
from bench_records.conversion import convert
from bench_records.disk import NotKept, begun, disk_reason, give_room, keep_room, kept
from bench_records.layout import (
    FORMAT,
    PARQUET,
    PREFIX,
    RESERVED,
    SECOND,
    STREAM,
    RecordedEvent,
    RecordError,
    SignalInfo,
    encode,
)

if TYPE_CHECKING:
    import numpy.typing as npt
    import pyarrow as pa

# A batch is complete on disk within one second: half a second of samples, and half a second for a slow disk.
BATCH_INTERVAL_S = 0.5
# Two hours at the full rate of the bench, which need at most 0.9 GB of memory.
SAMPLE_LIMIT = 50_000_000
EVENT_LIMIT = 100_000
#: Name of the stream until its head is complete.
_HEAD: Final = STREAM + ".part"
_TAKEN: Final = (
    "{} exists: another run is writing there, or a run was killed; if it was killed, recover its data with "
    "`astb report {}`"
)


class Recorder:
    """Writes one record to a directory, which is created if it does not exist.

    ``receive`` may be called from one thread and ``event`` from another. ``limit`` is the largest number of samples in
    the record. Later samples are counted and dropped; the meta data state the number of dropped samples and events.
    ``start_ns`` is the time 0 s of the record; without it, this is the first sample or event. If ``in_background`` is
    false, ``receive`` itself writes each batch. This is for virtual time, in which a slow disk delays no tick.

    Raises ``RecordError`` if the directory already contains an unfinished stream, if two signals have the same name,
    or if the meta data use a key of the file format.
    """

    def __init__(
        self,
        directory: Path | str,
        signals: Sequence[SignalInfo],
        meta: dict[str, Any] | None = None,
        *,
        start_ns: int | None = None,
        limit: int = SAMPLE_LIMIT,
        in_background: bool = True,
    ) -> None:
        import pyarrow as pa

        self.directory = Path(directory)
        self.signals = tuple(signals)
        self.samples = 0
        self.dropped = 0
        _refuse_doubles(self.signals)
        _refuse_reserved(meta or {})
        if limit < 1:
            raise RecordError(f"limit = {limit} samples; the limit must be at least 1")
        self._limit = limit
        self._events_kept = 0
        self._pending: list[tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]]] = []
        self._events: list[RecordedEvent] = []
        self._batch_start_ns: int | None = None
        self._start_ns = start_ns
        self._closed = False
        self._failure: Exception | None = None
        self._lock = threading.Lock()  # for the data of append and event; never held during a write
        self._disk = threading.Lock()  # the stream; taken before the other lock
        self._wake = threading.Event()

        self._file = _create(self.directory / _HEAD, self.directory / STREAM)
        schema = _stream_schema().with_metadata(
            {
                PREFIX + "format": encode(FORMAT),
                PREFIX + "start_ns": encode(start_ns),
                PREFIX + "signals": encode(self.signals),
                **{PREFIX + key: encode(value) for key, value in (meta or {}).items()},
            }
        )
        try:
            keep_room(self.directory)
            with kept(self.directory / STREAM):
                self._writer = pa.ipc.new_stream(self._file, schema)
                self._writer.write_batch(_batch(_no_samples()))  # Arrow writes no head before the first batch
                self._file.flush()
                if OPEN_FILES_MOVE:
                    (self.directory / _HEAD).rename(self.directory / STREAM)
        except RecordError:
            self._give_up()
            raise
        self._thread = threading.Thread(target=self._write_batches, name="recorder", daemon=True)
        self._writing = ThreadPoolExecutor(1, "recorder")
        self._in_background = in_background
        if in_background:
            self._thread.start()

    def receive(
        self,
        times_ns: npt.ArrayLike,
        signal: npt.ArrayLike,
        values: npt.ArrayLike,
    ) -> None:
        """Store samples, given as three arrays (n,): nanoseconds, index of the signal, and value in SI. The arrays
        are copied.

        Raises ``RecordError`` for arrays of different lengths, an unknown signal, after ``close``, and after a disk
        error.
        """
        import numpy as np

        times = np.array(times_ns, dtype=np.int64, ndmin=1)
        index = np.array(signal, dtype=np.int16, ndmin=1)
        numbers = np.array(values, dtype=np.float64, ndmin=1)
        if not times.shape == index.shape == numbers.shape or times.ndim != 1:
            raise RecordError(
                "times, signals and values must be arrays of equal length, not of "
                f"{times.shape}, {index.shape} and {numbers.shape}"
            )
        if not times.size:
            return
        if index.view(np.uint16).max() >= len(self.signals):  # a negative index is a large one here
            wrong = index[(index < 0) | (index >= len(self.signals))][0]
            raise RecordError(
                f"signal index {wrong} does not exist; this record has the indices 0 to {len(self.signals) - 1}"
            )
        with self._lock:
            self._refuse_if_unwritable()
            room = self._limit - self.samples
            if times.size > room:
                self.dropped += times.size - room
                times, index, numbers = times[:room], index[:room], numbers[:room]
                if not room:
                    return
            self.samples += times.size
            self._pending.append((times, index, numbers))
            newest = int(times[-1])
            if self._batch_start_ns is None:
                self._batch_start_ns = newest
            due = newest - self._batch_start_ns >= BATCH_INTERVAL_S * SECOND
            if due:
                self._batch_start_ns = newest
        if due and self._in_background:
            self._wake.set()
        elif due:
            self._undisturbed(self._drain)

    def event(self, time_ns: int, kind: str, text: str, **data: Any) -> None:
        """Record an event at ``time_ns``, such as a change of state, a trip or a check. ``data`` must be valid for
        JSON. Events after the first `EVENT_LIMIT` are counted and dropped.
        """
        event = RecordedEvent(int(time_ns), kind, text, data)
        try:
            encode(event)
        except (TypeError, ValueError) as error:
            raise RecordError(
                f"event {kind} ({text}): its data cannot be written as JSON: {error}; use texts, numbers and lists"
            ) from error
        with self._lock:
            self._refuse_if_unwritable()
            if self._events_kept < EVENT_LIMIT:
                self._events_kept += 1
                self._events.append(event)
            else:
                self.dropped += 1

    def flush(self) -> None:
        """Pass all stored samples to the operating system."""
        with self._lock:
            self._refuse_if_unwritable()
        self._undisturbed(self._drain)

    def close(self, **meta: Any) -> Path:
        """Convert the stream to ``record.parquet`` and ``meta.json``. Return the path of the Parquet file.

        ``meta`` are facts that are known only at the end of the run. A second call has no effect. Raises ``NotKept``
        for a disk error. The stream then remains, and can be converted later when the disk has space again.
        """
        _refuse_reserved(meta)
        target = self.directory / PARQUET
        with self._lock:
            if self._closed:
                return target
            self._closed = True
        if self._in_background:
            self._wake.set()
            self._thread.join()
        if self.dropped:
            meta["dropped"] = self.dropped
        try:
            self._undisturbed(self._finish_stream)
            if not OPEN_FILES_MOVE:
                self._file.close()
            convert(self.directory / STREAM, meta)
        except RecordError:
            self._put_back()
            raise
        finally:
            self._writing.shutdown()
            # Locked until the record exists, because an unlocked stream counts as interrupted.
            with suppress(OSError):  # a full disk refuses the last bytes again; the error is already reported
                self._file.close()
            give_room(self.directory)
        return target

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _undisturbed(self, write: Callable[[], None]) -> None:
        """Write in a separate thread, which Ctrl-C does not interrupt. The caller is interrupted after the write.

        An incomplete batch would make all later batches unreadable.
        """
        writing = self._writing.submit(write)
        try:
            writing.result()
        finally:
            wait([writing])

    def _refuse_if_failed(self) -> None:
        if self._failure is not None:
            raise NotKept(
                f"{self.directory / STREAM} cannot be written any more: {disk_reason(self._failure)}"
            ) from self._failure

    def _refuse_if_unwritable(self) -> None:
        self._refuse_if_failed()
        if self._closed:
            raise RecordError(
                f"the record in {self.directory} is closed; start a new run to record more samples or events"
            )

    def _write_batches(self) -> None:
        while not self._closed:
            self._wake.wait(BATCH_INTERVAL_S)
            self._wake.clear()
            try:
                self._drain()
            except RecordError:
                return  # this thread has no caller: receive, event, flush and close raise the error

    def _finish_stream(self) -> None:
        import pyarrow as pa

        try:
            self._drain()
            self._refuse_if_failed()
            self._writer.close()
            self._file.flush()
        except (OSError, pa.ArrowException) as error:
            self._failure = error
        self._refuse_if_failed()

    def _give_up(self) -> None:
        """Remove all files of a record that could not be started."""
        with suppress(OSError):
            self._file.close()
        give_room(self.directory)
        with suppress(OSError):
            (self.directory / _HEAD).unlink()

    def _put_back(self) -> None:
        """If a user has removed the folder, write the contents of the open stream to a new folder."""
        stream = self.directory / STREAM
        if stream.exists():
            return
        with suppress(OSError):
            stream.parent.mkdir(parents=True, exist_ok=True)
            # The buffer is not flushed, because the disk may refuse it again.
            with stream.open("xb") as copy, FileIO(self._file.fileno(), closefd=False) as held:
                held.seek(0)
                copyfileobj(held, copy)

    def _refuse_if_moved(self) -> None:
        """Raise FileNotFoundError if the stream file was moved or removed. Its data would be lost when this process
        ends.
        """
        if not os.path.samestat((self.directory / STREAM).stat(), os.fstat(self._file.fileno())):
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))

    def _drain(self) -> None:
        import numpy as np
        import pyarrow as pa

        with self._disk:
            with self._lock:
                pending, self._pending = self._pending, []
                events, self._events = self._events, []
                if pending:
                    self._batch_start_ns = int(pending[-1][0][-1])
            if not pending and not events:
                return
            columns = [np.concatenate(part) for part in zip(*pending, strict=True)] or _no_samples()
            try:
                self._writer.write_batch(
                    _batch(columns), custom_metadata={"events": encode(events)} if events else None
                )
                self._file.flush()
                self._refuse_if_moved()
            except (OSError, pa.ArrowException) as error:
                self._failure = error
        self._refuse_if_failed()


def _no_samples() -> list[npt.NDArray[Any]]:
    import numpy as np

    return [np.empty(0, np.int64), np.empty(0, np.int16), np.empty(0)]


def _batch(columns: Sequence[npt.NDArray[Any]]) -> pa.RecordBatch:
    import pyarrow as pa

    schema = _stream_schema()
    # pa.array would import pandas, which blocks all other threads for a second during the run.
    arrays = [
        pa.Array.from_buffers(field.type, len(column), [None, pa.py_buffer(column)])
        for field, column in zip(schema, columns, strict=True)
    ]
    return pa.record_batch(arrays, schema=schema)


def _stream_schema() -> pa.Schema:
    import pyarrow as pa

    return pa.schema([("time_ns", pa.int64()), ("signal", pa.int16()), ("value", pa.float64())])


def _create(head: Path, stream: Path) -> BinaryIO:
    """Open and lock the file ``head``. It is renamed to ``stream`` when it contains the facts of the run.

    On systems that cannot rename open files, ``stream`` itself is opened.
    """
    with begun(stream, f"the directory {stream.parent}"):
        stream.parent.mkdir(parents=True, exist_ok=True)
    in_place = not OPEN_FILES_MOVE
    if in_place and stream.exists():
        raise RecordError(_TAKEN.format(stream, stream.parent))
    with begun(stream):
        file = stream.open("x+b") if in_place else head.open("a+b")
    if not hold(file) or (stream.exists() and not in_place):
        file.close()
        raise RecordError(_TAKEN.format(stream, stream.parent))
    file.truncate(0)  # remains of a run that was killed at this point
    return file


def _refuse_doubles(signals: Sequence[SignalInfo]) -> None:
    seen: set[str] = set()
    for signal in signals:
        if signal.name in seen:
            raise RecordError(f"signal {signal.name} is listed twice; rename one of the two")
        seen.add(signal.name)


def _refuse_reserved(meta: dict[str, Any]) -> None:
    for key in meta:
        if key in RESERVED:
            raise RecordError(f"meta key {key!r} is reserved for the file format; choose another name")
