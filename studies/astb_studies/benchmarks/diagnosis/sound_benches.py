"""Scores of sound benches: how much of each effect a replay imitates, and how it changes with time.

``python -m astb_studies.benchmarks.diagnosis.sound_benches`` makes the table again.

Sound benches are screened as in the benchmark, with other seeds. Scores should be standard normal. The replay causes
additional scatter about 0, because its motion is smoothed, and its friction reverses a little earlier or later than in
the bench. It also causes variations between sections of a run in the directions of an effect
(`diagnosis.engine.constancy`).

``--effects`` replaces only the rows of the given effects (for example new ones), each with its number of benches.
"""

import os
from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")

import click
import numpy as np

from astb_studies.benchmarks.diagnosis.bench_cases import BenchCases, temporary_directory
from diagnosis.engine.base_model import fit_base_model
from diagnosis.engine.config import Config
from diagnosis.engine.constancy import changes
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.runs import measured_channels
from diagnosis.engine.search_state import CurrentModel, Problem
from diagnosis.engine.trials import current_model, refit
from diagnosis.systems.air_spring.parameters import SOUND

SEEDS: Final = 900_000
HEADER: Final = """\
# Made by `python -m astb_studies.benchmarks.diagnosis.sound_benches`; do not edit.
# What {count} sound benches show, no two alike, each screened in six runs of twenty s.
"""
IMITATED: Final = """
# Amplitude (SI) of each effect that the replay imitates, as one standard deviation, at each point of the grid of its
# shapes; 0 scatters no more than its noise.
[imitated]
"""
OVERDISPERSION: Final = """
# What stretches of the runs show in the directions of each effect: χ² per χ² of chance.
[overdispersion]
"""


class Scored(NamedTuple):
    """An effect at a point of its grid: its squared score less 1, and its squared λ per unit of amplitude."""

    effect: str
    place: int
    excess: float
    information: float


class Changed(NamedTuple):
    """Variation between sections of all runs in the directions of an effect: χ², and its mean by chance."""

    effect: str
    chi2: float
    freedom: float


def shown(effects: Sequence[str], seed: int) -> tuple[list[Scored], list[Changed]]:
    """Return the scores of a sound bench for some effects (default: all)."""
    bench = BenchCases()
    with temporary_directory() as directory:
        dataset = bench.measure(seed, "null", "white", Path(directory)).dataset
    data, model = measured_channels(dataset, bench.simulator)
    problem = Problem(
        Replay(model, data.of("fit"), 1), (), dict(model.catalogue), Config(seed=seed, workers=1)
    )
    current = current_model(problem, fit_base_model(problem.replay))
    scored = [one for one in _scored(current) if not effects or one.effect in effects]
    return scored, list(_changed(problem, current, effects))


def _scored(current: CurrentModel) -> Iterator[Scored]:
    screening = current.screening
    scales = np.array([one.amplitude.scale for one in screening.candidates])
    excess = screening.projection.z**2 / screening.inflation - 1.0
    information = (screening.projection.norm / scales) ** 2 / screening.inflation
    for one, z, unit in zip(screening.candidates, excess, information, strict=True):
        if unit > 0.0:
            yield Scored(_bare(one.effect.name), one.effect.grid.index(one.shapes), float(z), float(unit))


def _changed(problem: Problem, current: CurrentModel, effects: Sequence[str]) -> Iterator[Changed]:
    screening = current.screening
    for name in problem.hypotheses:
        if effects and _bare(name) not in effects:
            continue
        start = screening.start(current.model.point, screening.best(name))
        chi2, freedom = np.sum(changes(refit(problem, start, current), name), axis=0)
        if freedom > 0.0:
            yield Changed(_bare(name), float(chi2), float(freedom))


def _bare(name: str) -> str:
    """The name of an effect without its place."""
    return name.partition(".")[0]


@click.command()
@click.option("--rigs", default=40, show_default=True)
@click.option("--processes", default=2, show_default=True)
@click.option("--effects", "named", default="", help="Rows of these only, by commas; the others stay.")
def main(rigs: int, processes: int, named: str) -> None:
    """Measure the table on a number of sound benches, and store it."""
    scored, changed = list[Scored](), list[Changed]()
    effects = tuple(filter(None, named.split(",")))
    with ProcessPoolExecutor(processes) as pool:
        for number, found in enumerate(pool.map(partial(shown, effects), range(SEEDS, SEEDS + rigs)), 1):
            scored += found[0]
            changed += found[1]
            click.echo(f"{number} of {rigs}")
    parts = {"imitated": _imitated(scored), "overdispersion": _overdispersion(changed)}
    header = HEADER.format(count=rigs)
    if effects:
        header = SOUND.read_text(encoding="utf-8").partition(IMITATED)[0]
        content = {
            part: {name: f"{row}  # of {rigs}" for name, row in rows.items()} for part, rows in parts.items()
        }
        parts = {part: _kept(part, effects) | rows for part, rows in content.items()}
    lines = {
        part: "".join(f"{name} = {rows[name]}\n" for name in sorted(rows)) for part, rows in parts.items()
    }
    text = f"{header}{IMITATED}{lines['imitated']}{OVERDISPERSION}{lines['overdispersion']}"
    SOUND.write_text(text, encoding="utf-8")


def _kept(part: str, others: Sequence[str]) -> dict[str, str]:
    """Return the rows of a part of the table, without those of the effects ``others``."""
    lines = SOUND.read_text(encoding="utf-8").partition(f"[{part}]\n")[2].partition("\n\n")[0].splitlines()
    rows = (line.partition(" = ") for line in lines)
    return {name: row for name, _, row in rows if name not in others}


def _imitated(scored: Sequence[Scored]) -> dict[str, str]:
    """Return the row of each effect whose scores scatter beyond chance."""
    seen: dict[str, dict[int, list[tuple[float, float]]]] = defaultdict(lambda: defaultdict(list))
    for one in scored:
        seen[one.effect][one.place].append((one.excess, one.information))
    rows = {}
    for name, points in sorted(seen.items()):
        means = [np.mean(values, axis=0) for _, values in sorted(points.items())]
        amplitudes = [f"{np.sqrt(max(excess, 0.0) / information):.2g}" for excess, information in means]
        scatters = ", ".join(f"{np.sqrt(1.0 + excess):.2f}" for excess, _ in means)
        click.echo(f"{name}: scores scatter by {scatters}")
        if set(amplitudes) != {"0"}:
            rows[name] = f"[{', '.join(amplitudes)}]"
    return rows


def _overdispersion(changed: Sequence[Changed]) -> dict[str, str]:
    """Return the row of each effect."""
    rows = {}
    for name in sorted({one.effect for one in changed}):
        values = np.array([(one.chi2, one.freedom) for one in changed if one.effect == name])
        chi2, freedom = values.sum(axis=0)
        rows[name] = f"{max(chi2 / freedom, 1.0):.2f}"
    return rows


if __name__ == "__main__":
    main()
