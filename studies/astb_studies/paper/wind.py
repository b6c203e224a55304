"""Crosswind: the lateral force of the air on a moving car, from a mean wind and gusts that come from a seed.

The train runs with V_t across a wind of Ū + u(t), square to the track. The gusts u are a sum of harmonics k/T with
Gaussian amplitudes from the counter hash of `bench_sim.model.noise`. They are periodic in the length T of the record
and depend only on the seed; a shorter step adds points to the same wind. Variations slower than 1/T are part of the
mean.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Final

import numpy as np
from numpy.typing import NDArray

from bench_sim.model.compiled import compiled
from bench_sim.model.noise import normal

Real = float | NDArray[np.float64]
Samples = NDArray[np.float64]

#: First channel of the counter hash that the gusts use; the sensors' noise has those below.
_CHANNELS: Final = 1 << 16
_ALONG_THE_CAR: Final = _CHANNELS - 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Crosswind:
    """A train in the wind, per car; read by `load_paper`."""

    train_speed: Annotated[float, "m/s"]
    air_density: Annotated[float, "kg/m3"]
    side_area: Annotated[float, "m2"]
    side_coefficient: Annotated[float, "1"]
    stall_angle: Annotated[float, "rad"]
    coefficient_exponent: Annotated[float, "1"]
    turbulence_intensity: Annotated[float, "1"]
    length_scale: Annotated[float, "m"]
    coherence_decay: Annotated[float, "1"]
    car_length: Annotated[float, "m"]


def coefficient(beta: Real, wind: Crosswind) -> Real:
    """C_S(β) = C_90 min(1, (sin β/sin β_s)^1.2): lateral force coefficient at the yaw angle ``beta`` (rad), odd in β.

    Assumed, with the shape of the literature's correlations: it grows up to the stall angle β_s and stays there.
    """
    s = np.sin(beta)
    share = np.minimum(np.abs(s) / np.sin(wind.stall_angle), 1.0)
    return wind.side_coefficient * np.sign(s) * share**wind.coefficient_exponent


def lateral_force(speed: Real, wind: Crosswind) -> Real:
    """(1) F_w = ½ ρ A_s C_S(β) V_r² in N per car; ``speed`` W of the wind in m/s, V_r² = V_t² + W², β = atan2(W, V_t).

    That there is such a force: stated in the paper; its form is that of the literature. Each bogie bears half.
    """
    beta = np.arctan2(speed, wind.train_speed)
    dynamic_pressure = 0.5 * wind.air_density * (wind.train_speed**2 + np.square(speed))
    return dynamic_pressure * wind.side_area * coefficient(beta, wind)


def relative_speed(mean: float, wind: Crosswind) -> float:
    """V_r = √(V_t² + Ū²) in m/s, ``mean`` in m/s."""
    return float(np.hypot(wind.train_speed, mean))


def spectrum(f: Real, mean: float, wind: Crosswind) -> Real:
    """One-sided spectrum of u as the moving train meets it, in m²/s² per Hz; ``f`` in Hz, ``mean`` Ū in m/s.

        f S/σ² = 4 x/(1 + 70.8 x²)^{5/6} · [c² + (1 − c²) (0.5 + 94.4 x²)/(1 + 70.8 x²)],  x = f L/V_r,  c = Ū/V_r

    Literature: von Kármán's spectrum for a train at rest (c = 1); in motion Cooper's observer, who crosses gusts of
    isotropic turbulence at an angle and mixes longitudinal and transverse correlation. Its integral is σ² = (I_u Ū)².
    """
    V_r = relative_speed(mean, wind)
    if V_r == 0.0:
        return np.zeros_like(np.asarray(f, dtype=np.float64))
    time = wind.length_scale / V_r
    x2 = np.square(np.asarray(f) * time)
    c2 = (mean / V_r) ** 2
    mixed = c2 + (1.0 - c2) * (0.5 + 94.4 * x2) / (1.0 + 70.8 * x2)
    return (wind.turbulence_intensity * mean) ** 2 * time * 4.0 / (1.0 + 70.8 * x2) ** (5.0 / 6.0) * mixed


def coherence(f: Real, distance: Real, mean: float, wind: Crosswind) -> Real:
    """Davenport's exp(−C f |Δ|/V_r): cross spectrum over spectrum, at ``distance`` Δ (m) along the train; literature.

    It is real, because the travel of the gusts along the train is neglected.
    """
    return np.exp(-_decay(f, mean, wind) * np.abs(distance))


def line_admittance(f: Real, mean: float, wind: Crosswind) -> Real:
    """χ² = 2 (e^{−η} − 1 + η)/η², η = C f B/V_r: spectrum of the mean of u over the car length B, over that of u.

    Derived: Davenport's coherence integrated over both ends.
    """
    eta = np.asarray(_decay(f, mean, wind) * wind.car_length)
    large = np.maximum(eta, 1e-5)
    return np.where(eta < 1e-5, 1.0 - eta / 3.0, 2.0 * (np.expm1(-large) + large) / large**2)


def empirical_admittance(f: Real, mean: float, wind: Crosswind) -> Real:
    """χ² = 1/(1 + (2 f B/V_r)^1.2); assumed, in the shape of the literature's fits: more of the fast gusts pass."""
    V_r = relative_speed(mean, wind)
    return 1.0 / (1.0 + (2.0 * np.asarray(f) * wind.car_length / V_r) ** 1.2)


