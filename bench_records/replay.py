"""The data of a run for the animated drawing of the bench: readings at intervals, valves, states, events."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

from bench_protocol.table_signals import MEASUREMENTS
from bench_records.event_table import tabled_events
from bench_records.run_drawings import TRIP

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from bench_records.plot_data import PlotData
    from bench_records.record import Record

#: Decimals for each unit; two for any other unit.
DECIMALS: Final = {"mm": 1, "bar": 2, "kN": 1, "K": 1, "degC": 1, "mrad": 2, "m/s2": 2}
#: Largest number of pictures of a run, and their least distance (s).
PICTURES: Final = 3000
APART: Final = 0.1
#: A reading is valid for this time (s); the slowest signals have one reading per second.
STANDS: Final = 2.5
_EVENTS: Final = 300
#: Units that are written differently than they are typed.
WRITTEN: Final = {"m/s2": "m/s²", "degC": "°C"}
_STATE: Final = "rig.state"


def replay_of(record: Record, numbers: PlotData) -> dict[str, Any] | None:
    """Return the data of a run for the script of the drawing. Its series are added to ``numbers``. Return None if
    there are no readings.
    """
    step = max(APART, math.ceil(1000 * record.duration / PICTURES) / 1000)
    signals = [_signal(record, one.name, one.unit, numbers, step) for one in MEASUREMENTS]
    if all(one["at"] is None for one in signals):
        return None
    known = record.meta.get("dimensions") or {}
    return {
        "duration": record.duration,
        "step": step,
        "dimensions": {name: one["value"] for name, one in known.get("known", {}).items()},
        "signals": signals,
        "settings": [
            (
                _event_time(record, event),
                {name: value for name, value in event.data.items() if name.startswith("air.")},
            )
            for event in record.events
            if event.kind == "setting" and any(name.startswith("air.") for name in event.data)
        ],
        "states": _states(record),
        "phases": [(round(phase.start, 3), phase.name) for phase in record.phases],
        "trips": [
            (_event_time(record, event), event.data.get("signal", ""))
            for event in record.events
            if event.kind == TRIP
        ],
        "events": _events(record),
    }


def _signal(record: Record, name: str, unit: str, numbers: PlotData, step: float) -> dict[str, Any]:
    info = record.signals.get(name)
    shown = info.shown_unit if info else unit
    decimals = DECIMALS.get(shown, 2)
    times, values = record.series(name) if info else (None, None)
    at = None
    if info is not None and times is not None and times.size:
        at = numbers.place(thinned(times, info.shown(values), record.duration, step, decimals))
    return {
        "name": name,
        "label": name.replace(".", " ").replace("_", " "),
        "unit": WRITTEN.get(shown, shown),
        "decimals": decimals,
        "factor": info.scale if info else 1.0,
        "at": at,
    }


def thinned(
    times: npt.NDArray[np.float64],
    values: npt.NDArray[np.float64],
    duration: float,
    step: float,
    decimals: int,
) -> npt.NDArray[np.float64]:
    """Return the latest sample at each of the instants 0, ``step``, 2 ``step`` … up to ``duration`` (s), rounded to
    ``decimals``. It is NaN without a sample in the last `STANDS` s.
    """
    import numpy as np

    grid = np.arange(math.floor(duration / step + 1e-6) + 1) * step
    rows = np.searchsorted(times, grid + 1e-9, side="right") - 1
    stands = (rows >= 0) & (grid - times[rows] <= STANDS)
    return np.where(stands, np.round(values[rows], decimals), np.nan)


def _states(record: Record) -> list[tuple[float, str]]:
    import numpy as np

    if _STATE not in record.signals:
        return []
    times, values = record.series(_STATE)
    if not times.size:
        return []
    names = record.signals[_STATE].names
    changes = np.concatenate(([0], np.flatnonzero(np.diff(values)) + 1))
    return [(round(float(times[k]), 3), names.get(int(values[k]), "").replace("_", " ")) for k in changes]


def _events(record: Record) -> list[tuple[float, str]]:
    events = [(_event_time(record, event), event.text or event.kind) for event in tabled_events(record)]
    events += [(round(phase.start, 3), f"phase {phase.name}") for phase in record.phases]
    return sorted(events)[:_EVENTS]


def _event_time(record: Record, event: Any) -> float:
    return round(record.time_of(event), 3)
