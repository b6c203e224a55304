"""Computes what figures, table and claims need, on all cores, and holds the results."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, Final

import numpy as np

from astb_studies.paper import combined, sensitivity
from astb_studies.paper.bench_results import (
    IDENTIFICATION,
    PLANS,
    BenchResults,
    directory_of,
    gather,
    measure,
)
from astb_studies.paper.checks.catalogue import CHECKS, select
from astb_studies.paper.checks.evaluation import entry
from astb_studies.paper.experiments import OTHER_RIDES, paper_ride, plant_ride
from astb_studies.paper.identified import Identified, identify_rig
from astb_studies.paper.model_jobs import Curves, confusable, model_jobs
from astb_studies.paper.sensitivity import Indices
from astb_studies.paper.subject import Subject
from bench_protocol.arrays import Floats

#: Called with a kind of work, how many parts of it are ready, and how many there are.
Progress = Callable[[str, int, int], None]

BENCH, CHECKED, MODEL, SENSITIVITY, FIGURES = (
    "bench experiments",
    "claims and checks",
    "model beside the bench",
    "global sensitivity",
    "figures and page",
)

#: What `astb paper` writes next to the page.
IDENTIFIED: Final = "identified.toml"


@dataclass(frozen=True, slots=True)
class ComfortRow:
    """One cell of the comfort table: a_y (m/s² rms) and N with half widths of their 95 % intervals (nan: none).

    ``layer`` is "plant", "paper", or of the plant one of `OTHER_RIDES`.
    """

    layer: str
    load: str
    wind_speed: float
    acceleration: float
    acceleration_width: float
    peak: float
    comfort: float
    comfort_width: float
    displacement: float
    bump_stop_time: float


@dataclass(frozen=True, slots=True)
class Study:
    """The results of the study: the same ones for the same seed, whatever the number of cores."""

    quick: bool
    seeds: tuple[int, ...]
    realisations: int
    bench: BenchResults
    identified: Identified
    model: dict[str, Curves]
    rides: list[ComfortRow]
    sensitivity: dict[str, Indices]
    entries: list[dict[str, Any]]

    @property
    def fitted(self) -> dict[str, float]:
        """The identified parameters of the plant, SI."""
        return {name: one.value for name, one in self.identified.parameters.items()}


def study(executor: Executor, out: Path, *, quick: bool, seed: int, progress: Progress) -> Study:
    """Run everything and return it; the bench's records lie below ``out``.

    ``quick`` measures on one rig instead of three, with one realisation of the wind instead of ten and a small sample
    of the sensitivity. NoBenchResult if a plan was blocked.
    """
    seeds = (seed,) if quick else (seed, seed + 1, seed + 2)
    groups = claim_groups()
    tables = _sensitivity_tables(quick)
    # The rides are one long piece: they come first. Then the bench, for which the next stage waits.
    checked: list[Future[Any]] = [executor.submit(check_group, groups[0], quick)]
    springs = executor.submit(_identified, seed, out)
    measured = [executor.submit(measure, plan, one, out) for plan in PLANS for one in seeds]
    measured += [
        executor.submit(measure, plan, seed, out, name, given)
        for name, plan, given in (*combined.rides(quick), *combined.cases())
    ]
    checked += [executor.submit(other_rides, name, quick) for name in OTHER_RIDES]
    checked += [executor.submit(check_group, ids, quick) for ids in groups[1:]]
    spread = {
        layer: [executor.submit(sensitivity.evaluate, layer, part) for part in parts]
        for layer, (parts, _) in tables.items()
    }
    confused = executor.submit(confusable, quick)
    _watch(BENCH, [springs, *measured], progress)
    _watch(CHECKED, checked, progress)
    _watch(SENSITIVITY, [future for futures in spread.values() for future in futures], progress)
    for future in measured:
        future.result()
    bench, identified = gather(out, seeds, quick=quick), springs.result()
    fitted = {name: one.value for name, one in identified.parameters.items()}
    jobs = model_jobs(bench, identified, out / IDENTIFIED)
    modelled = {name: executor.submit(job, fitted, *args) for name, job, args in jobs}
    modelled["confusable"] = confused
    _watch(MODEL, [*modelled.values()], progress)
    for future in as_completed([*checked, *modelled.values(), *(f for fs in spread.values() for f in fs)]):
        future.result()
    entries: dict[int, dict[str, Any]] = {}
    rides: list[ComfortRow] = []
    for one in checked:
        found, of_the_table = one.result()
        entries |= found
        rides += of_the_table
    return Study(
        quick,
        seeds,
        1 if quick else 10,
        bench,
        identified,
        {name: future.result() for name, future in modelled.items()},
        rides,
        {
            layer: sensitivity.indices(
                layer, np.concatenate([f.result() for f in futures], axis=1), tables[layer][1]
            )
            for layer, futures in spread.items()
        },
        [entries[place] for place in sorted(entries)],
    )


def _watch(kind: str, futures: Sequence[Future[Any]], progress: Progress) -> None:
    """Report progress whenever one of the futures is done."""
    ready = count(1)
    progress(kind, 0, len(futures))
    for future in futures:
        future.add_done_callback(lambda _: progress(kind, next(ready), len(futures)))


# -- claims and checks, and the rides of the table -----------------------------------------------------------------


def claim_groups() -> list[list[str]]:
    """Group the ids whose checks share experiments, so that one process measures them once; the rides come first."""
    groups: list[tuple[set[str], set[str]]] = []
    for check in CHECKS:
        names, ids = {check.shares} - {""}, {check.id}
        apart = []
        for known_names, known_ids in groups:
            if known_names & names or known_ids & ids:
                names, ids = names | known_names, ids | known_ids
            else:
                apart.append((known_names, known_ids))
        groups = [*apart, (names, ids)]
    ordered = sorted(groups, key=lambda group: ("ride" not in group[0], sorted(group[1])))
    return [sorted(ids) for _, ids in ordered]


def check_group(ids: Sequence[str], quick: bool) -> tuple[dict[int, dict[str, Any]], list[ComfortRow]]:
    """Evaluate some checks; with the rides among them also return the cells of the table, which they have measured."""
    subject = Subject(quick=quick)
    entries = {place: entry(CHECKS[place], subject) for place in select(ids)}
    return entries, _rides(subject) if "A27" in ids else []


def other_rides(name: str, quick: bool) -> tuple[dict[int, dict[str, Any]], list[ComfortRow]]:
    """Return no entries, and the cells of the table for one of `OTHER_RIDES`."""
    return {}, _on_the_plant(Subject(quick=quick), name)


def _rides(subject: Subject) -> list[ComfortRow]:
    nan = float("nan")
    table = _on_the_plant(subject)
    for (load, speed), (rms, index) in paper_ride(subject).items():
        table.append(ComfortRow("paper", load, speed, rms, nan, nan, index, nan, nan, nan))
    return table


def _on_the_plant(subject: Subject, other: str = "") -> list[ComfortRow]:
    table = []
    for (load, speed), cell in plant_ride(subject, other).items():
        a, N = cell.estimate("acceleration"), cell.estimate("weighted", 6.0)
        table.append(
            ComfortRow(
                other or "plant",
                load,
                speed,
                a.mean,
                a.half_width,
                cell.estimate("peak_acceleration").mean,
                N.mean,
                N.half_width,
                cell.estimate("mean_lateral").mean,
                cell.estimate("bump_stop_time").mean,
            )
        )
    return table


# -- identification ------------------------------------------------------------------------------------------------


def _identified(seed: int, out: Path) -> Identified:
    """Measure the springs of the first rig, identify them, and write their parameter file."""
    measure(IDENTIFICATION, seed, out)
    return identify_rig(directory_of(out, IDENTIFICATION, seed), out / IDENTIFIED)


# -- sensitivity ---------------------------------------------------------------------------------------------------


def _sensitivity_tables(quick: bool) -> dict[str, tuple[list[Floats], int]]:
    """For each layer the parameter sets in parts for the processes, and the size of the sample."""
    subject = Subject()
    tables = {}
    for layer, n, parts in (("plant", 32 if quick else 256, 4 if quick else 24), ("paper", 1024, 1)):
        whole = sensitivity.sets(sensitivity.nominal(subject, layer), n)
        tables[layer] = (np.array_split(whole, parts, axis=1), n)
    return tables
