"""Step 9, before: the base model at its best, which the extended model has to beat.

Theory of operation
-------------------
A gain means something over the best that the base model can do. Fitted under the noise of the extended model it is not
at its best: that noise is the residual with the causes included. Its filter passes signals that the base model could
follow, and gives weight to those that it cannot. On a system with hysteresis the error of a base model was three times
too large.

So the base model is fitted twice more: under noise estimated from its own errors, and by plain least squares, each
channel weighed by what the base model leaves of it. Whichever of the three predicts the reported runs best is what the
gain is measured from. It may look at them, since it is to be beaten there.
"""

from __future__ import annotations

import numpy as np

from diagnosis.contracts import Array
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.predict import Prediction, predict
from diagnosis.engine.noise import Noise, estimate, quietest, white


def best_before(base: FittedModel, after: Prediction, floors: Array) -> tuple[FittedModel, Prediction]:
    """Return the base model fitted as predicts the runs of ``after`` best, and that prediction.

    ``base`` is its fit under the noise of the extended model, ``after`` what that predicts with its numbers fixed, and
    ``floors`` (c,) are what noise alone leaves in each channel.
    """
    fits = [base]
    for noise in _noises(base):
        fits.append(fit(base.replay, noise, fits[-1].point, fits[-1].linearisation))
    runs, known = after.replay.runs, after.linearisation
    arms = [(model, predict(model, runs, known, fixed=True)) for model in fits]
    return min(arms, key=lambda arm: noise_ratio(arm[1], floors))


def noise_ratio(prediction: Prediction, floors: Array) -> float:
    """Return the RMSE of a prediction over the noise, all channels together; NaN where nothing counts."""
    total, count = 0.0, 0
    for run, predicted in zip(prediction.replay.runs, prediction.outputs, strict=True):
        error = ((run.outputs - predicted) / floors)[run.counted]
        total, count = total + float(error @ error), count + error.size
    return float(np.sqrt(total / count)) if count else float("nan")


def plain_noise(model: FittedModel) -> Noise:
    """Return white noise as large in each channel as what a model leaves there."""
    return _white(model, _own_noise(model))


def _noises(base: FittedModel) -> tuple[Noise, Noise]:
    """Return the noise of the base model's own errors, coloured as they are and white."""
    coloured = _own_noise(base)
    return coloured, _white(base, coloured)


def _own_noise(model: FittedModel) -> Noise:
    """Return the noise of a model's own errors."""
    channels, runs = model.replay.simulator.channels, model.replay.runs
    residuals = model.replay.residuals(model.predictions)
    return estimate(channels, residuals, [run.counted for run in runs], spent=len(model.point.numbers))


def _white(model: FittedModel, coloured: Noise) -> Noise:
    pairs = zip(coloured.channels, model.replay.simulator.channels, strict=True)
    return white([max(noise.deviation, quietest(channel)) for noise, channel in pairs])
