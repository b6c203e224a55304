"""The verdict: which of six things may be said, and what of the misfit still has no name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from diagnosis.contracts import MeasuredRun
from diagnosis.engine.config import Config
from diagnosis.engine.errors import at_most_one
from diagnosis.engine.fit import FittedModel
from diagnosis.engine.linear import inverse
from diagnosis.engine.naming import Naming
from diagnosis.engine.screen import Screen, Sight
from diagnosis.engine.unknown import Omnibus, explain, score_test
from diagnosis.finding import Unknown, Verdict

REMAINDER: Final = 0.01  #: part of the explained χ² from which on a significant rest belongs to the verdict
EXCHANGEABLE: Final = (
    3.0  #: so many standard deviations of its amplitude a cause keeps beside a surface, if it is one
)

GENEROUS: Final = 10.0  #: beside a cause, a surface may be so many times as large as is believed
STEADY: Final = 2.0  #: the amplitude of a true cause changes by no more than this factor beside a surface


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """The verdict with the surfaces that were fitted; ``model`` holds those that were kept.

    ``doubtful`` are accepted effects that an unnamed surface, which is needed anyway, makes superfluous.
    """

    verdict: Verdict
    model: FittedModel
    unknowns: tuple[Unknown, ...]
    doubtful: tuple[str, ...]


def judge(naming: Naming, sight: Sight, select: Sequence[MeasuredRun], config: Config) -> Judgement:
    """Judge what the search found, and what the simulator's surfaces see beyond it in the last sight."""
    model, surfaces = sight.model, sight.model.replay.simulator.surfaces
    tests = [
        score_test(model.linearisation, surface, columns)
        for surface, columns in zip(surfaces, sight.surfaces, strict=True)
    ]
    tests = [replace(test, p=at_most_one(test.p, len(tests))) for test in tests]
    explained = sum(accepted.strength**2 for accepted in naming.accepted)
    clear = [
        test
        for test in sorted(tests, key=lambda test: (test.p, -test.statistic))
        if test.p < config.alpha_unknown and test.statistic - test.freedom > REMAINDER * explained
    ]
    unknowns: tuple[Unknown, ...] = ()
    doubtful: tuple[str, ...] = ()
    if clear:
        test = clear[0]
        doubtful = tuple(a.effect for a in naming.accepted if _exchangeable(model, test, a.effect))
        model, unknown = explain(model, test, sight.screen, select)
        unknowns = (unknown,)
    return Judgement(
        _verdict(naming, sight.screen, unknowns, doubtful, explained, config), model, unknowns, doubtful
    )


def _verdict(
    naming: Naming,
    screen: Screen,
    unknowns: Sequence[Unknown],
    doubtful: Sequence[str],
    explained: float,
    config: Config,
) -> Verdict:
    rest = [i for i in screen.exceeding if screen.z[i] ** 2 > REMAINDER * explained]
    kept = any(unknown.kept for unknown in unknowns)
    if len(doubtful) == len(naming.accepted):
        if unknowns:
            return Verdict.UNKNOWN if kept else Verdict.UNRESOLVED
        return Verdict.UNRESOLVED if rest else Verdict.NO_EFFECT
    if naming.confused(config.ambiguous):
        return Verdict.AMBIGUOUS
    return Verdict.REMAINDER if unknowns or rest else Verdict.NAMED


def _exchangeable(model: FittedModel, test: Omnibus, effect: str) -> bool:
    """Return whether an effect is superfluous, or another one, beside a surface: then it names nothing of its own."""
    here = model.linearisation
    place = next(i for i, c in enumerate(here.point.coordinates) if c.owner == effect)
    projection = here.project(test.columns)
    ridge = inverse(projection.gram + np.eye(len(test.start)) / GENEROUS**2)
    alone = here.point.numbers[place]
    beside = alone - projection.shadow[place] @ ridge @ projection.score
    variance = here.covariance()[place, place] + projection.shadow[place] @ ridge @ projection.shadow[place]
    return bool(abs(beside) < EXCHANGEABLE * np.sqrt(variance) or not 1.0 / STEADY < beside / alone < STEADY)
