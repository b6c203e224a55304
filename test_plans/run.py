"""The execution of a plan: set-up, main part, tear-down whatever happens, and the record of all of it."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.signals import Kind, Table
from bench_protocol.table import TICK
from bench_protocol.units import FACTORS, ms, us
from drivers.errors import BenchError
from test_plans.analysis import NotMeasured
from test_plans.plan import Nobody, Part, Plan, Run, Watcher

if TYPE_CHECKING:
    from bench_records.layout import SignalInfo
    from bench_records.recorder import Recorder
    from bench_records.result import Result, Timing
    from drivers.bench import Bench

#: Whose fault it is, in words.
_WHOSE: Final = {"rig": "the rig", "link": "the link to the rig", "plan": "the plan"}
_STOPPED: Final = "stopped by the operator"
#: Upper edges of the bins of the rig's lateness histogram (s); the last has none.
_EDGES: Final = (50 * us, 100 * us, 250 * us, 500 * us, 1 * ms)
_BINS: Final = ("50us", "100us", "250us", "500us", "1ms", "more")

#: The panels of the report, by the end of a signal's name.
_QUANTITIES: Final = (
    ("height", "Spring heights"),
    ("temperature", "Gas temperatures"),
    ("supply.pressure", "Supply (gauge)"),
    ("pressure", "Spring pressures (gauge)"),
    ("displacement", "Actuator displacements"),
    ("lateral.force", "Lateral actuator force"),
    ("force", "Vertical actuator forces"),
    ("acceleration", "Lateral acceleration"),
    ("platform.vertical", "Platform"),
    ("platform.lateral", "Platform"),
    ("platform.roll", "Platform roll"),
    ("load_cell.5", "Lateral load cells"),
    ("load_cell.6", "Lateral load cells"),
)


def execute(
    plan: Plan,
    bench: Bench,
    directory: Path | str,
    *,
    meta: Mapping[str, Any] | None = None,
    rig: str = "",
    seed: int | None = None,
    watcher: Watcher | None = None,
) -> Result:
    """Run ``plan`` on a connected ``bench`` and leave record, ``result.json`` and ``junit.xml`` in ``directory``.

    The verdict is *fail* if the product broke a limit and *blocked* if rig, link, plan or operator kept it from being
    judged. Tear-down runs in every case, and its own troubles stand behind those that came first. KeyboardInterrupt
    comes out again, once everything is written; the report is made of the directory by ``bench_records.report``.
    """
    from bench_records.junit import write_junit
    from bench_records.layout import phases_of
    from bench_records.recorder import Recorder
    from bench_records.result import Outcome, conclude

    signals = recorded_signals(bench.table)
    start = bench.clock.now()
    recorder = Recorder(
        directory, list(signals.values()), {"plan": plan.name, **(meta or {})}, start_ns=start
    )
    run = Run(bench, recorder, watcher or Nobody(), plan.lasts)
    bench.receiver.sink = _Sink(bench.table, list(signals), recorder)
    bench.settings.applied = lambda values: _keep_settings(run, values)
    before = _lateness(bench)
    try:
        with suppress(BenchError):  # a rig that is gone is what set-up will complain of
            _keep_settings(run, bench.settings.in_force())
        first, interrupted = _attempt(run, "set-up", plan.setup)
        if not first:
            first, interrupted = _attempt(run, "main", plan.main)
        last, again = _attempt(run, "tear-down", plan.teardown)
        timing = _timing(before, _lateness(bench))
    finally:
        bench.receiver.sink = None
        bench.settings.applied = lambda values: None
        recorder.close()
    run.progress(1.0)

    reason = "; then ".join(trouble for trouble in (first, last and f"in tear-down: {last}") if trouble)
    if not first and conclude("", "", "", run.checks).verdict is Outcome.FAIL:
        # The product was judged and failed; that the bench then misbehaved stands among the events.
        reason = ""
    result = conclude(
        plan.name,
        plan.title,
        plan.instruction,
        run.checks,
        reason=reason,
        curves=run.curves,
        phases=phases_of(run.phases, start, bench.clock.now()),
        rig=rig,
        seed=seed,
        timing=timing,
    )
    result.write(directory)
    write_junit(result, directory)
    if interrupted or again:
        raise KeyboardInterrupt
    return result


def _attempt(run: Run, name: str, part: Part) -> tuple[str, bool]:
    """Run one part; return what went wrong, whose fault it is included, and whether the operator stopped it."""
    interrupted = False
    try:
        with run.phase(name):
            part(run)
        return "", False
    except BenchError as error:
        trouble = f"{_WHOSE[error.fault]}: {error}"
    except NotMeasured as error:
        trouble = f"the measurement: {error}"
    except KeyboardInterrupt:
        trouble, interrupted = _STOPPED, True
    except Exception as error:
        trouble = f"the plan: {type(error).__name__} at {_place(error)}: {error}"
    run.keep("error", f"{name}: {trouble}")
    run.watcher.say(f"{name}: {trouble}")
    return trouble, interrupted


def _place(error: Exception) -> str:
    """The innermost line of a plan from which ``error`` came; with plans outside this package, the outermost one."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = Path(__file__)
    outside = [frame for frame in frames if Path(frame.filename) != ours]
    plans = [frame for frame in outside if Path(frame.filename).parent == ours.parent]
    frame = (plans or outside or list(frames))[-1 if plans else 0]
    return f"{Path(frame.filename).name}:{frame.lineno}"


