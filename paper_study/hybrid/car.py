"""The car that is computed where the springs are measured: half of one, in lateral and vertical motion and roll."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi, sin
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

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

    def track(self, t: float) -> tuple[float, float]:
        """Return ½(1 − cos ωt) and its rate (1/s) at ``t`` s after the track has begun."""
        omega = 2.0 * pi * self.train_speed / self.track_wavelength
        return sin(0.5 * omega * t) ** 2, 0.5 * omega * sin(omega * t)

    def bump_stop(self, travel: float) -> float:
        """Return the force on the car (N) of a bump stop that is pressed by ``travel`` m: linear beyond its table."""
        ways, forces = self.bump_stop_travel, self.bump_stop_force
        way = abs(travel)
        if way <= ways[0]:
            return 0.0
        k = 1
        while k < len(ways) - 1 and way > ways[k]:
            k += 1
        slope = (forces[k] - forces[k - 1]) / (ways[k] - ways[k - 1])
        force = forces[k - 1] + slope * (way - ways[k - 1])
        return -force if travel > 0.0 else force


class Springs(NamedTuple):
    """What both springs do to the car beyond carrying it (N, N, N·m about the middle of their top plates)."""

    lateral: float
    vertical: float
    moment: float


class Place(NamedTuple):
    """How the springs stand (m, m, rad): sheared, lengthened, rolled."""

    shear: float
    height: float
    roll: float


class Ride:
    """The motion of a car that is pushed by wind and track, and by springs of which it is told.

    m ÿ = W + F_y + F_d + F_bs,  m z̈ = F_z,  J φ̈ = M + e F_y + e_d F_d + e_s F_bs − h_w W − K_arb φ + m g e φ

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
        self.inertia = mass * car.roll_gyration**2
        self.time = 0.0
        self.place = [0.0, 0.0, 0.0]  #: lateral, vertical, roll of the centre of gravity
        self.speed = [0.0, 0.0, 0.0]
        self.acceleration = [0.0, 0.0, 0.0]
        self.stop_force = 0.0

    def _track(self) -> tuple[float, float]:
        place, rate = self.car.track(self.time)
        share = self.fade(self.time)
        return share * place, share * rate

    def step(self, springs: Springs, dt: float = STEP) -> None:
        """Go on by ``dt`` s under what the springs do: speeds first, then places (symplectic Euler)."""
        car, weight = self.car, self.mass * self.gravity
        y, _, roll = self.place
        bogie, bogie_rate = (car.track_lateral * one for one in self._track())
        damper = -car.damper_rate * (self.speed[0] - bogie_rate + car.damper_depth * self.speed[2])
        stop = car.bump_stop(y - bogie + car.bump_stop_depth * roll)
        wind = self.wind(self.time)
        moment = (
            springs.moment
            + car.centre_height * springs.lateral
            + car.damper_depth * damper
            + car.bump_stop_depth * stop
            - car.wind_height * wind
            + (weight * car.centre_height - car.anti_roll_stiffness) * roll
        )
        self.acceleration = [
            (wind + springs.lateral + damper + stop) / self.mass,
            springs.vertical / self.mass,
            moment / self.inertia,
        ]
        for k in range(3):
            self.speed[k] += dt * self.acceleration[k]
            self.place[k] += dt * self.speed[k]
        self.stop_force = stop
        self.time += dt

    def place_at(self, ahead: float) -> Place:
        """Return how the springs will stand ``ahead`` s from now, at the present accelerations; the track is known."""
        y, z, roll = (
            x + ahead * v + 0.5 * ahead**2 * a
            for x, v, a in zip(self.place, self.speed, self.acceleration, strict=True)
        )
        car, then = self.car, self.time + ahead
        track = self.fade(then) * car.track(then)[0]
        return Place(
            y + car.centre_height * roll - car.track_lateral * track, z - car.track_vertical * track, roll
        )

    @property
    def floor_acceleration(self) -> float:
        """The lateral acceleration of the floor (m/s²), without the weight that is felt on a floor that leans."""
        return self.acceleration[0] + self.car.floor_depth * self.acceleration[2]


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
