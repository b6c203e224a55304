"""Step 9, before: the base model at its best, which the extended model has to beat.

Theory of operation
-------------------
A gain means something over the best that the base model can do. Fitted under the noise of the extended model it is not
at its best: that noise is what is left when the causes are in, its filter passes what the base model could follow and
weighs what it cannot. On a system with hysteresis a base model was told to be three times as wrong as it had to be.

So the base model is fitted twice more: under noise estimated from its own errors, and by plain least squares, each
channel weighed by what the base model leaves of it. Whichever of the three predicts the reported runs best is what the
gain is measured from. It may look at them, since it is to be beaten there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diagnosis.contracts import Array, MeasuredRun
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.linearise import from_quotients
from diagnosis.engine.fitting.predict import Prediction, predict
from diagnosis.engine.footprints import Footprints
from diagnosis.engine.noise import Noise, estimate, quietest, white
from diagnosis.engine.whitening import filters


def best_before(
    base: FittedModel, around: Footprints, runs: Sequence[MeasuredRun], floors: Array
) -> tuple[FittedModel, Prediction]:
    """Return the base model fitted as predicts ``runs`` best, and that prediction.

    ``base`` is its fit under the noise of the extended model, ``around`` holds columns of its parameters, and
    ``floors`` (c,) are what noise alone leaves in each channel.
    """
    fits = [base, *(_refitted(base, around, noise) for noise in _noises(base))]
    arms = [(model, predict(model, runs, fixed=True)) for model in fits]
    return min(arms, key=lambda arm: noise_ratio(arm[1], floors))


def noise_ratio(prediction: Prediction, floors: Array) -> float:
    """Return the RMSE of a prediction over the noise, all channels together; NaN where nothing counts."""
    total, count = 0.0, 0
    for run, predicted in zip(prediction.replay.runs, prediction.outputs, strict=True):
        error = ((run.outputs - predicted) / floors)[run.counted]
        total, count = total + float(error @ error), count + error.size
    return float(np.sqrt(total / count)) if count else float("nan")


def _noises(base: FittedModel) -> tuple[Noise, Noise]:
    """Return the noise of the base model's own errors, coloured as they are and white."""
    channels, runs = base.replay.simulator.channels, base.replay.runs
    residuals = base.replay.residuals(base.predictions)
    masks = [run.counted for run in runs]
    coloured = estimate(channels, residuals, masks, spent=len(base.point.numbers))
    deviations = [
        max(noise.deviation, quietest(channel))
        for noise, channel in zip(coloured.channels, channels, strict=True)
    ]
    return coloured, white(deviations)


def _refitted(base: FittedModel, around: Footprints, noise: Noise) -> FittedModel:
    """Fit the base model under another noise, with columns that are there already."""
    replay = base.replay
    residuals = replay.residuals(around.predictions)
    known = from_quotients(
        replay, around.point, filters(noise, replay.runs), residuals, around.parameter_columns
    )
    return fit(replay, noise, base.point, known)