# -- what is recorded ----------------------------------------------------------------------------------------------


def recorded_signals(table: Table) -> dict[int, SignalInfo]:
    """Return for every table row that a rig reports how the record describes it."""
    from bench_records.layout import SignalInfo

    found = {}
    for row, signal in enumerate(table.signals):
        if signal.kind not in (Kind.MEASUREMENT, Kind.STATUS):
            continue
        quantity = next((q for ending, q in _QUANTITIES if signal.name.endswith(ending)), "")
        if signal.name.startswith("load_cell.") and not quantity:
            quantity = "Vertical load cells"
        found[row] = SignalInfo(
            signal.name,
            "" if signal.unit == "1" else signal.unit,
            FACTORS[signal.unit],
            signal.name.replace(".", " ").replace("_", " "),
            quantity if signal.kind is Kind.MEASUREMENT else "",
            dict(enumerate(signal.choices)),
        )
    return found


class _Sink:
    """Takes every received sample for the record, and tells it of changes of the rig's state."""

    def __init__(self, table: Table, rows: list[int], recorder: Recorder) -> None:
        self._column = np.full(len(table.signals), -1, np.int16)
        self._column[rows] = np.arange(len(rows))
        self._recorder = recorder
        self._table = table
        self._kinds = {table.index[name]: kind for name, kind in _TOLD.items()}
        self._last = np.zeros(len(table.signals))
        self._watched = np.zeros(len(table.signals), np.bool_)
        self._watched[list(self._kinds)] = True

    def __call__(
        self, times: npt.NDArray[np.int64], rows: npt.NDArray[np.int64], values: npt.NDArray[np.float64]
    ) -> None:
        self._recorder.append(times, self._column[rows], values)
        places = self._watched[rows].nonzero()[0]
        if (values[places] != self._last[rows[places]]).any():
            self._compare(times[places].tolist(), rows[places].tolist(), values[places].tolist())

    def _compare(self, times: list[int], rows: list[int], values: list[float]) -> None:
        """Tell every change; the cause comes in the same frame as the state that it led to, and is told first."""
        for time, row, value in sorted(
            zip(times, rows, values, strict=True), key=lambda one: (one[0], -one[1])
        ):
            if value != self._last[row] and not isnan(value):
                self._last[row] = value
                self._tell(time, row, value)

    def _tell(self, time: int, row: int, value: float) -> None:
        signal, kind = self._table.signals[row], self._kinds[row]
        if kind != "trip":
            self._recorder.event(time, kind, f"{signal.name}: {signal.show(value)}")
        elif value >= 1:
            tripped = self._table.signals[int(value) - 1].name
            self._recorder.event(time, kind, f"limit of {tripped} tripped", signal=tripped)


def _keep_settings(run: Run, values: Mapping[str, float]) -> None:
    """Let the record keep settings in force from now on: numbers in SI, choices as their names."""
    table = run.bench.table
    data = {
        name: table[name].choices[round(value)] if table[name].choices else value
        for name, value in values.items()
    }
    run.keep(
        "setting",
        ", ".join(f"{name}: {table[name].show(value)}" for name, value in values.items()),
        **data,
    )


_TOLD: Final = {"rig.tripped": "trip", "rig.reason": "reason", "rig.state": "state"}


# -- how punctual the rig was --------------------------------------------------------------------------------------


def _lateness(bench: Bench) -> dict[str, float] | None:
    """The rig's own account of its punctuality, or nothing if the rig does not answer any more."""
    try:
        return {name: value for name, value in bench.settings.snapshot().items() if name.startswith("rig.")}
    except BenchError:
        return None


def _timing(before: dict[str, float] | None, after: dict[str, float] | None) -> Timing | None:
    """The punctuality during the run: differences of counters; quantiles are the upper edges of their bins."""
    from bench_records.result import Timing

    if before is None or after is None:
        return None
    counts = [round(after[f"rig.lateness_{name}"] - before[f"rig.lateness_{name}"]) for name in _BINS]
    ticks = round(after["rig.tick"] - before["rig.tick"])
    late = round(after["rig.late_ticks"] - before["rig.late_ticks"])
    if ticks < 0 or late < 0 or min(counts) < 0:
        return None  # the rig was started anew, or its counters went round
    if not any(counts):
        return Timing(ticks=ticks, late=late, period=TICK)
    worst = after["rig.lateness_max"]
    quantile: Callable[[float], float] = lambda q: min((*_EDGES, worst)[_bin(counts, q)], worst)  # noqa: E731
    return Timing(
        ticks=ticks,
        late=late,
        period=TICK,
        p50=quantile(0.50),
        p99=quantile(0.99),
        max=worst,
        edges=list(_EDGES),
        counts=counts,
    )


def _bin(counts: list[int], q: float) -> int:
    return int(np.searchsorted(np.cumsum(counts), q * sum(counts)))
