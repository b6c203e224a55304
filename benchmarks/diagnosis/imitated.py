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
# A number stands for each point of the grid of its shapes; 0 scatters no more than its noise.
"""


def excess(seed: int) -> list[tuple[str, int, float, float]]:
    """Return what a sound bench shows: effect, point of its grid, squared score less 1, squared λ per unit."""
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
    return [
        (one.effect.name.partition(".")[0], one.effect.grid.index(one.shapes), float(z), float(unit))
        for one, z, unit in zip(screening.candidates, square, information, strict=True)
        if unit > 0.0
    ]


@click.command()
@click.option("--rigs", default=32, show_default=True)
@click.option("--processes", default=2, show_default=True)
def main(rigs: int, processes: int) -> None:
    """Measure the table on so many sound benches, and keep it."""
    seen: dict[str, dict[int, list[tuple[float, float]]]] = defaultdict(lambda: defaultdict(list))
    with ProcessPoolExecutor(processes) as pool:
        for number, found in enumerate(pool.map(excess, range(SEEDS, SEEDS + rigs)), 1):
            for name, place, square, unit in found:
                seen[name][place].append((square, unit))
            click.echo(f"{number} of {rigs}")
    lines = [HEADER.format(count=rigs)]
    for name, points in sorted(seen.items()):
        amplitudes, scatters = [], []
        for _, values in sorted(points.items()):
            square, information = np.mean(values, axis=0)
            amplitudes.append(f"{np.sqrt(max(square, 0.0) / information):.2g}")
            scatters.append(f"{np.sqrt(1.0 + square):.2f}")
        click.echo(f"{name}: scores scatter by {', '.join(scatters)}")
        if set(amplitudes) != {"0"}:
            lines.append(f"{name} = [{', '.join(amplitudes)}]\n")
    IMITATED.write_text("".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
