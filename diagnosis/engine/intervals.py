"""Step 9, the intervals of each number of a cause, from the profile of χ² and the resolution of the samples.

Theory of operation
-------------------
A covariance is the curvature of χ² at its minimum. It ignores three things:

* **χ² is not a parabola.** So each number of a cause is fixed at both ends of its 95 % interval, and all others are
  fitted again. The penalised χ² must rise by 1.96². If the rise differs by more than a fifth, the end moves until it
  agrees (`profiled`). This is the interval of the profile likelihood, which need not be symmetric. If errors of the
  model (`model_error.py`) widen the interval by a factor, the required rise is larger by the square of this factor.
* **Ranges are limited.** No interval exceeds the possible range. For example, no friction is negative.
* **Sampling is finite.** The travel over which a friction reverses is visible only if it contains several samples.
  `Parameter.along` names the input along which a parameter is a length or a time. The resolution is the step of this
  input between samples (`resolution`): in each run the mean step weighted by travel, Σ|Δ|²/Σ|Δ|, and over the runs the
  mean weighted by the square of the parameter's column. A fit can give a shorter length and an interval, but they
  depend on assumptions between samples (smoothing, interpolation). So only an upper bound is reported.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from diagnosis.contracts import Array, DiagnosisError, Experiment, Hypothesis
from diagnosis.engine.config import BENT, PROFILE_STEPS
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.linear import Prior, prior_of
from diagnosis.engine.fitting.point import Point, effect_coordinates
from diagnosis.estimates import Z95, estimate, unresolved
from diagnosis.finding import Estimate


def intervals(effect: Hypothesis, model: FittedModel, covariance: Array) -> list[Estimate]:
    """Return the estimates of amplitude and shapes of an effect of a fitted model.

    ``covariance`` (k, k) is that of the fitted numbers, including errors of the model.
    """
    found = []
    for coordinate in effect_coordinates(effect):
        place = model.point.place(coordinate)
        plain = model.covariance()[place, place]
        wider = float(np.sqrt(covariance[place, place] / plain)) if plain > 0.0 else 1.0
        ends = [coordinate.to_value(end) for end in profiled(model, place, wider)]
        deviation = float(np.sqrt(max(covariance[place, place], 0.0))) * coordinate.scale
        value = coordinate.to_value(float(model.point.numbers[place]))
        one = estimate(coordinate.parameter, value, deviation, (min(ends), max(ends)))
        finest = resolution(model, place)
        if abs(value) < finest:
            one = unresolved(coordinate.parameter, max(finest, *map(abs, ends)))
        found.append(one)
    return found


def resolution(model: FittedModel, place: int) -> float:
    """Return the length below which the samples do not resolve a number of a fit, in its own unit; 0 for most numbers.

    It is the mean step between samples of the input along which the number is a length, in the runs that determine it.
    """
    along = model.point.coordinates[place].parameter.along
    if not along:
        return 0.0
    one = np.zeros(len(model.point.numbers))
    one[place] = 1.0
    total, weights = 0.0, 0.0
    for run, block in zip(model.replay.runs, model.linearisation.blocks, strict=True):
        steps = np.abs(np.diff(_input(run.experiment, along)))
        if steps.any():
            weight = float(np.sum(block.along(one) ** 2))
            total, weights = total + weight * float(steps @ steps / steps.sum()), weights + weight
    return total / weights if weights > 0.0 else 0.0


def _input(experiment: Experiment, name: str) -> Array:
    """Return an input (n,) of an experiment by name, or its time. Raises DiagnosisError for an unknown name."""
    if name == "time":
        return experiment.time
    if name not in experiment.inputs:
        raise DiagnosisError(
            f"an effect has a parameter with along = {name!r}, but {experiment.name} has no such input; use one of "
            f"time, {', '.join(experiment.inputs)}"
        )
    return experiment.inputs[name]


def below_resolution(model: FittedModel, effect: Hypothesis) -> list[str]:
    """Return the parameters of an effect of a fitted model that the samples do not resolve."""
    places = {c.parameter.name: model.point.place(c) for c in effect_coordinates(effect)}
    values = model.point.values()
    return [name for name, place in places.items() if abs(values[place]) < resolution(model, place)]


def profiled(model: FittedModel, place: int, wider: float = 1.0) -> tuple[float, float]:
    """Return the ends of the 95 % interval of a number of a fit from the profile of χ², in engine units.

    ``wider`` is the factor by which errors of the model widen the interval.
    """
    return _interval_end(model, place, -1.0, wider), _interval_end(model, place, 1.0, wider)


def _interval_end(model: FittedModel, place: int, side: float, wider: float) -> float:
    """Return one end of the interval. It is that of the covariance if χ² there agrees within a fifth; otherwise it is
    searched on χ².
    """
    number = float(model.point.numbers[place])
    low, high = model.point.coordinates[place].range
    reach = max(side * ((low if side < 0.0 else high) - number), 0.0)
    deviation = float(np.sqrt(max(model.covariance()[place, place], 0.0)))
    plain = distance = min(Z95 * wider * deviation, reach)
    inside, outside = (
        (0.0, 0.0),
        None,
    )  # each a distance, and there the root of the rise over that of the interval
    for _ in range(PROFILE_STEPS):
        if not 0.0 < distance < np.inf:
            break
        rise = _rise(model, place, number + side * distance) / (Z95 * wider) ** 2
        if np.isnan(rise):
            return number + side * plain
        if abs(rise - 1.0) < BENT or (rise < 1.0 and distance == reach):
            break
        root = float(np.sqrt(max(rise, 0.0)))
        if root < 1.0:
            inside = (distance, root)
        else:
            outside = (distance, root)
        if outside:
            part = (1.0 - inside[1]) / (outside[1] - inside[1])
            distance = inside[0] + part * (outside[0] - inside[0])
        else:
            distance = min(distance / max(root, 1.0 / 3.0), reach)
    return number + side * distance


def _rise(model: FittedModel, place: int, number: float) -> float:
    """Return the rise of the penalised χ² if a number is fixed at ``number`` and all others are fitted again.

    NaN if this fit does not converge, because its χ² is then not the minimum.
    """
    point, covariance = model.point, model.covariance()
    moved = number - point.numbers[place]
    start = point.at(point.numbers + moved * covariance[:, place] / covariance[place, place])
    numbers, coordinates = start.numbers.copy(), list(point.coordinates)
    numbers[place] = number
    coordinates[place] = replace(coordinates[place], held=True)
    held = Point(tuple(coordinates), numbers)
    prior = prior_of(held)
    mean = prior.mean.copy()
    mean[place] = number
    again = fit(model.replay, model.noise, held, model.linearisation, prior=Prior(mean, prior.precision))
    own = point.coordinates[place].weight * number**2  # of the prior that the held number has no longer
    return again.penalised_chi2 + own - model.penalised_chi2 if again.converged else float("nan")
