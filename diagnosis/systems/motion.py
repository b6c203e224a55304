"""The motion of the bench, measured by its displacement sensors, without their noise and their lag.

A replay follows every sample, and friction responds to each reversal, also of the noise. So the samples are smoothed by
Whittaker's method: the motion x minimises

    Σ (y_n − x_n)²/σ² + Σ (Δ³x_n)²/q_n

over all existing samples y_n, and interpolates the others. σ is the noise of the sensor; q_n, the size of the third
difference around sample n, is that of the motion itself: small at rest, large at reversals.

The removed part of the motion is still in y − x. So y − x is smoothed too and added (twicing; Tukey, Exploratory Data
Analysis, 1977), both with a smaller q: the same noise is removed, and waves keep their size. With a single smoothing, a
wave of 0.5 mm at 12.5 Hz lost 0.08 % of its size, and forces that depend on it seemed to lag by half a millisecond.

A wave that is hardly larger than the noise is still lost. For example, a lateral motion of 2 mm at 12.5 Hz moves the
heights by 28 µm, because the bolster rolls. `in_step` finds the part of a signal that follows such a motion, if the
motion itself is clearly visible in another signal.
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import solveh_banded
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, uniform_filter1d
from scipy.signal import lfilter

from bench_protocol.table import TABLE
from bench_sim.model.layout import LATERAL
from bench_sim.model.wiring import sensor_of
from bench_sim.parameters import Parameters
from diagnosis.contracts import Array, DiagnosisError

#: Half of the window (in samples) within which third differences are assumed to have the same size.
_REACH: Final = 8
#: Number of iterations for the motion and its q, which depend on each other.
_ROUNDS: Final = 8
#: First value of q/σ² (passes 25 Hz of 200 Hz), and its limits (pass 3 Hz, and everything).
_FIRST, _SMALLEST, _LARGEST = 0.25, 1e-6, 20.0
#: Lower limit of q/σ² for a bolster that no actuator holds (passes 6.5 Hz). It oscillates at 2 to 4 Hz by less than the
#: noise of the sensors, but these oscillations change forces: an error of 8 µm changes a load cell by 4 N.
_SMALLEST_FREE: Final = 1e-4
#: Factor of q for the double smoothing. In all tests a quarter was better than a single smoothing with the whole q:
#: smaller errors of waves of 0.1 to 12.5 Hz (4.8 µm instead of 4.9 at 8 Hz) and of their accelerations (51 mm/s²
#: instead of 63), and equal errors of triangles.
_TWICE: Final = 0.25
#: Coefficients of the third difference.
_THIRD: Final = (-1.0, 3.0, -3.0, 1.0)
#: Half-way between samples, the error of a cubic is 1/42.7 of the fourth difference.
_CUBIC: Final = 128.0 / 3.0
#: Standard deviation (s) of the weights around a sample, to find the part in phase with another motion.
_IN_STEP: Final = 0.4
#: Up to this χ² of two degrees of freedom, a part in phase counts as chance.
_CHANCE: Final = 10.0
#: Smallest number of samples from which a motion is computed.
LEAST: Final = 8
#: Numbers of samples in a mean that distinguishes motion from noise. Motion above 20 Hz or 2 Hz would average out.
_BLOCKS: Final = (5, 50)

#: The sensors that measure the positions of bolster and platform.
SENSORS: Final = (
    "left.height",
    "right.height",
    "lateral.displacement",
    "platform.vertical",
    "platform.lateral",
    "platform.roll",
)
#: The sensors that also measure a roll of the bolster during its lateral motion.
_ROLLING: Final = ("left.height", "right.height")
#: Further readings of the motion, if the bench has them.
BESIDE: Final = ("lateral.force", "lateral.acceleration")
#: The input with the assumed deflection (m) of the lateral actuator's frame.
GIVE: Final = "lateral.give"


def motion_inputs(
    measured: Mapping[str, Array], step: float, parameters: Parameters, *, free: bool = False
) -> dict[str, Array]:
    """Return the motion inputs of `AirSpring`, each (n,), from readings (n,) every ``step`` s.

    ``measured`` holds signals of `SENSORS` (at least both heights) and `BESIDE`, with NaN where there was no sample. If
    it has ``lateral.force``, the deflection q of the lateral actuator's frame, F = k q + c dq/dt, is subtracted from
    the shear and is also returned. ``free``: the bolster swings freely.
    """
    par = parameters.record
    smallest = _SMALLEST_FREE if free else _SMALLEST

    def seen(name: str) -> Array:
        sensor = sensor_of(name)
        smoothed = smooth(measured[name], sensor_noise(name, par), smallest)
        if name in _ROLLING and sideways is not None:
            smoothed = smoothed + in_step(measured[name] - smoothed, sideways, step, sensor_noise(name, par))
        true = (smoothed - par.sensor_bias[sensor]) / (1.0 + par.sensor_gain[sensor])
        return without_lag(true, float(par.sensor_lag[sensor]), step)

    sideways = None
    if "lateral.displacement" in measured:
        sideways = smooth(
            measured["lateral.displacement"], sensor_noise("lateral.displacement", par), smallest
        )
    places = {name: seen(name) for name in SENSORS if name in measured}
    inputs = {name: values for name, values in places.items() if name != "lateral.displacement"}
    if "lateral.acceleration" in measured:
        inputs["lateral.acceleration"] = seen("lateral.acceleration")
    if "lateral.displacement" in places:
        given_way = np.zeros(len(places["left.height"]))
        if "lateral.force" in measured:
            given_way = inputs[GIVE] = give(seen("lateral.force"), LATERAL, par, step)
        inputs["shear"] = sheared(places, given_way, par)
    return inputs


def sheared(places: Mapping[str, Array], given_way: Array, par: Any) -> Array:
    """Return the shear y (n,) of the springs from the readings (n,) of the `SENSORS` that exist.

    The transducer of the lateral actuator reads d = y_B − h_a φ_B + q; ``given_way`` is the deflection q (n,) of its
    frame. With φ_B = (ζ_L − ζ_R)/2b + φ_P

        y = d − q + (h_a + e) φ_B − y_P + h φ_P
    """
    zero = np.zeros(len(given_way))
    platform = places.get("platform.roll", zero)
    roll = 0.5 * (places["left.height"] - places["right.height"]) / par.spring_half_spacing + platform
    return (
        places["lateral.displacement"]
        - given_way
        + (par.lateral_actuator_height + par.centre_height) * roll
        - places.get("platform.lateral", zero)
        + par.column_height * platform
    )


def give(force: Array, actuator: int, par: Any, step: float) -> Array:
    """Return the deflection q (n,) of an actuator's frame under a smooth ``force`` F (n,): F = k q + c dq/dt."""
    stiffness = float(par.frame_stiffness[actuator])
    return with_lag(force / stiffness, float(par.frame_damping[actuator]) / stiffness, step)


