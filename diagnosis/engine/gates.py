"""Step 6, the gates that a candidate must pass to be named: better by BIC, physical, more than rough, worth having.

Theory of operation
-------------------
With enough data a further parameter always fits a little more, and every real model is rejected by statistics alone.
Four gates stand between a good score and a name. Each returns why a model does not pass it, as the rest of a sentence
for people, or "" where it does.

* `unfit`: the BIC must be better, that is the penalised χ² must fall by ln N for each further parameter;
* `unphysical`: each parameter of the effect stays inside its range and leaves those of the others inside theirs, and no
  base parameter has to move further than its prior believes. A transducer 0.2 bar off zero is no explanation;
* `merely_rough`: of a cause in plain view, no equation being exact, a small rest is left that noise would not leave.
  A further cause must explain more than such a rest;
* `useless`: the select runs are predicted no worse by their log density, and a part of the explainable misfit goes
  where the effect acts.

The last gate needs to know what noise alone leaves, since no cause can explain that: `noise_floors`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from diagnosis.contracts import Array, Channel, MeasuredRun
from diagnosis.engine.config import (
    FLOOR_SLACK,
    FURTHER_STRAIN,
    LEAST_AT_REST,
    RANGE_CHI2,
    STRAINED_PRIOR,
    Config,
)
from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.fitting.point import Coordinate
from diagnosis.engine.fitting.predict import Prediction
from diagnosis.engine.noise import ChannelNoise, Noise
from diagnosis.engine.whitening import filters
from diagnosis.estimates import percent


def unfit(model: FittedModel, base: FittedModel) -> str:
    """Return why the fit of a model with one more effect is no explanation, as a sentence; "" if it may be one."""
    gap = model.bic - base.bic
    if not gap < 0.0:
        return f"BIC is worse by {gap:.1f}" if model.converged else "another candidate is far better"
    return unphysical(model, base)


def useless(
    model: FittedModel,
    after: Prediction | None,
    base: FittedModel,
    before: Prediction | None,
    floors: Array,
    config: Config,
) -> str:
    """Return why a model with one more effect predicts nothing better, as a sentence; "" if it does.

    ``after`` and ``before`` are predictions of the select runs; None where there are none.
    """
    if after is not None and before is not None and before.lpd - after.lpd >= config.lpd_loss:
        return f"it predicts the select runs worse: their log density falls by {before.lpd - after.lpd:.1f}"
    return explains_too_little(model, after, base, before, floors, config)


def unphysical(model: FittedModel, base: FittedModel) -> str:
    """Return what is not physical in a fit and was in that of ``base``; "" if nothing.

    A number that the data push out of its range, of whichever effect: what enters may not make another impossible. Or a
    belief that is strained further.
    """
    strained = {c: abs(u) for c, u in zip(base.point.coordinates, base.point.numbers, strict=True)}
    for coordinate, number in zip(model.point.coordinates, model.point.numbers, strict=True):
        if coordinate.weight and abs(number) > max(
            STRAINED_PRIOR, strained.get(coordinate, 0.0) + FURTHER_STRAIN
        ):
            value = _shown(coordinate, number)
            return (
                f"{coordinate.label} would have to be {value}, {abs(number):.1f} standard deviations of its prior from "
                "its expected value"
            )
    before = out_of_range(base)
    return next((why for which, why in out_of_range(model).items() if which not in before), "")


def out_of_range(model: FittedModel) -> dict[Coordinate, str]:
    """Return the numbers of effects that the data push out of their ranges, each with a sentence that says so."""
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
            and push**2 > RANGE_CHI2 * model.noise.dispersion * fitted.information[i, i]
        ):
            value = _shown(coordinate, number)
            found[coordinate] = f"{coordinate.label} reaches the limit of its range, {value}"
    return found


def _shown(coordinate: Coordinate, number: float) -> str:
    """Return a number of a fit in the unit that people read."""
    parameter = coordinate.parameter
    unit = parameter.display or parameter.unit
    return f"{coordinate.to_value(number) / parameter.scale:.4g}{'' if unit == '1' else f' {unit}'}"


def merely_rough(gained: float, explained: float, threshold: float, config: Config) -> str:
    """Return why a further cause may be no more than what the causes found so far are wrong by; "" if it is more.

    ``gained`` is the penalised χ² that it explains, ``explained`` what those before it did, ``threshold`` that of the
    scores: what exceeds the roughness must be significant.
    """
    gained = max(gained, 0.0)
    if not explained or gained >= config.rough**2 * explained + threshold**2:
        return ""
    part = math.sqrt(gained / explained)
    return f"it adds {percent(part)} to the explained misfit, which is within the error of the causes found before"


def explains_too_little(
    model: FittedModel,
    after: Prediction | None,
    base: FittedModel,
    before: Prediction | None,
    floors: Array,
    config: Config,
) -> str:
    """Return why a cause is not worth having: it explains too little of the misfit where it acts; "" if it does.

    Explainable is what exceeds the noise floor, RMSE² − floor². In the channel where the footprint is strongest, the
    root of the explainable error must fall by the part ``config.gain``. Where the misfit does not exceed the floor, no
    error is clearly visible and the statistics alone decide.
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
    part = f"only {percent(gained)}" if gained > 0.0 else "nothing"
    return f"it explains {part} of the misfit in {name}, the channel that it affects most"


