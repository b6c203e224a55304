"""Measures a bench with a hidden effect and writes only files: ``python -m astb_studies.benchmarks.diagnosis.sealed``.

The rig integrates the free bolster under its actuators every millisecond, the diagnosis replays an imposed motion every
2.5 ms. Every reading passes the rig's own CAN and Modbus encoders. The record does not contain the hidden effects;
they are written to a separate file.
"""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import get_args

import click
import numpy as np

from astb.rig_in_memory import RigInMemory
from astb_studies.benchmarks.diagnosis.ground_truth import Condition, GroundTruth, Kind, draw
from astb_studies.benchmarks.diagnosis.lambda_per_unit import LambdaPerUnit
from astb_studies.benchmarks.diagnosis.noises import COLOURED, COLOURS, LOST, of_twelve_bits
from astb_studies.benchmarks.diagnosis.short_screening import short_screening
from astb_studies.benchmarks.diagnosis.sibling_forms import CURVED, FAST, Curved
from astb_studies.benchmarks.diagnosis.sibling_forms import parameters as sibling
from astb_studies.benchmarks.diagnosis.uncatalogued_terms import UNCATALOGUED, roughness, together
from bench_protocol.frames import Block, join
from bench_protocol.words import SIDES
from bench_sim.parameters import Parameters, load
from bench_sim.parameters.effects import with_effects
from bench_sim.rig.rig import Rig
from drivers.bench import Bench
from drivers.memory import Faults
from test_plans.execution import execute
from test_plans.plan import Plan


class ScreeningFailed(RuntimeError):
    """The rig did not complete the plan, so there is no record to diagnose."""


def parameters_of(truth: GroundTruth) -> Parameters:
    """Return the bench of a truth: its springs, effects, terms outside the catalogue, roughness and noise."""
    bench = load()
    springs = {
        name: [truth.base.get(f"{side}.{name}", truth.base.get(name)) for side in SIDES]
        for name in {label.rpartition(".")[2] for label in truth.base}
    }
    bench = bench.with_values(**springs, **sibling(truth.form))
    terms = [UNCATALOGUED[name](size) for name, size in truth.outside.items()]
    if truth.roughness:
        terms.append(roughness(truth.seed, truth.roughness / LambdaPerUnit.read().roughness))
    bench = with_effects(bench.with_values(**together(*terms)), truth.effects)
    if truth.condition == "12 bits":
        coarse = of_twelve_bits(bench)
        bench = bench.with_values(sensor_resolution=coarse)
    return bench


class Coloured:
    """Runs a rig whose output sensors have AR(1) noise: each sample includes a part of the previous one."""

    def __init__(self, rig: Rig, colour: float, seed: int) -> None:
        par = rig.plant.parameter_array
        self._run: Callable[[int], Block] = rig.run
        self._bias = par["sensor_bias"][0]
        self._built = self._bias[COLOURED].copy()
        noise = par["sensor_noise"][0]
        self._innovation = noise[COLOURED] * np.sqrt(1.0 - colour**2)
        noise[COLOURED] = 0.0
        self._colour = colour
        self._rng = np.random.default_rng([seed, 5])
        self._noise = np.zeros(len(COLOURED))
        self._tick = 0

    def run(self, ticks: int) -> Block:
        """Run a number of ticks; every fifth tick has a reading with its own noise."""
        blocks = []
        while ticks > 0:
            piece = min(ticks, FAST - self._tick % FAST)
            if self._tick % FAST + piece == FAST:
                fresh = self._innovation * self._rng.standard_normal(len(COLOURED))
                self._noise = self._colour * self._noise + fresh
                self._bias[COLOURED] = self._built + self._noise
            blocks.append(self._run(piece))
            self._tick += piece
            ticks -= piece
        return join(blocks)


@contextlib.contextmanager
def bench_of(truth: GroundTruth, plan: Callable[[Rig], None] = lambda _: None) -> Iterator[Bench]:
    """Yield a connected bench on the rig of a truth, in memory and virtual time; ``plan`` schedules its faults."""
    rig = Rig(parameters_of(truth), seed=truth.seed)
    plan(rig)
    run: Callable[[int], Block] = rig.run
    if truth.condition in COLOURS:
        run = Coloured(rig, COLOURS[truth.condition], truth.seed).run
    if CURVED in truth.form:
        run = Curved(rig, truth.form[CURVED]).run
    memory = RigInMemory(rig, run)
    # Commands arrive: five lost in a row are a watchdog's business, and happen once in a screening.
    lossy = {"faults": Faults(lose=LOST), "outward": Faults()} if truth.condition == "frames lost" else {}
    with memory.bench(**lossy, seed=truth.seed) as bench:
        yield bench


def measure(truth: GroundTruth, out: Path, plan: Plan | None = None) -> None:
    """Run ``plan``, or the short screening, on the bench of ``truth``; leave a record. Raises ScreeningFailed."""
    plan = plan or short_screening()
    with bench_of(truth) as bench:
        result = execute(plan, bench, out, rig="virtual", seed=0)
    if result.verdict not in {"pass", "fail"}:
        raise ScreeningFailed(f"{plan.name}: {result.verdict}: {result.reason or '; '.join(result.warnings)}")


@click.command()
@click.option("--seed", type=int, required=True)
@click.option("--kind", type=click.Choice(get_args(Kind)), required=True)
@click.option("--condition", type=click.Choice(get_args(Condition)), default="white", show_default=True)
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Directory of the record.")
@click.option("--truth", "sealed", type=click.Path(path_type=Path), required=True, help="File for the judge.")
def main(seed: int, kind: Kind, condition: Condition, out: Path, sealed: Path) -> None:
    """Hide effects in a bench, drawn from SEED, and screen it."""
    truth = draw(seed, kind, condition)
    truth.write(sealed)
    measure(truth, out)


if __name__ == "__main__":
    main()
