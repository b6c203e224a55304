"""Half a car on one bogie under crosswind: the car body replaces the bolster on the same two air springs.

The six states of the bolster are those of the car body. The states of the platform are those of the bogie, which
follows the track. Gas, orifices, valves, rubber and springs are those of the bench (`air_spring`). The centre of
gravity is e above the top plates. Damper and bump stop act e_d and e_s below it, and the wind acts h_w above it.
The forces of springs, damper and bump stop depend on the displacements of these points relative to the bogie. The
equations of motion of the car body are:

    m ÿ = ½F_w + ΣF_y + F_d + F_bs
    m z̈ = ΣF_z − m g
    J φ̈ = Σ(s_i b F_z,i + e F_y,i + M_i) + e_d F_d + e_s F_bs − ½h_w F_w − K_arb φ + m g e φ

The last term is from the weight: if the body rolls by φ, its centre, e above the springs, moves sideways by eφ.
"""

from dataclasses import dataclass
from enum import IntEnum
from math import cos, pi, sin
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bench_sim.model.air_spring import air_spring
from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.bolster import bump_stop_force, extra_stop_force
from bench_sim.model.compiled import compiled, compiled_entry, compiled_once
from bench_sim.model.layout import BUMP_POINTS, STATES, State
from bench_sim.model.quantities import Quantity
from bench_sim.model.runge_kutta import integrated_states, runge_kutta
from bench_sim.model.step_start import begin


class TrackShape(IntEnum):
    """Shape of the track under the bogie."""

    NONE = 0
    COSINE = 1  #: unilateral cosine, ½a (1 − cos ωt): never below zero, peak to peak a
    HARMONIC = 2  #: a sin ωt


class RideChannel(IntEnum):
    """Columns of a recorded ride, in SI units. Left and up are positive; roll is positive if the left side is up."""

    LATERAL = 0  #: centre of gravity of the car body against the undisturbed track
    VERTICAL = 1
    ROLL = 2
    LATERAL_SPEED = 3
    VERTICAL_SPEED = 4
    ROLL_SPEED = 5
    LATERAL_ACCELERATION = 6
    VERTICAL_ACCELERATION = 7
    ROLL_ACCELERATION = 8
    BOGIE_LATERAL = 9
    BOGIE_VERTICAL = 10
    WIND = 11  #: force on this half of the car, N
    DAMPER = 12  #: force of the lateral damper on the car body, N
    BUMP_STOP = 13  #: force of the lateral bump stop on the car body, N


CHANNELS: Final = len(RideChannel)

#: Parameters of a vehicle in addition to those of its springs.
CAR_QUANTITIES: Final = (
    Quantity("roll_gyration", "m"),
    Quantity("centre_height", "m"),
    Quantity("floor_depth", "m"),
    Quantity("wind_height", "m"),
    Quantity("damper_rate", "N*s/m"),
    Quantity("damper_knee", "m/s"),
    Quantity("damper_rate_beyond", "N*s/m"),
    Quantity("damper_depth", "m"),
    Quantity("bump_stop_depth", "m"),
    Quantity("bump_stop_travel", "m", (BUMP_POINTS,)),
    Quantity("bump_stop_force", "N", (BUMP_POINTS,)),
    Quantity("anti_roll_stiffness", "N*m/rad"),
    Quantity("train_speed", "m/s"),
    Quantity("track_shape", "1"),
    Quantity("track_waves", "1"),
    Quantity("track_wavelength", "m"),
    Quantity("track_vertical", "m"),
    Quantity("track_lateral", "m"),
)

#: The record that compiled code reads as ``car.name``.
CAR: Final = np.dtype([(q.name, np.float64, q.shape) for q in CAR_QUANTITIES])


@compiled
def track_wave(t: float, car: Any) -> tuple[float, float]:
    """Return displacement and rate (1/s) of a track wave with amplitude 1 at ``t`` s, with ω = 2πV/λ.

    Both are 0 before t = 0 and after ``track_waves`` waves.
    """
    omega = 2.0 * pi * car.train_speed / car.track_wavelength
    phase = omega * t
    if phase < 0.0 or phase >= 2.0 * pi * car.track_waves:
        return 0.0, 0.0
    shape = int(car.track_shape)
    if shape == TrackShape.COSINE:
        return 0.5 * (1.0 - cos(phase)), 0.5 * omega * sin(phase)
    if shape == TrackShape.HARMONIC:
        return sin(phase), omega * cos(phase)
    return 0.0, 0.0


