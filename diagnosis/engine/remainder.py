"""Step 9, remainder: how many times the noise the extended model leaves, and what each cause gains, on unseen runs.

Theory of operation
-------------------
A name that passes every gate may still be a relative of the true cause, the nearest that the catalogue has, or a part
of it. What the runs say that nothing was fitted to decides how much is claimed:

* more than `REMAINDER_RATIO` times the noise left: whatever was named, something else is there, and the verdict
  says so;
* besides, more than `RELATIVE` of the error left in every channel: what explains so little of what it was named for is
  a relative of the cause, and not the cause. Nothing is named then;
* a cause without which the runs are predicted as well gains nothing there. It may be true and small; it says so.

All is measured on the report runs; where there are none, on the select runs; else on the fit runs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from diagnosis.contracts import Array, Dataset, MeasuredRun, Role
from diagnosis.engine.before import noise_ratio
from diagnosis.engine.config import EXPLAINABLE, FLOOR_SLACK, RELATIVE, REMAINDER_RATIO
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.predict import Prediction, predict


@dataclass(frozen=True, slots=True)
class Remainder:
    """Errors over the noise before and after, all channels together, on the runs of a ``role``.

    ``left`` is the least part of the explainable error that remains in any channel, as a root of squares; NaN where
    nothing was to be explained. ``without`` is the error over the noise without each cause, by name.
    """

    role: Role
    before: float
    after: float
    left: float
    without: Mapping[str, float] = field(default_factory=dict)

    @property
    def large(self) -> bool:
        """Whether more is left than noise makes."""
        return self.after > REMAINDER_RATIO

    @property
    def relative(self) -> bool:
        """Whether the named causes explain so little that the cause must be another one."""
        return self.large and self.left > RELATIVE

    def gained(self, cause: str) -> float:
        """Return the part of the explainable squared error that is gone with a cause; NaN where there is none."""
        square = self.without[cause] ** 2
        left = max(self.after, 1.0) ** 2
        return (square - left) / (square - 1.0) if square > EXPLAINABLE**2 else float("nan")


def held_back(data: Dataset) -> tuple[Role, tuple[MeasuredRun, ...]]:
    """Return the runs that the fit has seen least of, and their role."""
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
    """Measure the remaining error of ``after`` relative to ``before`` on the same runs.

    ``model`` is the extended one, ``base`` the one without any effect under the same noise.
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
    """Return the least part of the explainable error that remains in any channel that has one."""
    squares = np.array([mean_squares(before), mean_squares(after)]) / floors**2
    some = squares[0] > EXPLAINABLE**2
    if not some.any():
        return float("nan")
    left = np.maximum(squares[1][some] - 1.0, 0.0) / (squares[0][some] - 1.0)
    return float(np.sqrt(left.min()))


def part_left(before: Prediction, after: Prediction, floors: Array, *, unsure: bool = False) -> float:
    """Return the part of the explainable error of all channels together that remains, as a root; NaN if there is none.

    A channel that hardly has any, and reaches its noise by chance, does not support the others. ``unsure``: at most,
    if what the noise floors are uncertain by were left as well.
    """
    explainable, left = np.maximum(
        np.array([mean_squares(before), mean_squares(after)]) / floors**2 - 1.0, 0.0
    ).sum(axis=1)
    left += (FLOOR_SLACK - 1.0) * unsure
    return float(np.sqrt(left / explainable)) if explainable > EXPLAINABLE**2 - 1.0 else float("nan")


def mean_squares(prediction: Prediction) -> Array:
    """Return the mean squared error of each channel (c,), 0 where nothing counts."""
    errors = [
        np.where(run.counted, run.outputs - predicted, np.nan)
        for run, predicted in zip(prediction.replay.runs, prediction.outputs, strict=True)
    ]
    together = np.concatenate(errors)
    count = np.isfinite(together).sum(axis=0)
    total = np.nansum(together**2, axis=0)
    return np.divide(total, count, out=np.zeros_like(total), where=count > 0)
