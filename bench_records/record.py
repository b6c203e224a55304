"""The reader of a record: series by name, a table at one rate, events, phases, and meta data."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from bench_protocol.suggestion import did_you_mean
from bench_records.layout import (
    FORMAT,
    PARQUET,
    PREFIX,
    RESERVED,
    SECOND,
    STREAM,
    Phase,
    RecordedEvent,
    RecordError,
    SignalInfo,
    as_array,
    encode,
    flat,
    phases_of,
)
from bench_records.stream import metadata_errors, read_stream, refuse_held

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    import pandas as pd
    import pyarrow as pa

# More rows than this indicate a wrong rate.
ROW_LIMIT = 20_000_000


class Record:
    """The record of one run. All times are in seconds since the start of the record."""

    def __init__(
        self,
        path: Path,
        table: pa.Table,
        meta: dict[str, Any],
        signals: Sequence[SignalInfo],
        events: list[RecordedEvent],
    ) -> None:
        self.path = path
        self.start_ns: int = meta.pop("start_ns")
        self.meta = meta
        self.signals = {signal.name: signal for signal in signals}
        self.events = events
        self._table = table

    def __len__(self) -> int:
        return int(self._table.num_rows)

    @cached_property
    def duration(self) -> float:
        """Return the time (s) from the start to the last sample or event."""
        instants = [self.start_ns, *(event.time_ns for event in self.events)]
        if len(self):
            instants.append(int(as_array(self._table.column("time_ns")).max()))
        return (max(instants) - self.start_ns) / SECOND

    @cached_property
    def phases(self) -> list[Phase]:
        """Return the named parts of the run, in the order in which they began."""
        return phases_of(self.events, self.start_ns, self.start_ns + round(self.duration * SECOND))

    def time_of(self, event: RecordedEvent) -> float:
        """Return the time of an event in seconds since the start."""
        return (event.time_ns - self.start_ns) / SECOND

    def series(self, name: str) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return all samples of one signal, sorted by time: times (n,) in s and values (n,) in SI. Both arrays are
        read-only.

        They are empty if the signal has no samples. Raises ``RecordError`` for an unknown name.
        """
        import numpy as np

        if name not in self.signals:
            raise RecordError(f"{self.path} has no signal {name!r}{_nearest(name, self.signals)}")
        return self._series.get(name, (np.empty(0), np.empty(0)))

    def frame(self, names: Sequence[str], rate: float, gap: float = 1.0) -> pd.DataFrame:
        """Return signals sampled at one ``rate`` in Hz as a data frame: index ``time_s``, and one column in SI for
        each name.

        Values between samples are interpolated linearly. Signals with named values keep the last value instead. Values
        are NaN in gaps of more than ``gap`` seconds, before the first sample and after the last. Raises ``RecordError``
        for an unknown name, a rate that is not positive, and too many rows.
        """
        import numpy as np
        import pandas as pd

        if not (0.0 < rate < float("inf")):
            raise RecordError(f"rate = {rate} Hz; the rate must be positive and finite")
        if self.duration * rate > ROW_LIMIT:
            raise RecordError(
                f"rate = {rate} Hz over {self.duration:.0f} s makes more than {ROW_LIMIT} rows; choose a lower rate"
            )
        # The grid includes the last instant even if rounding makes duration * rate slightly less than an integer.
        grid = np.arange(int(self.duration * rate + 1e-6) + 1) / rate
        columns = {
            name: _resample(*self.series(name), grid, gap, bool(self.signals[name].names)) for name in names
        }
        return pd.DataFrame(columns, index=pd.Index(grid, name="time_s"))

    @cached_property
    def _series(self) -> dict[str, tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]]:
        """Return the samples of each signal, sorted by time. Sorting all samples once is faster than a search for
        each signal.
        """
        import numpy as np

        if not len(self):
            return {}
        column = flat(self._table.column("signal"))
        index = as_array(column.indices)
        stamps = as_array(self._table.column("time_ns"))
        order = np.argsort(index, kind="stable")
        ends = np.cumsum(np.bincount(index, minlength=len(column.dictionary)))[:-1]
        for rows in np.split(order, ends):
            if np.any(np.diff(stamps[rows]) < 0):
                rows[:] = rows[np.argsort(stamps[rows], kind="stable")]
        times = (stamps[order] - self.start_ns) / SECOND
        values = as_array(self._table.column("value"))[order]
        for array in (times, values):
            array.flags.writeable = False
        return {
            name: (time, value)
            for name, time, value in zip(
                column.dictionary.to_pylist(), np.split(times, ends), np.split(values, ends), strict=True
            )
        }


