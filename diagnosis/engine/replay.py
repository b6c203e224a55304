"""The simulator on the measured runs: predictions and finite-difference sensitivities, in parallel and in order."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from diagnosis.contracts import Array, DiagnosisError, MeasuredRun, Simulator
from diagnosis.engine.point import Point, neighbour, opposite


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """A simulator with the runs it replays. ``workers`` threads share the simulations; the order is always the same.

    Everything is told run by run: predictions are (n, c), sensitivities (n, c, k) to what that run depends on.
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

    def of(self, runs: Iterable[MeasuredRun]) -> Replay:
        """Return the same simulator on other runs."""
        return Replay(self.simulator, tuple(runs), self.workers)

    def predictions(self, point: Point) -> list[Array]:
        """Simulate every run at a point."""
        return self._all([(r, point) for r in range(len(self.runs))])

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
    ) -> list[Array]:
        """Return ∂y/∂u (n, c, k) of each run to its coordinates at ``places``, or to all that it depends on.

        Differences are one-sided; ``central`` ones cost twice as much and have no error of first order.
        """
        wanted = [point.own(name) for name in self.names] if places is None else places
        steps = {i: neighbour(point, i) for i in sorted({i for own in wanted for i in own})}
        ahead = self.differences(predictions, [[steps[i] for i in own] for own in wanted])
        if not central:
            return ahead
        back = {i: opposite(point, to, distance) for i, (to, distance) in steps.items()}
        behind = self.differences(predictions, [[back[i] for i in own] for own in wanted])
        return [0.5 * (a + b) for a, b in zip(ahead, behind, strict=True)]

    def differences(
        self, predictions: Sequence[Array], steps: Sequence[Sequence[tuple[Point, float]]]
    ) -> list[Array]:
        """Return the difference quotients (n, c, k) of each run to its own k points at signed distances."""
        done = iter(self._all([(r, to) for r, own in enumerate(steps) for to, _ in own]))
        columns = []
        for predicted, own in zip(predictions, steps, strict=True):
            block = np.empty((*predicted.shape, len(own)))
            for k, (_, distance) in enumerate(own):
                block[:, :, k] = (next(done) - predicted) / distance
            columns.append(block)
        return columns

    def _all(self, jobs: Sequence[tuple[int, Point]]) -> list[Array]:
        """Simulate (run, point) pairs; what comes back has the order of the jobs."""
        simulate: Callable[[tuple[int, Point]], Array] = self._simulate
        if self.workers <= 1 or len(jobs) < 2:
            return [simulate(job) for job in jobs]
        with ThreadPoolExecutor(self.workers) as pool:
            return list(pool.map(simulate, jobs))

    def _simulate(self, job: tuple[int, Point]) -> Array:
        run, point = self.runs[job[0]], job[1]
        outputs = self.simulator.run(run.experiment, point.parameters(run.experiment.name), point.effects())
        if outputs.shape != run.outputs.shape:
            raise DiagnosisError(
                f"{self.simulator.name} returned outputs of shape {outputs.shape} for the run {run.experiment.name}, "
                f"which has {run.outputs.shape}: one row per sample and one column per channel are right"
            )
        return outputs
