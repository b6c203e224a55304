"""The screen: how well every candidate's footprint matches what the model leaves, and what chance alone would match."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from diagnosis.contracts import Array, Effect, Surface
from diagnosis.engine.fit import ITERATIONS, FittedModel, counted, filters, fit
from diagnosis.engine.linear import Block, Columns, Linearisation, Projection, prior, solve
from diagnosis.engine.noise import Filter, Mask, Noise, estimate, quietest, white
from diagnosis.engine.point import Coordinate, Point, effect_coordinates, neighbour, surface_coordinates
from diagnosis.engine.replay import Quotients, Replay

BLOCKS: Final = 256  #: of all runs together, to see how scores scatter
DRAWS: Final = 20_000  #: of the maximum of all scores under chance


@dataclass(frozen=True, slots=True)
class Candidate:
    """An effect with the shapes of one point of its grid."""

    effect: Effect
    shapes: tuple[float, ...]

    def entered(self, point: Point) -> Point:
        """Return a point with this effect in it, of no size yet."""
        return point.with_(effect_coordinates(self.effect), (0.0, *self.shapes))

    @property
    def amplitude(self) -> Coordinate:
        """The coordinate of the amplitude."""
        return effect_coordinates(self.effect)[0]


@dataclass(frozen=True, slots=True, eq=False)
class Screen:
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
        entered = candidate.entered(point)
        effect = candidate.effect.amplitude
        inside = candidate.amplitude.inside(
            float(np.clip(self.amplitude[i], 0.95 * effect.low, 0.95 * effect.high))
        )
        numbers = entered.numbers.copy()
        numbers[: len(point.numbers)] -= inside * self.projection.shadow[:, i]
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
class Footprints:
    """What each number of a model, each candidate and each coefficient of a surface would change around a ``point``.

    Quotients (k, n, c) for each run, as they come from the simulator: ``own``, of the ``entries``, of each surface.
    """

    point: Point
    predictions: tuple[Array, ...]
    own: tuple[Quotients, ...]
    entries: tuple[Candidate, ...]
    more: tuple[Quotients, ...]
    surfaces: tuple[tuple[Quotients, ...], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """A model fitted under its noise, the scores of all candidates, and each surface's columns (m, n, c) by run."""

    model: FittedModel
    screen: Screen
    surfaces: tuple[tuple[Quotients, ...], ...]


def signs(effects: Sequence[Effect], scores: Array) -> Array:
    """Return ±1 (m,): what makes a score count as positive; only one sign is physical for a one-sided effect."""
    physical = [0.0 if not e.one_sided else 1.0 if e.amplitude.low >= 0.0 else -1.0 for e in effects]
    return np.where(np.array(physical) == 0.0, np.where(scores < 0.0, -1.0, 1.0), physical)


def candidates(effects: Sequence[Effect]) -> tuple[Candidate, ...]:
    """Return every effect at every point of its grid."""
    return tuple(Candidate(effect, shapes) for effect in effects for shapes in effect.grid)


def footprints(replay: Replay, point: Point, entries: Sequence[Candidate]) -> Footprints:
    """Simulate what the numbers of a model and the candidates change around a point."""
    predictions = replay.predictions(point)
    steps = [neighbour(c.entered(point), len(point.numbers)) for c in entries]
    return Footprints(
        point,
        tuple(predictions),
        tuple(replay.sensitivities(point, predictions)),
        tuple(entries),
        tuple(replay.differences(predictions, [steps] * len(replay.runs))),
    )


def with_surfaces(replay: Replay, around: Footprints) -> Footprints:
    """Add what each coefficient of each surface of the simulator would change."""
    surfaces = [
        tuple(replay.differences(around.predictions, [_roughened(around.point, surface)] * len(replay.runs)))
        for surface in replay.simulator.surfaces
    ]
    return replace(around, surfaces=tuple(surfaces))


def joined(these: Footprints, others: Footprints) -> Footprints:
    """Put footprints on further runs beside these; their point is the same, with the nuisances of those runs."""
    return Footprints(
        others.point,
        these.predictions + others.predictions,
        these.own + others.own,
        these.entries,
        these.more + others.more,
        tuple(mine + more for mine, more in zip(these.surfaces, others.surfaces, strict=True)),
    )


def look(replay: Replay, around: Footprints, *, alpha: float, seed: int, steps: int = ITERATIONS) -> Sight:
    """Estimate the noise around a model, fit the model under it, and score every candidate against it.

    Noise is what a linear model of everything leaves: of the model's own numbers, of all candidates and of the
    coefficients of the surfaces. So it holds no effect that anybody will look for, whichever is there.
    """
    start, names = around.point, replay.names
    everything = [np.concatenate(parts) for parts in zip(around.more, *around.surfaces, strict=True)]
    residuals = replay.residuals(around.predictions)
    noise = remaining_noise(replay, start, residuals, around.own, everything)
    whiten = filters(noise, replay)
    model = fit(replay, noise, start, _around(names, start, whiten, residuals, around.own))
    columns = [f.single(x) for f, x in zip(whiten, everything, strict=True)]
    del everything
    inflation = overdispersion(model.linearisation, columns)
    noise = replace(noise, dispersion=float(np.median(inflation)) if len(inflation) else 1.0)
    model = fit(replay, noise, model.point, model.linearisation, steps=steps)
    ends = np.cumsum([len(around.entries), *(len(surface[0]) for surface in around.surfaces)])
    entry = [x[: ends[0]] for x in columns]
    return Sight(
        model,
        screen(model.linearisation, around.entries, entry, inflation[: ends[0]], alpha=alpha, seed=seed),
        tuple(tuple(x[a:b] for x in columns) for a, b in pairwise(ends)),
    )


