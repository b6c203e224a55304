"""Step 8, undecided rivals: on the fit runs they fit clearly worse than a cause, but they predict unseen runs equally
well.

Theory of operation
-------------------
BIC compares causes in units of the noise. If the error of a model is many times the noise, even a small part of this
error is a BIC gap of thousands, and the effect that absorbs most of it wins. Then unseen runs decide: a physical rival
that predicts them as well as the cause stays a rival. This is tested for all channels together, and for the channels in
which the cause acts, because errors of other channels can hide the difference. For example, a large error of the forces
can hide that only the pressures distinguish a slow clock from a delay.

A similar effect in the same model can also be a rival. For example, friction that reverses between two samples and a
lag of the force both round the corner of a loop. Together with a lag, the presliding travel of the friction is below
the resolution of the samples; without the lag, the presliding travel explains the rounding. So for two similar effects
(confusers) in the model, the model without one of them is a rival if the omitted effect gains nothing on unseen runs,
and if either of the two has a parameter below the resolution (`intervals.py`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from diagnosis.contracts import Array, Hypothesis
from diagnosis.engine.best_base import noise_ratio
from diagnosis.engine.config import NO_GAIN, PREDICTS_AS_WELL
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.predict import Prediction, predict
from diagnosis.engine.intervals import below_resolution
from diagnosis.engine.remainder import Remainder, mean_squares
from diagnosis.engine.search_state import Accepted, SearchResult


class Undecided(NamedTuple):
    """An effect that explains unseen runs as well as the cause ``instead_of``, and the model with it. ``both_present``:
    the model with the cause also contains the effect.
    """

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
    """Return the rivals that predict the unseen runs of ``after`` as well as the accepted effects.

    ``model`` contains the accepted effects, ``left`` is its error on these runs, ``floors`` (c,) is the noise of each
    channel. There are no rivals if the error is as small as the noise, or if all runs were fitted.
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
    """Return the prediction of a model, as fitted, for the runs of another prediction."""
    return predict(model, after.replay.runs, after.linearisation, fixed=True)


def _as_well_where_it_acts(rival: Prediction, after: Prediction, absent: Prediction) -> bool:
    """Return whether a rival predicts as well as the model ``after`` in the channels in which the cause acts.
    ``absent`` is the prediction without the cause.
    """
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
    """Yield the confusers of an effect that are in the same model. The effect must gain nothing on unseen runs, and
    either it or the confuser must have an unresolved parameter.
    """
    if left.gained(accepted.effect) >= NO_GAIN:
        return
    mine = hypotheses[accepted.effect]
    for other in found.accepted:
        theirs = hypotheses[other.effect]
        alike = theirs.name in mine.confusers or mine.name in theirs.confusers
        if alike and (below_resolution(model, mine) or below_resolution(model, theirs)):
            without = found.without[mine.name]
            yield Undecided(theirs.name, mine.name, without, without.bic - model.bic, both_present=True)
