"""The effect of the communication step of an FMU on its outputs, and on the fitted numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.contracts import Array, DiagnosisError, MeasuredRun, Nuisance
from diagnosis.systems.fmu.simulator import FmuSimulator

#: Change by half the step, as a part of the noise, from which on the step is doubted: the error is a third larger.
_COARSE: Final = 0.25
#: Error of a number by the step, relative to its standard deviation, from which on the step is doubted.
_BIASED: Final = 0.5
#: An error of second order in the step is four thirds of the change by half the step.
_WHOLE_ERROR: Final = 4.0 / 3.0
#: Step of a number for its sensitivity, as a part of its spread.
_MOVED: Final = 0.1


def step_doubts(simulator: FmuSimulator, runs: Sequence[MeasuredRun]) -> Iterator[str]:
    """Yield a sentence for each output, and each base parameter, that depends noticeably on the communication step."""
    few = _few(runs)
    step = simulator.step_of(few[0].experiment)
    finer = simulator.with_step(0.5 * step)
    try:
        now = [simulator.run(run.experiment, {}, {}) for run in few]
        changes = [finer.run(run.experiment, {}, {}) - one for run, one in zip(few, now, strict=True)]
    except DiagnosisError:  # an FMU whose step is fixed
        return
    sizes = np.max([np.sqrt(np.mean(change**2, axis=0)) for change in changes], axis=0)
    for channel, size in zip(simulator.channels, sizes, strict=True):
        if channel.noise > 0.0 and size > _COARSE * channel.noise:
            yield (
                f"{channel.name} of {simulator.name} changes by {size / channel.noise:.2g} times its noise where the "
                f"communication step is {0.5 * step:g} s and not {step:g} s; use a shorter fmu.step, or the "
                "error of the step may be found as a cause"
            )
    times = sum(len(one.outputs) for one in runs) / sum(len(one.outputs) for one in few)
    yield from _biases(simulator, few, now, changes, times)


def _few(runs: Sequence[MeasuredRun]) -> list[MeasuredRun]:
    """Return at most three runs: with the least motion, with a medium motion, and with the largest motion."""
    moved = sorted(runs, key=lambda one: float(np.nanmax(np.nanstd(one.outputs, axis=0), initial=0.0)))
    return [moved[k] for k in sorted({0, len(moved) // 2, len(moved) - 1})]


def _biases(
    simulator: FmuSimulator,
    runs: Sequence[MeasuredRun],
    now: Sequence[Array],
    changes: Sequence[Array],
    times: float,
) -> Iterator[str]:
    """Yield sentences on base parameters that the error of the communication step shifts noticeably.

    The shift is δ = (n JᵀJ + S)⁻¹ n Jᵀ e, with e the error of these runs divided by the noise, J the sensitivity to
    each parameter, S the prior precision, and n (``times``) the ratio of all data to these runs.
    """
    noise = np.array([channel.noise for channel in simulator.channels])
    noisy, base = noise > 0.0, simulator.nuisances
    if not base or not noisy.any():
        return
    J = np.stack([_divided_by_noise(_moved(simulator, one, runs, now), noisy, noise) for one in base], axis=1)
    e = _WHOLE_ERROR * _divided_by_noise(changes, noisy, noise)
    counted = np.isfinite(e) & np.isfinite(J).all(axis=1)
    J, e = J[counted], e[counted]
    information = times * J.T @ J + np.diag([1.0 / one.spread**2 for one in base])
    bias = np.linalg.solve(information, times * J.T @ e)
    known_to = np.sqrt(np.diag(np.linalg.inv(information)))
    shares = np.abs(bias) / known_to
    doubted = [k for k in np.argsort(-shares) if shares[k] > _BIASED]
    if doubted:
        each = ", ".join(f"{base[k].name} {_size(float(bias[k]), base[k])}" for k in doubted)
        yield (
            f"the communication step of {simulator.step_of(runs[0].experiment):g} s changes the fitted parameters of "
            f"{simulator.name}: {each}, up to {shares[doubted[0]]:.2g} times their uncertainty; half "
            "of fmu.step leaves a quarter of this error"
        )


def _divided_by_noise(outputs: Sequence[Array], noisy: NDArray[np.bool_], noise: Array) -> Array:
    """Return the outputs of all runs divided by the noise, as one array of one dimension."""
    return np.concatenate([(one[:, noisy] / noise[noisy]).ravel() for one in outputs])


def _moved(
    simulator: FmuSimulator, one: Nuisance, runs: Sequence[MeasuredRun], now: Sequence[Array]
) -> list[Array]:
    """Return the change of the outputs of each run per unit of a base parameter."""
    by = _MOVED * one.spread
    if one.nominal + by > one.high:
        by = -by
    value = {one.name: one.nominal + by}
    return [
        (simulator.run(run.experiment, value, {}) - before) / by
        for run, before in zip(runs, now, strict=True)
    ]


def _size(bias: float, one: Nuisance) -> str:
    if one.nominal != 0.0:
        return f"by {100.0 * bias / abs(one.nominal):+.2g} %"
    return f"by {bias / one.scale:+.2g} {one.display or one.unit}"
