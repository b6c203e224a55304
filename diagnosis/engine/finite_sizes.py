"""Step 6, finite sizes: simulate temporary causes at finite sizes if the residual is far above the noise.

Theory of operation
-------------------
A score uses the derivative of the outputs by an amplitude, at amplitude 0. It is small for a cause that acts only
temporarily: a stop is reached for a moment of a run, an overflow runs for a minute of an hour. The score is divided by
its scatter (`noise_estimate.py`), which is large if only few stretches contribute. The base model without the cause
moves far beyond the stop, or fills the tank far above its rim, so its derivative there is not that of the true system.
The noise estimate takes the residual of such a cause for correlated noise, in which a slow error has hardly any weight.

So if nothing has entered and the error exceeds `REMAINDER_RATIO` times the noise, all candidates are tested once more
by plain least squares. Each channel is weighted by its residual under the current model, and the model is fitted again
with these weights. Each candidate is simulated at the points of its grid with finite amplitudes, `SIZES` times the
expected one; the whole change of the outputs is the column. With c times this change, and all parameters of the model
adapted, the linear model lowers χ² by 2 c s·r − c² |s|² (s: the change after projection on the parameters, r: the
residual). One amplitude represents those up to half-way to the next, c from 1/√5 to √5. Fits start at the best points;
simulations with numbers that are not finite are dropped.

Then all gates apply, as for any candidate. Two more replace the threshold of the score, which was not passed. χ² must
fall by the square of the threshold, and the remaining part of the error must be less than `RELATIVE` where the cause
acts, on the validation runs if there are any. A candidate that explains less is wrong, or only similar to the cause. An
effect whose earlier fit failed must leave less than `PREDICTED_SHARE`; otherwise it may be a similar effect that fits
only a little better.

This step is skipped if the error is at the noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from diagnosis.contracts import DiagnosisError, Hypothesis
from diagnosis.engine.best_base import noise_ratio, plain_noise
from diagnosis.engine.columns import squares
from diagnosis.engine.config import (
    FINITE_FITS,
    LARGEST_CHANGE,
    PREDICTED_SHARE,
    RELATIVE,
    REMAINDER_RATIO,
    SIZES,
)
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.point import Point
from diagnosis.engine.fitting.predict import Prediction, of_fit
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.fitting.steady import root_mean_squares
from diagnosis.engine.footprints import candidates
from diagnosis.engine.memory import give_back
from diagnosis.engine.remainder import least_left
from diagnosis.engine.search_state import Problem, SearchState, Trial
from diagnosis.engine.suspects import MOST_LEFT
from diagnosis.engine.trials import predicted, tried
from diagnosis.engine.whitening import filters

#: Largest fitted amplitude over the simulated one: half-way to the next one, as a factor.
REACH: Final = math.sqrt(SIZES[1] / SIZES[0])


class _Start(NamedTuple):
    """A start point for the fit of an effect. ``gain`` is the reduction of χ² that the linear model predicts from
    there.
    """

    gain: float
    point: Point


def far_above_noise(state: SearchState) -> bool:
    """Return whether the error of the current model is large enough for a test at finite sizes."""
    return noise_ratio(of_fit(state.current.model), state.floors) > REMAINDER_RATIO


def plainly(problem: Problem, state: SearchState) -> SearchState:
    """Return the state with its model fitted again by plain least squares. Its ``explained_chi2`` is 0, because only
    the χ² explained after this fit counts.
    """
    model = state.current.model
    plain = fit(problem.replay, plain_noise(model), model.point, model.linearisation)
    current = replace(state.current, model=plain, prediction=predicted(problem, plain), explained_chi2=0.0)
    return replace(state, current=current)


def try_finite_sizes(problem: Problem, state: SearchState, known: Sequence[Trial]) -> tuple[Trial, ...]:
    """Fit candidates, started at finite amplitudes, together with a model from `plainly`. Return the trials, best BIC
    first.

    Only the most promising candidates are fitted, at most three.
    Candidates with ``known`` trials have failed a gate before, so their limits are stricter.
    """
    tried_before = {trial.effect for trial in known}
    current, least = state.current, state.current.screening.threshold**2
    before = current.prediction or of_fit(current.model)

    def gate(model: FittedModel, there: Prediction | None) -> str:
        if current.model.penalised_chi2 - model.penalised_chi2 < least:
            return "it explains no more than chance might"
        most = PREDICTED_SHARE if tried_before.intersection(model.effects) else RELATIVE
        return MOST_LEFT if least_left(before, there or of_fit(model), state.floors) > most else ""

    others = [one for name, one in problem.hypotheses.items() if name not in current.effects]
    starts = {one.name: _best(problem, current.model, one) for one in others}
    worth = {name: start for name, start in starts.items() if start and start.gain > least}
    first = sorted(worth, key=lambda name: -worth[name].gain)[:FINITE_FITS]
    return tried(problem, state, {name: worth[name].point for name in first}, gate)


def _best(problem: Problem, model: FittedModel, effect: Hypothesis) -> _Start | None:
    """Return the best start point for one effect in addition to a model; None if its simulations fail."""
    replay, known = problem.replay, len(model.point.numbers)
    steps = [step for one in candidates([effect]) for step in _amplitudes(one.added_to(model.point), known)]
    base = replay.base(model.point, model.predictions, [len(steps)] * len(replay.runs))
    try:
        columns = replay.differences(base, [steps] * len(replay.runs))
    except DiagnosisError:  # A simulator may fail far from where anything was found to be.
        return None
    errors = root_mean_squares(replay.residuals(model.predictions))
    changed = (
        np.sum([squares(run, errors) for run in columns], axis=0)
        * np.square([d for _, d in steps])
        / model.samples
    )
    finite = np.flatnonzero(changed < LARGEST_CHANGE**2).tolist()  # so is NaN left out
    if not finite:
        return None
    whiten = filters(model.noise, replay.runs)
    white = [f.columns([run.chosen(finite)]) for f, run in zip(whiten, columns, strict=True)]
    projection = model.linearisation.project(white, replay.workers)
    distances = np.array([steps[i][1] for i in finite])
    square, score = projection.norm**2, projection.score
    share = np.divide(score, square * distances, out=np.zeros_like(score), where=square > 0.0)
    taken = np.clip(share, 1.0 / REACH, REACH) * distances
    gains = np.where(square > 0.0, taken * (2.0 * score - taken * square), 0.0)
    best = int(np.argmax(gains))
    give_back()
    to = steps[finite[best]][0]
    moved = to.numbers.copy()
    moved[:known] -= taken[best] * projection.regression[:, best]
    moved[known] = taken[best]
    return _Start(float(gains[best]), _finite(replay, to.at(moved), to))


def _amplitudes(flat: Point, place: int) -> Iterator[tuple[Point, float]]:
    """Yield a point for each finite amplitude at ``place``, with the distance of this amplitude from 0."""
    low, high = flat.coordinates[place].range
    sizes = {float(np.clip(sign * size, low, high)) for size in SIZES for sign in (1.0, -1.0)}
    for size in sorted(sizes - {0.0}):
        numbers = flat.numbers.copy()
        numbers[place] = size
        yield replace(flat, numbers=numbers), size


def _finite(replay: Replay, start: Point, simulated: Point) -> Point:
    """Return ``start`` if all outputs are finite there; otherwise ``simulated``, where only the amplitude differs from
    the model.
    """
    outputs = replay.predictions(start)
    fine = (np.isfinite(one[run.counted]).all() for run, one in zip(replay.runs, outputs, strict=True))
    return start if all(fine) else simulated
