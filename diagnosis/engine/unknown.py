"""Step 7, what has no name: a test on a surface over two states, and that surface fitted inside the model.

Theory of operation
-------------------
Whatever the catalogue lacks is still a force, a flow or a heat that depends on states: a smooth surface over two of
them, a sum of basis functions, stands for all of it. It is tested like a candidate, by the scores of its coefficients
together (`score_test`). The whole surface sees everything and nothing well. Most of what has no name depends on one
state alone, a stop or a one-way damper, and is clearer among the few functions of that state. So each state is tested
alone as well, and the clearest view counts, its p-value multiplied by the number of views.

What is seen is fitted inside the model, its prior spread as the ridge. The named causes keep their numbers: the
surface is what they leave, and must not eat them. It is kept where, as fitted, it predicts the select runs better. It
is told as a surface, with the range that the runs visited and with what it resembles, and never as a cause
(`explain`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.contracts import Array, MeasuredRun, Surface
from diagnosis.engine.config import (
    CLEAR_COEFFICIENT,
    FIXED_WEIGHT,
    LARGE_COEFFICIENT,
    REMAINDER,
    VISITED,
    Config,
)
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.linear import Linearisation, Prior, prior_of, solve
from diagnosis.engine.fitting.point import Point, surface_coordinates
from diagnosis.engine.fitting.predict import predict
from diagnosis.engine.fitting.replay import Quotients
from diagnosis.engine.noise_estimate import overdispersion
from diagnosis.engine.p_values import bonferroni, p_of_chi2
from diagnosis.engine.screening import ScreenedModel, Screening
from diagnosis.engine.search_state import Accepted
from diagnosis.finding import Figure, Nearest, Region, Series, Unknown, number, numbers


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


def score_test(linearisation: Linearisation, surface: Surface, columns: Sequence[Quotients]) -> Omnibus:
    """χ² = sᵀ G⁺ s of the projected scores s, in the directions that the data would show.

    G is the Gram matrix per prior spread: where one of its eigenvalues is below 1, a surface as large as is believed
    stays under the noise, and looking there would only add chance. χ² counts as much less as scores scatter more than
    the noise allows (Rao and Scott). Of all views, the one with the smallest p-value counts.
    """
    projection = linearisation.project(columns)
    seen = []
    for view in _views(surface):
        values, vectors = np.linalg.eigh(view @ projection.information @ view.T)
        shown = values > 1.0
        along = vectors[:, shown].T @ view @ projection.score
        scatter = overdispersion(linearisation, [np.tensordot(view, c, 1).astype(c.dtype) for c in columns])
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


def clear_surfaces(
    accepted: Sequence[Accepted], screened: ScreenedModel, together: ScreenedModel, config: Config
) -> list[Omnibus]:
    """Return the tests of surfaces that see a good part of what the accepted effects explain, the clearest first.

    How clear they are is what the model says that saw fit runs and select runs ``together``; what their fit starts from
    is what the fit runs say.
    """
    surfaces = screened.model.replay.simulator.surfaces
    # The gain in log predictive density is NaN, and counts as none, where there are no select runs.
    explained = sum(one.lambda_**2 + max(0.0, 2.0 * one.lpd_gain) for one in accepted)
    tests = []
    for surface, columns, all_columns in zip(
        surfaces, screened.surface_columns, together.surface_columns, strict=True
    ):
        seen = score_test(together.model.linearisation, surface, all_columns)
        p = bonferroni(seen.p, len(surfaces))
        if p < config.alpha_unknown and seen.statistic - seen.freedom > REMAINDER * explained:
            test = score_test(screened.model.linearisation, surface, columns)
            tests.append(replace(test, statistic=seen.statistic, freedom=seen.freedom, p=p))
    return sorted(tests, key=lambda test: (test.p, -test.statistic))


def _views(surface: Surface) -> list[Array]:
    """Orthonormal directions (k, m) of all m coefficients, then of what depends on one coordinate alone."""
    views = [np.eye(len(surface.coefficients))]
    for axis in np.array(surface.centres).T:
        alone = (axis == np.unique(axis)[:, np.newaxis]).astype(np.float64)
        views.append(alone / np.linalg.norm(alone, axis=1, keepdims=True))
    return views


def explain(
    model: FittedModel, test: Omnibus, screening: Screening, select: Sequence[MeasuredRun]
) -> tuple[FittedModel, Unknown]:
    """Fit a surface inside a model and say where it acts and what it resembles; never what it is.

    The model that is returned holds the surface where that predicts the select runs better; else it is ``model``.
    """
    coordinates = surface_coordinates(test.surface)
    start = model.point.extended(
        coordinates, [c.to_value(u) for c, u in zip(coordinates, test.start, strict=True)]
    )
    fitted = fit(model.replay, model.noise, start, model.linearisation, prior=_effects_fixed(model, start))
    gain = _gain(model, fitted, select)
    kept = gain > 0.0
    places = [fitted.point.place(c) for c in coordinates]
    deviations = np.sqrt(np.maximum(np.diagonal(fitted.covariance())[places], 0.0))
    regions = _regions(test.surface, fitted.point.numbers[places], deviations)
    nearest = resemblance(model.linearisation, test, screening)
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
    return predict(fitted, select, fixed=True).lpd - predict(model, select, fixed=True).lpd


def _effects_fixed(model: FittedModel, start: Point) -> Prior:
    """Return the priors of a larger model that leave the effects of a fitted one where they are."""
    prior = prior_of(start)
    for i, coordinate in enumerate(model.point.coordinates):
        if coordinate.owner:
            prior.mean[i] = model.point.numbers[i]
            prior.precision[i, i] = (
                FIXED_WEIGHT * model.linearisation.information[i, i] / model.noise.dispersion
            )
    return prior


def resemblance(
    linearisation: Linearisation, test: Omnibus, screening: Screening, most: int = 3
) -> list[Nearest]:
    """The named effects whose footprint is most like that of the surface, by the cosine after projection."""
    together = [
        np.concatenate((named, np.tensordot(test.start, unnamed, 1)[np.newaxis]))
        for named, unnamed in zip(screening.columns, test.columns, strict=True)
    ]
    projection = linearisation.project(together)
    cosines = np.abs(projection.cosines[-1, :-1])
    best: dict[str, float] = {}
    for candidate, cosine in zip(screening.candidates, cosines, strict=True):
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
        size = np.array([np.sqrt(np.mean(coefficients[k] ** 2)) for k in at])
        clear = np.array([np.any(np.abs(coefficients[k]) > CLEAR_COEFFICIENT * deviations[k]) for k in at])
        seen = places[[bool(np.any(deviations[k] < VISITED)) for k in at]]
        acts = clear & (size > LARGE_COEFFICIENT * size.max())
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
    seen = deviations < VISITED
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
