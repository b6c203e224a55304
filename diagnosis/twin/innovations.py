"""Innovations: the unexpected part of the model error in each half second of a run.

Theory of operation
-------------------
The model has p uncertain parameters θ: tolerances of the springs, zeros of the sensors, the gas at the start of a
stretch. To first order its error in a reading is r = H θ + noise, with H from finite differences. θ is estimated during
the run, by least squares from the samples so far (a Kalman filter for constants; R. E. Kalman, 1960):

    e_k = r_k − H_k θ̂_{k−1},   S_k = R_k + H_k P_{k−1} H_kᵀ,   P_k⁻¹ = P_{k−1}⁻¹ + H_kᵀ R_k⁻¹ H_k

The innovation e_k of a block is the part that earlier blocks do not predict. As long as the model is valid, S_k^{−1/2}
e_k are independent standard normal numbers, from block to block. A deviation of the rig from its model appears there,
unless a tolerance explains it.

The state of the friction at the start of a stretch is unknown too. From the last reversal on it follows F = F_max (1 −
u₀ D/(D + x)), with unknown position on the curve, u₀, and unknown curve, D (M. Berg, 1998; after a small loop the curve
continues). Without a history u₀ is 1 and D the travel x₂ of the friction. So each spring, and both together in the
lateral direction, have three further parameters: a force that decays with x₂/(x₂ + x), where x is the largest travel of
the rubber from the start, one that grows with x₂ x/(x₂ + x)², and one that acts after a reversal, where the curve
before a small loop may continue or not. F_max is proportional to the pressure.

No model is exact, and the motion that drives it is measured. So R has two further parts, in the mean of a block and in
each of its bins: the effect of the noise of the motion on every reading, and the error of the model. The latter is a
share of the change of the reading since the start, and of the two terms of the shear: if the bolster rolls, the shear
is the small difference of a transducer and of the roll times an arm. The sizes are those on rigs without faults
(`FLOOR`, `FORM`), rather too large than too small.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench_protocol.signals import Group
from bench_protocol.table_signals import BY_GROUP
from bench_protocol.words import SIDES
from bench_records.record import Record
from bench_sim.model.rubber import friction_limit
from diagnosis.contracts import Array, Channel, Experiment, Job, MeasuredRun, Nuisance
from diagnosis.systems.air_spring.parameters import CHAMBERS, EACH_SIDE, SHEAR
from diagnosis.systems.air_spring.simulator import AirSpring

#: Length (s) of the bins for averaging readings, and number of bins in a block to be judged.
BIN: Final = 0.05
BINS: Final = 10
BLOCK: Final = BIN * BINS
#: Effect of the noise of the motion on a reading, in standard deviations of the reading's noise.
FLOOR: Final = 0.4
#: Error of a sound model, relative to the change of a reading since the start.
FORM: Final = 0.02
#: Errors of the equations persist for this many blocks. Together these blocks give as much information on the
#: parameters as one block.
_LASTS: Final = 10
#: Uncertainty of gas that was moved just before: its temperature in K, the delay of its thermometers in s, and its
#: pressure in Pa.
WARMTH: Final = 1.0
BEHIND: Final = 0.5
PRESSURE: Final = 450.0
#: Uncertainty of friction, one standard deviation: its force at the start of a stretch, relative to its limit; the
#: curve that it follows, D in x₂; its error after a reversal, relative to the limit (`friction_goes_on`).
FRICTION: Final[Mapping[str, float]] = {"force": 0.6, "curve": 0.6, "turn": 0.1}
#: Travel (in x₂) from which on a displacement counts as a motion.
_GONE: Final = 0.05
#: The median of the square of a standard normal number.
_MEDIAN: Final = 0.4549
#: Time (s) over which a rate is computed.
_FIRST: Final = 1.0


class Estimate(NamedTuple):
    """The present estimate of the parameters: mean (p,) and covariance (p, p), in units of the prior standard
    deviations.
    """

    mean: Array
    covariance: Array

    @classmethod
    def prior(cls, parameters: Sequence[Nuisance]) -> Estimate:
        """Return the estimate from the priors alone."""
        return cls(np.zeros(len(parameters)), np.eye(len(parameters)))

    def at_a_start(self, parameters: Sequence[Nuisance], rates: Mapping[str, float]) -> Estimate:
        """Return the estimate for the start of another stretch. Parameters of springs and sensors are kept. Those of a
        single stretch are reset, such as the gas and the state of the friction.

        ``rates`` (K/s) are the rates of the thermometers of the chambers at the start.
        """
        own = np.array([not one.per_run for one in parameters])
        return Estimate(
            np.where(own, self.mean, 0.0),
            np.where(
                np.outer(own, own), self.covariance, np.diag([_start(one, rates) ** 2 for one in parameters])
            ),
        )


def _start(parameter: Nuisance, rates: Mapping[str, float]) -> float:
    """Return the standard deviation of a parameter at the start of a stretch, divided by that of its prior."""
    place, _, what = parameter.name.rpartition(".")
    if what == "initial_temperature":
        return float(np.hypot(WARMTH, BEHIND * rates.get(place, 0.0))) / parameter.spread
    return PRESSURE / parameter.spread if what == "initial_pressure" else 1.0


class Innovations(NamedTuple):
    """The results of a stretch for b blocks and c channels."""

    measured: Array  #: (b, c) mean readings
    expected: Array  #: (b, c) of the model with what it had learnt before
    band: Array  #: (b, c) standard deviation of the one against the other
    white: Array  #: (b, c, BINS) whitened innovations, NaN where a bin has no reading
    estimate: Estimate  #: after the last block


class Columns(NamedTuple):
    """Readings and simulated values of a stretch, and their derivatives by the parameters, as means over bins."""

    samples: NDArray[np.int64]  #: (n, c) readings in each bin
    measured: Array  #: (n, c)
    simulated: Array  #: (n, c)
    parameters: Array  #: (n, c, p), each for one standard deviation of its prior
    inputs: Array  #: (n, c) what arms and an accelerometer wrong by `FORM` do, one standard deviation
    noise: Array  #: (c,) variance of a single reading


def parameters_of(simulator: AirSpring) -> tuple[Nuisance, ...]:
    """Return all parameters that the twin estimates: those of the simulator, and the state of the friction."""
    places = (*SIDES, "lateral")
    remembered = (
        Nuisance(f"{place}.friction.{what}", "1", 0.0, spread, per_run=True)
        for place in places
        for what, spread in FRICTION.items()
    )
    return (*simulator.nuisances, *remembered)


def columns_of(
    run: MeasuredRun, channels: Sequence[Channel], simulator: AirSpring, noise: Array | None = None
) -> Columns:
    """Simulate a run, and once more for each parameter. Return the means of the results over bins.

    ``noise`` (c,) is the variance of a reading if known. Otherwise it is estimated from the run; it is at least that of
    the data sheet.
    """
    parameters = simulator.nuisances
    names = [one.name for one in parameters]
    jobs = [Job(run.experiment, {}, {})]
    jobs += [Job(run.experiment, {one.name: one.nominal + one.difference}, {}) for one in parameters]
    jobs += [Job(one, {}, {}) for one in _wrongly_driven(run.experiment, simulator.parameters.record)]
    outputs = simulator.run_many(jobs)
    base = next(outputs)
    bins = Bins(run)
    slopes = [
        bins.mean(moved - base) * (one.spread / one.difference)
        for one, moved in zip(parameters, outputs, strict=False)
    ]
    inputs = np.sqrt(sum((bins.mean(moved - base) ** 2 for moved in outputs), np.zeros_like(slopes[0])))
    pressures = _pressures(run.experiment, channels, bins.mean(base))
    felt = dict(zip(names, slopes, strict=True))
    slopes += _remembered(run.experiment, channels, felt, bins, simulator, pressures)
    if noise is None:
        noise = np.maximum(_believed(channels), _noise_variance(run.outputs - base, bins))
    return Columns(
        bins.samples, bins.mean(run.outputs), bins.mean(base), np.stack(slopes, axis=-1), inputs, noise
    )


class Bins:
    """Division of a run into bins of ``size`` samples. ``samples`` (n, c) is the number of samples that count in each
    bin.
    """

    def __init__(self, run: MeasuredRun) -> None:
        self.size = max(round(BIN / run.experiment.step), 1)
        self.counted = run.counted
        self._some = len(self.counted) // self.size * self.size
        self.samples: NDArray[np.int64] = self._sum(self.counted)

    def mean(self, values: Array) -> Array:
        """Return the mean over the samples that count in each bin (n, c); 0 without such samples."""
        total = self._sum(np.where(self.counted, values, 0.0))
        return np.asarray(total / np.maximum(self.samples, 1))

    def _sum(self, values: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(values[: self._some].reshape(-1, self.size, values.shape[1]).sum(axis=1))


def _believed(channels: Sequence[Channel]) -> Array:
    """Return the variance of a reading (c,) from data sheets."""
    return np.array([channel.noise**2 + channel.resolution**2 / 12.0 for channel in channels])


def _noise_variance(errors: Array, bins: Bins) -> Array:
    """Return the variance of a reading (c,), from differences of errors (n, c) between samples and between bins.

    The median of squares ignores model errors and jumps, which are in few differences. Bins show correlated noise.
    """
    single = [_from_one_to_the_next(one) for one in np.where(bins.counted, errors, np.nan).T]
    averaged = []
    for mean, samples in zip(bins.mean(errors).T, bins.samples.T, strict=True):
        there = samples > 0
        many = float(np.median(samples[there])) if there.any() else 0.0
        averaged.append(_from_one_to_the_next(mean[there]) * many)
    return np.maximum(single, averaged)


def _from_one_to_the_next(values: Array) -> float:
    """Return the variance of normal numbers, from the median square of the differences between neighbours. NaN are
    skipped.
    """
    seen = values[np.isfinite(values)]
    return float(np.median(np.diff(seen) ** 2)) / (2.0 * _MEDIAN) if len(seen) > 2 else 0.0


def friction_goes_on(place: Array, travel: float) -> tuple[Array, Array, Array]:
    """Return three series (n,): the additional friction on a path ``place`` (n,) due to earlier motions, relative to
    the friction limit, per unit of their unknown factors.

    x is the largest distance from the start so far, and x₂ is ``travel`` (m). u₀ and D are explained at the top of this
    file. The series are:

    * x₂/(x₂ + x); its factor is −(u₀ − 1).
    * ± x₂ x/(x₂ + x)², with the sign of the first motion; its factor is −(D/x₂ − 1).
    * 1 after a reversal, and 0 before; its factor is the error of the friction there, relative to the limit.
    """
    way = place - place[0]
    away = np.maximum.accumulate(np.abs(way))
    gone = np.flatnonzero(away > _GONE * travel)
    sense = float(np.sign(way[gone[0]])) if gone.size else 0.0
    left = travel / (travel + away)
    turned = np.maximum.accumulate(away - np.abs(way) > _GONE * travel).astype(np.float64)
    return left, sense * left * (1.0 - left), turned


def _pressures(experiment: Experiment, channels: Sequence[Channel], simulated: Array) -> list[Array]:
    """Return for each side the simulated pressure (n,) in the bellows; constant if no channel is this pressure."""
    places = {channel.name: k for k, channel in enumerate(channels)}
    found = []
    for side in SIDES:
        name = f"{side}.bellows_pressure"
        first = np.full(len(simulated), experiment.settings[name])
        read = simulated[:, places[name]] if name in places else first
        found.append(np.where(read > 0.0, read, first))  # 0 where a bin has no sample
    return found


def _remembered(
    experiment: Experiment,
    channels: Sequence[Channel],
    slopes: Mapping[str, Array],
    bins: Bins,
    simulator: AirSpring,
    pressures: Sequence[Array],
) -> Iterator[Array]:
    """Yield the effect of the friction's history on the channels (n, c), in the order of `parameters_of`.

    The limit of the friction depends on the ``pressures`` (n,) of the bellows.
    """
    par, samples, size, inputs = simulator.parameters.record, bins.samples, bins.size, experiment.inputs

    def limit(friction: str, side: int) -> Array:
        constant, slope = par[friction][side], par[f"{friction}_slope"][side]
        return np.array([friction_limit(constant, slope, one) for one in pressures[side]])

    def each(place: Array, travel: float, limits: Array, where: Array) -> Iterator[Array]:
        for spread, share in zip(FRICTION.values(), friction_goes_on(place, travel), strict=True):
            some = share[: len(samples) * size].reshape(len(samples), size)
            yield np.outer(spread * limits * some.mean(axis=1), where)

    def felt(slope: Array, force: float) -> Array:
        """Return the change of the channels per N of a spring's force. ``slope`` is the derivative by a parameter that
        causes the ``force``.
        """
        forces = np.array([channel.kind == "force" for channel in channels])
        return np.where(forces, _at_first(slope, samples), 0.0) / force

    for k, side in enumerate(SIDES):
        more = EACH_SIDE["effective_area"] * float(par.effective_area[k])
        where = felt(slopes[f"{side}.effective_area"], more * pressures[k][0])
        travel = float(par.friction_vertical_travel[k])
        yield from each(inputs[f"{side}.height"], travel, limit("friction_vertical", k), where)
    sheared = slopes[f"{SHEAR}.offset"]
    cells = [k for k, channel in enumerate(channels) if channel.name in BY_GROUP[Group.LATERAL_LOAD_CELL]]
    total = float(_at_first(sheared, samples)[cells].sum())
    where = felt(sheared, total) if total else np.zeros(len(channels))
    shear = inputs.get("shear", np.zeros(len(experiment.time)))
    both = limit("friction_lateral", 0) + limit("friction_lateral", 1)
    yield from each(shear, float(par.friction_lateral_travel[0]), both, where)


def _at_first(values: Array, samples: NDArray[np.int64]) -> Array:
    """Return the mean (c,) of ``values`` (n, c) over the first bins with samples, as many as a block has; 0 without
    any.
    """
    seen = samples > 0
    early = seen & (np.cumsum(seen, axis=0) <= BINS)
    return np.asarray(np.where(early, values, 0.0).sum(axis=0) / np.maximum(early.sum(axis=0), 1))


def _wrongly_driven(experiment: Experiment, par: Any) -> Iterator[Experiment]:
    """Yield the experiment with two errors of its input motion, one after the other.

    First: the shear, computed with arms that are wrong by the share `FORM` (`diagnosis.systems.motion.sheared`).
    Second, if there is an accelerometer: its gain is wrong by the same share.
    """
    inputs = experiment.inputs
    left, right = inputs["left.height"], inputs["right.height"]
    roll = 0.5 * (left - right) / par.spring_half_spacing + inputs.get("platform.roll", 0.0)
    wrong = FORM * (par.lateral_actuator_height + par.centre_height) * roll
    yield replace(experiment, inputs={**inputs, "shear": inputs.get("shear", 0.0) + wrong})
    if (read := inputs.get("lateral.acceleration")) is not None:
        yield replace(experiment, inputs={**inputs, "lateral.acceleration": (1.0 + FORM) * read})


def gas_rates(record: Record, start: float) -> dict[str, float]:
    """Return by chamber the rate of change (K/s) of its thermometer at the start of a stretch."""
    rates = {}
    for chamber in CHAMBERS:
        name = f"{chamber}_temperature"
        times, values = record.series(name) if name in record.signals else (np.empty(0), np.empty(0))
        near = np.isfinite(values) & (times >= start) & (times < start + _FIRST)
        if near.sum() > 2:
            rates[chamber] = float(np.polynomial.Polynomial.fit(times[near], values[near], 1).deriv()(start))
    return rates


def rough(columns: Columns) -> Array:
    """Return the allowed error of the model (n, c), as one standard deviation."""
    first = _at_first(columns.simulated, columns.samples)
    travel = np.maximum.accumulate(
        np.where(columns.samples > 0, np.abs(columns.simulated - first), 0.0), axis=0
    )
    floor = FLOOR * np.sqrt(columns.noise)
    return np.sqrt(floor**2 + (FORM * travel) ** 2 + columns.inputs**2)


def judge(columns: Columns, estimate: Estimate, off: Array | None = None) -> Innovations:
    """Compute the innovations of the blocks of a stretch in order. Each block is compared with the estimate from
    earlier blocks.

    ``off`` (n, c) is the allowed error of the model; the default is that of `rough`.
    """
    blocks, channels = len(columns.samples) // BINS, columns.samples.shape[1]
    errors = columns.measured - columns.simulated
    off = rough(columns) if off is None else off
    measured, expected, band = (np.full((blocks, channels), np.nan) for _ in range(3))
    white = np.full((blocks, channels, BINS), np.nan)
    mean, information = estimate.mean, np.linalg.inv(estimate.covariance)
    for b in range(blocks):
        rows = slice(b * BINS, (b + 1) * BINS)
        count = columns.samples[rows]
        covariance = np.linalg.inv(information)
        gained, pull = np.zeros_like(information), np.zeros_like(mean)
        for c in np.flatnonzero(count.any(axis=0)):
            there = count[:, c] > 0
            H = columns.parameters[rows][there, c]
            form = off[rows][there, c] ** 2
            R = columns.noise[c] / count[there, c] + form
            e = errors[rows][there, c] - H @ mean
            S = H @ covariance @ H.T + np.diag(R) + form.max()
            white[b, c, there] = np.linalg.solve(np.linalg.cholesky(S), e)
            measured[b, c] = columns.measured[rows][there, c].mean()
            expected[b, c] = measured[b, c] - e.mean()
            band[b, c] = np.sqrt(S.mean())
            weighted = H.T / (R + _LASTS * there.sum() * form)
            gained += weighted @ H
            pull += weighted @ e
        information = information + gained
        mean = mean + np.linalg.solve(information, pull)
    return Innovations(measured, expected, band, white, Estimate(mean, np.linalg.inv(information)))
