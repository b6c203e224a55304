"""The gates that a candidate must pass to be named: better by BIC and prediction, physical, and worth having."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from diagnosis.contracts import Array, Channel, MeasuredRun
from diagnosis.engine.config import Config
from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.fitting.predict import Prediction
from diagnosis.engine.noise import Noise, filters

PUSH: Final = 4.0  #: χ² that would be gained beyond the end of a range: two standard deviations
STRAIN: Final = 4.0  #: so many prior standard deviations is no belief any more
MORE: Final = 1.0  #: and a cause strains it that asks for so many more than the model without it
SLACK: Final = 1.1  #: a noise floor is known to a tenth
REST: Final = 50  #: so many samples at rest say how large the noise is


def unfit(model: FittedModel, effect: str, base: FittedModel) -> str:
    """Return why the fit of a model with one more effect is no explanation, as a sentence; "" if it may be one."""
    gap = model.bic - base.bic
    if not gap < 0.0:
        return f"BIC is worse by {gap:.1f}" if model.converged else "comes nowhere near another cause"
    return unphysical(model, effect, base)


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
        return f"predicts the select runs worse: log density falls by {before.lpd - after.lpd:.1f}"
    return idle(model, after, base, before, floors, config)


def unphysical(model: FittedModel, effect: str, base: FittedModel) -> str:
    """Return what is not physical in a fit: a number pushed out of its range, a belief strained; "" if nothing."""
    here = model.linearisation
    strained = {c: abs(u) for c, u in zip(base.point.coordinates, base.point.numbers, strict=True)}
    for i, (coordinate, number) in enumerate(zip(here.point.coordinates, here.point.numbers, strict=True)):
        low, high = coordinate.range
        push = here.gradient[i]
        outwards = (number <= low and push < 0.0) or (number >= high and push > 0.0)
        value = f"{coordinate.outside(number) / coordinate.parameter.scale:.4g} "
        value += coordinate.parameter.display or coordinate.parameter.unit
        if (
            coordinate.owner == effect
            and outwards
            and push**2 > PUSH * model.noise.dispersion * here.information[i, i]
        ):
            return f"{coordinate.label} runs into the end of its range, {value}"
        if coordinate.weight and abs(number) > max(STRAIN, strained.get(coordinate, 0.0) + MORE):
            return f"{coordinate.label} would have to be {value}, {abs(number):.1f} σ from what is believed"
    return ""


def idle(
    model: FittedModel,
    after: Prediction | None,
    base: FittedModel,
    before: Prediction | None,
    floors: Array,
    config: Config,
) -> str:
    """Return why a cause is not worth having: it explains too little of the misfit where it acts; "" if it does.

    Explainable is what exceeds the noise floor, RMSE² − floor². In the channel where the footprint is strongest, the
    root of what stays explainable must fall by the part ``config.gain``. Where the misfit does not exceed the floor,
    there is nothing to be explained in plain view and the statistics alone decide.
    """
    if after is None or before is None:
        replay, old, new = base.replay, base.predictions, model.predictions
    else:
        replay, old, new = before.replay, before.outputs, after.outputs
    footprint = [f(b - a) for f, a, b in zip(filters(base.noise, replay.runs), old, new, strict=True)]
    channel = int(np.argmax(sum(np.sum(p**2, axis=0) for p in footprint)))
    square0, square1 = (_mean_square(replay.runs, outputs, channel) for outputs in (old, new))
    explainable = square0 - SLACK * floors[channel] ** 2
    if explainable <= 0.0:
        return ""
    gained = 1.0 - np.sqrt(max(explainable - (square0 - square1), 0.0) / explainable)
    if gained >= config.gain:
        return ""
    name = replay.simulator.channels[channel].name
    return f"explains only {100.0 * gained:.2g} % of the misfit in {name}, where it acts most"


def noise_floors(channels: Sequence[Channel], runs: Sequence[MeasuredRun], noise: Noise) -> Array:
    """Return what noise alone leaves in each channel (c,), as a standard deviation.

    Stretches at rest say it, else the data sheet, else what cannot be predicted from one sample to the next.
    """
    floors = []
    for i, (channel, seen) in enumerate(zip(channels, noise.channels, strict=True)):
        quiet = [_straightened(run.outputs[part, i]) for run in runs for part in _rests(run, i)]
        if quiet:
            floors.append(float(np.sqrt(np.mean(np.concatenate(quiet) ** 2))))
        elif channel.noise > 0.0:
            floors.append(float(np.hypot(channel.noise, channel.resolution / np.sqrt(12.0))))
        else:
            floors.append(seen.innovation)
    return np.array(floors)


def _rests(run: MeasuredRun, channel: int) -> list[slice]:
    """Return the stretches at rest of one channel that are long enough; what stands still may stand elsewhere later."""
    still = np.concatenate(([False], run.rest & run.counted[:, channel], [False]))
    borders = np.flatnonzero(still[1:] != still[:-1]).reshape(-1, 2)
    return [slice(start, stop) for start, stop in borders.tolist() if stop - start >= REST]


def _straightened(values: Array) -> Array:
    """Return values (n,) less the line through them: gas at rest still warms up, rubber still creeps."""
    time = np.linspace(-1.0, 1.0, len(values))
    slope = time @ values / (time @ time)
    return values - values.mean() - slope * time


def _mean_square(runs: Sequence[MeasuredRun], outputs: Sequence[Array], channel: int) -> float:
    errors = [
        (run.outputs[:, channel] - predicted[:, channel])[run.counted[:, channel]]
        for run, predicted in zip(runs, outputs, strict=True)
    ]
    return float(np.mean(np.concatenate(errors) ** 2))
