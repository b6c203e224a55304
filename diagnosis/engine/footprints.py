"""Step 4, footprints: the change of the outputs by each candidate and each parameter of the model.

Theory of operation
-------------------
A footprint is the derivative of all outputs by the amplitude of an effect, at an amplitude of 0. One simulation with a
small amplitude gives it as a difference quotient, because effects must be smooth in their amplitude there. Other
parameters of an effect (a time constant, a travel) are undefined at amplitude 0. So an effect is tested at a few values
of them, the points of its grid. An effect at one point of its grid is a `Candidate`.

The same is done for every parameter of the base model and of the accepted effects, because changes that these can
imitate do not support a candidate. Step 4 continues in `screening.py`. In step 7 it is done for each coefficient of the
surfaces that represent unknown terms. All quotients are simulated once, before the noise is known. The noise estimate
(step 3, `noise_estimate.py`) and the scores use them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.contracts import Array, Hypothesis, Surface
from diagnosis.engine.columns import Columns, apart, mixed
from diagnosis.engine.config import SPOILT_FOOTPRINT
from diagnosis.engine.fitting.point import (
    Coordinate,
    Point,
    effect_coordinates,
    halved,
    neighbour,
    opposite,
    surface_coordinates,
)
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.fitting.steady import root_mean_squares, steady


@dataclass(frozen=True, slots=True)
class Candidate:
    """An effect with the shapes of one point of its grid."""

    effect: Hypothesis
    shapes: tuple[float, ...]

    def added_to(self, point: Point) -> Point:
        """Return a point with this effect added at amplitude 0."""
        return point.extended(effect_coordinates(self.effect), (0.0, *self.shapes))

    @property
    def amplitude(self) -> Coordinate:
        """The coordinate of the amplitude."""
        return effect_coordinates(self.effect)[0]

    @property
    def imitated(self) -> float:
        """The amplitude that errors of the simulator can imitate at this point of the grid."""
        return self.effect.imitated[self.effect.grid.index(self.shapes)] if self.effect.imitated else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Footprints:
    """Difference quotients of each run around a ``point``, per engine unit, neither whitened nor projected.

    ``parameter_columns`` are for the numbers of the point, ``candidate_columns`` for the ``candidates``,
    ``surface_columns`` for the coefficients of each surface.
    """

    point: Point
    predictions: tuple[Array, ...]
    parameter_columns: tuple[Columns, ...]
    candidates: tuple[Candidate, ...]
    candidate_columns: tuple[Columns, ...]
    surface_columns: tuple[tuple[Columns, ...], ...] = ()

    @property
    def looked_for(self) -> tuple[tuple[Columns, ...], ...]:
        """For each run, the columns of all possible missing terms: candidates, then surfaces."""
        return tuple(zip(self.candidate_columns, *self.surface_columns, strict=True))

    def without_columns(self) -> Footprints:
        """Return point and candidates, without columns."""
        return Footprints(self.point, (), (), self.candidates, ())


def candidates(effects: Sequence[Hypothesis]) -> tuple[Candidate, ...]:
    """Return every effect at every point of its grid."""
    return tuple(Candidate(effect, shapes) for effect in effects for shapes in effect.grid)


def footprints(replay: Replay, point: Point, tried: Sequence[Candidate]) -> Footprints:
    """Simulate the footprints of the parameters of a model and of the candidates, around a point."""
    predictions = replay.predictions(point)
    steps = [neighbour(candidate.added_to(point), len(point.numbers)) for candidate in tried]
    base = replay.base(point, predictions, [len(steps)] * len(replay.runs))
    return Footprints(
        point,
        tuple(predictions),
        tuple(replay.sensitivities(point, predictions)),
        tuple(tried),
        tuple(replay.differences(base, [steps] * len(replay.runs))),
    )


def confirmed(replay: Replay, around: Footprints, places: Sequence[int], norms: Array) -> Footprints:
    """Return the footprints. Those at ``places`` are computed again with shorter steps, so that a jump of the simulator
    has no effect.

    ``norms`` (m,) are the norms of all whitened and projected footprints. A jump is measured relative to them.
    """
    if not places:
        return around
    size, runs = len(around.candidates), len(replay.runs)
    flat = [around.candidates[i].added_to(around.point) for i in places]
    whole = [neighbour(point, len(around.point.numbers)) for point in flat]
    half = [halved(point, *step) for point, step in zip(flat, whole, strict=True)]
    quarter = [halved(point, *step) for point, step in zip(flat, half, strict=True)]
    behind = [opposite(point, *step) for point, step in zip(flat, half, strict=True)]
    first = [columns.chosen(places) for columns in around.candidate_columns]
    base = replay.base(around.point, around.predictions, [len(places)] * runs)
    second = replay.differences(base, [half] * runs)
    errors = root_mean_squares(replay.residuals(around.predictions))
    large = SPOILT_FOOTPRINT * norms[list(places)] ** 2
    spoilt = [apart(a, b, errors) > large for a, b in zip(first, second, strict=True)]
    if not np.any(spoilt):
        return around
    third = replay.differences(base, [quarter] * runs)
    fourth = replay.differences(base, [behind] * runs)
    mended = []
    for columns, *parts, mine in zip(
        around.candidate_columns, first, second, third, fourth, spoilt, strict=True
    ):
        found = steady(parts, np.outer((1.0, 0.0, 0.0, 0.0), np.ones(len(places))), mine, errors)
        old, new = np.ones(size), np.zeros(size)
        old[list(places)], new[list(places)] = 0.0, 1.0
        mended.append(mixed((columns, found.among(places, size)), np.array((old, new))))
    return replace(around, candidate_columns=tuple(mended))


def with_surfaces(replay: Replay, around: Footprints) -> Footprints:
    """Return the footprints, extended by those of each coefficient of each surface of the simulator."""
    surfaces, runs = replay.simulator.surfaces, len(replay.runs)
    most = max((len(surface.coefficients) for surface in surfaces), default=0)
    base = replay.base(around.point, around.predictions, [most] * runs)
    columns = [
        tuple(replay.differences(base, [_coefficients(around.point, surface)] * runs)) for surface in surfaces
    ]
    return replace(around, surface_columns=tuple(columns))


def joined(first: Footprints, second: Footprints) -> Footprints:
    """Return the footprints on the runs of both. The point of ``second`` is that of ``first`` plus the nuisances of its
    further runs.
    """
    return Footprints(
        second.point,
        first.predictions + second.predictions,
        first.parameter_columns + second.parameter_columns,
        first.candidates,
        first.candidate_columns + second.candidate_columns,
        tuple(a + b for a, b in zip(first.surface_columns, second.surface_columns, strict=True)),
    )


def _coefficients(point: Point, surface: Surface) -> list[tuple[Point, float]]:
    """Return a neighbour of a point for each coefficient of a surface."""
    flat = point.extended(surface_coordinates(surface), [p.nominal for p in surface.coefficients])
    return [neighbour(flat, i) for i in range(len(point.numbers), len(flat.numbers))]
