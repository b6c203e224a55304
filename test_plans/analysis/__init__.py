"""Computation of stiffness and damping from sampled motion and force: first harmonics, secants and loops.

A harmonic motion is ``x(t) = Re(X e^{iωt})`` with the complex amplitude X. The complex stiffness is ``K = F/X``. Its
real part K' stores energy. Its imaginary part K'' dissipates ``π K'' |X|²`` per cycle; the damping is ``c = K''/ω``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from math import pi, tau
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from bench_protocol.signals import Group
from bench_protocol.table_signals import BY_GROUP
from bench_protocol.words import SIDES
from test_plans.description import lag_of

Samples = npt.NDArray[np.float64]
Wave = Literal["sine", "triangle"]

#: Smallest number of samples per cycle. A fit to fewer samples has no meaning.
SAMPLES_PER_CYCLE_MIN: Final = 8
_ENOUGH: Final = f"a whole cycle and {SAMPLES_PER_CYCLE_MIN} samples per cycle are needed"
#: Number of iterations to find the phase of a wave.
_STEPS: Final = 3
#: A sample of a slow loop counts as a turning point if the motion is within this fraction of its range from an end.
TURNING: Final = 0.02


class NotMeasured(ValueError):
    """Raised if the samples do not contain the requested quantity."""


@dataclass(frozen=True, slots=True)
class Stiffness:
    """A complex stiffness (N/m) at a frequency (Hz) and the amplitude (m) at which it was measured."""

    value: complex
    frequency: float
    amplitude: float

    @property
    def storage(self) -> float:
        """K' in N/m."""
        return self.value.real

    @property
    def loss(self) -> float:
        """K'' in N/m."""
        return self.value.imag

    @property
    def damping(self) -> float:
        """c = K''/ω in N·s/m."""
        return self.value.imag / (tau * self.frequency)

    @property
    def energy(self) -> float:
        """Energy lost per cycle in J."""
        return pi * self.value.imag * self.amplitude**2


def first_harmonic(times: Samples, values: Samples, frequency: float) -> complex:
    """Return the complex amplitude of ``values`` at ``frequency`` (Hz): least squares on 1, t, cos ωt and sin ωt.

    The column t removes a slow drift (cooling gas), which would falsify a plain Fourier coefficient. ``times`` (s) and
    ``values`` have the shape (n,). Raises NotMeasured for gaps (NaN), for too few samples, and for less than one whole
    cycle.
    """
    if times.shape != values.shape or times.ndim != 1:
        raise NotMeasured(
            f"times of shape {times.shape} and values of shape {values.shape} do not fit; give one "
            "value for each time"
        )
    if times.size < SAMPLES_PER_CYCLE_MIN:
        raise NotMeasured(f"{times.size} samples are too few for a first harmonic; {_ENOUGH}")
    period = (times[-1] - times[0]) / (times.size - 1)
    cycles = (times[-1] - times[0] + period) * frequency
    if cycles < 1 - 1e-6 or times.size < SAMPLES_PER_CYCLE_MIN * cycles * (1 - 1e-6):
        raise NotMeasured(
            f"{times.size} samples over {cycles:.3g} cycles are too few for a first harmonic; {_ENOUGH}"
        )
    if not np.isfinite(values).all():
        raise NotMeasured(f"{np.count_nonzero(~np.isfinite(values))} of {values.size} samples are missing")
    cosine, sine = _harmonic_rows(np.asarray(times, float).tobytes(), frequency) @ values
    return complex(cosine, -sine)


def distortion(times: Samples, motion: Samples, frequency: float, wave: Wave = "sine") -> float:
    """Return how much ``motion`` deviates from a ``wave`` of ``frequency`` (Hz): rms of the residual divided by rms of
    the wave.

    The residual is that of a fit of a line and the wave. The noise of a sensor gives 0.3 % at 5 mm. Late set-points, or
    an actuator that stops between set-points, give several per cent. Such stops change the first harmonic and the
    secant, so that both deviate from the stiffness at this frequency.
    """
    amplitude = first_harmonic(times, motion, frequency)
    if abs(amplitude) == 0.0:
        raise NotMeasured(f"nothing moved, so there is no {wave} to measure")
    phase = tau * frequency * times + np.angle(amplitude)
    found, rest = _fit(times, motion, phase, wave)
    for _ in range(_STEPS):  # over one cycle, the harmonics of a triangle look like a drift too
        phase = phase + found[3] / found[2]
        found, rest = _fit(times, motion, phase, wave)
    size = abs(found[2]) / np.sqrt(3.0 if wave == "triangle" else 2.0)
    return float(rest.std() / size)


