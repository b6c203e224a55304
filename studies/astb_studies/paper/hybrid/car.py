"""The computed car on measured springs: half a car with lateral, vertical and roll motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from typing import Final

import numpy as np
import numpy.typing as npt

from bench_protocol.car import (
    MovingCar,
    floor_acceleration,
    move_car,
    springs_ahead,
    track_slope,
    track_wave,
)
from bench_protocol.geometry import SpringPose, Springs
from bench_protocol.units import FACTORS, kN, m, mm, s

#: The step by which the car is integrated: 1/40 of what its fastest mode on the bump stop takes for a radian.
STEP: Final = 1e-3 * s


@dataclass(frozen=True, slots=True)
class Car:
    """Half a car on one bogie (SI); heights and depths from its centre of gravity. A test holds it to the model's file.

    The bogie follows a track of unilateral cosines, lateral and vertical.
    """

    roll_gyration: float = 1.33 * m
    centre_height: float = 0.67 * m  #: above the top plates of the springs
    floor_depth: float = 0.6 * m
    wind_height: float = 0.4 * m
    damper_rate: float = 30 * kN  #: N·s/m
    damper_depth: float = 1.1 * m
    bump_stop_depth: float = 1.1 * m
    bump_stop_travel: tuple[float, ...] = tuple(y * mm for y in (25, 30, 35, 40, 45, 50, 55, 60, 65))
    bump_stop_force: tuple[float, ...] = (0, 600, 1760, 3730, 6870, 11580, 17170, 29200, 230000)
    anti_roll_stiffness: float = 940 * kN  #: N·m/rad
    train_speed: float = 100 * FACTORS["km/h"]
    track_wavelength: float = 23.15 * m
    track_vertical: float = 5 * mm
    track_lateral: float = 5 * mm

    @property
    def track_frequency(self) -> float:
        """Number of track waves per second (Hz)."""
        return self.train_speed / self.track_wavelength

    def track(self, t: float) -> tuple[float, float]:
        """Return ½(1 − cos ωt) and its rate (1/s) at ``t`` s after the track has begun."""
        f = self.track_frequency
        return track_wave(f * t), f * track_slope(f * t)

    def at_rest(self, mass: float, gravity: float) -> MovingCar:
        """Return the car at rest, with this ``mass`` (kg)."""
        known = {one.name for one in fields(MovingCar)}
        own = {name: value for name, value in asdict(self).items() if name in known}
        return MovingCar(mass, mass * self.roll_gyration**2, gravity, **own)


class Ride:
    """The motion of a car under wind, track, and the measured forces of the springs (`bench_protocol.car`).

    ``wind`` (N) and the share ``fade`` of the track are functions of the time since the start (s).
    """

    def __init__(
        self,
        car: Car,
        mass: float,
        gravity: float,
        wind: Callable[[float], float],
        fade: Callable[[float], float],
    ) -> None:
        self.car, self.mass, self.gravity, self.wind, self.fade = car, mass, gravity, wind, fade
        self.time = 0.0
        self.now = car.at_rest(mass, gravity)

    def step(self, springs: Springs, dt: float = STEP) -> None:
        """Integrate ``dt`` s under the forces of the springs."""
        now, car = self.now, self.car
        share = self.fade(self.time)
        place, rate = (share * one for one in car.track(self.time))
        now.springs[:] = springs
        now.wind = self.wind(self.time)
        now.track[0], now.track_rate[0] = car.track_lateral * place, car.track_lateral * rate
        move_car(now, dt)
        self.time += dt

    def place_at(self, ahead: float) -> SpringPose:
        """Return the place of the springs ``ahead`` s from now, at the present accelerations; the track is known."""
        car, then = self.car, self.time + ahead
        track = self.fade(then) * car.track(then)[0]
        return SpringPose(
            *springs_ahead(self.now, ahead, car.track_lateral * track, car.track_vertical * track, 0.0)
        )

    @property
    def floor_acceleration(self) -> float:
        """The lateral acceleration of the floor (m/s²), without the component of gravity on an inclined floor."""
        return float(floor_acceleration(self.now))


def linear(
    car: Car, mass: float, gravity: float
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return mass, damping and stiffness (3, 3) over (y + eφ, z, φ) of the car alone, clear of its bump stop.

    In these coordinates the forces of `Springs` act by themselves.
    """
    # y = s − eφ at the centre of gravity, when s is that of the top plates.
    e, d = car.centre_height, car.damper_depth - car.centre_height
    inertia = mass * car.roll_gyration**2
    M = np.array([[mass, 0.0, -mass * e], [0.0, mass, 0.0], [-mass * e, 0.0, inertia + mass * e**2]])
    C = car.damper_rate * np.array([[1.0, 0.0, d], [0.0, 0.0, 0.0], [d, 0.0, d**2]])
    K = np.zeros((3, 3))
    K[2, 2] = car.anti_roll_stiffness - mass * gravity * e
    return M, C, K
