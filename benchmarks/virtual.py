"""AW0 and AW3 in virtual time, with everything that is recorded, and where that time goes."""

import contextlib
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from astb.rig_file import Simulation
from astb.session import build_rig, virtual_session
from bench_protocol.units import NS, ms
from bench_records.report import write_report
from bench_sim.model.plant import Plant
from bench_sim.parameters import load
from benchmarks.measure import BenchmarkRow, Effort, Section, Spread, compare
from test_plans.discovery import plans
from test_plans.execution import execute

TICK: Final = 1 * ms
BATCH: Final = 20
REPETITIONS, QUICK_REPETITIONS = 7, 2
#: What is timed inside a run: the rig's ticks, its reading of commands, the drivers' receiving, the record.
PARTS: Final = ("rig: ticks", "rig: commands", "drivers: frames", "record")


class Meter:
    """Wraps functions and adds up the time that passes in them (s)."""

    def __init__(self) -> None:
        self.spent = dict.fromkeys(PARTS, 0.0)

    def of(self, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any) -> Any:
            start = time.perf_counter_ns()
            try:
                return function(*arguments)
            finally:
                self.spent[part] += (time.perf_counter_ns() - start) / NS

        return timed


def execute_plan(name: str, directory: Path, meter: Meter | None = None) -> tuple[float, float]:
    """Run a plan on a rig of its own; return simulated and real time of the plan itself (s)."""
    rig: Any = build_rig(Simulation())
    with contextlib.ExitStack() as stack:
        if meter:
            rig.run = meter.of("rig: ticks", rig.run)
            rig.receive = meter.of("rig: commands", rig.receive)
            stack.enter_context(metered_record(meter))
        session = stack.enter_context(virtual_session(rig, Simulation()))
        receiver: Any = session.bench.receiver
        if meter:
            receiver.accept = meter.of("drivers: frames", receiver.accept)
        session.bench.connect()
        simulated, start = session.clock.now(), time.perf_counter()
        result = execute(plans()[name], session.bench, directory / name, rig="virtual", seed=0)
        elapsed = time.perf_counter() - start
        if result.verdict != "pass":
            raise RuntimeError(f"{name}: {result.verdict} {result.reason}: not a run to be timed")
        return (session.clock.now() - simulated) / NS, elapsed


@contextlib.contextmanager
def metered_record(meter: Meter) -> Iterator[None]:
    """Time what plans give to the record."""
    import test_plans.recording

    recording: Any = test_plans.recording.Recording
    original = recording.take
    recording.take = meter.of("record", original)
    try:
        yield
    finally:
        recording.take = original


def bare_plant(duration: float) -> float:
    """Return how long the model alone needs for ``duration`` s, in batches as in a run (s)."""
    plant = Plant.at_rest(load("astb").record)
    start = time.perf_counter()
    for _ in range(round(duration / TICK / BATCH)):
        plant.step(BATCH)
    return time.perf_counter() - start


def run(effort: Effort) -> Section:
    """Run both plans several times, each time beside the bare model."""
    ours: list[float] = []
    control: list[float] = []
    drawing: list[float] = []
    computing: list[float] = []
    shares: dict[str, list[float]] = {part: [] for part in PARTS}
    rest: list[float] = []
    simulated = 0.0
    for repetition in range(1 + (QUICK_REPETITIONS if effort.quick else REPETITIONS)):
        with tempfile.TemporaryDirectory() as directory:
            before = time.process_time()
            runs = [execute_plan(name, Path(directory)) for name in ("aw0", "aw3")]
            processor = time.process_time() - before
            start = time.perf_counter()
            for name in ("aw0", "aw3"):
                write_report(Path(directory) / name)
            drawn = time.perf_counter() - start
        simulated = sum(duration for duration, _ in runs)
        bare = bare_plant(simulated)
        meter = Meter()
        with tempfile.TemporaryDirectory() as directory:
            measured = sum(execute_plan(name, Path(directory), meter)[1] for name in ("aw0", "aw3"))
        if repetition == 0:
            continue  # imports, and whatever else happens only once
        ticks = simulated / TICK
        ours.append(sum(elapsed for _, elapsed in runs) / ticks)
        control.append(bare / ticks)
        drawing.append(drawn / 2)
        computing.append(processor)
        meter.spent["drivers: frames"] -= meter.spent["record"]  # the record is fed from inside the receiver
        for part in PARTS:
            shares[part].append(meter.spent[part] / ticks)
        rest.append((measured - sum(meter.spent.values())) / ticks)
    speed = 1.0 / (Spread.of(ours).middle / TICK)
    rows = [
        compare(
            "aw0 and aw3, per tick of 1 ms",
            ours,
            "the bare model, per step",
            control,
            aim="200 times real time",
            met=speed >= 200,
        ),
        *(compare(f"of that, {part}", shares[part], "the bare model", control) for part in PARTS),
        compare("of that, waits, plan and the end of the record", rest, "the bare model", control),
        BenchmarkRow("drawing one report", "s", Spread.of(drawing)),
    ]
    notes = (
        f"Both plans simulate {simulated:.1f} s and take {simulated / speed:.2f} s: "
        f"{speed:.0f} times real time, from the first line of the plan to the closed record, without the report. "
        f"Imports and compilation are not in it. Times on the wall; the processor was busy with it, building both rigs "
        f"included, for {Spread.of(computing).middle:.2f} s.",
    )
    return Section("AW0 and AW3 in virtual time", rows, notes)
