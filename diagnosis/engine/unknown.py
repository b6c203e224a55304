"""What no named effect explains: a test on a surface over two states, and that surface fitted inside the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.contracts import Array, MeasuredRun, Surface
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.linear import Linearisation, Prior, prior_of, solve
from diagnosis.engine.fitting.point import Point, surface_coordinates
from diagnosis.engine.fitting.predict import HELD, predict
from diagnosis.engine.fitting.replay import Quotients
from diagnosis.engine.noise_estimate import overdispersion
from diagnosis.engine.p_values import bonferroni, p_of_chi2
from diagnosis.engine.screening import Screening
from diagnosis.finding import Figure, Nearest, Region, Series, Unknown, number, numbers

#: A surface acts where its coefficients are so many standard deviations from 0, and such a part of the largest ones.
CLEAR, LARGE = 2.0, 0.25
#: A coefficient was seen where the data halve the standard deviation that was believed.
SEEN = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Omnibus:
    """The score test of one surface: χ² of its coefficients together, or of the sums along one coordinate.

    ``p`` is the chance of one as large in any of these views. ``start`` (m,) are the coefficients that the score
    estimates, in units of their prior spread.
    """

    surface: Surface
    columns: tuple[Quotients, ...]
    statistic: float
    freedom: int
    p: float
    start: Array


def score_test(here: Linearisation, surface: Surface, columns: Sequence[Quotients]) -> Omnibus:
    """χ² = sᵀ G⁺ s of the projected scores s, in the directions that the data would show.

    G is the Gram matrix per prior spread: where one of its eigenvalues is below 1, a surface as large as is believed
    stays under the noise, and looking there would only add chance. χ² counts as much less as scores scatter more than
    the noise allows (Rao and Scott).

    The whole surface sees everything and nothing well. Most of what is unnamed depends on one state alone, a stop or a
    one-way damper, and is clearer among the few functions of that state. The clearest view counts.
    """
    projection = here.project(columns)
    seen = []
    for view in _views(surface):
        values, vectors = np.linalg.eigh(view @ projection.information @ view.T)
        shown = values > 1.0
        along = vectors[:, shown].T @ view @ projection.score
        scatter = overdispersion(here, [np.tensordot(view, c, 1).astype(c.dtype) for c in columns])
        statistic = float(np.sum(along**2 / values[shown]) / np.mean(scatter))
        freedom = int(shown.sum())
        seen.append((p_of_chi2(statistic, freedom), statistic, freedom))
    p, statistic, freedom = min(seen, key=lambda view: view[0])
    return Omnibus(
        surface=surface,
        columns=tuple(columns),
        statistic=statistic,
        freedom=freedom,
        p=bonferroni(p, len(seen)),
        start=solve(projection.information + np.eye(len(surface.coefficients)), projection.score),
    )


def _views(surface: Surface) -> list[Array]:
    """Orthonormal directions (k, m) of all m coefficients, then of what depends on one coordinate alone."""
    views = [np.eye(len(surface.coefficients))]
    for axis in np.array(surface.centres).T:
        alone = (axis == np.unique(axis)[:, np.newaxis]).astype(np.float64)
        views.append(alone / np.linalg.norm(alone, axis=1, keepdims=True))
    return views


def explain(
    model: FittedModel, test: Omnibus, screen: Screening | None, select: Sequence[MeasuredRun]
) -> tuple[FittedModel, Unknown]:
    """Fit a surface inside a model and say where it acts and what it resembles; never what it is.

    The prior spread of its coefficients is the ridge. The named causes keep their numbers: the surface is what they
    leave, and must not eat them. It is kept where, as fitted, it predicts the select runs better; then the model that
    is returned holds it, otherwise it is ``model``.
    """
    coordinates = surface_coordinates(test.surface)
    start = model.point.extended(
        coordinates, [c.outside(u) for c, u in zip(coordinates, test.start, strict=True)]
    )
    fitted = fit(model.replay, model.noise, start, model.linearisation, prior=_held(model, start))
    gain = _gain(model, fitted, select)
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


def _gain(model: FittedModel, fitted: FittedModel, select: Sequence[MeasuredRun]) -> float:
    """Return by how much better the select runs are predicted, as fitted: no other number makes up for a surface."""
    if not select:
        return float("nan")
    return predict(fitted, select, held=True).lpd - predict(model, select, held=True).lpd


def _held(model: FittedModel, start: Point) -> Prior:
    """Return the priors of a larger model that leave the effects of a fitted one where they are."""
    prior = prior_of(start)
    for i, coordinate in enumerate(model.point.coordinates):
        if coordinate.owner:
            prior.mean[i] = model.point.numbers[i]
            prior.precision[i, i] = HELD * model.linearisation.information[i, i] / model.noise.dispersion
    return prior


def resemblance(here: Linearisation, test: Omnibus, screen: Screening, most: int = 3) -> list[Nearest]:
    """The named effects whose footprint is most like that of the surface, by the cosine after projection."""
    together = [
        np.concatenate((named, np.tensordot(test.start, unnamed, 1)[np.newaxis]))
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
    """Stretches of each coordinate on which the surface differs from 0; coefficients are in units of their spread."""
    if not surface.centres:
        return []
    found = []
    for name, axis in zip(surface.coordinates, np.array(surface.centres).T, strict=True):
        places = np.unique(axis)
        at = [axis == place for place in places]
        size = np.array([np.sqrt(np.mean(coefficients[here] ** 2)) for here in at])
        sure = np.array([np.any(np.abs(coefficients[here]) > CLEAR * deviations[here]) for here in at])
        seen = places[[bool(np.any(deviations[here] < SEEN)) for here in at]]
        acts = sure & (size > LARGE * size.max())
        borders = np.flatnonzero(np.diff(np.concatenate(([0], acts.astype(np.int8), [0]))))
        for start, stop in borders.reshape(-1, 2):
            found.append(
                Region(
                    coordinate=name,
                    low=float(places[start]),
                    high=float(places[stop - 1]),
                    visited_low=float(seen.min()) if seen.size else None,
                    visited_high=float(seen.max()) if seen.size else None,
                )
            )
    return found


def _sentence(surface: Surface, regions: Sequence[Region], nearest: Sequence[Nearest], kept: bool) -> str:
    acts, seen = [], []
    for name in surface.coordinates:
        mine = [r for r in regions if r.coordinate == name]
        if mine:
            first, unit = mine[0], name.rpartition(" in ")[2] if " in " in name else ""
            what = name.rpartition(" in ")[0] or name
            seen.append(f"{what} {_span(first.visited_low, first.visited_high)} {unit}".rstrip())
            if (mine[0].low, mine[-1].high) != (first.visited_low, first.visited_high) or len(mine) > 1:
                acts.append(f"{what} {' and '.join(_span(r.low, r.high) for r in mine)} {unit}".rstrip())
    parts = [surface.title[:1].upper() + surface.title[1:] + (f", at {', '.join(acts)}" if acts else "")]
    if nearest:
        parts.append(
            "nearest named: " + ", ".join(f"{n.effect} (cosine {n.cosine or 0.0:.2f})" for n in nearest)
        )
    parts.append("valid only inside " + (", ".join(seen) if seen else "what the runs visited"))
    if not kept:
        parts.append("not kept: it does not predict the select runs better")
    return "; ".join(parts) + "."


def _span(low: float | None, high: float | None) -> str:
    return f"{low or 0.0:.3g} to {high or 0.0:.3g}" if low != high else f"{low or 0.0:.3g}"


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
