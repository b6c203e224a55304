"""The screening of candidates with dense matrices and known white noise, for the drawings that explain it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.contracts import Array, Hypothesis, MeasuredRun, Simulator

#: Gauss-Newton steps of the base model.
STEPS = 4


@dataclass(frozen=True, eq=False)
class DenseScreening:
    """A base model at its best fit; samples of all runs and channels are rows, in standard deviations of the noise.

    ``footprints`` (N, m) are per unit of amplitude, one for each effect and point of its grid. ``left`` (N, m) is the
    part of them that the base model cannot imitate. ``errors`` (N,) are the residuals of the base model.
    """

    effects: tuple[Hypothesis, ...]  #: of each footprint
    shapes: tuple[tuple[int, int], ...]  #: samples and channels of each run
    errors: Array
    footprints: Array
    left: Array
    gram: Array  #: (m, m) of the projected footprints, with the priors of the base model as observations
    score: Array
    imitators: tuple[str, ...]  #: of each footprint, the parameter of the base model that imitates it best

    @property
    def names(self) -> tuple[str, ...]:
        """The effects by name."""
        return tuple(dict.fromkeys(effect.name for effect in self.effects))

    @property
    def norm(self) -> Array:
        """λ per unit of amplitude (m,)."""
        return np.sqrt(np.diagonal(self.gram))

    @property
    def visible(self) -> Array:
        """Part of each footprint that the base model cannot imitate (m,)."""
        return self.norm / np.linalg.norm(self.footprints, axis=0)

    @property
    def z(self) -> Array:
        """Scores (m,), negative where the sign is not physical."""
        z = self.score / self.norm
        return np.where(self._one_sided, z, np.abs(z))

    @property
    def cosines(self) -> Array:
        """Cosines (m, m) of the projected footprints."""
        return self.gram / np.outer(self.norm, self.norm)

    @property
    def alike(self) -> Array:
        """The largest cosine by size for each pair of effects."""
        sizes = np.abs(self.cosines)
        places = [self._places(name) for name in self.names]
        return np.array([[sizes[np.ix_(a, b)].max() for b in places] for a in places])

    def of(self, rows: Array, run: int) -> Array:
        """Return the rows (N,) of one run as samples and channels."""
        start = sum(n * c for n, c in self.shapes[:run])
        n, c = self.shapes[run]
        return rows[start : start + n * c].reshape(n, c)

    def best(self, name: str) -> int:
        """Return the place of the highest score of an effect."""
        return max(self._places(name), key=lambda i: float(self.z[i]))

    def most_visible(self, name: str) -> int:
        """Return the grid point of an effect with the largest remaining footprint per typical size."""
        return max(self._places(name), key=lambda i: float(self.norm[i]))

    def by_chance(self, draws: int, seed: int) -> Array:
        """Return the largest of all scores without a hidden effect (draws,)."""
        values, vectors = np.linalg.eigh(self.cosines)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        z = np.random.default_rng(seed).standard_normal((draws, len(values))) @ root.T
        return np.where(self._one_sided, z, np.abs(z)).max(axis=1)

    @property
    def _one_sided(self) -> Array:
        return np.array([effect.one_sided for effect in self.effects])

    def _places(self, name: str) -> list[int]:
        return [i for i, effect in enumerate(self.effects) if effect.name == name]


def _one_step(effect: Hypothesis, shapes: Sequence[float]) -> dict[str, float]:
    """Return the values of an effect whose amplitude is one step of its difference quotient."""
    amplitude = {effect.amplitude.name: effect.amplitude.difference}
    return amplitude | {p.name: value for p, value in zip(effect.shapes, shapes, strict=True)}


def dense_screening(
    simulator: Simulator, runs: Sequence[MeasuredRun], effects: Sequence[Hypothesis]
) -> DenseScreening:
    """Fit the base model of a simulator to runs and return it with the footprints of effects."""
    noise = np.array([channel.noise for channel in simulator.channels])
    coordinates = [
        (nuisance, run)
        for nuisance in simulator.nuisances
        for run in (range(len(runs)) if nuisance.per_run else (None,))
    ]

    def predicted(numbers: Array, effect: dict[str, dict[str, float]] | None = None) -> Array:
        rows = []
        for k, run in enumerate(runs):
            given = {
                nuisance.name: nuisance.nominal + number * nuisance.spread
                for (nuisance, own), number in zip(coordinates, numbers, strict=True)
                if own in {None, k}
            }
            rows.append((simulator.run(run.experiment, given, effect or {}) / noise).ravel())
        return np.concatenate(rows)

    def sensitivities(numbers: Array, predictions: Array) -> Array:
        steps = [nuisance.difference / nuisance.spread for nuisance, _ in coordinates]
        moved = numbers + np.diag(steps)
        return np.column_stack(
            [(predicted(n) - predictions) / step for n, step in zip(moved, steps, strict=True)]
        )

    measured = np.concatenate([(run.outputs / noise).ravel() for run in runs])
    numbers = np.zeros(len(coordinates))
    prior = np.eye(len(coordinates))  # of the parameters in their spreads
    for _ in range(STEPS):
        predictions = predicted(numbers)
        X = sensitivities(numbers, predictions)
        numbers = numbers + np.linalg.solve(X.T @ X + prior, X.T @ (measured - predictions) - numbers)
    predictions = predicted(numbers)
    X = sensitivities(numbers, predictions)
    entries = [(effect, shapes) for effect in effects for shapes in effect.grid]
    columns = []
    for effect, shapes in entries:
        moved = predicted(numbers, {effect.name: _one_step(effect, shapes)})
        columns.append((moved - predictions) / effect.amplitude.difference)
    footprints = np.column_stack(columns)
    cross = X.T @ footprints
    regression = np.linalg.solve(X.T @ X + prior, cross)
    errors = measured - predictions
    parts = np.abs(regression) * np.sqrt(np.diagonal(X.T @ X + prior))[:, None]
    return DenseScreening(
        tuple(effect for effect, _ in entries),
        tuple(run.outputs.shape for run in runs),
        errors,
        footprints,
        footprints - X @ regression,
        footprints.T @ footprints - cross.T @ regression,
        footprints.T @ errors - regression.T @ (X.T @ errors - numbers),
        tuple(coordinates[i][0].name for i in np.argmax(parts, axis=0)),
    )
