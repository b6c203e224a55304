"""Compile the model in advance, in two processes: python -m tools.compile_model.

Otherwise each function is compiled at its first use. This would delay the first rig, the first diagnosis and each
process of the tests.
"""

from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import Final

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

#: Samples each second and in all, of motions that rest, shake and rest again.
RATE: Final = 200.0
LENGTH: Final = 2000
#: Gauge pressure in the springs, Pa.
GAUGE: Final = 2e5


def compile_rig() -> None:
    """Compile the tick of a rig, in real and virtual time, and the cycle of a commander."""
    from astb.rig_file import Simulation
    from astb.rig_in_memory import RigInMemory
    from astb.session import build_rig

    RigInMemory(build_rig(Simulation()))
    import drivers.cycle  # noqa: F401  compiled when it is imported


def compile_diagnosis() -> None:
    """Compile the replay of a diagnosis, with a few seconds of an unmodified bench."""
    from bench_sim.model.effects import CATALOGUE
    from bench_sim.parameters import load
    from diagnosis.contracts import Dataset, Experiment, MeasuredRun
    from diagnosis.engine.config import Config
    from diagnosis.engine.diagnose import diagnose
    from diagnosis.systems.air_spring.simulator import AirSpring

    bench = AirSpring(load(), effects=CATALOGUE)
    noise = np.array([channel.noise for channel in bench.channels])
    time = np.arange(LENGTH) / RATE
    moving = (time > 2.0) & (time < 8.0)
    runs = []
    for k, frequency in enumerate((0.5, 1.0, 2.0)):
        height = np.where(moving, 3e-3 * np.sin(2.0 * np.pi * frequency * time), 0.0)
        inputs = {"left.height": height, "right.height": 0.5 * height}
        settings = {"left.bellows_pressure": GAUGE, "right.bellows_pressure": GAUGE}
        one = Experiment(f"run {k}", time, inputs, settings)
        outputs = bench.run(one, {}, {}) + noise * np.random.default_rng(k).normal(size=(LENGTH, len(noise)))
        runs.append(MeasuredRun(one, outputs, np.ones(LENGTH, bool), ~moving))
    diagnose(Dataset(bench.channels, tuple(runs)), bench, Config(effects=("leak.left", "sample_and_hold")))


def compile_plant() -> None:
    """Compile the plant and the imposed motions, which the study of the paper and many tests use."""
    from bench_sim.model.experiments import VERTICAL, ImposedMotion, impose
    from bench_sim.model.plant import STEP, Plant
    from bench_sim.parameters import load

    plant = Plant.at_rest(load().record)
    plant.step()
    plant.measure()
    impose(plant, [ImposedMotion(VERTICAL, 1e-3, 1.0)], STEP)


def main() -> None:
    """Compile the parts in two processes, and print a line for each part, with a clock on a terminal."""
    parts = {
        "what a diagnosis replays": compile_diagnosis,
        "the rig's tick": compile_rig,
        "the bench alone": compile_plant,
    }
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with (
        ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes,
        Progress(*columns, console=Console(stderr=True)) as progress,
    ):
        bar = progress.add_task("compiling", total=len(parts))
        names = {processes.submit(part): name for name, part in parts.items()}
        for done in as_completed(names):
            done.result()
            progress.advance(bar)
            progress.console.print(f"compiled: {names[done]}")


if __name__ == "__main__":
    main()