def noise_floors(channels: Sequence[Channel], runs: Sequence[MeasuredRun], noise: Noise) -> Array:
    """Return what noise alone leaves in each channel (c,), as a standard deviation.

    Stretches at rest say it, else the data sheet, else what cannot be predicted from one sample to the next. A line is
    taken out of each stretch, and with it much of a noise that remembers: of that, ``noise`` knows how much.
    """
    floors = []
    for i, (channel, seen) in enumerate(zip(channels, noise.channels, strict=True)):
        quiet = [_straightened(run.outputs[part, i]) for run in runs for part in rests(run, i)]
        if quiet:
            left = sum(float(values @ values) for values in quiet)
            floors.append(math.sqrt(left / sum(_left_by_a_line(seen, len(values)) for values in quiet)))
        elif channel.noise > 0.0:
            floors.append(float(np.hypot(channel.noise, channel.resolution / np.sqrt(12.0))))
        else:
            floors.append(seen.innovation)
    return np.array(floors)


def not_above(floors: Array, model: FittedModel, unseen: Prediction | None = None) -> Array:
    """Return noise floors (c,), none of them above the residual of a model on the runs that it was fitted to.

    None is clearly above its residual on ``unseen`` runs either. A data sheet is an upper bound, and a rig assumed at
    rest may have moved: noise cannot be larger than all errors.
    """
    channels = range(len(floors))
    left = np.sqrt([_mean_square(model.replay.runs, model.predictions, i) for i in channels])
    floors = np.where(left > 0.0, np.minimum(floors, left), floors)
    if unseen is not None:
        there = np.sqrt([_mean_square(unseen.replay.runs, unseen.outputs, i) for i in channels])
        floors = np.where((there > 0.0) & (FLOOR_SLACK * there < floors), there, floors)
    return floors


def rests(run: MeasuredRun, channel: int) -> list[slice]:
    """Return the stretches at rest of one channel that are long enough; the channel may rest at another place later."""
    still = np.concatenate(([False], run.rest & run.counted[:, channel], [False]))
    borders = np.flatnonzero(still[1:] != still[:-1]).reshape(-1, 2)
    return [slice(start, stop) for start, stop in borders.tolist() if stop - start >= LEAST_AT_REST]


def _straightened(values: Array) -> Array:
    """Return values (n,) less the line through them: gas at rest still warms up, rubber still creeps."""
    time = np.linspace(-1.0, 1.0, len(values))
    slope = time @ values / (time @ time)
    return values - values.mean() - slope * time


@lru_cache(maxsize=256)
def _left_by_a_line(noise: ChannelNoise, count: int) -> float:
    """Return the sum of squares that is left on average of so many samples of noise, of power 1, less a line."""
    time = np.linspace(-1.0, 1.0, count)
    time /= np.sqrt(time @ time)
    correlations = noise.correlations(count - 1)
    taken = 0.0
    for direction in (np.full(count, count**-0.5), time):
        overlap = [float(direction[: count - k] @ direction[k:]) for k in range(len(correlations))]
        taken += float(2.0 * correlations @ overlap) - overlap[0]
    return count - taken


def _mean_square(runs: Sequence[MeasuredRun], outputs: Sequence[Array], channel: int) -> float:
    errors = [
        (run.outputs[:, channel] - predicted[:, channel])[run.counted[:, channel]]
        for run, predicted in zip(runs, outputs, strict=True)
    ]
    together = np.concatenate(errors)
    return float(np.mean(together**2)) if together.size else 0.0
