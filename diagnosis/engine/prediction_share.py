"""How much of the error a cause, as fitted, takes from the select runs, which it was not fitted to.

Theory of operation
-------------------
The form of a model is a little wrong somewhere, and a cause may owe its evidence to that (`constancy.py`). A cause that
only compensates the form helps little on runs that it was not fitted to. So the remaining error there bounds the error
of a cause: an amplitude that is off by a part δ leaves that part of the error that the cause explains, with the base
parameters making room for it on both sides. The part left, as a root, is thus the largest δ. It is known no better than
the noise floor, and says nothing where that is all there is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from diagnosis.contracts import Array, MeasuredRun
from diagnosis.engine.config import PREDICTED_SHARE
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.predict import predict
from diagnosis.engine.remainder import part_left

#: Returns the part of the error that an effect of a model leaves of the select runs, at most; infinite if not known.
ResidualBound = Callable[[FittedModel, str], float]


def is_predicted(model: FittedModel, effect: str, select: Sequence[MeasuredRun], floors: Array) -> bool:
    """Return whether an effect, as fitted, takes most of the error of all channels from the select runs."""
    return bool(select) and _left(model, effect, select, floors) < PREDICTED_SHARE


def residual_bound(select: Sequence[MeasuredRun], floors: Array) -> ResidualBound:
    """Return what states how large a part of its amplitude an effect of a model may be off, by the select runs."""

    def left(model: FittedModel, effect: str) -> float:
        part = _left(model, effect, select, floors, unsure=True) if select else math.nan
        return math.inf if math.isnan(part) else part

    return left


def _left(
    model: FittedModel, effect: str, select: Sequence[MeasuredRun], floors: Array, *, unsure: bool = False
) -> float:
    alone = fit(model.replay, model.noise, model.point.without(effect), model.linearisation)
    without, beside = (predict(one, select, fixed=True) for one in (alone, model))
    return part_left(without, beside, floors, unsure=unsure)
