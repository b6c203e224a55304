"""What sound benches show by themselves: a table of the amplitude of each effect that a replay imitates.

``python -m benchmarks.diagnosis.imitated`` makes it anew. Sound benches are screened like those of the benchmark, with
seeds of their own; scores should be standard normal. What they scatter beyond that, about 0, is the doing of the
replay: its motion is smoothed, its friction turns a little earlier or later than that of the bench.
"""

import os
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Final

os.environ.setdefault("OMP_NUM_THREADS", "1")

import click
import numpy as np

from benchmarks.diagnosis.bench_cases import BenchCases, temporary_directory
from diagnosis.engine.base_model import fit_base_model
from diagnosis.engine.config import Config
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.runs import measured_channels
from diagnosis.engine.search_state import Problem
from diagnosis.engine.trials import current_model
from diagnosis.systems.air_spring_parameters import IMITATED

SEEDS: Final = 900_000
HEADER: Final = """\
# Made by `python -m benchmarks.diagnosis.imitated`; do not edit. Amplitude (SI) of each effect that the replay of a
# sound bench imitates, as one standard deviation: {count} benches, no two alike, screened in six runs of twenty s.
# What is not listed scatters no more than its noise.
"""


def excess(seed: int) -> list[tuple[str, float, float]]:
    """Return what a sound bench shows: effect, squared score less 1, and squared λ per unit of amplitude."""
    bench = BenchCases()
    with temporary_directory() as directory:
        dataset = bench.measure(seed, "null", "white", Path(directory)).dataset
    data, model = measured_channels(dataset, bench.simulator)
    replay = Replay(model, data.of("fit"), 1)
    problem = Problem(replay, (), dict(model.catalogue), Config(seed=seed, workers=1))
    screening = current_model(problem, fit_base_model(replay)).screening
    scales = np.array([one.amplitude.scale for one in screening.candidates])
    square = screening.projection.z**2 / screening.inflation - 1.0
    information = (screening.projection.norm / scales) ** 2 / screening.inflation
    names = [one.effect.name.partition(".")[0] for one in screening.candidates]
    return [
        (name, float(z), float(unit))
        for name, z, unit in zip(names, square, information, strict=True)
        if unit > 0.0
    ]


@click.command()
@click.option("--rigs", default=32, show_default=True)
@click.option("--processes", default=2, show_default=True)
def main(rigs: int, processes: int) -> None:
    """Measure the table on so many sound benches, and keep it."""
    squares: dict[str, list[float]] = defaultdict(list)
    information: dict[str, list[float]] = defaultdict(list)
    with ProcessPoolExecutor(processes) as pool:
        for number, found in enumerate(pool.map(excess, range(SEEDS, SEEDS + rigs)), 1):
            for name, square, unit in found:
                squares[name].append(square)
                information[name].append(unit)
            click.echo(f"{number} of {rigs}")
    lines = [HEADER.format(count=rigs)]
    for name in sorted(squares):
        mean = float(np.mean(squares[name]))
        click.echo(f"{name}: scores scatter by {np.sqrt(1.0 + mean):.2f}")
        if mean > 0.0:
            lines.append(f"{name} = {np.sqrt(mean / np.mean(information[name])):.2g}\n")
    IMITATED.write_text("".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
