"""The simulator on the measured runs: predictions and finite-difference sensitivities, in parallel and in order."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import ceil
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from diagnosis.contracts import Array, CompleteSimulator, DiagnosisError, Job, MeasuredRun
from diagnosis.engine.columns import Columns, ColumnsInWork, apart, packing_of, squares
from diagnosis.engine.config import LEAST_ROUGH, MOST_BATCH, SPOILT
from diagnosis.engine.fitting.point import Point, halved, neighbour, opposite
from diagnosis.engine.fitting.steady import chosen, root_mean_squares, steady
from diagnosis.engine.simulation import checked, completed, simulate_many
from diagnosis.engine.threads import in_threads

Out = TypeVar("Out")


@dataclass(frozen=True, slots=True, eq=False)
class Base:
    """The ``point`` from which differences are computed. ``predictions`` (n, c) are the outputs of each run; ``rough``
    are its approximate outputs, or None.
    """

    point: Point
    predictions: Sequence[Array]
    rough: Sequence[Array | None]


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """A simulator with the runs it replays. ``workers`` threads share the simulations; the results keep their order.

    All results are per run: predictions are (n, c), sensitivities are the packed columns of the run's coordinates.
    Columns are differences, whose errors are far larger than those of single precision.
    """

    simulator: CompleteSimulator
    runs: tuple[MeasuredRun, ...]
    workers: int = 2

    def __post_init__(self) -> None:
        object.__setattr__(self, "simulator", completed(self.simulator))  # whatever a program of Python gives
        names = [run.experiment.name for run in self.runs]
        if len(set(names)) < len(names):
            raise DiagnosisError(
                f"the dataset holds two runs of the same name among {names}; give each run another name"
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the runs."""
        return tuple(run.experiment.name for run in self.runs)

    @property
    def records(self) -> tuple[str, ...]:
        """The record of each run. Parts of one record share its nuisances."""
        return tuple(run.experiment.record for run in self.runs)

    def of(self, runs: Iterable[MeasuredRun]) -> Replay:
        """Return a replay of other runs with the same simulator."""
        return Replay(self.simulator, tuple(runs), self.workers)

    def predictions(self, point: Point) -> list[Array]:
        """Simulate every run at a point, and return the outputs (n, c) of each run."""
        found: dict[int, Array] = {}
        self._simulate([(r, point) for r in range(len(self.runs))], found.__setitem__, self._outputs)
        return [found[r] for r in range(len(self.runs))]

    def residuals(self, predictions: Sequence[Array]) -> list[Array]:
        """Return measured minus predicted values, (n, c) of each run; NaN where a sample does not count."""
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
        """Return ∂y/∂u of each run for its coordinates at ``places``, or for all coordinates that it depends on.

        Differences for the numbers of effects are one-sided. With ``central`` they are central: this takes twice as
        long and has no error of first order. Differences for the nuisances are always central and checked for jumps,
        because every result on an effect is a remainder after projection on them (`diagnosis.engine.fitting.steady`).
        """
        wanted = [point.places_of(record) for record in self.records] if places is None else places
        kept = [[not point.coordinates[i].owner for i in own] for own in wanted]
        base = self.base(point, predictions, [len(own) for own in wanted])
        ahead = {i: neighbour(point, i) for i in sorted({i for own in wanted for i in own})}
        back = {i: opposite(point, to, distance) for i, (to, distance) in ahead.items()}
        first = self.differences(base, [[ahead[i] for i in own] for own in wanted])
        twice = [[steady or central for steady in mine] for mine in kept]
        second = self.differences(base, chosen(back, wanted, twice))
        errors = root_mean_squares(self.residuals(predictions))
        halves = [{i: halved(point, *step) for i, step in steps.items()} for steps in (ahead, back)]
        spoilt = [
            np.array(mine, bool) & (apart(a, b, errors) > SPOILT * squares(a, errors))
            for mine, a, b in zip(kept, first, second, strict=True)
        ]
        third, fourth = (self.differences(base, chosen(half, wanted, spoilt)) for half in halves)

        def mean(mine: Sequence[bool], again: NDArray[np.bool_]) -> Columns:
            # All four are as large as their mean, so those of each run are freed when it is added.
            parts = [columns.pop(0) for columns in (first, second, third, fourth)]
            half = 0.5 * np.array(mine)
            return steady(parts, np.array((1.0 - half, half, 0.0 * half, 0.0 * half)), again, errors)

        return [mean(mine, again) for mine, again in zip(twice, spoilt, strict=True)]

    def base(self, point: Point, predictions: Sequence[Array], counts: Sequence[int]) -> Base:
        """Return the base of differences. Runs for which many differences are needed (``counts``) are also simulated
        approximately.
        """
        rough: list[Array | None] = [None] * len(self.runs)
        worth = [(r, point) for r, count in enumerate(counts) if count >= LEAST_ROUGH]

        def keep(i: int, outputs: Array | None) -> None:
            rough[worth[i][0]] = outputs

        self._simulate(worth, keep, self._roughly)
        return Base(point, predictions, rough)

    def differences(self, base: Base, steps: Sequence[Sequence[tuple[Point, float] | None]]) -> list[Columns]:
        """Return for each run the difference quotients to its k points, which are given with signed distances; 0 where
        the step is None.

        Both outputs of a quotient are approximate, or both are exact. They are exact if the points differ in a number
        that approximate outputs cannot resolve.
        """
        columns = [
            ColumnsInWork(packing_of(run), len(own)) for run, own in zip(self.runs, steps, strict=True)
        ]
        jobs = [(r, k, *step) for r, own in enumerate(steps) for k, step in enumerate(own) if step]
        roughly = [base.rough[r] is not None and not self._too_alike(base.point, to) for r, _, to, _ in jobs]
        exact = [job for job, rough_will_do in zip(jobs, roughly, strict=True) if not rough_will_do]
        rough = [job for job, rough_will_do in zip(jobs, roughly, strict=True) if rough_will_do]

        def divide_rough(i: int, outputs: Array | None) -> None:
            r, k, _, distance = rough[i]
            start = base.rough[r]
            if outputs is None or start is None:
                exact.append(rough[i])
            else:
                columns[r].put(k, outputs, start, distance)

        def divide(i: int, outputs: Array) -> None:
            r, k, _, distance = exact[i]
            columns[r].put(k, outputs, base.predictions[r], distance)

        self._simulate([(r, point) for r, _, point, _ in rough], divide_rough, self._roughly)
        exact.sort(key=lambda job: job[:2])  # Threads append in any order.
        self._simulate([(r, point) for r, _, point, _ in exact], divide, self._outputs)
        return [of_run.done() for of_run in columns]

    def _too_alike(self, base: Point, to: Point) -> bool:
        """Return whether a point differs from the base in a number that approximate outputs cannot resolve."""
        known = len(base.numbers)
        moved = np.flatnonzero(to.numbers[:known] != base.numbers)
        further = (*(to.coordinates[i] for i in moved), *to.coordinates[known:])
        return not self.simulator.too_alike.isdisjoint(c.owner or c.parameter.name for c in further)

    def _simulate(
        self,
        places: Sequence[tuple[int, Point]],
        use: Callable[[int, Out], None],
        run: Callable[[Sequence[Job]], Iterator[Out]],
    ) -> None:
        """Simulate runs at points. Call ``use`` with the index of each place and its outputs; the calls come from any
        thread and in any order.
        """
        jobs = [self._job(self.runs[r], point) for r, point in places]
        size = max(self.simulator.least_batch, min(MOST_BATCH, ceil(len(jobs) / self.workers)))

        def work(start: int) -> None:
            for i, outputs in enumerate(run(jobs[start : start + size]), start):
                use(i, outputs)

        in_threads(self.workers, work, range(0, len(jobs), size))

    def _outputs(self, jobs: Sequence[Job]) -> Iterator[Array]:
        return simulate_many(self.simulator, jobs)

    def _roughly(self, jobs: Sequence[Job]) -> Iterator[Array | None]:
        for job, outputs in zip(jobs, self.simulator.run_roughly(jobs), strict=True):
            yield None if outputs is None else checked(self.simulator, job, outputs)

    @staticmethod
    def _job(run: MeasuredRun, point: Point) -> Job:
        return Job(run.experiment, point.parameters(run.experiment.record), point.effects())