def _roughened(point: Point, surface: Surface) -> list[tuple[Point, float]]:
    """Return the neighbours of a point along the coefficients of a surface."""
    flat = point.with_(surface_coordinates(surface), [p.nominal for p in surface.coefficients])
    return [neighbour(flat, i) for i in range(len(point.numbers), len(flat.numbers))]


def overdispersion(here: Linearisation, columns: Sequence[Quotients]) -> Array:
    """Return by how much the scores of columns (m, n, c) scatter more than whitened noise allows (m,), at least 1.

    The sandwich of robust statistics: the variance of a score is the sum of squares of what blocks of a run add to
    it, each far longer than the noise remembers. It sees what no whitening of single channels can: errors of the
    model and the inputs that last, or that several channels share. What the columns explain together counts as no
    error, so an effect does not hide itself.
    """
    projection = here.project(columns)
    seen = projection.norm > 0.0
    explained = np.zeros(len(seen))
    explained[seen] = solve(projection.gram[np.ix_(seen, seen)], projection.score[seen])
    imitated = projection.shadow @ explained
    length = max(1, sum(len(block.residual) for block in here.blocks) // BLOCKS)
    meat, count = np.zeros(len(seen)), 0
    for block, more in zip(here.blocks, columns, strict=True):
        error = block.residual - np.tensordot(explained, more, 1) + block.along(imitated)
        for start in range(0, len(error), length):
            inside = slice(start, start + length)
            part = error[inside].ravel()
            score = more[:, inside].reshape(len(seen), part.size) @ part
            own = [
                columns.values[:, inside].reshape(len(places), part.size) @ part
                for places, columns in block.parts
            ]
            score -= np.concatenate(own) @ projection.shadow[block.places]
            meat += score**2
            count += 1
    square = projection.norm**2
    ratio = np.divide(meat, square, out=np.ones_like(meat), where=seen)
    return np.maximum(ratio * count / max(count - 1, 1), 1.0)


def screen(
    here: Linearisation,
    entries: Sequence[Candidate],
    columns: Sequence[Quotients],
    inflation: Array,
    *,
    alpha: float,
    seed: int,
) -> Screen:
    """Score candidates by their whitened columns (m, n, c) of each run."""
    projection = here.project(columns)
    one_sided = np.array([c.effect.one_sided for c in entries], dtype=bool)
    return Screen(
        tuple(entries),
        projection,
        tuple(columns),
        inflation,
        threshold(projection.cosines, one_sided, alpha, seed),
    )


def threshold(cosines: Array, one_sided: Mask, alpha: float, seed: int) -> float:
    """Return the score that the largest of N(0, cosines) exceeds with probability alpha; two-sided ones by size."""
    if len(cosines) == 0:
        return float("inf")
    values, vectors = np.linalg.eigh(cosines)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    draws = np.random.default_rng(seed).standard_normal((DRAWS, len(cosines))) @ root.T
    draws[:, ~one_sided] = np.abs(draws[:, ~one_sided])
    return float(np.quantile(draws.max(axis=1), 1.0 - alpha))


def remaining_noise(
    replay: Replay,
    point: Point,
    residuals: Sequence[Array],
    own: Sequence[Quotients],
    more: Sequence[Quotients],
) -> Noise:
    """Return the noise that a least-squares fit of all columns leaves: those of the point, and ``more`` (m, n, c)."""
    channels = replay.simulator.channels
    masks = [counted(run) for run in replay.runs]
    rough = []
    for i, channel in enumerate(channels):
        errors = np.concatenate([r[m[:, i], i] for r, m in zip(residuals, masks, strict=True)])
        rough.append(max(float(np.sqrt(np.mean(errors**2))), quietest(channel), 1e-150))
    whiten = filters(white(rough), replay)
    here = _around(replay.names, point, whiten, residuals, own)
    projection = here.project([f.single(x) for f, x in zip(whiten, more, strict=True)])
    seen = projection.norm > 0.0
    others = np.zeros(len(seen))
    others[seen] = solve(projection.gram[np.ix_(seen, seen)], projection.score[seen])
    mine = here.step() - projection.shadow @ others
    leftovers = [
        residual - np.tensordot(mine[point.own(name)], x, 1) - np.tensordot(others, y, 1)
        for name, residual, x, y in zip(replay.names, residuals, own, more, strict=True)
    ]
    return estimate(
        channels, leftovers, masks, spent=len(mine) + int(np.linalg.matrix_rank(projection.cosines))
    )


def _around(
    names: Sequence[str],
    point: Point,
    whiten: Sequence[Filter],
    residuals: Sequence[Array],
    own: Sequence[Quotients],
) -> Linearisation:
    """Return the linearisation from quotients: the nuisances' columns, then those of the model's effects."""
    blocks = []
    for name, f, residual, quotients in zip(names, whiten, residuals, own, strict=True):
        white = f(quotients)
        parts = tuple(
            (
                tuple(i for i in point.own(name) if bool(point.coordinates[i].owner) is special),
                Columns(white[[bool(point.coordinates[i].owner) is special for i in point.own(name)]]),
            )
            for special in (False, True)
        )
        blocks.append(Block(name, f(residual), parts))
    return Linearisation(point, prior(point), tuple(blocks))
