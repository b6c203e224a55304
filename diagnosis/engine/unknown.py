"""What no named effect explains: a test on a surface over two states, and that surface fitted inside the model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.contracts import Array, MeasuredRun, Surface
from diagnosis.engine.errors import at_most_one, chi_square
from diagnosis.engine.fit import FittedModel, filters, fit, predict
from diagnosis.engine.linear import Linearisation, solve
from diagnosis.engine.point import neighbour, surface_coordinates
from diagnosis.engine.screen import Screen
from diagnosis.finding import Figure, Nearest, Region, Series, Unknown, number, numbers

#: A surface acts where a coefficient is so many standard deviations from 0, and such a part of the largest one.
CLEAR, LARGE = 2.0, 0.1
#: A coefficient was seen where the data halve the standard deviation that was believed.
SEEN = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Omnibus:
    """The score test of one surface: χ² of its coefficients together, ``p`` for all surfaces that were tested.

    ``start`` (m,) are the coefficients that the score estimates, in units of their prior spread.
    """

    surface: Surface
    columns: tuple[Array, ...]
    statistic: float
    freedom: int
    p: float
    start: Array


def omnibus(model: FittedModel, surfaces: Sequence[Surface]) -> list[Omnibus]:
    """Test every surface of a simulator against what a fitted model leaves; the clearest comes first.

    The p-value is exact for Gaussian noise, and Bonferroni's over the surfaces.
    """
    tests = [score_test(model.linearisation, surface, columns(model, surface)) for surface in surfaces]
    shared = [replace(test, p=at_most_one(test.p, len(tests))) for test in tests]
    return sorted(shared, key=lambda test: (test.p, -test.statistic))


def columns(model: FittedModel, surface: Surface) -> tuple[Array, ...]:
    """What each coefficient of a surface would change: whitened (n, c, m) for each run, per prior spread."""
    point = model.point
    flat = point.with_(surface_coordinates(surface), [p.nominal for p in surface.coefficients])
    steps = [neighbour(flat, i) for i in range(len(point.numbers), len(flat.numbers))]
    replay = model.replay
    quotients = replay.differences(model.predictions, [steps] * len(replay.runs))
    return tuple(f(q) for f, q in zip(filters(model.noise, replay), quotients, strict=True))


def score_test(here: Linearisation, surface: Surface, columns: Sequence[Array]) -> Omnibus:
    """χ² = sᵀ G⁺ s of the projected scores s, in the directions that the data would show.

    G is the Gram matrix per prior spread: where one of its eigenvalues is below 1, a surface as large as is believed
    stays under the noise, and looking there would only add chance.
    """
    projection = here.project(columns)
    values, vectors = np.linalg.eigh(projection.gram)
    shown = values > 1.0
    along = vectors[:, shown].T @ projection.score
    statistic = float(np.sum(along**2 / values[shown]))
    return Omnibus(
        surface=surface,
        columns=tuple(columns),
        statistic=statistic,
        freedom=int(shown.sum()),
        p=chi_square(statistic, int(shown.sum())),
        start=solve(projection.gram + np.eye(len(values)), projection.score),
    )


def explain(
    model: FittedModel, test: Omnibus, screen: Screen | None, select: Sequence[MeasuredRun]
) -> tuple[FittedModel, Unknown]:
    """Fit a surface inside a model and say where it acts and what it resembles; never what it is.

    The prior spread of its coefficients is the ridge.  It is kept where it predicts the select runs better; then the
    model that is returned holds it, otherwise it is ``model``.
    """
    coordinates = surface_coordinates(test.surface)
    start = [c.outside(u) for c, u in zip(coordinates, test.start, strict=True)]
    fitted = fit(model.replay, model.noise, model.point.with_(coordinates, start), model.linearisation)
    gain = predict(fitted, select).lpd - predict(model, select).lpd if select else float("nan")
    kept = gain > 0.0
    places = [fitted.point.place(c) for c in coordinates]
    deviations = np.sqrt(np.maximum(np.diagonal(fitted.covariance())[places], 0.0))
    regions = _regions(test.surface, fitted.point.numbers[places], deviations)
    nearest = resemblance(model.linearisation, test, screen) if screen else []
    unknown = Unknown(
        surface=test.surface.name,
        title=test.surface.title,
        statistic=number(test.statistic),
        freedom=test.freedom,
        p=number(test.p),
        kept=kept,
        lpd_gain=number(gain),
        regions=regions,
        nearest=nearest,
        sentence=_sentence(test.surface, regions, nearest, kept),
        figure=_map(test.surface, fitted.point.values()[places], deviations),
    )
    return (fitted if kept else model), unknown


def resemblance(here: Linearisation, test: Omnibus, screen: Screen, most: int = 3) -> list[Nearest]:
    """The named effects whose footprint is most like that of the surface, by the cosine after projection."""
    together = [
        np.concatenate((named, (unnamed @ test.start)[:, :, np.newaxis]), axis=2)
        for named, unnamed in zip(screen.columns, test.columns, strict=True)
    ]
    projection = here.project(together)
    cosines = np.abs(projection.cosines[-1, :-1])
    best: dict[str, float] = {}
    for candidate, cosine in zip(screen.candidates, cosines, strict=True):
        best[candidate.effect.name] = max(best.get(candidate.effect.name, 0.0), float(cosine))
    ranked = sorted(best.items(), key=lambda item: -item[1])[:most]
    return [Nearest(effect=name, cosine=number(cosine)) for name, cosine in ranked]


def _regions(surface: Surface, coefficients: Array, deviations: Array) -> list[Region]:
    """Where the surface differs from 0 along each coordinate; coefficients are in units of their prior spread."""
    if not surface.centres:
        return []
    centres = np.array(surface.centres)
    size = np.abs(coefficients)
    clear = (size > CLEAR * deviations) & (size > LARGE * size.max())
    seen = deviations < SEEN
    return [
        Region(
            coordinate=name,
            low=_edge(axis[clear], np.min),
            high=_edge(axis[clear], np.max),
            visited_low=_edge(axis[seen], np.min),
            visited_high=_edge(axis[seen], np.max),
        )
        for name, axis in zip(surface.coordinates, centres.T, strict=True)
    ]


def _edge(values: Array, which: Callable[[Array], float]) -> float | None:
    return float(which(values)) if values.size else None


def _sentence(surface: Surface, regions: Sequence[Region], nearest: Sequence[Nearest], kept: bool) -> str:
    acts = [f"{r.coordinate} from {r.low:.3g} to {r.high:.3g}" for r in regions if r.low is not None]
    seen = [
        f"{r.coordinate} from {r.visited_low:.3g} to {r.visited_high:.3g}"
        for r in regions
        if r.visited_low is not None
    ]
    parts = [surface.title[:1].upper() + surface.title[1:] + (f", on {' and '.join(acts)}" if acts else "")]
    if nearest:
        parts.append(
            "nearest named: " + ", ".join(f"{n.effect} (cosine {n.cosine or 0.0:.2f})" for n in nearest)
        )
    parts.append("valid only inside " + (" and ".join(seen) if seen else "what the runs visited"))
    if not kept:
        parts.append("not kept: it does not predict the select runs better")
    return "; ".join(parts) + "."


def _map(surface: Surface, values: Array, deviations: Array) -> Figure | None:
    """The fitted surface over its two coordinates, where the data speak of it."""
    if not surface.centres or len(surface.coordinates) != 2:
        return None
    first = surface.coefficients[0]
    x, y = np.array(surface.centres).T
    seen = deviations < SEEN
    return Figure(
        kind="map",
        x_label=surface.coordinates[0],
        y_label=surface.coordinates[1],
        z_label=f"in {first.display or first.unit}",
        series=[
            Series(
                name=surface.title,
                x=numbers(x[seen]),
                y=numbers(y[seen]),
                z=numbers(values[seen] / first.scale),
            )
        ],
    )