def _fit(times: Samples, motion: Samples, phase: Samples, wave: Wave) -> tuple[Samples, Samples]:
    """Fit 1, t, the wave and its slope to ``motion``. Return the four coefficients, and the residual (n,)."""
    columns = np.column_stack([np.ones_like(times), times - times.mean(), *_shape(phase, wave)])
    found, *_ = np.linalg.lstsq(columns, motion)
    return found, motion - columns @ found


def _shape(phase: Samples, wave: Wave) -> tuple[Samples, Samples]:
    """Return a wave of amplitude 1 at each ``phase`` (rad), and its derivative by the phase."""
    if wave == "triangle":
        return np.arcsin(np.cos(phase)) * 2 / pi, -np.sign(np.sin(phase)) * 2 / pi
    return np.cos(phase), -np.sin(phase)


@lru_cache(maxsize=16)
def _harmonic_rows(times: bytes, frequency: float) -> Samples:
    """Return the two rows (2, n) of a pseudo-inverse that give the coefficients of cos ωt and sin ωt from samples at
    ``times`` (s).

    The rows are cached, because the pseudo-inverse takes most of the computing time, and an uncertainty needs the same
    rows a hundred times.
    """
    t = np.frombuffer(times)
    columns = np.column_stack(
        [np.ones_like(t), t - t.mean(), np.cos(tau * frequency * t), np.sin(tau * frequency * t)]
    )
    return np.linalg.pinv(columns)[2:]


def one_cycle(
    times: Samples, values: Samples, frequency: float, *, harmonics: int = 7, points: int = 100
) -> Samples:
    """Return the mean cycle of ``values`` at ``points`` equally spaced phases from time 0 on, without noise and drift.

    Least squares on 1, t and the first ``harmonics`` of ``frequency`` (Hz). Raises NotMeasured for gaps, or if there
    are too few samples.
    """
    orders = np.arange(1, harmonics + 1)
    if times.size < 2 * (2 * harmonics + 2) or not np.isfinite(values).all():
        raise NotMeasured(
            f"{np.isfinite(values).sum()} samples are too few for a cycle of {harmonics} harmonics"
        )
    angles = tau * frequency * np.outer(times, orders)
    drift = (times - times.mean())[:, None]
    columns = np.hstack([np.ones_like(drift), np.cos(angles), np.sin(angles), drift])
    fit, *_ = np.linalg.lstsq(columns, values, rcond=None)
    phases = tau * np.outer(np.arange(points) / points, orders)
    return np.asarray(
        fit[0] + np.cos(phases) @ fit[1 : harmonics + 1] + np.sin(phases) @ fit[harmonics + 1 : -1]
    )


def without_lag(amplitude: complex, lag: float, frequency: float) -> complex:
    """Return the amplitude at the input of a first-order sensor with the time constant ``lag`` (s), from that of its
    reading: ``X (1 + iωτ)``.
    """
    return amplitude * (1 + 1j * tau * frequency * lag)


def straight_line(times: Samples, values: Samples) -> tuple[float, float]:
    """Return level (in the middle of the samples) and slope (per s) of a fitted line. NaN are ignored."""
    level, good = level_of(values), np.isfinite(values)
    if not good.all():
        times, values = times[good], values[good]
    middle, squares = _about_the_mean(np.asarray(times, float).tobytes())
    return level, float(np.sum(middle * (values - level)) / squares)


def level_of(values: Samples) -> float:
    """Return the mean of the samples. NaN are ignored. Raises NotMeasured for fewer than two samples."""
    good = np.isfinite(values)
    if not good.all():
        values = values[good]
    if values.size < 2:
        raise NotMeasured(f"{values.size} samples are too few for a mean value; at least 2 are needed")
    return float(values.mean())


@lru_cache(maxsize=16)
def _about_the_mean(times: bytes) -> tuple[Samples, float]:
    """Return ``times`` (s) minus their mean, and the sum of the squares. Cached, because an uncertainty needs them
    often.
    """
    t = np.frombuffer(times)
    middle = t - t.mean()
    return middle, float(np.sum(middle**2))


def dynamic_stiffness(
    times: Samples,
    motion: Samples,
    force: Samples,
    frequency: float,
    *,
    lags: tuple[float, float] = (0.0, 0.0),
) -> Stiffness:
    """Return the stiffness K = F/X from first harmonics of ``motion`` (m) and ``force`` (N). The force must increase
    with the motion.

    ``lags`` (s) are the time constants of the sensors of motion and force. Each reading is corrected for its own lag.
    """
    X, F = (
        without_lag(first_harmonic(times, read, frequency), lag, frequency)
        for read, lag in zip((motion, force), lags, strict=True)
    )
    if abs(X) == 0.0:
        raise NotMeasured("nothing moved, so the stiffness cannot be measured")
    return Stiffness(F / X, frequency, abs(X))


