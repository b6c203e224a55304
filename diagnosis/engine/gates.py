"""Step 6, the gates that a candidate must pass: better BIC, physical, larger than roughness, useful for prediction.

Theory of operation
-------------------
With enough data each further parameter improves the fit a little, and statistics alone reject every real model. So a
candidate with a good score must pass four gates. Each returns the reason why a model fails, as a clause for the report,
or "" if it passes.

* `unfit`: the BIC must be better: the penalised χ² must fall by at least ln N for each further parameter;
* `unphysical`: all parameters of effects stay inside their ranges, and no base parameter moves further from its prior
  than allowed. A transducer with a zero error of 0.2 bar is no explanation;
* `merely_rough`: no equation is exact, so a large cause leaves a small residual above the noise. A further cause must
  explain more than this residual;
* `useless`: the log density of the validation runs must not fall, and a part of the explainable misfit must disappear
  in the channel where the effect acts.

The last gate needs the error by noise alone, which no cause can explain: `noise_floors`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import numpy as np

from diagnosis.contracts import Array, Channel, MeasuredRun
from diagnosis.engine.config import (
    FLOOR_SLACK,
    FURTHER_STRAIN,
    LEAST_AT_REST,
    STRAINED_PRIOR,
    TWO_SIGMA_CHI2,
    Config,
)
from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.fitting.point import Coordinate
from diagnosis.engine.fitting.predict import Prediction
from diagnosis.engine.noise import ChannelNoise, Noise
from diagnosis.engine.p_values import independent_samples
from diagnosis.engine.whitening import filters
from diagnosis.estimates import percent

_STOPPED: Final = "another candidate fits far better"


def unfit(model: FittedModel, base: FittedModel) -> str:
    """Return why a fit with one more effect is not an explanation, as a clause; "" if it may be one."""
    if not model.bic < base.bic:
        return "it does not improve the fit enough" if model.converged else _STOPPED
    return unphysical(model, base)


def useless(
    model: FittedModel,
    after: Prediction | None,
    base: FittedModel,
    before: Prediction | None,
    floors: Array,
    config: Config,
) -> str:
    """Return why a model with one more effect does not predict better, as a clause; "" if it does.

    ``after`` and ``before`` are predictions of the validation runs; None without validation runs.
    """
    if after is not None and before is not None and before.lpd - after.lpd >= config.lpd_loss:
        return "it predicts the validation runs worse"
    return explains_too_little(model, after, base, before, floors, config)


def unphysical(model: FittedModel, base: FittedModel) -> str:
    """Return a clause on an unphysical result of a fit that the fit of ``base`` does not have; "" if there is none.

    A number of any effect is unphysical if the data push it out of its range, because a new effect must not make
    another one impossible. A base parameter is unphysical if it moves further from its prior than allowed.
    """
    strained = {c: abs(u) for c, u in zip(base.point.coordinates, base.point.numbers, strict=True)}
    for coordinate, number in zip(model.point.coordinates, model.point.numbers, strict=True):
        if coordinate.weight and abs(number) > max(
            STRAINED_PRIOR, strained.get(coordinate, 0.0) + FURTHER_STRAIN
        ):
            name = coordinate.in_words(model.replay.simulator.catalogue)
            value = _value_as_text(coordinate, number)
            return f"it needs {name} = {value}, {abs(number):.1f} standard deviations from the expected value"
    before = out_of_range(base)
    return next((why for which, why in out_of_range(model).items() if which not in before), "")


def out_of_range(model: FittedModel) -> dict[Coordinate, str]:
    """Return the numbers of effects that the data push out of their ranges, each with a clause for the report."""
    fitted = model.linearisation
    found = {}
    for i, (coordinate, number) in enumerate(
        zip(fitted.point.coordinates, fitted.point.numbers, strict=True)
    ):
        low, high = coordinate.range
        push = fitted.gradient[i]
        outwards = (number <= low and push < 0.0) or (number >= high and push > 0.0)
        if (
            coordinate.owner
            and outwards
            and push**2 > TWO_SIGMA_CHI2 * model.noise.dispersion * fitted.information[i, i]
        ):
            name = coordinate.in_words(model.replay.simulator.catalogue)
            found[coordinate] = (
                f"the {name} reaches the limit of its permitted range ({_value_as_text(coordinate, number)})"
            )
    return found


def _value_as_text(coordinate: Coordinate, number: float) -> str:
    """Return a fitted number as text in its display unit."""
    parameter = coordinate.parameter
    unit = parameter.display or parameter.unit
    return f"{coordinate.to_value(number) / parameter.scale:.4g}{'' if unit == '1' else f' {unit}'}"


def merely_rough(gained: float, explained: float, threshold: float, config: Config) -> str:
    """Return why a further cause may be only an error in the equations of the accepted causes; "" if it is larger.

    ``gained`` is the penalised χ² that the further cause explains, ``explained`` that of the accepted causes.
    ``threshold`` is the threshold of the scores: the gain beyond the roughness must be significant.
    """
    gained = max(gained, 0.0)
    if not explained or gained >= config.rough**2 * explained + threshold**2:
        return ""
    part = math.sqrt(gained / explained)
    share = percent(part)
    return f"its effect is only {share} of that of the accepted causes; errors of their equations can be as large"


def explains_too_little(
    model: FittedModel,
    after: Prediction | None,
    base: FittedModel,
    before: Prediction | None,
    floors: Array,
    config: Config,
) -> str:
    """Return why a cause explains too little of the misfit where it acts; "" if it explains enough.

    The explainable misfit is RMSE² − `FLOOR_SLACK`·floor². In the channel with the strongest footprint its root must
    fall by the part ``config.gain``. If it is not positive, no error is clearly visible, and only the statistics
    decide.
    """
    if after is None or before is None:
        replay, old, new = base.replay, base.predictions, model.predictions
    else:
        replay, old, new = before.replay, before.outputs, after.outputs
    footprint = [f.spread(b - a) for f, a, b in zip(filters(base.noise, replay.runs), old, new, strict=True)]
    channel = int(np.argmax(sum(np.sum(p**2, axis=0) for p in footprint)))
    square0, square1 = (_mean_square(replay.runs, outputs, channel) for outputs in (old, new))
    explainable = square0 - FLOOR_SLACK * floors[channel] ** 2
    if explainable <= 0.0:
        return ""
    gained = 1.0 - np.sqrt(max(explainable - (square0 - square1), 0.0) / explainable)
    if gained >= config.gain:
        return ""
    name = replay.simulator.channels[channel].name
    if gained <= 0.0:
        return f"it acts most on {name}, but does not reduce the error of this signal"
    return f"it acts most on {name}, but reduces the error of this signal by only {percent(gained)}"


def noise_floors(channels: Sequence[Channel], runs: Sequence[MeasuredRun], noise: Noise) -> Array:
    """Return the standard deviation (c,) of the noise alone in each channel.

    It is taken from stretches at rest. Without these it is taken from the data sheet, or else from the innovation of
    ``noise``. A line is subtracted from each stretch, which also removes a part of coloured noise; ``noise`` gives the
    correction.
    """
    floors = []
    for i, (channel, seen) in enumerate(zip(channels, noise.channels, strict=True)):
        quiet = _at_rest(runs, i)
        if quiet:
            left = sum(float(np.sum(_straightened(values) ** 2)) for values in quiet)
            floors.append(math.sqrt(left / sum(_left_by_a_line(seen, _places(values)) for values in quiet)))
        elif channel.noise > 0.0:
            floors.append(float(np.hypot(channel.noise, channel.resolution / np.sqrt(12.0))))
        else:
            floors.append(seen.innovation)
    return np.array(floors)


def samples_at_rest(runs: Sequence[MeasuredRun], noise: Noise) -> Array:
    """Return the number (c,) of independent samples at rest from which `noise_floors` estimates each floor.

    It is infinite for a channel without rests. Correlated samples count as fewer.
    """
    counts = []
    for i, seen in enumerate(noise.channels):
        quiet = _at_rest(runs, i)
        count = sum(int(np.isfinite(values).sum()) - 2 for values in quiet)
        correlations = seen.correlations(max(map(len, quiet), default=1) - 1)[1:]
        counts.append(independent_samples(count, correlations) if quiet else math.inf)
    return np.array(counts)


def _at_rest(runs: Sequence[MeasuredRun], channel: int) -> list[Array]:
    """Return the values of one channel in each rest with enough samples; NaN for lost ones."""
    return [values for run in runs for values in rests(run, channel, LEAST_AT_REST)]


def not_above(floors: Array, model: FittedModel, unseen: Prediction | None = None) -> Array:
    """Return noise floors (c,), limited to the residual of a model on its fit runs.

    They are also limited to the residual on ``unseen`` runs if that is clearly smaller. Noise cannot be larger than the
    whole error. But a data sheet gives an upper bound, and a rig that was assumed at rest may have moved.
    """
    channels = range(len(floors))
    left = np.sqrt([_mean_square(model.replay.runs, model.predictions, i) for i in channels])
    floors = np.where(left > 0.0, np.minimum(floors, left), floors)
    if unseen is not None:
        there = np.sqrt([_mean_square(unseen.replay.runs, unseen.outputs, i) for i in channels])
        floors = np.where((there > 0.0) & (FLOOR_SLACK * there < floors), there, floors)
    return floors


def rests(run: MeasuredRun, channel: int, least: int) -> list[Array]:
    """Return the values of one channel in each stretch at rest, NaN for lost samples. The position may differ between
    the stretches. A stretch must have at least ``least`` samples, and at least as many samples as lost ones.
    """
    borders = np.flatnonzero(np.diff(run.rest, prepend=False, append=False)).reshape(-1, 2)
    values = np.where(run.counted[:, channel], run.outputs[:, channel], np.nan)
    found = [values[start:stop] for start, stop in borders.tolist()]
    return [one for one in found if np.isfinite(one).sum() >= max(least, 0.5 * len(one))]


def _straightened(values: Array) -> Array:
    """Return the samples of a rest minus a fitted line, because gas still warms up and rubber still creeps."""
    left = values[np.isfinite(values)]
    for direction in _line(_places(values)):
        left = left - direction @ left * direction
    return left


def _places(values: Array) -> tuple[int, ...]:
    """Return the places of the samples that were not lost."""
    return tuple(np.flatnonzero(np.isfinite(values)).tolist())


def _line(places: tuple[int, ...]) -> tuple[Array, Array]:
    """Return a constant and a slope (m,) at these places, orthonormal."""
    slope = np.array(places) - np.mean(places)
    return np.full(len(places), len(places) ** -0.5), slope / np.sqrt(slope @ slope)


@lru_cache(maxsize=256)
def _left_by_a_line(noise: ChannelNoise, places: tuple[int, ...]) -> float:
    """Return the mean sum of squares of noise with power 1 at these places, after a fitted line is subtracted."""
    length = places[-1] + 1
    correlations = noise.correlations(length - 1)
    taken = 0.0
    for part in _line(places):
        direction = np.zeros(length)
        direction[list(places)] = part
        overlap = [float(direction[: length - k] @ direction[k:]) for k in range(len(correlations))]
        taken += float(2.0 * correlations @ overlap) - overlap[0]
    return len(places) - taken


def _mean_square(runs: Sequence[MeasuredRun], outputs: Sequence[Array], channel: int) -> float:
    errors = [
        (run.outputs[:, channel] - predicted[:, channel])[run.counted[:, channel]]
        for run, predicted in zip(runs, outputs, strict=True)
    ]
    together = np.concatenate(errors)
    return float(np.mean(together**2)) if together.size else 0.0