def sensor_noise(name: str, par: Any) -> float:
    """Return the standard deviation of one sample: the noise of its sensor, and the rounding of sensor and wire."""
    sensor = sensor_of(name)
    steps = float(par.sensor_resolution[sensor]), TABLE[name].step
    return float(np.sqrt(par.sensor_noise[sensor] ** 2 + sum(step**2 for step in steps) / 12.0))


def smooth(values: Array, noise: float, smallest: float = _SMALLEST) -> Array:
    """Return ``values`` (n,) without noise; NaN are interpolated. ``noise`` is the standard deviation of the noise.

    q is at least ``smallest`` σ². Readings that contain only noise are replaced by their mean. Raises DiagnosisError
    for fewer than eight samples.
    """
    known = np.isfinite(values)
    if known.sum() < LEAST:
        raise DiagnosisError(f"a motion has {known.sum()} measured samples; use a run with at least {LEAST}")
    if _is_pure_noise(values[known], noise):
        return np.full(len(values), np.mean(values[known]))
    ratio = np.full(len(values) - 3, _FIRST)
    for _ in range(_ROUNDS):
        square = (np.diff(_whittaker(values, known, ratio), 3) / noise) ** 2
        ratio = np.clip(uniform_filter1d(square, 2 * _REACH + 1, mode="nearest"), smallest, _LARGEST)
    once = _whittaker(values, known, _TWICE * ratio)
    return once + _whittaker(values - once, known, _TWICE * ratio)


def in_step(left: Array, motion: Array, step: float, noise: float) -> Array:
    """Return the part of the residual ``left`` (n,) that follows the acceleration and the speed of a ``motion`` (n,).
    ``left`` is NaN where there is no sample; ``step`` is the interval in s.

    It is α times the acceleration plus β times the speed. α and β are fitted around every sample. The result is zero
    where the χ² of the fit is no larger than by chance, and the full fit where it is much larger. If the residual
    scatters more than the ``noise`` of the data sheet, χ² uses this scatter instead.
    """
    time = step * np.arange(len(motion))
    spline = CubicSpline(time, motion)
    speed, acceleration = spline(time, 1), spline(time, 2)
    known = np.isfinite(left)
    seen = np.where(known, left, 0.0)
    width = _IN_STEP / step

    def around(values: Array) -> Array:
        # As sums over samples, of which so many count as one each; beyond the ends there are none.
        count = 2.0 * np.sqrt(np.pi) * width
        return np.asarray(count * gaussian_filter1d(np.where(known, values, 0.0), width, mode="constant"))

    power = around(seen**2) / np.maximum(around(np.ones(len(left))), 1.0)
    vv, aa, va = around(speed**2), around(acceleration**2), around(speed * acceleration)
    sv, sa = around(seen * speed), around(seen * acceleration)
    determinant = vv * aa - va**2
    regular = determinant > 1e-6 * vv * aa
    determinant = np.where(regular, determinant, 1.0)
    beta, alpha = (aa * sv - va * sa) / determinant, (vv * sa - va * sv) / determinant
    chi2 = np.where(regular, beta * sv + alpha * sa, 0.0) / np.maximum(noise**2, power)
    part = 1.0 - (_CHANCE / np.maximum(chi2, _CHANCE)) ** 2
    return np.asarray(part * (beta * speed + alpha * acceleration))


