"""λ of something hidden: the norm of its footprint once the base model is refitted, in the noise of the data sheets."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from diagnosis.contracts import Array, Effects, Experiment, MeasuredRun, Simulator
from diagnosis.engine.fitting.linear import Block, Columns, Linearisation, prior_of
from diagnosis.engine.fitting.point import base_point, neighbour
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.footprints import Candidate
from diagnosis.engine.noise import filters, white

#: Columns that are held at once.
_BATCH = 12


class LinearisedBase:
    """The base model, linear around its nominal parameters on some runs, and λ of what it lacks there."""

    def __init__(self, simulator: Simulator, runs: Sequence[MeasuredRun]) -> None:
        self._replay = Replay(simulator, tuple(runs))
        deviations = [float(np.hypot(c.noise, c.resolution / 12**0.5)) for c in simulator.channels]
        self._whiten = filters(white(deviations), self._replay.runs)
        self._point = base_point(simulator.nuisances, self._replay.names)
        self._predictions = self._replay.predictions(self._point)
        own = self._replay.sensitivities(self._point, self._predictions)
        blocks = [
            Block(name, np.zeros_like(predicted), ((tuple(self._point.places_of(name)), Columns(f(x))),))
            for name, f, predicted, x in zip(
                self._replay.names, self._whiten, self._predictions, own, strict=True
            )
        ]
        self._linearisation = Linearisation(self._point, prior_of(self._point), tuple(blocks))

    def lambdas_per_unit(self, entries: Sequence[Candidate]) -> list[float]:
        """Return λ per unit of amplitude of each candidate."""
        found: list[float] = []
        for k in range(0, len(entries), _BATCH):
            batch = entries[k : k + _BATCH]
            steps = [neighbour(c.added_to(self._point), len(self._point.numbers)) for c in batch]
            norms = self._norms(self._replay.differences(self._predictions, [steps] * len(self._predictions)))
            found += [norm / c.amplitude.scale for c, norm in zip(batch, norms, strict=True)]
        return found

    def lambda_of(self, run: Callable[[Experiment, Effects], Array], effects: Effects) -> float:
        """Return λ of ``effects``, as ``run`` predicts them; the base model is refitted as if it were linear."""
        return self._norms(self._columns(run, [effects]))[0]

    def absorbed(self, run: Callable[[Experiment, Effects], Array], effects: Sequence[Effects]) -> Array:
        """Return how far the k base parameters would move to imitate each of m ``effects`` (k, m), in their spreads."""
        projection = self._linearisation.project(self._whitened(self._columns(run, effects)))
        shared = [i for i, c in enumerate(self._point.coordinates) if not c.record]
        found: Array = projection.regression[shared]
        return found

    def _columns(
        self, run: Callable[[Experiment, Effects], Array], effects: Sequence[Effects]
    ) -> list[Array]:
        return [
            np.stack([run(one.experiment, given) - predicted for given in effects])
            for one, predicted in zip(self._replay.runs, self._predictions, strict=True)
        ]

    def _norms(self, columns: Sequence[NDArray[np.floating]]) -> list[float]:
        norms: list[float] = self._linearisation.project(self._whitened(columns)).norm.tolist()
        return norms

    def _whitened(self, columns: Sequence[NDArray[np.floating]]) -> list[NDArray[np.floating]]:
        return [f(x) for f, x in zip(self._whiten, columns, strict=True)]
