"""Runs of a plan as a campaign on two workers, next to two processes that each run half of them in a plain loop."""

import itertools
import multiprocessing
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Final

from astb.campaigns.plan_case import PlanCase, by_key, run_plan_case, run_plan_cases
from astb.campaigns.workers import cluster
from astb.rig_file import Simulation
from astb_studies.benchmarks.measure import BenchmarkRow, Effort, Section, Spread, compare, interleaved, wall

WORKERS: Final = 2
#: Both find their processes running and warm. Cases are equally long, or the loops would have to wait for one another.
CASES: Final = 12
EFFICIENCY: Final = 0.9


def loop(cases: Sequence[PlanCase]) -> None:
    """Run plans one after the other, and keep nothing."""
    for case in cases:
        run_plan_case(case)


def start_and_end() -> None:
    """Start and stop a local cluster."""
    with cluster(workers=WORKERS):
        pass


def run(effort: Effort) -> Section:
    """Measure both in turn; the target applies to the median of the ratios."""
    cases = by_key(PlanCase(plan="leak_down", simulation=Simulation(seed=seed)) for seed in range(CASES))
    halves = [list(cases.values())[start::WORKERS] for start in range(WORKERS)]
    numbers = itertools.count()
    context = multiprocessing.get_context("spawn")
    with (
        tempfile.TemporaryDirectory() as directory,
        cluster(workers=WORKERS) as client,
        ProcessPoolExecutor(WORKERS, mp_context=context) as pool,
    ):
        found = interleaved(
            5 if effort.quick else 9,
            {
                "loops": lambda: wall(lambda: list(pool.map(loop, halves)), CASES),
                "campaign": lambda: wall(
                    lambda: run_plan_cases(cases, Path(directory, str(next(numbers))), client=client), CASES
                ),
            },
        )
    ratio = Spread.of([plain / ours for plain, ours in zip(found["loops"], found["campaign"], strict=True)])
    ups = [wall(start_and_end, 1) for _ in range(3)]
    return Section(
        "A campaign",
        [
            compare("a case, on two workers", found["campaign"], "in two plain loops", found["loops"]),
            BenchmarkRow(
                "efficiency: plain loops over campaign",
                "",
                ratio,
                aim=f"at least {EFFICIENCY:g}",
                met=ratio.middle >= EFFICIENCY,
            ),
            BenchmarkRow("a local cluster comes and goes", "s", Spread.of(ups)),
        ],
        ("A case is leak_down in virtual time; the campaign keeps a row of each, the loops keep nothing.",),
    )