def abrupt(motion: Array, noise: float) -> NDArray[np.bool_]:
    """Return a mask (n,): True where a smooth ``motion`` (n,) reverses too fast to compute its acceleration accurately.

    There its third difference exceeds a tenth of the ``noise`` of the sensor, and the smoothing passes more than 13 Hz.
    The part of a noise of 10 µm that passes too is an acceleration of 10 mm/s², a quarter of the noise of a load cell.
    """
    third = np.pad(np.abs(np.diff(motion, 3)), (1, 2), mode="edge")
    return np.asarray(maximum_filter1d(third, 2 * _REACH + 1, mode="nearest") > 0.1 * noise)


def sudden(acceleration: Array, noise: float) -> NDArray[np.bool_]:
    """Return a mask (n,): True where the ``acceleration`` (n,) of an accelerometer changes too fast to be interpolated.

    There the error of a cubic through four samples, half-way between two of them, exceeds the ``noise`` of the sensor:
    it is 3/128 of the fourth difference. The spline of a replay is better for waves, and no better for steps.
    """
    fourth = np.pad(np.abs(np.diff(acceleration, 4)), 2, mode="edge")
    return np.asarray(maximum_filter1d(fourth, 2 * _REACH + 1, mode="nearest") > _CUBIC * noise)


def without_lag(values: Array, lag: float, step: float) -> Array:
    """Return x = y + τ dy/dt, the input of a sensor with first-order ``lag`` τ (s), from its smooth output y (n,)."""
    time = step * np.arange(len(values))
    return values + lag * CubicSpline(time, values)(time, 1)


def with_lag(values: Array, lag: float, step: float) -> Array:
    """Return y (n,) with y + τ dy/dt = x: the smooth signal x = ``values`` (n,) after a first-order ``lag`` τ (s).

    The result is exact for the cubic spline through x: a cubic p gives p − τ p′ + τ² p″ − τ³ p‴, and the difference
    from it decays as e^{−t/τ}. At the first sample y is x.
    """
    if lag == 0.0:
        return values
    time = step * np.arange(len(values))
    spline = CubicSpline(time, values)
    continuous = values - lag * spline(time, 1) + lag**2 * spline(time, 2)
    decay = np.exp(-step / lag)
    kink = 6.0 * lag**3 * spline.c[0]
    drive = np.concatenate(([values[0] - continuous[0]], (decay - 1.0) * kink))
    return np.asarray(continuous + lfilter([1.0], [1.0, -decay], drive))


def _is_pure_noise(seen: Array, noise: float) -> bool:
    """Return whether successive samples (n,) are pure noise: then the scatter of means of m samples falls with √m.

    The scatter may be up to twice ``noise``, because rounding can be coarser than the noise.
    """
    power = float(np.var(seen))
    if power > (2.0 * noise) ** 2:
        return False
    for size in _BLOCKS:
        count = len(seen) // size
        means = seen[: count * size].reshape(count, size).mean(axis=1)
        if count > 1 and size * float(np.var(means)) > (1.0 + 5.0 / np.sqrt(count)) * power:
            return False
    return True


def _whittaker(values: Array, known: NDArray[np.bool_], ratio: Array) -> Array:
    """Return x from (W + Δ³ᵀ diag(σ²/q) Δ³) x = W y. The matrix is a band of seven diagonals; ``ratio`` (n−3,)
    is q/σ².
    """
    band = np.zeros((4, len(values)))
    band[0] = known
    for i, first in enumerate(_THIRD):
        for j, second in enumerate(_THIRD[: i + 1]):
            band[i - j, j : j + len(ratio)] += first * second / ratio
    solution: Array = solveh_banded(band, np.where(known, values, 0.0), lower=True)
    return solution


def binned(times: Array, values: Array, edges: Array) -> tuple[Array, Array]:
    """Return the number (n,) and the sum (n,) of the samples (m,) in each interval between edges (n + 1,). Times are
    sorted.
    """
    places = np.searchsorted(times, edges)
    count = np.diff(places).astype(np.float64)
    sums = np.add.reduceat(np.append(values[: places[-1]], 0.0), places[:-1])
    return count, np.where(count > 0, sums, 0.0)


def scatter(count: Array, total: Array, squares: Array, width: int) -> Array:
    """Return the standard deviation (n,) of all samples in a window of ``width`` steps around each step; 0 without
    samples.

    The inputs are for each step (n,): the number of samples, their sum and the sum of their squares. Subtract the mean
    first for a better accuracy.
    """
    window = np.ones(width)
    count, total, squares = (
        np.convolve(one, window)[width // 2 :][: len(one)] for one in (count, total, squares)
    )
    count = np.maximum(count, 1.0)
    return np.sqrt(np.maximum(squares / count - (total / count) ** 2, 0.0))
