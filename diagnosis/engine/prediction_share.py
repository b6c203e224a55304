"""The part of the error of the validation runs that a cause, as fitted to other runs, removes.

Theory of operation
-------------------
The equations of a model are slightly wrong, and this may be the only evidence for a cause (`constancy.py`). Such a
cause helps little on runs that it was not fitted to. So the remaining error there limits the error of a cause: an
amplitude with the relative error δ leaves the part δ of the error that the cause explains. The root of the remaining
part is thus the largest δ. Its accuracy is that of the noise floor, and it is undefined if there is only noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from diagnosis.contracts import Array, MeasuredRun
from diagnosis.engine.config import PREDICTED_SHARE
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.predict import predict
from diagnosis.engine.remainder import part_left

#: Returns the part of the error that an effect of a model leaves of the validation runs, at most; infinite if not
#: known.
ResidualBound = Callable[[FittedModel, str], float]


def is_predicted(model: FittedModel, effect: str, select: Sequence[MeasuredRun], floors: Array) -> bool:
    """Return whether an effect, as fitted, removes most of the error of all channels on the validation runs."""
    return bool(select) and _share_without(model, effect, select, floors) < PREDICTED_SHARE


def residual_bound(select: Sequence[MeasuredRun], floors: Array) -> ResidualBound:
    """Return a function: for a model and an effect it returns the largest relative error of the amplitude that the
    validation runs allow.
    """

    def left(model: FittedModel, effect: str) -> float:
        part = _share_without(model, effect, select, floors, unsure=True) if select else math.nan
        return math.inf if math.isnan(part) else part

    return left


def _share_without(
    model: FittedModel, effect: str, select: Sequence[MeasuredRun], floors: Array, *, unsure: bool = False
) -> float:
    alone = fit(model.replay, model.noise, model.point.without(effect), model.linearisation)
    without, beside = (predict(one, select, fixed=True) for one in (alone, model))
    return part_left(without, beside, floors, unsure=unsure)
