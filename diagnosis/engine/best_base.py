"""Step 9, before: the best base model, the reference for the gain.

Theory of operation
-------------------
The gain is measured from the best fit of the base model. A fit under the noise of the extended model is not the best
one, because this noise is estimated from the residual of the model that includes the causes. Its filter gives a small
weight to signals that the base model can follow, and a large weight to others. On a system with hysteresis the error of
the base model was three times too large.

So the base model is fitted twice more: under noise estimated from its own residuals, and by plain least squares, each
channel weighted by its own residual. The fit that predicts the test runs best is the reference. This choice may use
the test runs, because it can only make the gain smaller.
"""

from __future__ import annotations

import numpy as np

from diagnosis.contracts import Array
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.predict import Prediction, predict
from diagnosis.engine.noise import Noise, estimate, quietest, white


def best_before(base: FittedModel, after: Prediction, floors: Array) -> tuple[FittedModel, Prediction]:
    """Return the fit of the base model that predicts the runs of ``after`` best, and its prediction.

    ``base`` is the fit under the noise of the extended model. ``after`` is the prediction of the extended model with
    fixed parameters. ``floors`` (c,) is the noise of each channel.
    """
    fits = [base]
    for noise in _noises(base):
        fits.append(fit(base.replay, noise, fits[-1].point, fits[-1].linearisation))
    runs, known = after.replay.runs, after.linearisation
    arms = [(model, predict(model, runs, known, fixed=True)) for model in fits]
    return min(arms, key=lambda arm: noise_ratio(arm[1], floors))


def noise_ratio(prediction: Prediction, floors: Array) -> float:
    """Return the RMSE of a prediction in units of the noise ``floors`` (c,), over all channels; NaN if no sample
    counts.
    """
    total, count = 0.0, 0
    for run, predicted in zip(prediction.replay.runs, prediction.outputs, strict=True):
        error = ((run.outputs - predicted) / floors)[run.counted]
        total, count = total + float(error @ error), count + error.size
    return float(np.sqrt(total / count)) if count else float("nan")


def plain_noise(model: FittedModel) -> Noise:
    """Return white noise with the size of the residual of a model in each channel."""
    return _white(model, _own_noise(model))


def _noises(base: FittedModel) -> tuple[Noise, Noise]:
    """Return two noises estimated from the residual of the base model: coloured, and white."""
    coloured = _own_noise(base)
    return coloured, _white(base, coloured)


def _own_noise(model: FittedModel) -> Noise:
    """Return the noise estimated from a model's own residual."""
    channels, runs = model.replay.simulator.channels, model.replay.runs
    residuals = model.replay.residuals(model.predictions)
    return estimate(channels, residuals, [run.counted for run in runs], spent=len(model.point.numbers))


def _white(model: FittedModel, coloured: Noise) -> Noise:
    pairs = zip(coloured.channels, model.replay.simulator.channels, strict=True)
    return white([max(noise.deviation, quietest(channel)) for noise, channel in pairs])
