"""Step 2, base parameters: fit all parameters of the user's simulation.

Theory of operation
-------------------
No two specimens are alike. Zeros of sensors, volumes, areas and stiffnesses lie within tolerances, which the simulator
declares as priors (`contracts.Nuisance`). A base model with fixed wrong values leaves errors that look like an effect.
So the base parameters are never fixed: they are fitted here, before any effect is tested, and again with every
hypothesis (`trials.py`), by penalised least squares (`fitting/fit.py`).

The noise is still unknown in this first fit. It assumes white noise with the size from the data sheet, or of the raw
error if there is none. This is accurate enough for the footprints of step 4. After step 3 the model is fitted again
with the estimated noise.
"""

from __future__ import annotations

import numpy as np

from diagnosis.engine.fitting.fit import fit
from diagnosis.engine.fitting.point import Point, base_point
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.noise import quietest, white


def fit_base_model(replay: Replay) -> Point:
    """Fit the base model under white noise, as a first approximation, and return the fitted point."""
    point = base_point(replay.simulator.nuisances, replay.records)
    residuals = replay.residuals(replay.predictions(point))
    deviations = []
    for i, channel in enumerate(replay.simulator.channels):
        errors = np.concatenate(
            [r[run.counted[:, i], i] for r, run in zip(residuals, replay.runs, strict=True)]
        )
        deviations.append(channel.noise or max(float(np.std(errors)), quietest(channel), 1e-150))
    return fit(replay, white(deviations), point, target=0.0).point


def without_effects(point: Point) -> Point:
    """Return a point without its effects and surfaces: the base model."""
    for owner in point.owners:
        point = point.without(owner)
    return point
