"""AW0 and AW3 in virtual time with full recording, and the time of each part of the software."""

import contextlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from astb.rig_file import Simulation
from astb.session import build_rig, virtual_session
from astb_studies.benchmarks.measure import BenchmarkRow, Effort, Section, Spread, compare, interleaved
from bench_protocol.units import NS, ms, s
from bench_records.report import write_report
from bench_sim.model.plant import Plant
from bench_sim.parameters import load
from drivers.memory import InMemoryCan
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.recording import Recording

TICK: Final = 1 * ms
BATCH: Final = 20
REPETITIONS, QUICK_REPETITIONS = 7, 2
#: Targets: speed relative to real time, and processor time of the whole command (s).
SPEED_AIM: Final = 300
COMMAND_AIM: Final = 2.5 * s
LIBRARIES: Final = "import numba, matplotlib.figure, pyarrow.parquet"
#: The timed parts of a run: ticks of the rig with the commands, reception in the drivers, and the record.
PARTS: Final = ("rig: ticks and commands", "drivers: frames", "record")


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
    """Run a plan on its own rig; return simulated and real time of the plan itself (s)."""
    rig: Any = build_rig(Simulation())
    with contextlib.ExitStack() as stack:
        if meter:
            rig.run_until_event = meter.of("rig: ticks and commands", rig.run_until_event)
            stack.enter_context(metered(meter, "drivers: frames", InMemoryCan, "receive"))
            stack.enter_context(metered(meter, "record", Recording, "take"))
        session = stack.enter_context(virtual_session(rig, Simulation()))
        session.bench.connect()
        simulated, start = session.clock.now(), time.perf_counter()
        result = execute(plans()[name], session.bench, directory / name, rig="virtual", seed=0)
        elapsed = time.perf_counter() - start
        if result.verdict != "pass":
            raise RuntimeError(
                f"{name}: {result.verdict} {result.reason}; the duration of such a run does not count"
            )
        return (session.clock.now() - simulated) / NS, elapsed


@contextlib.contextmanager
def metered(meter: Meter, part: str, owner: Any, method: str) -> Iterator[None]:
    """Time a method of all objects of a class, because this module has no access to the objects."""
    original = getattr(owner, method)
    setattr(owner, method, meter.of(part, original))
    try:
        yield
    finally:
        setattr(owner, method, original)


def bare_plant(duration: float) -> float:
    """Return the time of the model alone for ``duration`` s, in batches as in a run (s)."""
    plant = Plant.at_rest(load("astb").record)
    start = time.perf_counter()
    for _ in range(round(duration / TICK / BATCH)):
        plant.step(BATCH)
    return time.perf_counter() - start


def processor_time(*arguments: str) -> float:
    """Return the processor time of a Python process with these arguments, from its start to its end (s)."""
    before = os.times()
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    after = os.times()
    return after.children_user - before.children_user + after.children_system - before.children_system


def whole_command(repetitions: int) -> BenchmarkRow:
    """Measure ``astb run aw0 aw3 --virtual`` as a user starts it, compared with the imports of its libraries."""

    def command() -> float:
        with tempfile.TemporaryDirectory() as directory:
            return processor_time("-m", "astb", "run", "aw0", "aw3", "--virtual", "--out", directory)

    times = interleaved(repetitions, {"command": command, "imports": lambda: processor_time("-c", LIBRARIES)})
    return compare(
        "astb run aw0 aw3 --virtual, processor time of the whole command",
        times["command"],
        "importing numba, matplotlib and pyarrow",
        times["imports"],
        aim=f"{COMMAND_AIM:g} s",
        met=Spread.of(times["command"]).middle <= COMMAND_AIM,
    )


def run(effort: Effort) -> Section:
    """Run both plans several times, each time next to the bare model; then the whole command."""
    ours: list[float] = []
    control: list[float] = []
    drawing: list[float] = []
    shares: dict[str, list[float]] = {part: [] for part in PARTS}
    rest: list[float] = []
    simulated = 0.0
    repetitions = QUICK_REPETITIONS if effort.quick else REPETITIONS
    for repetition in range(1 + repetitions):
        with tempfile.TemporaryDirectory() as directory:
            runs = [execute_plan(name, Path(directory)) for name in ("aw0", "aw3")]
            start = time.process_time()
            for name in ("aw0", "aw3"):
                write_report(Path(directory) / name)
            drawn = time.process_time() - start
        simulated = sum(duration for duration, _ in runs)
        bare = bare_plant(simulated)
        meter = Meter()
        with tempfile.TemporaryDirectory() as directory:
            measured = sum(execute_plan(name, Path(directory), meter)[1] for name in ("aw0", "aw3"))
        if repetition == 0:
            continue  # imports and other work that happens only once
        ticks = simulated / TICK
        ours.append(sum(elapsed for _, elapsed in runs) / ticks)
        control.append(bare / ticks)
        drawing.append(drawn / 2)
        meter.spent["drivers: frames"] -= meter.spent["record"]  # the record is fed from inside the receiver
        for part in PARTS:
            shares[part].append(meter.spent[part] / ticks)
        rest.append((measured - sum(meter.spent.values())) / ticks)
    speed = 1.0 / (Spread.of(ours).middle / TICK)
    rows = [
        compare(
            f"aw0 and aw3, per tick of 1 ms: {speed:.0f} times real time",
            ours,
            "the bare model, per step",
            control,
            aim=f"{SPEED_AIM} times real time",
            met=speed >= SPEED_AIM,
        ),
        *(compare(f"of that, {part}", shares[part], "the bare model", control) for part in PARTS),
        compare("of that, waits, plan and the end of the record", rest, "the bare model", control),
        BenchmarkRow("drawing one report, processor time", "s", Spread.of(drawing)),
        whole_command(repetitions),
    ]
    return Section("AW0 and AW3 in virtual time", rows, (explained(simulated, speed),))


def explained(simulated: float, speed: float) -> str:
    """Return the notes on the rows: which parts the times include."""
    return (
        f"Both plans simulate {simulated:.1f} s and take {simulated / speed:.2f} s on the wall: "
        f"{speed:.0f} times real time, from the first line of the plan to the closed record, without the report. "
        "The processor time of the whole command has everything in it: imports, both rigs, both runs and both reports; "
        "only the compiled model was there already."
    )
