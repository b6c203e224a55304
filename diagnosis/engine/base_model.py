"""Step 2, base parameters first: the simulation that a user trusts, with every parameter of it at its best fit.

Theory of operation
-------------------
No two specimens are alike. Zeros of sensors, volumes, areas and stiffnesses lie within tolerances which the simulator
declares as priors (`contracts.Nuisance`). A base model that is frozen at wrong values leaves errors that look like an
effect. So the base parameters are never frozen: they are fitted here, before anything is judged, and again with every
hypothesis (`trials.py`), by penalised least squares (`fitting/fit.py`).

This first fit knows no noise yet. It takes that of the data sheet, or the raw error where there is none, as white: it
only has to come near enough for the footprints of step 4 to be taken at the right place. What follows from the noise of
step 3 is fitted again under it.
"""

from __future__ import annotations

import numpy as np

from diagnosis.engine.fitting.fit import fit
from diagnosis.engine.fitting.point import Point, base_point
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.noise import quietest, white


def fit_base_model(replay: Replay) -> Point:
    """Return the base model at its best fit under white noise, to be near before anything is judged."""
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
    """Return the base model's part of a point: no effect, no surface."""
    for owner in point.owners:
        point = point.without(owner)
    return point