def read(directory: Path | str) -> Record:
    """Return the record in a directory. The record of a killed run has the entry ``recovered`` in its meta data.

    Raises ``RecordError`` if there is no record, if the run has not ended, or if the format is not supported.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = Path(directory) / PARQUET
    if path.with_name(STREAM).exists():
        return _read_cut_off(path.with_name(STREAM))
    if not path.parent.exists():
        raise RecordError(f"{directory} does not exist; check the path")
    if not path.is_file():
        raise RecordError(f"{directory} holds no {PARQUET}; name the folder of a single run")
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            raw = file.metadata.metadata or {}
            ours = {
                key.decode(errors="replace"): value
                for key, value in raw.items()
                if key.startswith(PREFIX.encode())
            }
            if ours.get(PREFIX + "format") != encode(FORMAT):
                raise RecordError(
                    f"{path} is a Parquet file, but not in the format {FORMAT}; read it with `astb import`"
                )
            table = file.read(columns=["time_ns", "signal", "value"])
    except (pa.ArrowException, OSError) as error:
        raise RecordError(
            f"{path} is damaged, or is not a Parquet file ({error}); use a copy, or repeat the run"
        ) from error
    facts = {key.removeprefix(PREFIX): value for key, value in ours.items()}
    with metadata_errors(path):
        meta = {
            key: msgspec.json.decode(value) for key, value in sorted(facts.items()) if key not in RESERVED
        }
        meta["start_ns"] = msgspec.json.decode(facts["start_ns"], type=int)
        signals = msgspec.json.decode(facts["signals"], type=list[SignalInfo])
        events = msgspec.json.decode(facts["events"], type=list[RecordedEvent])
    return Record(path, table, meta, signals, events)


def _read_cut_off(stream: Path) -> Record:
    import pyarrow as pa

    refuse_held(stream.parent)
    found = read_stream(stream)
    builder = pa.lib.StringBuilder()  # pa.array would import pandas
    builder.append_values([signal.name for signal in found.signals])
    signals = pa.DictionaryArray.from_arrays(flat(found.table.column("signal")), builder.finish())
    table = found.table.set_column(1, "signal", signals)
    facts = {**found.facts, "recovered": str(found.recovery)}
    meta = {**dict(sorted(facts.items())), "start_ns": found.start_ns}
    return Record(stream, table, meta, found.signals, found.events)


def _resample(
    times: npt.NDArray[np.float64],
    values: npt.NDArray[np.float64],
    grid: npt.NDArray[np.float64],
    gap: float,
    hold: bool,
) -> npt.NDArray[np.float64]:
    import numpy as np

    if not times.size:
        return np.full(grid.shape, np.nan)
    before = np.searchsorted(times, grid, side="right") - 1
    after = np.clip(np.searchsorted(times, grid, side="left"), 0, times.size - 1)
    known = (before >= 0) & (grid <= times[-1])
    before = np.clip(before, 0, None)
    bridged = times[after] - times[before] <= gap
    result = values[before] if hold else np.interp(grid, times, values)
    return np.where(known & bridged, result, np.nan)


def _nearest(name: str, names: Sequence[str] | dict[str, SignalInfo]) -> str:
    return f"; {did_you_mean(name, names)}"
