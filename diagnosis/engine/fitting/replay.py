"""The simulator on the measured runs: predictions and finite-difference sensitivities, in parallel and in order."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import ceil

import numpy as np

from diagnosis.contracts import Array, BatchSimulator, DiagnosisError, Job, MeasuredRun, Simulator
from diagnosis.engine.columns import Columns, ColumnsInWork, mean, packing_of
from diagnosis.engine.config import LEAST_BATCH, MOST_BATCH
from diagnosis.engine.fitting.point import Point, neighbour, opposite
from diagnosis.engine.simulation import checked, simulate


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """A simulator with the runs it replays. ``workers`` threads share the simulations; the order is always the same.

    Everything is told run by run: predictions are (n, c), sensitivities the packed columns of what that run depends on.
    Those are differences, which single precision holds to far more digits than they are right.
    """

    simulator: Simulator
    runs: tuple[MeasuredRun, ...]
    workers: int = 2

    def __post_init__(self) -> None:
        names = [run.experiment.name for run in self.runs]
        if len(set(names)) < len(names):
            raise DiagnosisError(
                f"the dataset holds two runs of the same name among {names}; each needs its own"
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the runs."""
        return tuple(run.experiment.name for run in self.runs)

    @property
    def records(self) -> tuple[str, ...]:
        """The record of each run: runs that are parts of one share its nuisances."""
        return tuple(run.experiment.record for run in self.runs)

    def of(self, runs: Iterable[MeasuredRun]) -> Replay:
        """Return the same simulator on other runs."""
        return Replay(self.simulator, tuple(runs), self.workers)

    def predictions(self, point: Point) -> list[Array]:
        """Simulate every run at a point."""
        found: dict[int, Array] = {}
        self._simulate([(r, point) for r in range(len(self.runs))], found.__setitem__)
        return [found[r] for r in range(len(self.runs))]

    def residuals(self, predictions: Sequence[Array]) -> list[Array]:
        """Return measured minus predicted, (n, c) of each run; NaN where nothing counts."""
        return [
            np.where(run.scored[:, None], run.outputs - predicted, np.nan)
            for run, predicted in zip(self.runs, predictions, strict=True)
        ]

    def sensitivities(
        self,
        point: Point,
        predictions: Sequence[Array],
        places: Sequence[Sequence[int]] | None = None,
        *,
        central: bool = False,
    ) -> list[Columns]:
        """Return ∂y/∂u of each run to its coordinates at ``places``, or to all that it depends on.

        Differences are one-sided; ``central`` ones cost twice as much and have no error of first order.
        """
        wanted = [point.places_of(record) for record in self.records] if places is None else places
        steps = {i: neighbour(point, i) for i in sorted({i for own in wanted for i in own})}
        ahead = self.differences(predictions, [[steps[i] for i in own] for own in wanted])
        if not central:
            return ahead
        back = {i: opposite(point, to, distance) for i, (to, distance) in steps.items()}
        behind = self.differences(predictions, [[back[i] for i in own] for own in wanted])
        return [mean(a, b) for a, b in zip(ahead, behind, strict=True)]

    def differences(
        self, predictions: Sequence[Array], steps: Sequence[Sequence[tuple[Point, float]]]
    ) -> list[Columns]:
        """Return the difference quotients of each run to its own k points at signed distances."""
        columns = [
            ColumnsInWork(packing_of(run), len(own)) for run, own in zip(self.runs, steps, strict=True)
        ]

        jobs = [(r, k) for r, own in enumerate(steps) for k in range(len(own))]

        def divide(i: int, outputs: Array) -> None:
            r, k = jobs[i]
            columns[r].put(k, outputs, predictions[r], steps[r][k][1])

        self._simulate([(r, steps[r][k][0]) for r, k in jobs], divide)
        return [of_run.done() for of_run in columns]

    def _simulate(self, places: Sequence[tuple[int, Point]], use: Callable[[int, Array], None]) -> None:
        """Simulate runs at points; ``use`` gets outputs by the index of their place, from any thread, in any order."""
        jobs = [self._job(self.runs[r], point) for r, point in places]
        size = max(LEAST_BATCH, min(MOST_BATCH, ceil(len(jobs) / self.workers)))
        if not isinstance(self.simulator, BatchSimulator):
            size = 1

        def work(start: int) -> None:
            for i, outputs in enumerate(self._outputs(jobs[start : start + size]), start):
                use(i, outputs)

        starts = range(0, len(jobs), size)
        if self.workers <= 1 or len(starts) < 2:
            for start in starts:
                work(start)
            return
        with ThreadPoolExecutor(self.workers) as pool:
            for _ in pool.map(work, starts):
                pass

    def _outputs(self, jobs: Sequence[Job]) -> Iterator[Array]:
        if isinstance(self.simulator, BatchSimulator):
            for job, outputs in zip(jobs, self.simulator.run_many(jobs), strict=True):
                yield checked(self.simulator, job, outputs)
        else:
            for job in jobs:
                yield simulate(self.simulator, job)

    @staticmethod
    def _job(run: MeasuredRun, point: Point) -> Job:
        return Job(run.experiment, point.parameters(run.experiment.record), point.effects())
