"""A diagnosis of six minutes on the bench with the whole catalogue: seconds, integrations by purpose, memory."""

import multiprocessing
import resource
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from astb.diagnose import with_roles
from astb_studies.benchmarks.diagnosis.ground_truth import GroundTruth
from astb_studies.benchmarks.diagnosis.sealed import measure
from astb_studies.benchmarks.measure import BenchmarkRow, Effort, Section, Spread, compare, wall
from bench_protocol.units import s
from bench_sim.model.effects import CATALOGUE
from bench_sim.parameters import load
from diagnosis.contracts import Array, Dataset, Effects, Experiment, Job, MeasuredRun
from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose
from diagnosis.systems.air_spring.simulator import AirSpring
from diagnosis.systems.records import read_records
from test_plans.plans.screening import SCREENING
from test_plans.programmes.perform import programme_plan

#: Runs, seconds of each and candidates (None: all): of the page, and of a quick look.
WHOLE: Final = (6, 60 * s, None)
QUICK: Final = (4, 20 * s, 20)
LIMIT: Final = 10.0
LIMIT_MEMORY: Final = 1000.0
HIDDEN: Final = {"leak.left": {"area": 1e-7}}
REPETITIONS, QUICK_REPETITIONS = 3, 1
#: What a diagnosis does while it reports of it by the beginning of such a text.
PURPOSES: Final = {
    "fitting the base model": "base fit and first scores",
    "fitting candidates": "trials, and scores with the entered candidates",
    "checking the causes": "each cause left out",
    "looking for unknown effects": "surfaces",
    "measuring the gain": "panel and gain",
}


class Counting:
    """A simulator that counts its runs by purpose."""

    def __init__(self, simulator: AirSpring) -> None:
        self._simulator = simulator
        self.purpose = ""
        self.counts: Counter[str] = Counter()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._simulator, name)

    def run(self, experiment: Experiment, parameters: Mapping[str, float], effects: Effects) -> Array:
        self.counts[self.purpose] += 1
        return self._simulator.run(experiment, parameters, effects)

    def run_many(self, jobs: Sequence[Job]) -> Iterator[Array]:
        self.counts[self.purpose] += len(jobs)
        return self._simulator.run_many(jobs)

    def run_roughly(self, jobs: Sequence[Job]) -> Iterator[Array | None]:
        self.counts[self.purpose] += len(jobs)
        return self._simulator.run_roughly(jobs)

    def set_purpose(self, text: str, _part: float) -> None:
        """Set the purpose of the next runs."""
        self.purpose = next(purpose for begin, purpose in PURPOSES.items() if text.startswith(begin))


@dataclass(frozen=True)
class Measured:
    """One diagnosis: its duration and that of one replay of all runs (s), peak memory (MB), runs by purpose, causes."""

    seconds: float
    replay: float
    memory: float
    counts: Mapping[str, int]
    named: tuple[str, ...]


def _cut(one: MeasuredRun, length: float) -> MeasuredRun:
    """Return the beginning of a run."""
    kept = slice(round(length / one.experiment.step) + 1)
    inputs = {name: values[kept] for name, values in one.experiment.inputs.items()}
    experiment = replace(one.experiment, time=one.experiment.time[kept], inputs=inputs)
    return replace(
        one, experiment=experiment, outputs=one.outputs[kept], scored=one.scored[kept], rest=one.rest[kept]
    )


def diagnosed(dataset: Dataset, effects: tuple[str, ...] | None) -> Measured:
    """Diagnose once in a fresh process."""
    simulator = Counting(AirSpring(load(), effects=CATALOGUE))
    found: list[str] = []

    def replay_once() -> None:
        for one in dataset.runs:
            AirSpring(load(), effects=CATALOGUE).run(one.experiment, {}, {})

    def name_it() -> None:
        found[:] = diagnose(dataset, simulator, Config(effects=effects), simulator.set_purpose).names

    replay = wall(replay_once, 1)
    seconds = wall(name_it, 1)
    kilobytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return Measured(seconds, replay, 1e-3 * kilobytes, simulator.counts, tuple(found))


def run(effort: Effort) -> Section:
    """Hide a leak, measure it once, and diagnose the record several times, each time in its own process."""
    runs, length, candidates = QUICK if effort.quick else WHOLE
    simulator = AirSpring(load(), effects=CATALOGUE)
    with tempfile.TemporaryDirectory() as directory:
        record = Path(directory) / "record"
        truth = GroundTruth(seed=0, kind="single", condition="white", effects=HIDDEN)
        measure(truth, record, programme_plan(SCREENING))
        dataset = read_records([record], simulator)
    dataset = with_roles(replace(dataset, runs=tuple(_cut(one, length) for one in dataset.runs[:runs])))
    others = [name for name in simulator.catalogue if name not in HIDDEN]
    effects = None if candidates is None else (*HIDDEN, *others[: candidates - 1])
    context = multiprocessing.get_context("spawn")
    measured = []
    for _ in range(QUICK_REPETITIONS if effort.quick else REPETITIONS):
        with ProcessPoolExecutor(1, mp_context=context) as process:
            measured.append(process.submit(diagnosed, dataset, effects).result())
    return Section(
        "A diagnosis", _rows(measured, len(effects or simulator.catalogue)), (_note(dataset, measured),)
    )


def _rows(measured: Sequence[Measured], candidates: int) -> list[BenchmarkRow]:
    ours = Spread.of([one.seconds for one in measured])
    memory = Spread.of([one.memory for one in measured])
    return [
        compare(
            f"diagnosis, {candidates} candidates, two threads",
            [one.seconds for one in measured],
            "all runs replayed once",
            [one.replay for one in measured],
            aim=f"within {LIMIT:g} s",
            met=ours.middle <= LIMIT,
        ),
        BenchmarkRow(
            "memory at most",
            "MB",
            memory,
            aim=f"at most {LIMIT_MEMORY:g} MB",
            met=memory.middle <= LIMIT_MEMORY,
        ),
        *(
            BenchmarkRow(
                f"runs of the simulator: {purpose}", "", Spread.of([one.counts[purpose] for one in measured])
            )
            for purpose in PURPOSES.values()
        ),
    ]


def _note(dataset: Dataset, measured: Sequence[Measured]) -> str:
    length = sum(float(one.experiment.time[-1]) for one in dataset.runs)
    named = ", ".join(dict.fromkeys(name for one in measured for name in one.named)) or "nothing"
    return (
        f"The beginnings of {len(dataset.runs)} runs of a screening, together {length:.0f} s at 200 Hz; "
        f"named: {named}. "
        "With the whole catalogue and 60 s of six runs, it once took 252 s and 7.4 GB."
    )
