"""λ of a hidden effect: the norm of its footprint after the base model is refitted, in a given noise."""

from collections.abc import Callable, Sequence

import numpy as np

from diagnosis.contracts import Array, Effects, Experiment, MeasuredRun, Simulator
from diagnosis.engine.columns import Columns, columns_of, packing_of
from diagnosis.engine.fitting.linear import Projection
from diagnosis.engine.fitting.linearise import from_quotients
from diagnosis.engine.fitting.point import Point, base_point, neighbour
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.footprints import Candidate
from diagnosis.engine.noise import Noise, white
from diagnosis.engine.whitening import filters

#: Columns that are held at once.
_BATCH = 12


class LinearisedBase:
    """The base model, linear around its nominal parameters on some runs, and λ of missing effects.

    Without ``noise``, the noise is white with the sizes of the data sheets.
    """

    def __init__(self, simulator: Simulator, runs: Sequence[MeasuredRun], noise: Noise | None = None) -> None:
        self._replay = Replay(simulator, tuple(runs))
        deviations = [float(np.hypot(c.noise, c.resolution / 12**0.5)) for c in simulator.channels]
        self._whiten = filters(noise or white(deviations), self._replay.runs)
        self._point = base_point(simulator.nuisances, self._replay.records)
        self._predictions = self._replay.predictions(self._point)
        own = self._replay.sensitivities(self._point, self._predictions)
        nothing = [np.zeros_like(predicted) for predicted in self._predictions]
        self._linearisation = from_quotients(self._replay, self._point, self._whiten, nothing, own)

    def lambdas_per_unit(self, entries: Sequence[Candidate]) -> list[float]:
        """Return λ per unit of amplitude of each candidate."""
        found: list[float] = []
        for k in range(0, len(entries), _BATCH):
            batch = entries[k : k + _BATCH]
            steps = [neighbour(c.added_to(self._point), len(self._point.numbers)) for c in batch]
            columns = self._differences(steps)
            norms: list[float] = self._projected(columns).norm.tolist()
            found += [norm / c.amplitude.scale for c, norm in zip(batch, norms, strict=True)]
        return found

    def lambda_of(self, run: Callable[[Experiment, Effects], Array], effects: Effects) -> float:
        """Return λ of ``effects``, as ``run`` predicts them; the base model is refitted as if it were linear."""
        return float(self._projected(self._columns(run, [effects])).norm[0])

    def lambda_apart(
        self, run: Callable[[Experiment, Effects], Array], effects: Effects, entries: Sequence[Candidate]
    ) -> float:
        """Return λ of the part of ``effects`` that the most similar candidate cannot imitate."""
        steps = [neighbour(c.added_to(self._point), len(self._point.numbers)) for c in entries]
        further = self._differences(steps)
        both = zip(self._whiten, self._columns(run, [effects]), further, strict=True)
        information = self._linearisation.project(f.columns([x, y]) for f, x, y in both).information
        own, others = information[0, 0], np.diagonal(information)[1:]
        imitated = np.divide(information[0, 1:] ** 2, others, out=np.zeros_like(others), where=others > 0.0)
        return float(np.sqrt(max(own - imitated.max(initial=0.0), 0.0)))

    def parts_apart(self, entries: Sequence[Candidate], others: Sequence[Candidate]) -> list[float]:
        """Return the part of the λ of each candidate that the most similar one of ``others`` cannot imitate."""
        together = [*entries, *others]
        steps = [neighbour(c.added_to(self._point), len(self._point.numbers)) for c in together]
        columns = self._differences(steps)
        information = self._projected(columns).information
        length = np.sqrt(np.diagonal(information))
        alike = np.abs(information[: len(entries), len(entries) :])
        cosines = alike / np.outer(length[: len(entries)], length[len(entries) :])
        found: list[float] = np.sqrt(np.maximum(1.0 - cosines.max(axis=1) ** 2, 0.0)).tolist()
        return found

    def absorbed(self, run: Callable[[Experiment, Effects], Array], effects: Sequence[Effects]) -> Array:
        """Return how far the k base parameters would move to imitate each of m ``effects`` (k, m), in their spreads."""
        projection = self._projected(self._columns(run, effects))
        shared = [i for i, c in enumerate(self._point.coordinates) if not c.record]
        found: Array = projection.regression[shared]
        return found

    def _differences(self, steps: Sequence[tuple[Point, float]]) -> list[Columns]:
        """Return the difference quotients of each run to the same points at signed distances."""
        runs = len(self._predictions)
        base = self._replay.base(self._point, self._predictions, [len(steps)] * runs)
        return self._replay.differences(base, [steps] * runs)

    def _columns(
        self, run: Callable[[Experiment, Effects], Array], effects: Sequence[Effects]
    ) -> list[Columns]:
        return [
            columns_of(
                packing_of(one), np.stack([run(one.experiment, given) - predicted for given in effects])
            )
            for one, predicted in zip(self._replay.runs, self._predictions, strict=True)
        ]

    def _projected(self, columns: Sequence[Columns]) -> Projection:
        return self._linearisation.project(f.columns([x]) for f, x in zip(self._whiten, columns, strict=True))