@compiled
def place_bogie(t: float, car: Any, x: Any) -> None:
    """Write position and speed of the track under the bogie into the states of the platform."""
    place, speed = track_wave(t, car)
    x[State.PLATFORM_LATERAL] = car.track_lateral * place
    x[State.PLATFORM_LATERAL_SPEED] = car.track_lateral * speed
    x[State.PLATFORM_VERTICAL] = car.track_vertical * place
    x[State.PLATFORM_VERTICAL_SPEED] = car.track_vertical * speed


@compiled
def damper_force(x: Any, car: Any) -> float:
    """Return the force of the lateral damper on the car body in N: −c v, with another rate beyond ±``damper_knee``."""
    speed = (
        x[State.BOLSTER_LATERAL_SPEED]
        - x[State.PLATFORM_LATERAL_SPEED]
        + car.damper_depth * x[State.BOLSTER_ROLL_SPEED]
    )
    slow = min(max(speed, -car.damper_knee), car.damper_knee)
    return -car.damper_rate * slow - car.damper_rate_beyond * (speed - slow)


@compiled
def wind_at(t: float, force: Any, interval: float) -> float:
    """Return the wind force at ``t`` s, interpolated between samples ``interval`` s apart. The last sample stays
    valid.
    """
    s = max(t / interval, 0.0)
    last = force.shape[0] - 1
    if s >= last:
        return force[last]
    n = int(s)
    return force[n] + (s - n) * (force[n + 1] - force[n])


@compiled
def car_term(x: Any, par: Any, car: Any, wind: float, out: Any, dx: Any) -> None:
    """Add all forces except those of the springs to ``dx``, and divide the sums by mass and inertia.

    ``wind`` is the force on this half of the car in N.
    """
    roll = x[State.BOLSTER_ROLL]
    y = x[State.BOLSTER_LATERAL] - x[State.PLATFORM_LATERAL]
    damper = damper_force(x, car)
    bump = bump_stop_force(y + car.bump_stop_depth * roll, car)
    if par.extra_stop_stiffness != 0.0:
        bump += extra_stop_force(y + car.bump_stop_depth * roll, par)
    moment = (
        dx[State.BOLSTER_ROLL_SPEED]
        + car.damper_depth * damper
        + car.bump_stop_depth * bump
        - car.wind_height * wind
        - car.anti_roll_stiffness * (roll - x[State.PLATFORM_ROLL])
        + par.bolster_mass * par.gravity * par.centre_height * roll
    )
    force = dx[State.BOLSTER_LATERAL_SPEED] + wind + damper + bump
    dx[State.BOLSTER_LATERAL_SPEED] = force / par.bolster_mass
    dx[State.BOLSTER_VERTICAL_SPEED] = dx[State.BOLSTER_VERTICAL_SPEED] / par.bolster_mass - par.gravity
    dx[State.BOLSTER_ROLL_SPEED] = moment / par.bolster_inertia
    for k in range(3):
        dx[State.BOLSTER_LATERAL + k] += x[State.BOLSTER_LATERAL_SPEED + k]
    out[Algebraic.BUMP_STOP] = bump
    out[Algebraic.LATERAL_ACCELERATION] = dx[State.BOLSTER_LATERAL_SPEED]


@compiled
def car_slope(
    ahead: float, x: Any, mem: Any, u: Any, par: Any, car: Any, wind: float, dx: Any, out: Any
) -> None:
    """Write dx/dt to ``dx`` under a ``wind`` force in N. `car_term` replaces the terms of actuators, bolster and
    platform.
    """
    air_spring(mem.time + ahead, x, mem, u, par, dx, out)
    car_term(x, par, car, wind, out, dx)


@compiled_once
def riding(ahead: float, x: Any, mem: Any, u: Any, par: Any, given: Any, dx: Any, out: Any) -> None:
    """Compute the right-hand side of the car (`bench_sim.model.runge_kutta`) on its track and in the wind.

    ``given`` contains the car, the time since the first wind sample (s), the wind samples (N), and their interval (s).
    """
    car, since, force, interval = given
    place_bogie(mem.time + ahead, car, x)
    car_slope(ahead, x, mem, u, par, car, wind_at(since + ahead, force, interval), dx, out)


