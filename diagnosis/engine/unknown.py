"""Step 7, unknown terms: fit a surface over two states inside the model if its test is clear.

Theory of operation
-------------------
A term that the catalogue lacks is a force, a flow or a heat that depends on states. A smooth surface over two states, a
sum of basis functions, represents it. It is tested like a candidate, by the scores of its coefficients together
(`omnibus.py`). The test of the whole surface is general, but weak. Most unknown terms, such as a stop or a one-way
damper, depend on one state only, and a test with the few functions of this state is clearer. So each state is also
tested alone. The clearest view counts, its p-value multiplied by the number of views.

A clear surface is fitted inside the model, with its prior spread as the ridge. The named causes keep their numbers: the
surface fits only their residual. It is kept if, as fitted, it improves the prediction of the validation runs. It is
reported as a surface, with the range that the runs covered and with similar terms, and never as a cause (`explain`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import msgspec
import numpy as np

from diagnosis.contracts import Array, MeasuredRun, Surface
from diagnosis.engine.config import (
    CLEAR_COEFFICIENT,
    FIXED_WEIGHT,
    IDENTIFIED,
    LARGE_COEFFICIENT,
    REMAINDER,
    Config,
)
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.linear import Prior, prior_of
from diagnosis.engine.fitting.point import Point, surface_coordinates
from diagnosis.engine.fitting.predict import predict
from diagnosis.engine.omnibus import Omnibus
from diagnosis.engine.p_values import bonferroni
from diagnosis.engine.screening import ScreenedModel, Screening
from diagnosis.engine.search_state import Accepted
from diagnosis.estimates import number, numbers
from diagnosis.finding import Figure, Nearest, Region, Series, Unknown


def clear_surfaces(
    accepted: Sequence[Accepted], screened: ScreenedModel, together: ScreenedModel, config: Config
) -> list[Omnibus]:
    """Return the tests of surfaces that explain a large part compared with the accepted effects, the clearest first.

    ``together`` is the model of fit runs and validation runs; it gives the significance. ``screened``, from the fit
    runs, gives the start of the fit.
    """
    explained = sum(one.explained for one in accepted)
    tests = []
    for test, seen in zip(screened.tests, together.tests, strict=True):
        p = bonferroni(seen.p, len(screened.tests))
        if p < config.alpha_unknown and seen.excess > REMAINDER * explained:
            tests.append(replace(test, statistic=seen.statistic, freedom=seen.freedom, p=p))
    return sorted(tests, key=lambda test: (test.p, -test.statistic))


def explain(
    model: FittedModel, test: Omnibus, screening: Screening, select: Sequence[MeasuredRun]
) -> tuple[FittedModel, Unknown]:
    """Fit a surface inside a model, and describe where it acts and which terms it resembles.

    The returned model contains the surface if this improves the prediction of the validation runs; otherwise it is
    ``model``.
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
    nearest = resemblance(test, screening)
    titles = {one.effect.name: one.effect.title for one in screening.candidates}
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
        sentence=_sentence(test.surface, regions, [titles[one.effect] for one in nearest], kept),
        figure=_map(test.surface, fitted.point.values()[places], deviations),
    )
    return (fitted if kept else model), unknown


#: Why a surface is not a part of the final model.
_NOT_KEPT: Final = (
    "A smooth function ({}) was fitted to the remaining error. It is not used, because it does not predict the {} "
    "runs better."
)


def dropped(unknown: Unknown) -> Unknown:
    """Return the surface, marked as not kept, because it does not improve the prediction of the test runs."""
    return msgspec.structs.replace(unknown, kept=False, sentence=_NOT_KEPT.format(unknown.title, "test"))


def _gain(model: FittedModel, fitted: FittedModel, select: Sequence[MeasuredRun]) -> float:
    """Return the increase of the lpd of the validation runs by a fitted surface; NaN without validation runs."""
    if not select:
        return float("nan")
    return predict(fitted, select, fixed=True).lpd - predict(model, select, fixed=True).lpd


def _effects_fixed(model: FittedModel, start: Point) -> Prior:
    """Return a prior for the larger model ``start`` that fixes the effects at their values in ``model``."""
    prior = prior_of(start)
    for i, coordinate in enumerate(model.point.coordinates):
        if coordinate.owner:
            prior.mean[i] = model.point.numbers[i]
            prior.precision[i, i] = (
                FIXED_WEIGHT * model.linearisation.information[i, i] / model.noise.dispersion
            )
    return prior


def resemblance(test: Omnibus, screening: Screening, most: int = 3) -> list[Nearest]:
    """Return the named effects whose footprints are most similar to that of the surface, by the cosine after
    projection.
    """
    best: dict[str, float] = {}
    for candidate, cosine in zip(screening.candidates, np.abs(test.cosines), strict=True):
        best[candidate.effect.name] = max(best.get(candidate.effect.name, 0.0), float(cosine))
    ranked = sorted(best.items(), key=lambda item: -item[1])[:most]
    return [Nearest(effect=name, cosine=number(cosine)) for name, cosine in ranked]


def _regions(surface: Surface, coefficients: Array, deviations: Array) -> list[Region]:
    """Return for each coordinate the ranges in which the surface differs from 0. Coefficients and deviations are in
    units of the prior spread.
    """
    if not surface.centres:
        return []
    found = []
    for name, axis in zip(surface.coordinates, np.array(surface.centres).T, strict=True):
        places = np.unique(axis)
        at = [axis == place for place in places]
        size = np.array([np.sqrt(np.mean(coefficients[k] ** 2)) for k in at])
        clear = np.array([np.any(np.abs(coefficients[k]) > CLEAR_COEFFICIENT * deviations[k]) for k in at])
        seen = places[[bool(np.any(deviations[k] < IDENTIFIED)) for k in at]]
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


def _sentence(surface: Surface, regions: Sequence[Region], similar: Sequence[str], kept: bool) -> str:
    if not kept:
        return _NOT_KEPT.format(surface.title, "validation")
    acts, seen = [], []
    for name in surface.coordinates:
        mine = [r for r in regions if r.coordinate == name]
        if mine:
            first, unit = mine[0], name.rpartition(" in ")[2] if " in " in name else ""
            what = name.rpartition(" in ")[0] or name
            seen.append(f"{what} {_span(first.visited_low, first.visited_high)} {unit}".rstrip())
            if (mine[0].low, mine[-1].high) != (first.visited_low, first.visited_high) or len(mine) > 1:
                acts.append(f"{what} {' and '.join(_span(r.low, r.high) for r in mine)} {unit}".rstrip())
    parts = [f"A smooth function was fitted to this error: {surface.title}"]
    if acts:
        parts.append(f"The error is largest at {' and '.join(acts)}")
    if similar:
        parts.append(f"Similar known effects are: {'; '.join(similar)}")
    parts.append(f"The function is valid only for {' and '.join(seen) or 'the range of these runs'}")
    return ". ".join(parts) + "."


def _span(low: float | None, high: float | None) -> str:
    return f"{low or 0.0:.3g} to {high or 0.0:.3g}" if low != high else f"{low or 0.0:.3g}"


def _map(surface: Surface, values: Array, deviations: Array) -> Figure | None:
    """Return a map of the fitted surface over its two coordinates, only where the data determine it; None for another
    number of coordinates.
    """
    if not surface.centres or len(surface.coordinates) != 2:
        return None
    first = surface.coefficients[0]
    x, y = np.array(surface.centres).T
    seen = deviations < IDENTIFIED
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
