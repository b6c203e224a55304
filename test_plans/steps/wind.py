"""Wind on a car: the side force on one bogie and its moment, in a single gust or in a stochastic wind.

The train runs at V_t perpendicular to a wind W. All values are assumed, from the literature: the side force with
Baker's correlations, a gust as in EN 14067-6, and von Kármán's spectrum seen from a moving train.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import Final

import numpy as np

from bench_protocol.units import m, s
from test_plans.analysis import Samples
from test_plans.analysis.geometry import ACTUATORS

AIR_DENSITY: Final = 1.225  # kg/m³, ISO 2533


@dataclass(frozen=True, slots=True)
class Car:
    """A car in the wind. All values are assumed."""

    side_area: float = 20.0 * 3.0  #: m²
    side_coefficient: float = 1.0  #: at the stall angle and above
    stall_angle: float = pi / 3  #: rad
    exponent: float = 1.2
    length: float = 20.0 * m
    pressure_height: float = 1.2 * m  #: of the wind's force above the top plates of the springs


CAR: Final = Car()
#: Highest wind of the gust over the mean wind around it, as in EN 14067-6.
GUST_FACTOR: Final = 1.6946
#: Distance along the track from the peak to 1/e of the gust, before averaging over the car.
GUST_LENGTH: Final = 12.0 * m
TURBULENCE: Final = 0.15
LENGTH_SCALE: Final = 100.0 * m
#: Rise time of the mean wind, long enough to excite no oscillation.
RISE: Final = 4.0 * s
STEP: Final = 0.01 * s


def side_force(wind: Samples | float, train_speed: float, car: Car = CAR) -> Samples:
    """Return the side force on one bogie, ½ ρ A C(β) V_r² / 2 (N); ``wind`` and ``train_speed`` in m/s.

    C(β) = C₉₀ min(1, sin β / sin β_s)^1.2 with β = atan2(W, V_t) and V_r² = V_t² + W².
    """
    speed = np.hypot(train_speed, wind)
    share = np.minimum(np.abs(wind) / np.maximum(speed, 1e-9) / np.sin(car.stall_angle), 1.0)
    coefficient = car.side_coefficient * np.sign(wind) * share**car.exponent
    return np.asarray(0.25 * AIR_DENSITY * car.side_area * coefficient * speed**2)


def gust(peak: float, train_speed: float, times: Samples, middle: float, car: Car = CAR) -> Samples:
    """Return the wind (m/s) of a gust at equally spaced ``times`` (s). It has its ``peak`` (m/s) at the time ``middle``
    (s).

    The wind is U (1 + 0.6946 e^{−|x|/L}) with x = V_t (t − t_m), averaged over the length of the car.
    """
    mean = peak / GUST_FACTOR
    edges = train_speed * (times - middle)[:, None] + np.array([-0.5, 0.5]) * car.length
    # ∫ e^{−|x|/L} dx, which is odd in x.
    area = np.sign(edges) * GUST_LENGTH * -np.expm1(-np.abs(edges) / GUST_LENGTH)
    return np.asarray(mean * (1.0 + (GUST_FACTOR - 1.0) * np.diff(area, axis=1)[:, 0] / car.length))


def spectrum(f: Samples, mean: float, train_speed: float) -> Samples:
    """Return von Kármán's one-sided spectrum (m²/s² per Hz) of a wind of ``mean`` (m/s), as seen from the moving train.

    f S/σ² = 4x/(1 + 70.8x²)^{5/6} [c² + (1 − c²)(0.5 + 94.4x²)/(1 + 70.8x²)], x = f L/V_r, c = U/V_r, σ = 0.15 U
    (Cooper's moving observer).
    """
    speed = float(np.hypot(train_speed, mean))
    time, c2 = LENGTH_SCALE / speed, (mean / speed) ** 2
    x2 = np.square(f * time)
    mixed = c2 + (1.0 - c2) * (0.5 + 94.4 * x2) / (1.0 + 70.8 * x2)
    return np.asarray((TURBULENCE * mean) ** 2 * time * 4.0 / (1.0 + 70.8 * x2) ** (5 / 6) * mixed)


def admittance(f: Samples, mean: float, train_speed: float, car: Car = CAR) -> Samples:
    """Return the share of the spectrum that remains after averaging over the length of the car: 1/(1 + (2 f
    B/V_r)^1.2).
    """
    return np.asarray(1.0 / (1.0 + (2.0 * f * car.length / np.hypot(train_speed, mean)) ** 1.2))


def random_process(times: Samples, density: Samples, generator: np.random.Generator) -> Samples:
    """Return a stationary Gaussian process (n,) at equally spaced ``times``. ``density`` is its one-sided spectrum,
    from frequency 0 to n/2T.
    """
    n, step = times.size, times[1] - times[0]
    parts = generator.standard_normal((2, density.size))
    half = (parts[0] + 1j * parts[1]) * 0.5 * np.sqrt(density / (n * step)) * n
    half[0] = 0.0
    return np.asarray(np.fft.irfft(half, n))


def fade(times: Samples, rise: float = RISE) -> Samples:
    """Return a window over ``times``: 0 at both ends, 1 in between, with half-cosine edges of ``rise`` s."""
    edge = np.clip(np.minimum(times, times[-1] - times) / rise, 0.0, 1.0)
    return np.asarray(0.5 * (1.0 - np.cos(pi * edge)))


def on_the_bolster(force: Samples, rig: Mapping[str, float], car: Car = CAR) -> dict[str, Samples]:
    """Return the set-points of the actuators for a wind ``force`` (N) on the bogie, by reading.

    The lateral actuator acts below the wind; the vertical actuators supply the missing moment with opposite forces.
    """
    arm = car.pressure_height - (rig["centre_height"] + rig["lateral_actuator_height"])
    left, right = (rig[one] for one in ACTUATORS)
    more = force * arm / (left - right)
    return {"lateral.force": force, "vertical_left.force": more, "vertical_right.force": -more}
