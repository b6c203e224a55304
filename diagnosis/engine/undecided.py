"""Step 8, undecided rivals: separable from a cause under the noise, but not on unseen runs.

Theory of operation
-------------------
BIC compares causes in units of the noise. Where a model leaves many times that, each of its errors is worth a gap of
thousands, and the largest gap goes to whatever takes up most of them. Then runs count that nothing was fitted to. A
physical rival that predicts them as well as the cause stays a rival. This is tested for all channels together, and for
those alone in which the cause acts: where nearly all of the error is in others, the sum hardly changes with the cause,
and so with any rival. In one case a slow clock and a delay were found together. The pressures could separate them, but
the error was in the forces.

So is a relative that is in the model already. Friction that turns over between two samples and a force that lags are
one corner of a loop, rounded: with a lag together with it, the friction has no presliding that the samples would
resolve, and without it one that does the same. Where one of two confusers has such a number (`intervals.py`), and the
other gains nothing on unseen runs, the model without that other one is its rival.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from diagnosis.contracts import Array, Hypothesis
from diagnosis.engine.before import noise_ratio
from diagnosis.engine.config import NO_GAIN, PREDICTS_AS_WELL
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.predict import Prediction, predict
from diagnosis.engine.intervals import below_resolution
from diagnosis.engine.remainder import Remainder, mean_squares
from diagnosis.engine.search_state import Accepted, SearchResult


class Undecided(NamedTuple):
    """An effect that explains unseen runs as well as a cause, and its model; ``both_present``: both models have it."""

    effect: str
    instead_of: str
    model: FittedModel
    bic_gap: float
    both_present: bool = False


def undecided(
    found: SearchResult,
    model: FittedModel,
    hypotheses: Mapping[str, Hypothesis],
    left: Remainder,
    after: Prediction,
    floors: Array,
) -> list[Undecided]:
    """Return the rivals that predict the runs of ``after``, which were not fitted, as well as the accepted effects.

    ``model`` holds these, ``left`` and ``floors`` (c,) are what it and what noise alone leaves there. There are none
    where the noise is reached, or where no run was kept back.
    """
    if not left.large or left.role == "fit":
        return []
    rivals = []
    for accepted in found.accepted:
        among = [*_swapped(accepted, model), *_confusers_present(accepted, found, model, hypotheses, left)]
        absent = _forecast(found.without[accepted.effect], after) if among else after
        for rival in among:
            forecast = _forecast(rival.model, after)
            as_well = noise_ratio(forecast, floors) < PREDICTS_AS_WELL * left.after
            if as_well and (rival.both_present or _as_well_where_it_acts(forecast, after, absent)):
                rivals.append(rival)
    return rivals


def _forecast(model: FittedModel, after: Prediction) -> Prediction:
    """Return what a model predicts, as fitted, of the runs of another prediction."""
    return predict(model, after.replay.runs, after.linearisation, fixed=True)


def _as_well_where_it_acts(rival: Prediction, after: Prediction, absent: Prediction) -> bool:
    """Return whether a rival predicts those channels as well that the cause makes better, ``absent`` from one."""
    left, other, without = (mean_squares(one) for one in (after, rival, absent))
    acts = without > PREDICTS_AS_WELL**2 * left
    return not acts.any() or bool(np.mean(other[acts] / left[acts]) < PREDICTS_AS_WELL**2)


def _swapped(accepted: Accepted, model: FittedModel) -> Iterator[Undecided]:
    """Yield the rivals of the search, fitted again."""
    for trial in accepted.rivals:
        fitted = fit(model.replay, model.noise, trial.point, model.linearisation)
        yield Undecided(trial.effect, accepted.effect, fitted, fitted.bic - model.bic)


def _confusers_present(
    accepted: Accepted,
    found: SearchResult,
    model: FittedModel,
    hypotheses: Mapping[str, Hypothesis],
    left: Remainder,
) -> Iterator[Undecided]:
    """Yield the confusers of an effect in the same model, if it gains nothing and one is not resolved."""
    if left.gained(accepted.effect) >= NO_GAIN:
        return
    mine = hypotheses[accepted.effect]
    for other in found.accepted:
        theirs = hypotheses[other.effect]
        alike = theirs.name in mine.confusers or mine.name in theirs.confusers
        if alike and (below_resolution(model, mine) or below_resolution(model, theirs)):
            without = found.without[mine.name]
            yield Undecided(theirs.name, mine.name, without, without.bic - model.bic, both_present=True)
