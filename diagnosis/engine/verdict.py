"""The verdict: which of six things may be said, and what of the misfit still has no name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from diagnosis.contracts import MeasuredRun
from diagnosis.engine.config import Config
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.linear import inverse
from diagnosis.engine.fitting.point import surface_coordinates
from diagnosis.engine.fitting.predict import predict
from diagnosis.engine.naming import Accepted, Naming
from diagnosis.engine.p_values import bonferroni
from diagnosis.engine.screening import ScreenedModel, Screening
from diagnosis.engine.unknown import Omnibus, explain, score_test
from diagnosis.finding import Unknown, Verdict

REMAINDER: Final = 0.01  #: part of the explained χ² from which on a significant rest belongs to the verdict
SURE: Final = 1e-6  #: a surface that predicts nothing must be less likely than this to come from chance
#: Part of what a cause gains that it must still gain beside such a surface. A stop that was called a cubic spring kept
#: a hundredth, measured friction under its right name three to seven.
NEEDED: Final = 0.02
LIKENESS: Final = (
    0.9  #: part of an effect's footprint that a surface must be able to imitate to make it doubtful
)
GENEROUS: Final = 10.0  #: beside a cause, a surface may be so many times as large as is believed


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """The verdict with the surfaces that were fitted; ``model`` holds those that were kept.

    ``doubtful`` are accepted effects that an unnamed surface, which is needed anyway, makes superfluous.
    """

    verdict: Verdict
    model: FittedModel
    unknowns: tuple[Unknown, ...]
    doubtful: tuple[str, ...]


def _seen(naming: Naming, sight: ScreenedModel, whole: ScreenedModel, config: Config) -> list[Omnibus]:
    """Return the tests of surfaces that see a good part of what the named causes explain, the clearest first.

    How clear they are is what the ``whole`` says, where to start from what the fit runs say.
    """
    surfaces = sight.model.replay.simulator.surfaces
    # The gain is NaN, and counts as none, where there are no select runs.
    explained = sum(a.strength**2 + max(0.0, 2.0 * a.lpd_gain) for a in naming.accepted)
    tests = []
    for surface, columns, more in zip(surfaces, sight.surfaces, whole.surfaces, strict=True):
        seen = score_test(whole.model.linearisation, surface, more)
        p = bonferroni(seen.p, len(surfaces))
        if p < config.alpha_unknown and seen.statistic - seen.freedom > REMAINDER * explained:
            test = score_test(sight.model.linearisation, surface, columns)
            tests.append(replace(test, statistic=seen.statistic, freedom=seen.freedom, p=p))
    return sorted(tests, key=lambda test: (test.p, -test.statistic))


def judge(
    naming: Naming, sight: ScreenedModel, whole: ScreenedModel, select: Sequence[MeasuredRun], config: Config
) -> Judgement:
    """Judge what the search found, and what the simulator's surfaces see beyond it in the last sight.

    ``whole`` sees the select runs as well.
    """
    model = sight.model
    clear = _seen(naming, sight, whole, config)
    unknowns: tuple[Unknown, ...] = ()
    doubtful: tuple[str, ...] = ()
    if clear:
        test = clear[0]
        likenesses = tuple(a for a in naming.accepted if _imitable(model, test, a.effect))
        if likenesses and _superfluous(model, test, likenesses, select, config):
            doubtful = tuple(a.effect for a in likenesses)
        model, unknown = explain(model, test, sight.screen, select)
        if unknown.kept or test.p < SURE:
            unknowns = (unknown,)
    return Judgement(_verdict(naming, sight.screen, unknowns, doubtful, config), model, unknowns, doubtful)


def _verdict(
    naming: Naming,
    screen: Screening,
    unknowns: Sequence[Unknown],
    doubtful: Sequence[str],
    config: Config,
) -> Verdict:
    explained = sum(accepted.strength**2 for accepted in naming.accepted)
    rest = [i for i in screen.exceeding if screen.z[i] ** 2 > REMAINDER * explained]
    kept = any(unknown.kept for unknown in unknowns)
    if len(doubtful) == len(naming.accepted):
        if unknowns:
            return Verdict.UNKNOWN if kept else Verdict.UNRESOLVED
        return Verdict.UNRESOLVED if rest else Verdict.NO_EFFECT
    if naming.confused(config.ambiguous):
        return Verdict.AMBIGUOUS
    return Verdict.REMAINDER if unknowns or rest else Verdict.NAMED


def _imitable(model: FittedModel, test: Omnibus, effect: str) -> bool:
    """Return whether a surface can do what an effect does: beside it, most of what the data say of the amplitude goes.

    A cubic spring and a stop are both forces over a displacement.
    """
    here = model.linearisation
    covariance = here.covariance()
    place = next(i for i, c in enumerate(here.point.coordinates) if c.owner == effect)
    projection = here.project(test.columns)
    shadow = projection.regression[place]
    more = shadow @ inverse(projection.information + np.eye(len(test.start)) / GENEROUS**2) @ shadow
    return bool(covariance[place, place] < (1.0 - LIKENESS) * (covariance[place, place] + more))


def _superfluous(
    model: FittedModel,
    test: Omnibus,
    accepted: Sequence[Accepted],
    select: Sequence[MeasuredRun],
    config: Config,
) -> bool:
    """Return whether a surface says nearly as much without effects as beside them: then they are likenesses only.

    A true cause remembers what no surface does, or is right where no run has been yet.
    """
    coefficients = surface_coordinates(test.surface)
    beside = model.point.extended(coefficients, [c.parameter.nominal for c in coefficients])
    alone = beside
    for one in accepted:
        alone = alone.without(one.effect)
    # Beside much that has no name, a small cause is a part of that sooner than of anything else.
    part = NEEDED * max(1.0, test.statistic / sum(a.strength**2 for a in accepted))
    with_, without = (fit(model.replay, model.noise, p, model.linearisation) for p in (beside, alone))
    if not select:
        return without.bic - with_.bic < max(config.ambiguous, part * sum(a.bic_gain for a in accepted))
    lost = predict(with_, select).lpd - predict(without, select).lpd
    return lost < max(0.5 * config.ambiguous, part * sum(a.lpd_gain for a in accepted))
