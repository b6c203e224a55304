"""Equations of motion of a simulated car on the measured springs, for Python on a host and for a compiled tick.

The functions use numbers only: a rig compiles them, a host calls them in Python.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, pi, sin
from typing import Any, Final

#: Points of a bump stop's force over travel.
STOP_POINTS: Final = 9
#: Degrees of freedom of a car, and of its springs: lateral, vertical, roll.
WAYS: Final = 3


def _still() -> list[float]:
    return [0.0] * WAYS


def _no_stop() -> list[float]:
    return [0.0] * STOP_POINTS


@dataclass(slots=True)
class MovingCar:
    """Half a car on one bogie (SI): parameters, loads and motion. The compiled tick of a rig has a record with these
    fields.
    """

    mass: float = 0.0
    inertia: float = 0.0
    gravity: float = 0.0
    centre_height: float = 0.0  #: of the centre of gravity above the top plates
    floor_depth: float = 0.0  #: below the centre of gravity, as the other depths
    wind_height: float = 0.0  #: above the centre of gravity
    damper_rate: float = 0.0
    damper_depth: float = 0.0
    bump_stop_depth: float = 0.0
    bump_stop_travel: list[float] = field(default_factory=_no_stop)
    bump_stop_force: list[float] = field(default_factory=_no_stop)
    anti_roll_stiffness: float = 0.0
    wind: float = 0.0  #: force, N
    track: list[float] = field(default_factory=_still)  #: position of the bogie
    track_rate: list[float] = field(default_factory=_still)
    springs: list[float] = field(default_factory=_still)  #: their load on the car (`geometry.Springs`)
    place: list[float] = field(default_factory=_still)  #: position of its centre of gravity
    speed: list[float] = field(default_factory=_still)
    acceleration: list[float] = field(default_factory=_still)
    bump_stop: float = 0.0  #: its force on the car, N


def track_wave(phase: float) -> float:
    """Return ½(1 − cos 2πx), a unilateral cosine after x waves."""
    return 0.5 * (1.0 - cos(2.0 * pi * phase))


def track_slope(phase: float) -> float:
    """Return the derivative of `track_wave` with respect to the phase, π sin 2πx."""
    return pi * sin(2.0 * pi * phase)


def move_car(car: Any, dt: float) -> None:
    """Advance a `MovingCar` by ``dt`` s under wind, track and springs: first speeds, then positions (symplectic Euler).

    m ÿ = W + F_y + F_d + F_bs

    m z̈ = F_z

    J φ̈ = M + e F_y + e_d F_d + e_s F_bs − h_w W − K_arb (φ − φ_t) + m g e φ

    Damper and bump stop act between the car and the track. The force of the stop is linear between its points, and is
    extrapolated beyond the last one.
    """
    roll = car.place[2]
    damper = -car.damper_rate * (car.speed[0] - car.track_rate[0] + car.damper_depth * car.speed[2])
    travel = car.place[0] - car.track[0] + car.bump_stop_depth * roll
    way, stop = abs(travel), 0.0
    if way > car.bump_stop_travel[0]:
        k = 1
        while k < STOP_POINTS - 1 and way > car.bump_stop_travel[k]:
            k += 1
        slope = (car.bump_stop_force[k] - car.bump_stop_force[k - 1]) / (
            car.bump_stop_travel[k] - car.bump_stop_travel[k - 1]
        )
        stop = car.bump_stop_force[k - 1] + slope * (way - car.bump_stop_travel[k - 1])
        if travel > 0.0:
            stop = -stop
    moment = (
        car.springs[2]
        + car.centre_height * car.springs[0]
        + car.damper_depth * damper
        + car.bump_stop_depth * stop
        - car.wind_height * car.wind
        - car.anti_roll_stiffness * (roll - car.track[2])
        + car.mass * car.gravity * car.centre_height * roll
    )
    car.acceleration[0] = (car.wind + car.springs[0] + damper + stop) / car.mass
    car.acceleration[1] = car.springs[1] / car.mass
    car.acceleration[2] = moment / car.inertia
    for k in range(WAYS):
        car.speed[k] += dt * car.acceleration[k]
        car.place[k] += dt * car.speed[k]
    car.bump_stop = stop


def springs_ahead(car: Any, ahead: float, lateral: float, vertical: float, rolled: float) -> Any:
    """Return the predicted pose of the springs of a `MovingCar` in ``ahead`` s (`SpringPose`), as three numbers.

    Assumes constant accelerations, and the track at ``lateral`` (m), ``vertical`` (m) and ``rolled`` (rad).
    """
    half = 0.5 * ahead * ahead
    y = car.place[0] + ahead * car.speed[0] + half * car.acceleration[0]
    z = car.place[1] + ahead * car.speed[1] + half * car.acceleration[1]
    roll = car.place[2] + ahead * car.speed[2] + half * car.acceleration[2]
    return y + car.centre_height * roll - lateral, z - vertical, roll - rolled


def floor_acceleration(car: Any) -> Any:
    """Return the lateral acceleration of the floor (m/s²), without the component of gravity on a tilted floor."""
    return car.acceleration[0] + car.floor_depth * car.acceleration[2]