@compiled
def record(x: Any, car: Any, wind: float, slope: Any, out: Any, row: Any) -> None:
    """Write one row of a ride (`RideChannel`) to ``row``."""
    for k in range(6):
        row[RideChannel.LATERAL + k] = x[State.BOLSTER_LATERAL + k]
    for k in range(3):
        row[RideChannel.LATERAL_ACCELERATION + k] = slope[State.BOLSTER_LATERAL_SPEED + k]
    row[RideChannel.BOGIE_LATERAL] = x[State.PLATFORM_LATERAL]
    row[RideChannel.BOGIE_VERTICAL] = x[State.PLATFORM_VERTICAL]
    row[RideChannel.WIND] = wind
    row[RideChannel.DAMPER] = damper_force(x, car)
    row[RideChannel.BUMP_STOP] = out[Algebraic.BUMP_STOP]


@compiled_entry
def ride_on(
    x: Any,
    memory: Any,
    u: Any,
    parameters: Any,
    cars: Any,
    dt: float,
    steps: int,
    force: Any,
    interval: float,
    every: int,
    rows: Any,
    algebraics: Any,
) -> None:
    """Take ``steps`` Runge-Kutta steps of ``dt`` s in place. ``force`` holds the wind force on half the car in N from
    now on, in samples ``interval`` s apart.

    Row k of ``rows`` (CHANNELS) and of ``algebraics`` (ALGEBRAICS) is written before step k·every, until the arrays
    are full.
    """
    mem = memory[0]
    par = parameters[0]
    car = cars[0]
    work = np.empty((5, STATES))
    out = np.zeros(ALGEBRAICS)  # the actuators' places stay as they are: there are none
    states = integrated_states(par)
    slope = work[0]
    for n in range(steps):
        given = car, n * dt, force, interval
        begin(riding, x, mem, u, par, given, slope, out)
        if n % every == 0:
            k = n // every
            if k < rows.shape[0]:
                record(x, car, wind_at(n * dt, force, interval), slope, out, rows[k])
            if k < algebraics.shape[0]:
                algebraics[k] = out
        runge_kutta(riding, dt, states, x, mem, u, par, given, work, out)
        mem.step += 1
        place_bogie(mem.time, car, x)


@compiled_entry
def car_derivative(
    t: float, x: Any, memory: Any, u: Any, parameters: Any, cars: Any, wind: float, dx: Any, out: Any
) -> None:
    """Write dx/dt at ``t`` s under a ``wind`` force in N like `car_slope`, for integrators that choose their own steps.
    Records are passed as arrays of one element.
    """
    mem = memory[0]
    dx[:] = 0.0
    car_slope(t - mem.time, x, mem, u, parameters[0], cars[0], wind, dx, out)


@dataclass(frozen=True, slots=True)
class Ride:
    """A recorded ride: ``time`` in s, ``rows`` with the columns of `RideChannel`, and the variables of `Algebraic` if
    requested.
    """

    time: NDArray[np.float64]
    rows: NDArray[np.float64]
    algebraic: NDArray[np.float64]

    def of(self, channel: RideChannel) -> NDArray[np.float64]:
        """Return one column over time."""
        return self.rows[:, channel]

    def spring(self, quantity: Algebraic, side: int = 0) -> NDArray[np.float64]:
        """Return one algebraic variable over time."""
        return self.algebraic[:, quantity + side]

    def lateral_acceleration(self, depth: float = 0.0, gravity: float = 0.0) -> NDArray[np.float64]:
        """Return ÿ + d φ̈ + g φ in m/s², at ``depth`` m below the centre of gravity.

        With the acceleration of ``gravity`` (m/s²) this is the reading of an accelerometer on the inclined floor. With
        0, it is the acceleration of the motion alone.
        """
        return (
            self.of(RideChannel.LATERAL_ACCELERATION)
            + depth * self.of(RideChannel.ROLL_ACCELERATION)
            + gravity * self.of(RideChannel.ROLL)
        )

    def since(self, start: float) -> "Ride":
        """Return the part of the ride from ``start`` s on."""
        first = int(np.searchsorted(self.time, start - 1e-9))
        return Ride(self.time[first:], self.rows[first:], self.algebraic[first:])
