"""Step 9, gain: how much better the extended model predicts than the base model, on unseen runs.

Theory of operation
-------------------
All parameters of both models are fitted (base model: `best_base.py`). Both predict the test runs with the parameters
from the fit runs; only parameters of a single run (an initial pressure) are fitted again. The gain is the removed part
of the explainable error, (RMSE0² − RMSE1²)/(RMSE0² − floor²), because no model can explain noise. Its interval is from
a bootstrap of runs, or of blocks if there are few runs.

The other results are the coverage of the predictions, curves for drawings, and the shift of each base parameter in
standard deviations of the base model. The shifts show that the uncertainties of a model with a missing cause are wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtri

from diagnosis.contracts import Array, Channel, MeasuredRun
from diagnosis.engine.config import BOOTSTRAP_BLOCKS, BOOTSTRAPS, COVERAGE_LEVELS, EXPLAINABLE, LEAST_REPEATS
from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.fitting.point import Coordinate, Point
from diagnosis.engine.fitting.predict import Prediction
from diagnosis.estimates import number, numbers
from diagnosis.finding import Coverage, Gain, Models, Shift, Trace

#: Channels that are drawn, bins and points of their drawings.
DRAWN, BINS, POINTS = 6, 250, 400


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of two models: the gain in each channel and in all channels, the coverage of the predictions, and
    curves for drawings.
    """

    gains: list[Gain] = field(default_factory=list)
    coverage: list[Coverage] = field(default_factory=list)
    traces: list[Trace] = field(default_factory=list)
    #: Nuisances of the test runs in SI, before and after, by record and name.
    before_runs: dict[str, dict[str, float]] = field(default_factory=dict)
    after_runs: dict[str, dict[str, float]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class _Arms:
    """The test runs with the predictions (n, c) of both models."""

    runs: tuple[MeasuredRun, ...]
    outputs: tuple[tuple[Array, ...], tuple[Array, ...]]
    noise: Array

    def errors(self, arm: int) -> list[Array]:
        """Return measured minus predicted values (n, c) of each run for one model (``arm``: 0 before, 1 after); NaN
        where a sample does not count.
        """
        return [
            np.where(run.counted, run.outputs - predicted, np.nan)
            for run, predicted in zip(self.runs, self.outputs[arm], strict=True)
        ]


def compare(before: Prediction, after: Prediction, noise: Array, *, seed: int = 0) -> Comparison:
    """Compare two predictions of the same runs; ``noise`` (c,) is the noise floor of each channel."""
    runs, channels = after.replay.runs, after.replay.simulator.channels
    forecasts = before, after
    arms = _Arms(runs, (forecasts[0].outputs, forecasts[1].outputs), noise)
    errors = (arms.errors(0), arms.errors(1))
    rng = np.random.default_rng(seed)
    gains = [
        _gain("all", "× noise", 1.0, 1.0, float("nan"), [[e / noise for e in arm] for arm in errors], rng)
    ]
    for c, channel in enumerate(channels):
        one = [[e[:, c : c + 1] for e in arm] for arm in errors]
        measured = np.concatenate([run.outputs[run.counted[:, c], c] for run in runs])
        gains.append(
            _gain(
                channel.name,
                channel.display or channel.unit,
                channel.scale,
                float(noise[c]),
                float(measured.std()) if measured.size else float("nan"),
                one,
                rng,
            )
        )
    starts = [_of_records(forecast.linearisation.point) for forecast in forecasts]
    return Comparison(
        gains, _coverage(errors, noise), _traces(channels, arms, errors, gains[1:]), starts[0], starts[1]
    )


def _gain(
    channel: str,
    unit: str,
    scale: float,
    floor: float,
    swing: float,
    errors: Sequence[Sequence[Array]],
    rng: np.random.Generator,
) -> Gain:
    sums = np.concatenate([_sums(b, a) for b, a in zip(errors[0], errors[1], strict=True)])
    total = sums.sum(axis=(0, 1))
    before, after = np.sqrt(total[:2] / total[2]) if total[2] > 0 else (np.nan, np.nan)
    low, high = _interval(sums, floor, rng) if before > EXPLAINABLE * floor else (np.nan, np.nan)
    return Gain(
        channel=channel,
        unit=unit,
        rmse_before=number(before / scale),
        rmse_after=number(after / scale),
        floor=number(floor / scale),
        nrmse_before=number(before / swing) if swing > 0.0 else None,
        nrmse_after=number(after / swing) if swing > 0.0 else None,
        noise_ratio_before=number(before / floor),
        noise_ratio=number(after / floor),
        fraction=number(float(_fraction(total, floor))) if before > EXPLAINABLE * floor else None,
        fraction_low=number(low),
        fraction_high=number(high),
    )


def _sums(before: Array, after: Array) -> Array:
    """Return sums of squares before and after, and the number of samples, per block of one run: (1, blocks, 3)."""
    starts = (np.arange(BOOTSTRAP_BLOCKS) * len(before)) // BOOTSTRAP_BLOCKS
    parts = np.column_stack(
        (
            np.nansum(before**2, axis=1),
            np.nansum(after**2, axis=1),
            np.isfinite(before).sum(axis=1),
        )
    )
    return np.add.reduceat(parts, starts, axis=0)[np.newaxis]


def _fraction(total: Array, floor: float) -> Array:
    """Return (RMSE0² − RMSE1²)/(RMSE0² − floor²) from sums (…, 3). It is limited to 1, because an error below the noise
    is chance.
    """
    left = total[..., 0] - floor**2 * total[..., 2]
    gone = np.minimum(total[..., 0] - total[..., 1], left)
    return np.divide(gone, left, out=np.full_like(left, np.nan), where=left > 0.0)


def _interval(sums: Array, floor: float, rng: np.random.Generator) -> tuple[float, float]:
    """Return the 95 % interval of the gain fraction, by a bootstrap of runs, or of blocks if there are few runs."""
    units = sums.sum(axis=1) if len(sums) >= LEAST_REPEATS else sums.reshape(-1, 3)
    units = units[units[:, 2] > 0]
    drawn = units[rng.integers(len(units), size=(BOOTSTRAPS, len(units)))].sum(axis=1)
    low, high = np.nanquantile(_fraction(drawn, floor), (0.025, 0.975))
    return float(low), float(high)


def _coverage(errors: Sequence[Sequence[Array]], noise: Array) -> list[Coverage]:
    """Return for each nominal level the share of samples, over all channels, inside the predicted interval of both
    models.
    """
    sizes = [np.abs(np.concatenate([(e / noise)[np.isfinite(e)] for e in arm])) for arm in errors]
    if not sizes[0].size:
        return []
    return [
        Coverage(
            level=level,
            before=number(float(np.mean(sizes[0] < ndtri(0.5 + 0.5 * level)))),
            after=number(float(np.mean(sizes[1] < ndtri(0.5 + 0.5 * level)))),
        )
        for level in COVERAGE_LEVELS
    ]


def _traces(
    channels: Sequence[Channel], arms: _Arms, errors: Sequence[Sequence[Array]], gains: Sequence[Gain]
) -> list[Trace]:
    """Return curves of the channels with the largest errors of the base model, each in the run with its largest
    error.
    """
    order = sorted(range(len(gains)), key=lambda c: -(gains[c].noise_ratio_before or 0.0))[:DRAWN]
    return [
        _trace(channels[c], arms, errors, c) for c in order if np.isfinite(gains[c].rmse_before or np.nan)
    ]


def _trace(channel: Channel, arms: _Arms, errors: Sequence[Sequence[Array]], c: int) -> Trace:
    powers = [float(np.nanmean(e[:, c] ** 2)) if np.isfinite(e[:, c]).any() else -1.0 for e in errors[0]]
    r = int(np.argmax(powers))
    run, n = arms.runs[r], len(arms.runs[r].outputs)
    time, worst = run.experiment.time, errors[0][r][:, c]
    width = min(n, max(POINTS, n // 10))
    energy = np.concatenate(([0.0], np.cumsum(np.nan_to_num(worst) ** 2)))
    start = int(np.argmax(energy[width:] - energy[:-width])) if width < n else 0
    window = slice(start, start + width, max(1, width // POINTS))
    measured = np.where(np.isfinite(run.outputs[:, c]), run.outputs[:, c], np.nan)
    edges = (np.arange(min(BINS, n)) * n) // min(BINS, n)
    return Trace(
        run=run.experiment.name,
        channel=channel.name,
        unit=channel.display or channel.unit,
        times=[float(f"{t:.7g}") for t in time[window]],
        measured=numbers(measured[window] / channel.scale, 6),
        before=numbers(arms.outputs[0][r][window, c] / channel.scale, 6),
        after=numbers(arms.outputs[1][r][window, c] / channel.scale, 6),
        error_times=[float(f"{t:.7g}") for t in np.repeat(time[edges], 2)],
        error_before=numbers(_extremes(errors[0][r][:, c], edges) / channel.scale),
        error_after=numbers(_extremes(errors[1][r][:, c], edges) / channel.scale),
        noise=number(float(arms.noise[c]) / channel.scale),
    )


def _extremes(values: Array, edges: np.ndarray[tuple[int], np.dtype[np.int64]]) -> Array:
    """Return minimum, maximum, minimum, … of the finite values: two numbers for each bin. The bins begin at the
    ``edges``.
    """
    return np.column_stack((np.fmin.reduceat(values, edges), np.fmax.reduceat(values, edges))).ravel()


def shifts(before: FittedModel, after: FittedModel, covariance: Array) -> list[Shift]:
    """Return the nuisances of both models, the largest shift first, in standard deviations of the base model.

    ``covariance`` (k, k) is that of the numbers of the extended model.
    """
    deviations = [np.sqrt(np.maximum(np.diagonal(c), 0.0)) for c in (before.covariance(), covariance)]
    found = []
    for i, coordinate in enumerate(before.point.coordinates):
        if coordinate.owner:
            continue
        j = after.point.place(coordinate)
        move = float(after.point.numbers[j] - before.point.numbers[i])
        found.append(
            Shift(
                name=coordinate.parameter.name,
                unit=coordinate.parameter.display or coordinate.parameter.unit,
                before=_in_display_unit(coordinate, before.point.numbers[i]),
                after=_in_display_unit(coordinate, after.point.numbers[j]),
                sd_before=_width(coordinate, before.point.numbers[i], deviations[0][i]),
                sd_after=_width(coordinate, after.point.numbers[j], deviations[1][j]),
                sigmas=number(move / deviations[0][i]) if deviations[0][i] > 0.0 else None,
                run=coordinate.record,
            )
        )
    return sorted(found, key=lambda shift: -abs(shift.sigmas or 0.0))


def _in_display_unit(coordinate: Coordinate, value: float) -> float | None:
    return number(coordinate.to_value(float(value)) / coordinate.parameter.scale)


def _width(coordinate: Coordinate, value: float, deviation: float) -> float | None:
    size = abs(coordinate.to_value(float(value))) if coordinate.parameter.logarithmic else 1.0
    return number(size * coordinate.scale * float(deviation) / coordinate.parameter.scale)


def models(before: FittedModel, after: FittedModel, reported: Comparison) -> Models:
    """Return both models with their SI values, and the parameters that were fitted to each test run."""
    return Models(
        before=_shared(before.point),
        after=_shared(after.point),
        effects={
            owner: {name: float(value) for name, value in values.items()}
            for owner, values in after.point.effects().items()
        },
        before_runs=reported.before_runs | _of_records(before.point),
        after_runs=reported.after_runs | _of_records(after.point),
    )


def _shared(point: Point) -> dict[str, float]:
    values = point.values()
    return {
        c.parameter.name: float(v)
        for c, v in zip(point.coordinates, values, strict=True)
        if not c.owner and not c.record
    }


def _of_records(point: Point) -> dict[str, dict[str, float]]:
    records: dict[str, dict[str, float]] = {}
    for coordinate, value in zip(point.coordinates, point.values(), strict=True):
        if coordinate.record:
            records.setdefault(coordinate.record, {})[coordinate.parameter.name] = float(value)
    return records
