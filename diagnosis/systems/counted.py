"""Selection of the samples that count: readings with information, and forces while the acceleration of the bolster is
known.

The record of a planned run will count the same samples (`counted_if_recorded`). A run whose forces do not count cannot
decide between causes by its forces. A thermometer with a resolution of 50 mK gives new information a hundred times less
often than readings.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from bench_protocol.table import TABLE
from diagnosis.contracts import Array, Channel, Experiment
from diagnosis.engine.config import AR_ORDER
from diagnosis.systems.motion import abrupt, sensor_noise, sudden

#: Longest memory of noise in samples: rounding errors that stay constant for longer are not noise.
_REMEMBERED: Final = AR_ORDER
#: A signal is coarse if its step exceeds this multiple of its noise: then the noise does not change the reading.
_COARSE: Final = 2.0
#: A coarse signal counts as fast where its readings change by more than this part of a step on average over a window of
#: this many readings, and by more than one step in total.
_QUICK, _QUICK_WINDOW = 0.5, 11
#: The sensors that show a reversal of each input.
_SEEN_BY: Final = {
    "left.height": "left.height",
    "right.height": "right.height",
    "shear": "lateral.displacement",
}


def counted_if_recorded(
    experiment: Experiment, outputs: Array, channels: Sequence[Channel], par: Any
) -> NDArray[np.bool_]:
    """Return a mask (n, c): True for samples that would count in the record of a planned experiment with these
    ``outputs``.

    The bench's accelerometer measures the lateral acceleration. The setting ``conditioned`` is the time (s of the
    experiment) from which on friction no longer depends on the history.
    """
    inputs, step = experiment.inputs, experiment.step
    acceleration = np.gradient(np.gradient(inputs["shear"], step), step) if "shear" in inputs else None
    unknown = undetermined_forces(
        inputs,
        par,
        None if acceleration is None else sudden(acceleration, sensor_noise("lateral.acceleration", par)),
    )
    rates = {field.signal: message.rate for message in TABLE.messages for field in message.fields}
    counted = np.empty(outputs.shape, np.bool_)
    counted[:] = (experiment.time >= experiment.settings.get("conditioned", 0.0))[:, np.newaxis]
    for k, channel in enumerate(channels):
        if channel.name in unknown:
            counted[unknown[channel.name], k] = False
        if coarse(channel):
            read = np.full(len(outputs), np.nan)
            times = slice(0, None, max(round(1.0 / (rates[channel.name] * step)), 1))
            read[times] = channel.resolution * np.rint(outputs[times, k] / channel.resolution)
            counted[:, k] &= np.isfinite(at_its_steps(read))
    return counted


def undetermined_forces(
    inputs: Mapping[str, Array], par: Any, lateral: NDArray[np.bool_] | None = None
) -> dict[str, NDArray[np.bool_]]:
    """Return a mask (n,) for each force channel: True where the force of an actuator does not determine the force of
    the springs.

    There the acceleration of the bolster is not known well enough. ``lateral`` is True where the lateral acceleration
    is not measured; None without an accelerometer.
    """
    turns = {
        name: abrupt(inputs[name], sensor_noise(sensor, par))
        for name, sensor in _SEEN_BY.items()
        if name in inputs
    }
    # The lateral actuator is above the bolster's centre: the vertical ones hold its moment.
    anywhere = np.logical_or.reduce(tuple(turns.values()))
    return {
        "vertical_left.force": anywhere,
        "vertical_right.force": anywhere,
        "lateral.force": turns.get("shear", anywhere) if lateral is None else lateral,
    }


def coarse(channel: Channel) -> bool:
    """Return whether the resolution of a channel is so coarse that its noise does not change the reading."""
    return channel.resolution > _COARSE * channel.noise


def while_it_moves(values: Array, step: float) -> Array:
    """Return the readings (n,) of a fast signal with a coarse resolution ``step``, but only one reading per stretch at
    rest.

    While a signal moves, rounding errors change between samples and act like noise. While it stays within a step, the
    error is constant: of such a stretch only the middle sample is kept, the others are NaN.
    """
    result = values.copy()
    known = np.flatnonzero(np.isfinite(values))
    start = 0
    for k in range(1, len(known) + 1):
        if k < len(known) and abs(values[known[k]] - values[known[start]]) < 1.5 * step:
            continue
        stretch = known[start:k]
        if len(stretch) > _REMEMBERED:
            result[stretch] = np.nan
            middle = stretch[len(stretch) // 2]
            result[middle] = values[middle]
        start = k
    return result


def at_its_steps(values: Array) -> Array:
    """Return the informative readings (n,) of a signal whose resolution is coarser than its noise; the others are NaN.

    For a slow signal only the steps count, because a hundred equal readings contain no more information than one. At a
    step the signal is half-way between both readings. Noise may cause several steps between the same two readings; only
    the middle one counts. For a fast signal every reading counts: half-way between two samples, a wave is not half-way
    between the readings but further out, by a fifth of its amplitude for 2 Hz at ten samples per second.
    """
    result = np.full(len(values), np.nan)
    known = np.flatnonzero(np.isfinite(values))
    moved = np.abs(np.diff(values[known]))
    if not moved.any():
        return result
    step = moved[moved > 0.0].min()
    wide = maximum_filter1d(values[known], _QUICK_WINDOW) - minimum_filter1d(values[known], _QUICK_WINDOW)
    quick = uniform_filter1d(moved, _QUICK_WINDOW, mode="nearest") > _QUICK * step
    quick &= wide[:-1] > 1.5 * step
    steps = np.flatnonzero((moved > 0.0) & ~quick)
    before, after = known[steps], known[steps + 1]
    between = 0.5 * (values[before] + values[after])
    elsewhere = (np.diff(between) != 0.0) | (np.diff(np.cumsum(quick)[steps]) > 0)
    groups = np.split(np.arange(len(steps)), np.flatnonzero(elsewhere) + 1)
    once = np.array([group[len(group) // 2] for group in groups if len(group)], np.intp)
    result[(before[once] + after[once]) // 2] = between[once]
    readings = known[:-1][quick]
    result[readings] = values[readings]
    return result
