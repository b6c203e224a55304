"""A record that can be read during its run. Each call reads the samples since the previous call."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self

import msgspec
import numpy as np

from bench_records.layout import SECOND, STREAM, Phase, RecordedEvent, RecordError, as_array, phases_of
from bench_records.record import Record
from bench_records.stream import is_held, read_head

if TYPE_CHECKING:
    import numpy.typing as npt
    import pyarrow as pa

    Samples = tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]

#: Interval of thinning: the number of seconds with samples that have not been thinned.
_AT_A_TIME: Final = 60.0


class GrowingRecord(Record):
    """The record of a run that is still writing to ``directory``.

    Series, events and phases are those of the last call of `look`. Raises RecordError if no run is writing. The stream
    stays open, so no sample is lost when the run ends and replaces the stream by another file.
    """

    def __init__(self, directory: Path | str) -> None:
        stream = Path(directory) / STREAM
        if not is_held(stream.parent):
            raise RecordError(f"no run is writing into {directory}; use the folder of a run in progress")
        facts = read_head(stream)
        signals, self._begun = facts.pop("signals"), facts.pop("start_ns")
        super().__init__(stream, None, {**facts, "start_ns": self._begun or 0}, signals, [])
        self._names = tuple(self.signals)
        self._samples: dict[str, list[Samples]] = {}
        self._rows_read, self._latest_ns = 0, self.start_ns
        self._thinned_until = 0.0
        self._file = stream.open("rb")
        self._head, self._read = b"", 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def __len__(self) -> int:
        return self._rows_read

    @property
    def duration(self) -> float:
        """Return the time (s) from the start to the latest sample or event that was read."""
        return (self._latest_ns - self.start_ns) / SECOND

    @property
    def phases(self) -> list[Phase]:
        """Return the phases so far. An open phase ends at the latest time that was read."""
        return phases_of(self.events, self.start_ns, self._latest_ns)

    def look(self) -> bool:
        """Read the samples since the previous call. Return False after the run has ended and all samples are read."""
        continues = is_held(self.path.parent)
        self._take_in()
        return continues

    def series(self, name: str) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return all samples of one signal so far, in order of time, like `Record.series`."""
        if name not in self.signals:
            return super().series(name)  # which raises the error
        chunks = self._samples.get(name, [])
        if not chunks:
            return np.empty(0), np.empty(0)
        if len(chunks) > 1:
            times = np.concatenate([times for times, _ in chunks])
            values = np.concatenate([values for _, values in chunks])
            if np.any(np.diff(times) < 0):
                order = np.argsort(times, kind="stable")
                times, values = times[order], values[order]
            chunks[:] = [(times, values)]
        times, values = chunks[0]
        return (times - self.start_ns) / SECOND, values

    def thin(self, before: float) -> None:
        """Before a time (s), keep only one sample per second of each signal: the one nearest to the mean of that
        second.

        The work may be postponed to a later call. Without this, a run of a day would not fit into memory.
        """
        if before < self._thinned_until + _AT_A_TIME:
            return
        self._thinned_until = before
        for name, chunks in self._samples.items():
            self.series(name)  # brings them in order
            times, values = chunks[0]
            old = int(np.searchsorted(times, self.start_ns + round(before * SECOND)))
            if old:
                keep = np.append(_of_each_second(times[:old], values[:old]), np.arange(old, len(times)))
                chunks[:] = [(times[keep], values[keep])]

    def _take_in(self) -> None:
        """Read all complete new batches. A batch that is still being written is read by a later call."""
        import pyarrow as pa

        self._file.seek(self._read)
        fresh = self._file.read()
        source = io.BytesIO(self._head + fresh)
        try:
            reader = pa.ipc.open_stream(source)
            if (
                not self._head
            ):  # the schema is before the first batch, and is read again before every later batch
                self._head = source.getvalue()[: source.tell()]
                self._read = source.tell()
                fresh = fresh[source.tell() :]
            good = source.tell()
            while True:
                batch, custom = reader.read_next_batch_with_custom_metadata()
                events: list[RecordedEvent] = (
                    [] if custom is None else msgspec.json.decode(custom[b"events"], type=list[RecordedEvent])
                )
                self._append(batch, events)
                self._read += source.tell() - good
                good = source.tell()
        except (StopIteration, EOFError, pa.ArrowException, OSError):
            return

    def _append(self, batch: pa.RecordBatch, events: list[RecordedEvent]) -> None:
        times, values = as_array(batch.column("time_ns")), as_array(batch.column("value"))
        signal = as_array(batch.column("signal"))
        instants = [event.time_ns for event in events]
        if len(times):
            instants += [int(times.min()), int(times.max())]
        if self._begun is None and instants:
            self._begun = self.start_ns = min(instants)
        self._latest_ns = max([self._latest_ns, *instants])
        self._rows_read += len(times)
        self.events += events
        if not len(times):
            return
        order = np.argsort(signal, kind="stable")
        present, first = np.unique(signal[order], return_index=True)
        for place, rows in zip(present, np.split(order, first[1:]), strict=True):
            self._samples.setdefault(self._names[place], []).append((times[rows].copy(), values[rows].copy()))


def _of_each_second(times: npt.NDArray[np.int64], values: npt.NDArray[np.float64]) -> npt.NDArray[np.intp]:
    """Return the indices of the samples (n,), in order, that are nearest to the mean of their second. A NaN is chosen
    only if all samples of a second are NaN.
    """
    second = times // SECOND
    first = np.flatnonzero(np.diff(second, prepend=second[0] - 1))
    known = np.isfinite(values)
    total = np.add.reduceat(np.where(known, values, 0.0), first)
    mean = total / np.maximum(np.add.reduceat(known, first, dtype=np.int64), 1)
    group = np.cumsum(np.diff(second, prepend=second[0]) != 0)
    away = np.where(known, np.abs(values - mean[group]), np.inf)
    return np.lexsort((away, second))[first]
