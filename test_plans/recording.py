"""Record of a run: every sample that the rig reports, its changes of state, and the settings in force."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.arrays import Floats
from bench_protocol.clock import VirtualClock
from bench_protocol.signals import MEASURED, Kind
from bench_protocol.units import FACTORS
from bench_protocol.wires import Table
from bench_records.layout import RecordError, SignalInfo
from bench_records.recorder import Recorder

if TYPE_CHECKING:
    from drivers.bench import Bench
    from test_plans.run import Run

Instants = npt.NDArray[np.int64]
Rows = npt.NDArray[np.int64]

#: Signals whose changes are events of their own, and the kind of event.
_EVENTS: Final = {"rig.tripped": "trip", "rig.reason": "reason", "rig.state": "state"}


def recorded_signals(table: Table) -> dict[int, SignalInfo]:
    """Return for each table row that a rig reports the description of its signal in the record."""
    found = {}
    for row, signal in enumerate(table.signals):
        if signal.kind not in (*MEASURED, Kind.STATUS):
            continue
        found[row] = SignalInfo(
            signal.name,
            "" if signal.unit == "1" else signal.unit,
            FACTORS[signal.unit],
            signal.name.replace(".", " ").replace("_", " "),
            signal.group.row.panel if signal.group else "",
            dict(enumerate(signal.choices)),
        )
    return found


class Recording:
    """Writer of a run's record: every received sample, every change of the rig's state, and the run's events.

    Thread-safe: samples come from the receiver's thread, events from the plan's.
    """

    def __init__(self, table: Table, rows: list[int], recorder: Recorder) -> None:
        self._column = np.full(len(table.signals), -1, np.int16)
        self._column[rows] = np.arange(len(rows))
        self._recorder = recorder
        self._table = table
        self._kinds = {table.index[name]: kind for name, kind in _EVENTS.items()}
        self._last = np.zeros(len(table.signals))
        self._watched = np.zeros(len(table.signals), np.bool_)
        self._watched[list(self._kinds)] = True
        self._lock = threading.Lock()
        self.failure = ""  #: why it was not kept whole, once it is closed

    def take(self, times: Instants, rows: Rows, values: Floats) -> None:
        """Record received samples: ``times`` (ns), table ``rows`` and ``values`` (SI). Raises RecordError if the disk
        has failed.
        """
        column = self._column[rows]
        reported = column >= 0  # with a lease, the rig's answer repeats the request
        places = self._watched[rows].nonzero()[0]
        with self._lock:
            self._recorder.receive(times[reported], column[reported], values[reported])
            if (values[places] != self._last[rows[places]]).any():
                self._compare(times[places].tolist(), rows[places].tolist(), values[places].tolist())

    def event(self, time: int, kind: str, text: str, **data: Any) -> None:
        """Record an event of the run, after all samples received before it. Raises RecordError if the disk has
        failed.
        """
        with self._lock:
            self._recorder.event(time, kind, text, **data)

    def close(self) -> None:
        """Close the record. If the disk has failed, set ``failure`` to the reason."""
        try:
            self._recorder.close()
        except RecordError as error:
            self.failure = str(error)

    def _compare(self, times: list[int], rows: list[int], values: list[float]) -> None:
        """Record an event for every change of a watched signal. If cause and new state arrive in one frame, the cause
        comes first.
        """
        for time, row, value in sorted(
            zip(times, rows, values, strict=True), key=lambda one: (one[0], -one[1])
        ):
            if value != self._last[row] and not isnan(value):
                self._last[row] = value
                self._record_event(time, row, value)

    def _record_event(self, time: int, row: int, value: float) -> None:
        signal, kind = self._table.signals[row], self._kinds[row]
        if kind != "trip":
            self._recorder.event(time, kind, f"{signal.name}: {signal.show(value)}")
        elif tripped := self._table.tripped(value):
            self._recorder.event(time, kind, f"limit of {tripped.name} tripped", signal=tripped.name)


def begin_recording(bench: Bench, directory: Path | str, meta: dict[str, Any]) -> Recording:
    """Open the record of a run that begins now, and return it. Raises RecordError if the directory has an open
    record.
    """
    table, clock = bench.table, bench.clock
    signals = {
        row: one
        for row, one in recorded_signals(table).items()
        if table.signals[row].kind is not Kind.FURTHER or not bench.lacks(one.name)
    }
    recorder = Recorder(
        directory,
        list(signals.values()),
        meta,
        start_ns=clock.now(),
        in_background=not isinstance(clock, VirtualClock),
    )
    return Recording(table, list(signals), recorder)


def keep_settings(run: Run, values: Mapping[str, float]) -> None:
    """Record settings that apply from now on: numbers in SI, choices by name."""
    table = run.bench.table
    known = {name: value for name, value in values.items() if not isnan(value)}
    data = {
        name: table[name].choices[round(value)] if table[name].choices else value
        for name, value in known.items()
    }
    run.keep(
        "setting",
        ", ".join(f"{name}: {table[name].show(value)}" for name, value in known.items()),
        **data,
    )
