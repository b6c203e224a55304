"""The compiled functions of the FMU of half a car on external springs. They use the equations of the vehicle model."""

from dataclasses import asdict
from enum import IntEnum
from typing import Any, Final

import numpy as np

from astb.fmu.kernels.springs import gone_on
from bench_protocol import car as law
from bench_protocol.car import MovingCar
from bench_protocol.words import SIDES
from bench_sim.model.compiled import compiled

#: The parameters of an instance of the FMU: the car with its state, and two additional parameters.
CAR: Final = np.dtype(
    [
        *((name, "<f8", np.shape(value)) for name, value in asdict(MovingCar()).items()),
        ("roll_gyration", "<f8"),  # m
        ("spring_half_spacing", "<f8"),  # m
    ]
)
#: The car has no other memory.
NOTHING: Final = np.dtype([("nothing", "<f8")])
ROWS: Final = 1


class Force(IntEnum):
    """Indices of the input forces. Each force of the springs has two entries, left and right."""

    VERTICAL = 0  #: of the spring on the car, N up
    LATERAL = 2
    MOMENT = 4  #: N·m, left side up
    WIND = 6  #: N to the left


class CarOutput(IntEnum):
    """Indices of the outputs.

    The displacements of the springs come first, then their speeds and their accelerations.
    """

    HEIGHT = 0  #: of the springs, left and right, and their shear
    HEIGHT_SPEED = 3
    HEIGHT_ACCELERATION = 6
    SHEAR = 9  #: the shear again; the next two are of both springs together
    MEAN_HEIGHT = 10
    ROLL = 11
    ACCELERATION = 12  #: of the floor, lateral
    RISING = 13
    BUMP_STOP = 14
    PLACE = 15  #: of the centre of gravity: to the left, up, roll


INPUTS: Final = 7
#: The track: lateral, vertical, roll, their speeds and accelerations.
MOTIONS: Final = 9
OUTPUTS: Final = CarOutput.PLACE + 3
assert len(SIDES) == 2

_move, _ahead, _shaken = (compiled(one) for one in (law.move_car, law.springs_ahead, law.floor_acceleration))


@compiled
def _follow_track(car: Any, motion: Any, since: float) -> None:
    for way in range(3):
        car.track[way] = gone_on(motion, way, 0, since)
        car.track_rate[way] = gone_on(motion, way, 1, since)


@compiled
def _load(car: Any, u: Any) -> None:
    """Write the forces of springs and wind on the car; the weight is subtracted from the springs' forces."""
    left, right = u[Force.VERTICAL], u[Force.VERTICAL + 1]
    car.springs[0] = u[Force.LATERAL] + u[Force.LATERAL + 1]
    car.springs[1] = left + right - car.mass * car.gravity
    moment = u[Force.MOMENT] + u[Force.MOMENT + 1]
    car.springs[2] = moment + car.spring_half_spacing * (left - right)
    car.wind = u[Force.WIND]
    car.inertia = car.mass * car.roll_gyration * car.roll_gyration


@compiled
def _write_outputs(car: Any, motion: Any, out: Any) -> None:
    shear, height, roll = _ahead(car, 0.0, car.track[0], car.track[1], car.track[2])
    b, e = car.spring_half_spacing, car.centre_height
    out[CarOutput.HEIGHT] = height + b * roll
    out[CarOutput.HEIGHT + 1] = height - b * roll
    out[CarOutput.HEIGHT + 2] = shear
    for rate in range(2):
        # The motion of the car minus that of the track.
        if rate == 0:
            y, z, phi = car.speed[0], car.speed[1], car.speed[2]
            y_t, z_t, phi_t = car.track_rate[0], car.track_rate[1], car.track_rate[2]
        else:
            y, z, phi = car.acceleration[0], car.acceleration[1], car.acceleration[2]
            y_t, z_t, phi_t = motion[6], motion[7], motion[8]
        first = CarOutput.HEIGHT_SPEED + 3 * rate
        out[first] = z - z_t + b * (phi - phi_t)
        out[first + 1] = z - z_t - b * (phi - phi_t)
        out[first + 2] = y + e * phi - y_t
    out[CarOutput.SHEAR], out[CarOutput.MEAN_HEIGHT], out[CarOutput.ROLL] = shear, height, roll
    out[CarOutput.ACCELERATION] = _shaken(car)
    out[CarOutput.RISING] = car.acceleration[1]
    out[CarOutput.BUMP_STOP] = car.bump_stop
    for way in range(3):
        out[CarOutput.PLACE + way] = car.place[way]


def advance(
    x: Any,
    memory: Any,
    u: Any,
    parameters: Any,
    motion: Any,
    since: float,
    dt: float,
    steps: int,
    work: Any,
    out: Any,
) -> None:
    """Advance by ``steps`` fixed steps of ``dt`` s, and write the outputs at their end into ``out`` (`CarOutput`).

    The ``motion`` of the track was set ``since`` s before the first step; the forces are constant. The state is in
    ``parameters``; ``x``, ``memory`` and ``work`` are not used.
    """
    car = parameters[0]
    _load(car, u)
    for k in range(steps):
        _follow_track(car, motion, since + k * dt)
        _move(car, dt)
    _follow_track(car, motion, since + steps * dt)
    _write_outputs(car, motion, out)


def start(x: Any, memory: Any, u: Any, parameters: Any, motion: Any, air: float, work: Any, out: Any) -> None:
    """Set the initial state at rest on the track, with spring forces that balance the weight of the car."""
    car = parameters[0]
    _follow_track(car, motion, 0.0)
    _load(car, u)
    car.place[0] = car.track[0] - car.centre_height * car.track[2]
    car.place[1], car.place[2] = car.track[1], car.track[2]
    for way in range(3):
        car.speed[way] = car.track_rate[way]
    car.speed[0] -= car.centre_height * car.track_rate[2]
    _move(car, 0.0)
    _write_outputs(car, motion, out)
