"""The screen: how well every candidate's footprint matches what the model leaves, and what chance alone would match."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from diagnosis.contracts import Array, Hypothesis
from diagnosis.engine.fitting.fit import ITERATIONS, FittedModel, fit
from diagnosis.engine.fitting.linear import Linearisation, Projection
from diagnosis.engine.fitting.linearise import from_quotients
from diagnosis.engine.fitting.point import Point
from diagnosis.engine.fitting.replay import Quotients, Replay
from diagnosis.engine.footprints import Candidate, Footprints
from diagnosis.engine.noise import filters
from diagnosis.engine.noise_estimate import overdispersion, remaining_noise
from diagnosis.engine.threshold import threshold


@dataclass(frozen=True, slots=True, eq=False)
class Screening:
    """Scores of all candidates m against a fitted model.

    ``columns`` (m, n, c) of each run are whitened and not projected; ``inflation`` (m,) says how much more a score
    scatters than whitened noise would let it.
    """

    candidates: tuple[Candidate, ...]
    projection: Projection
    columns: tuple[Quotients, ...]
    inflation: Array
    threshold: float

    @property
    def scatter(self) -> Array:
        """Standard deviations of the scores (m,) of effects that are absent, in those of whitened noise."""
        imitated = np.array([c.effect.imitated / c.amplitude.scale for c in self.candidates])
        return np.sqrt(self.inflation + (imitated * self.projection.norm) ** 2)

    @property
    def z(self) -> Array:
        """Scores (m,): standard normal where the effect is absent; negative where the sign is not physical."""
        return self.projection.z * self._signs / self.scatter

    @property
    def strength(self) -> Array:
        """How well the data see a unit of amplitude (m,): λ per unit of the amplitude."""
        scales = np.array([c.amplitude.scale for c in self.candidates])
        return self.projection.norm / scales / self.scatter

    @property
    def amplitude(self) -> Array:
        """The amplitude (m,) which the score estimates, in its own unit."""
        norm = self.projection.norm
        scales = np.array([c.amplitude.scale for c in self.candidates])
        return scales * np.divide(self.projection.z, norm, out=np.zeros_like(norm), where=norm > 0.0)

    def start(self, point: Point, i: int) -> Point:
        """Return where a fit of a candidate may start: at the amplitude of its score, with what makes room for it."""
        candidate = self.candidates[i]
        entered = candidate.added_to(point)
        effect = candidate.effect.amplitude
        inside = candidate.amplitude.inside(
            float(np.clip(self.amplitude[i], 0.95 * effect.low, 0.95 * effect.high))
        )
        numbers = entered.numbers.copy()
        numbers[: len(point.numbers)] -= inside * self.projection.regression[:, i]
        numbers[len(point.numbers)] = inside
        return entered.at(numbers)

    @property
    def exceeding(self) -> list[int]:
        """Return the best point of each effect's grid that passes the threshold, highest score first."""
        best: dict[str, int] = {}
        for i in np.argsort(-self.z, kind="stable"):
            if self.z[i] > self.threshold:
                best.setdefault(self.candidates[i].effect.name, int(i))
        return list(best.values())

    def best(self, effect: str) -> int:
        """Return the best point of one effect's grid."""
        mine = [i for i, c in enumerate(self.candidates) if c.effect.name == effect]
        return max(mine, key=lambda i: float(self.z[i]))

    @property
    def _signs(self) -> Array:
        return signs([c.effect for c in self.candidates], self.projection.score)


@dataclass(frozen=True, slots=True, eq=False)
class ScreenedModel:
    """A model fitted under its noise, the scores of all candidates, and each surface's columns (m, n, c) by run."""

    model: FittedModel
    screen: Screening
    surfaces: tuple[tuple[Quotients, ...], ...]


def signs(effects: Sequence[Hypothesis], scores: Array) -> Array:
    """Return ±1 (m,): what makes a score count as positive; only one sign is physical for a one-sided effect."""
    physical = [0.0 if not e.one_sided else 1.0 if e.amplitude.low >= 0.0 else -1.0 for e in effects]
    return np.where(np.array(physical) == 0.0, np.where(scores < 0.0, -1.0, 1.0), physical)


def fit_and_screen(
    replay: Replay, around: Footprints, *, alpha: float, seed: int, steps: int = ITERATIONS
) -> ScreenedModel:
    """Estimate the noise around a model, fit the model under it, and score every candidate against it.

    Noise is what a linear model of everything leaves: of the model's own numbers, of all candidates and of the
    coefficients of the surfaces. So it holds no effect that anybody will look for, whichever is there.
    """
    start, names = around.point, replay.names
    everything = [np.concatenate(parts) for parts in zip(around.more, *around.surfaces, strict=True)]
    residuals = replay.residuals(around.predictions)
    noise = remaining_noise(replay, start, residuals, around.own, everything)
    whiten = filters(noise, replay.runs)
    model = fit(replay, noise, start, from_quotients(names, start, whiten, residuals, around.own))
    columns = [f.single(x) for f, x in zip(whiten, everything, strict=True)]
    del everything
    inflation = overdispersion(model.linearisation, columns)
    noise = replace(noise, dispersion=float(np.median(inflation)) if len(inflation) else 1.0)
    model = fit(replay, noise, model.point, model.linearisation, steps=steps)
    ends = np.cumsum([len(around.entries), *(len(surface[0]) for surface in around.surfaces)])
    entry = [x[: ends[0]] for x in columns]
    return ScreenedModel(
        model,
        screen(model.linearisation, around.entries, entry, inflation[: ends[0]], alpha=alpha, seed=seed),
        tuple(tuple(x[a:b] for x in columns) for a, b in pairwise(ends)),
    )


def screen(
    here: Linearisation,
    entries: Sequence[Candidate],
    columns: Sequence[Quotients],
    inflation: Array,
    *,
    alpha: float,
    seed: int,
) -> Screening:
    """Score candidates by their whitened columns (m, n, c) of each run."""
    projection = here.project(columns)
    one_sided = np.array([c.effect.one_sided for c in entries], dtype=bool)
    return Screening(
        tuple(entries),
        projection,
        tuple(columns),
        inflation,
        threshold(projection.cosines, one_sided, alpha, seed),
    )