def without_drift(motion: Samples, force: Samples) -> Samples:
    """Return the ``force`` of a closed loop minus its linear drift. Raises NotMeasured if the loop is not closed.

    At the start and at the end of the loop, the position and the friction are the same. So the difference of the forces
    is drift.
    """
    edge = TURNING * (motion.max() - motion.min())
    if abs(motion[-1] - motion[0]) > edge:
        raise NotMeasured(
            f"the loop is not closed: it begins at {motion[0]:.3g} m and ends at {motion[-1]:.3g} m"
        )
    ends = max(1, force.size // 50)
    # The means over both ends also differ slightly in motion: that part of the difference belongs to the spring.
    apart = motion[-ends:].mean() - motion[:ends].mean()
    slope = np.cov(motion, force)[0, 1] / motion.var(ddof=1)
    drift = force[-ends:].mean() - force[:ends].mean() - slope * apart
    return np.asarray(force - drift * np.linspace(-0.5, 0.5, force.size))


def secant_stiffness(motion: Samples, force: Samples) -> float:
    """Return ΔF/Δx (N/m) between the two turning points of a slow loop."""
    if not (np.isfinite(motion).all() and np.isfinite(force).all()):
        raise NotMeasured("samples of the slow loop are missing")
    low, high = float(motion.min()), float(motion.max())
    if not high > low:
        raise NotMeasured("nothing moved, so the stiffness cannot be measured")
    edge = TURNING * (high - low)
    top, bottom = motion >= high - edge, motion <= low + edge
    travel = motion[top].mean() - motion[bottom].mean()
    return float((force[top].mean() - force[bottom].mean()) / travel)


def loop_energy(motion: Samples, force: Samples) -> float:
    """Return ∮F dx (J) over a loop; positive for dissipation. The loop is closed by a line from the last point to the
    first.
    """
    return float(0.5 * np.sum((force + np.roll(force, -1)) * (np.roll(motion, -1) - motion)))


def whole_cycles(
    times: Samples,
    cycle: Samples,
    running: npt.NDArray[np.bool_],
    *,
    first: int,
    count: int,
    frequency: float,
) -> npt.NDArray[np.bool_]:
    """Return a mask of the samples in ``count`` whole cycles that begin with cycle ``first``.

    ``cycle`` is the sampled number of cycles that the generator has completed. ``running`` is True while it runs;
    earlier values of ``cycle`` belong to the previous program. Raises NotMeasured if the generator never completed
    ``first`` cycles, or if the samples end too early.
    """
    begun = np.flatnonzero(running & (cycle >= first))
    if begun.size == 0:
        raise NotMeasured(f"the generator did not complete the {first} cycles before the measurement")
    start, end = times[begun[0]], times[begun[0]] + count / frequency
    inside = (times >= start - 1e-9) & (times < end - 1e-9)
    if (
        np.count_nonzero(inside) < SAMPLES_PER_CYCLE_MIN * count
        or times[-1] < end - 2 / frequency / SAMPLES_PER_CYCLE_MIN
    ):
        raise NotMeasured(
            f"the samples end at {times[-1]:.3f} s, but {count} whole cycles end at {end:.3f} s"
        )
    return np.asarray(inside, np.bool_)


def without_inertia(force: complex, motion: complex, mass: float, frequency: float) -> complex:
    """Return the amplitude of the spring's force from that of the actuator's force: F_spring = F_act − m ẍ.

    ``force`` (N) and ``motion`` (m) have the same positive direction; ẍ = −ω² x.
    """
    return force + mass * (tau * frequency) ** 2 * motion


VERTICAL_CELLS: Final = BY_GROUP[Group.VERTICAL_LOAD_CELL]
SHEAR_CELLS: Final = BY_GROUP[Group.LATERAL_LOAD_CELL]
HEIGHTS: Final = BY_GROUP[Group.HEIGHT]
CHAMBERS: Final = ("bellows", "auxiliary")
PRESSURES: Final = BY_GROUP[Group.PRESSURE]
BELLOWS_TEMPERATURES: Final = tuple(f"{side}.bellows_temperature" for side in SIDES)
#: Signals of the state of the generator in its program.
GENERATOR: Final = ("rig.program", "rig.generator_cycle")


def harmonic(
    rig: Mapping[str, float], times: Samples, series: Samples, frequency: float, *signals: str
) -> complex:
    """Return the first harmonic of a ``series`` that was computed from ``signals``, corrected for the mean lag of these
    signals.
    """
    return without_lag(first_harmonic(times, series, frequency), lag_of(rig, *signals), frequency)
