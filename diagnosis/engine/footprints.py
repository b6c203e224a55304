"""Step 4a: the footprint of every candidate, by one simulation each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from diagnosis.contracts import Array, Hypothesis, Surface
from diagnosis.engine.fitting.point import (
    Coordinate,
    Point,
    effect_coordinates,
    neighbour,
    surface_coordinates,
)
from diagnosis.engine.fitting.replay import Quotients, Replay


@dataclass(frozen=True, slots=True)
class Candidate:
    """An effect with the shapes of one point of its grid."""

    effect: Hypothesis
    shapes: tuple[float, ...]

    def added_to(self, point: Point) -> Point:
        """Return a point with this effect in it, of no size yet."""
        return point.extended(effect_coordinates(self.effect), (0.0, *self.shapes))

    @property
    def amplitude(self) -> Coordinate:
        """The coordinate of the amplitude."""
        return effect_coordinates(self.effect)[0]


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


def candidates(effects: Sequence[Hypothesis]) -> tuple[Candidate, ...]:
    """Return every effect at every point of its grid."""
    return tuple(Candidate(effect, shapes) for effect in effects for shapes in effect.grid)


def footprints(replay: Replay, point: Point, entries: Sequence[Candidate]) -> Footprints:
    """Simulate what the numbers of a model and the candidates change around a point."""
    predictions = replay.predictions(point)
    steps = [neighbour(c.added_to(point), len(point.numbers)) for c in entries]
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


def _roughened(point: Point, surface: Surface) -> list[tuple[Point, float]]:
    """Return the neighbours of a point along the coefficients of a surface."""
    flat = point.extended(surface_coordinates(surface), [p.nominal for p in surface.coefficients])
    return [neighbour(flat, i) for i in range(len(point.numbers), len(flat.numbers))]