def gusts(time: Samples, mean: float, seed: int, wind: Crosswind, positions: Samples) -> Samples:
    """Return u(t) in m/s at ``positions`` (m, shape (k,)) along the train, shape (k, n).

    ``time`` (s, shape (n,)) has an even step, ``mean`` is Ū in m/s. The spectra are `spectrum`, between two positions
    `coherence`, up to half the sampling rate. Neighbours make a Markov chain along the train, because Davenport's
    coherence is exponential in the distance: no matrix is factorised. ValueError for an uneven ``time``.
    """
    f, step = _harmonics(time)
    amplitude = np.sqrt(np.asarray(spectrum(f, mean, wind)))
    order = np.argsort(positions)
    u = np.empty((len(order), len(time)))
    past, here = np.zeros(len(f), dtype=np.complex128), 0.0
    for place, k in enumerate(order):
        rho = coherence(f, positions[k] - here, mean, wind) if place else np.zeros(len(f))
        past = rho * past + np.sqrt(1.0 - np.square(rho)) * _variates(seed, _CHANNELS + 2 * place, len(f))
        here = positions[k]
        u[k] = _synthesis(amplitude * past, len(time), step)
    return u


def wind_force(
    time: Samples,
    mean: float,
    seed: int,
    wind: Crosswind,
    admittance: Callable[[Real, float, Crosswind], Real] = line_admittance,
) -> Samples:
    """Return the lateral force of the gusty wind on one car, F_w(Ū + u) in N, shape (n,); half of it on each bogie.

    ``time`` (s, shape (n,)) has an even step, ``mean`` is Ū in m/s; u is the mean gust over the car length. Equal
    integers ``seed`` give equal realisations. ValueError for an uneven ``time``.
    """
    f, step = _harmonics(time)
    power = np.asarray(spectrum(f, mean, wind))
    if np.any(power):
        power = power * admittance(f, mean, wind)
    u = _synthesis(np.sqrt(power) * _variates(seed, _ALONG_THE_CAR, len(f)), len(time), step)
    return np.asarray(lateral_force(mean + u, wind))


@compiled
def fill_normals(seed: int, channel: int, out: Any) -> None:
    """Write variates of N(0, 1) into ``out`` (n,): its index is the counter."""
    for i in range(out.size):
        out[i] = normal(seed, i, channel)


def _variates(seed: int, channel: int, n: int) -> NDArray[np.complex128]:
    """Complex Gaussian amplitudes with E|ξ|² = 1; the index is that of the harmonic."""
    parts = np.empty((2, n))
    fill_normals(seed, channel, parts[0])
    fill_normals(seed, channel + 1, parts[1])
    return (parts[0] + 1j * parts[1]) * np.sqrt(0.5)


def _harmonics(time: Samples) -> tuple[Samples, float]:
    """The frequencies k/T in Hz from 0 to half the sampling rate, and the step in s."""
    if len(time) < 2:
        raise ValueError(f"time has {len(time)} samples; give at least two samples at a constant step")
    step = float(time[-1] - time[0]) / (len(time) - 1)
    if not (step > 0.0 and np.max(np.abs(np.diff(time) - step)) < 1e-3 * step):
        raise ValueError(
            f"time has steps of {np.diff(time).min():g} to {np.diff(time).max():g} s; the step must be constant"
        )
    return np.arange(len(time) // 2 + 1) / (len(time) * step), step


def _synthesis(density: NDArray[np.complex128], n: int, step: float) -> Samples:
    """Σ √(2 Δf) |Z_k| cos(2π f_k t + arg Z_k) for amplitudes Z_k whose mean square is the one-sided spectrum."""
    half = density * np.sqrt(0.5 / (n * step)) * n
    half[0] = 0.0
    if n % 2 == 0:
        half[-1] = 0.0
    return np.fft.irfft(half, n)


def _decay(f: Real, mean: float, wind: Crosswind) -> Real:
    """C f/V_r in 1/m."""
    V_r = relative_speed(mean, wind)
    return (
        wind.coherence_decay * np.asarray(f) / V_r
        if V_r > 0.0
        else np.zeros_like(np.asarray(f, dtype=np.float64))
    )
