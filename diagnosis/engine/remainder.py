"""Step 9, remainder: the error of the extended model over the noise, and the gain by each cause, on unseen runs.

Theory of operation
-------------------
A cause that passes every gate may still be only similar to the true cause, or a part of it. Runs that nothing was
fitted to limit the claim:

* error above `REMAINDER_RATIO` times the noise: there is another cause, and the verdict says so;
* in addition, more than `RELATIVE` of the error left in every channel: the named cause explains so little that it is
  only similar to the true one. Then nothing is named;
* equal prediction without a cause: the cause gains nothing there. It may be true and small; the report says so.

All figures are for the test runs; without them, for the validation runs; otherwise for the fit runs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from diagnosis.contracts import Array, Dataset, MeasuredRun, Role
from diagnosis.engine.best_base import noise_ratio
from diagnosis.engine.config import EXPLAINABLE, FLOOR_SLACK, RELATIVE, REMAINDER_RATIO
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.predict import Prediction, predict


@dataclass(frozen=True, slots=True)
class Remainder:
    """Ratio of error to noise before and after, over all channels, on the runs of a ``role``.

    ``left`` is the part of the explainable error (RMS) that remains in the best channel; NaN without explainable error.
    ``without`` is, for each cause, the ratio of error to noise of the model without it.
    """

    role: Role
    before: float
    after: float
    left: float
    without: Mapping[str, float] = field(default_factory=dict)

    @property
    def large(self) -> bool:
        """Whether the remaining error is clearly above the noise."""
        return self.after > REMAINDER_RATIO

    @property
    def relative(self) -> bool:
        """Whether the named causes explain so little that the true cause must be another one."""
        return self.large and self.left > RELATIVE

    def gained(self, cause: str) -> float:
        """Return the part of the explainable squared error that a cause removes; NaN without explainable error."""
        square = self.without[cause] ** 2
        left = max(self.after, 1.0) ** 2
        return (square - left) / (square - 1.0) if square > EXPLAINABLE**2 else float("nan")


def held_back(data: Dataset) -> tuple[Role, tuple[MeasuredRun, ...]]:
    """Return the role and the runs that the fit used least: test runs, else validation runs, else fit runs."""
    roles: tuple[Role, ...] = ("report", "select", "fit")
    return next((role, data.of(role)) for role in roles if data.of(role))


def remainder(
    role: Role,
    base: FittedModel,
    before: Prediction,
    after: Prediction,
    model: FittedModel,
    causes: Sequence[str],
    floors: Array,
) -> Remainder:
    """Measure the error of ``after`` and of ``before`` on the same runs.

    ``model`` is the extended model, ``base`` the model without effects under the same noise.
    """
    total = noise_ratio(after, floors)
    runs = after.replay.runs
    without = {}
    for name in causes:
        alone = model.effects == (name,)
        fitted = (
            base if alone else fit(model.replay, model.noise, model.point.without(name), model.linearisation)
        )
        forecast = predict(fitted, runs, after.linearisation, fixed=True)
        without[name] = noise_ratio(forecast, floors)
    return Remainder(role, noise_ratio(before, floors), total, least_left(before, after, floors), without)


def least_left(before: Prediction, after: Prediction, floors: Array) -> float:
    """Return the part of the explainable error (RMS) that remains, in the channel where it is smallest; NaN without
    explainable error.
    """
    squares = np.array([mean_squares(before), mean_squares(after)]) / floors**2
    some = squares[0] > EXPLAINABLE**2
    if not some.any():
        return float("nan")
    left = np.maximum(squares[1][some] - 1.0, 0.0) / (squares[0][some] - 1.0)
    return float(np.sqrt(left.min()))


def part_left(before: Prediction, after: Prediction, floors: Array, *, unsure: bool = False) -> float:
    """Return the part of the explainable error (RMS) that remains over all channels; NaN without explainable error.

    All channels are summed, so that one channel with hardly any explainable error does not decide by chance. ``unsure``
    returns the upper limit within the uncertainty of the noise floors.
    """
    explainable, left = np.maximum(
        np.array([mean_squares(before), mean_squares(after)]) / floors**2 - 1.0, 0.0
    ).sum(axis=1)
    left += (FLOOR_SLACK - 1.0) * unsure
    return float(np.sqrt(left / explainable)) if explainable > EXPLAINABLE**2 - 1.0 else float("nan")


def mean_squares(prediction: Prediction) -> Array:
    """Return the mean squared error of each channel (c,), 0 if no sample counts."""
    errors = [
        np.where(run.counted, run.outputs - predicted, np.nan)
        for run, predicted in zip(prediction.replay.runs, prediction.outputs, strict=True)
    ]
    together = np.concatenate(errors)
    count = np.isfinite(together).sum(axis=0)
    total = np.nansum(together**2, axis=0)
    return np.divide(total, count, out=np.zeros_like(total), where=count > 0)
