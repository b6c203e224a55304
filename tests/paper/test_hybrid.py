"""The car in the loop: its equations and its margins by themselves, then on the virtual rig against the car alone."""

from math import exp, pi

import numpy as np
import pytest

from bench_protocol.units import mm, ms
from bench_sim.model.bolster import bump_stop_force
from bench_sim.parameters.vehicle import load_vehicle
from paper_study.hybrid import coupling
from paper_study.hybrid.car import STEP, Car, Place, Ride, Springs, linear
from paper_study.hybrid.coupling import HOST_STEP, path_of, setpoints_of, springs_of
from paper_study.hybrid.loop import FREQUENCIES, Path, loci, margins
from paper_study.plans.ride import CAR, lateness, margins_of
from test_plans.analysis import geometry
from test_plans.description import ours
from test_plans.specimen import ordinary
from test_plans.steps.poses import Home

OURS = ours()
MASS = 10_911.0
G = 9.80665


def test_the_car_is_the_one_of_the_models_file():
    record = load_vehicle().record
    for name in Car.__dataclass_fields__:
        assert getattr(CAR, name) == pytest.approx(np.asarray(record[name]), rel=1e-12), name
    assert record.damper_rate_beyond == record.damper_rate  # one slope: so has this one
    assert record.track_shape == 1


def test_the_bump_stop_is_the_models():
    record = load_vehicle().record
    for travel in np.linspace(-0.08, 0.08, 33).tolist():
        assert CAR.bump_stop(travel) == pytest.approx(bump_stop_force(travel, record), abs=1e-9)


def still(t):
    return 0.0


def linear_springs(place, speed, K, C):
    shear = place[0] + CAR.centre_height * place[2]
    rate = speed[0] + CAR.centre_height * speed[2]
    q, v = np.array([shear, place[1], place[2]]), np.array([rate, speed[1], speed[2]])
    return Springs(*(-(K @ q + C @ v)).tolist())


def test_small_motions_are_those_of_its_matrices():
    """On linear springs without delay it goes as the exact solution of M q̈ + C q̇ + K q = 0."""
    from scipy.linalg import expm

    K, C = np.diag([330e3, 930e3, 930e3]), np.diag([6e3, 60e3, 60e3])
    ride = Ride(CAR, MASS, G, still, still)
    ride.place = [4 * mm, 6 * mm, 2e-3]
    start = np.array([ride.place[0] + CAR.centre_height * ride.place[2], *ride.place[1:], 0.0, 0.0, 0.0])
    M, C_car, K_car = linear(CAR, MASS, G)
    A = np.zeros((6, 6))
    A[:3, 3:] = np.eye(3)
    A[3:, :3], A[3:, 3:] = -np.linalg.solve(M, K_car + K), -np.linalg.solve(M, C_car + C)
    for _ in range(1000):
        ride.step(linear_springs(ride.place, ride.speed, K, C))
    q = expm(A * 1000 * STEP) @ start
    found = [ride.place[0] + CAR.centre_height * ride.place[2], *ride.place[1:]]
    assert np.array(found) == pytest.approx(q[:3], abs=0.01 * 6 * mm)


def swings(path, ahead, K, C, seconds=15.0):
    """Let a car ride on linear springs behind a path; return the motion's growth from its middle to its end."""
    ride = Ride(CAR, MASS, G, still, still)
    ride.place = [2 * mm, 2 * mm, 2e-3]
    late = round((path.beat + path.latency + 0.5 * path.hold) / STEP)
    way = np.zeros((round(seconds / STEP) + late + 2, 3))
    served, rate = np.zeros(3), np.zeros(3)
    omega, size, force = 2 * pi * path.actuator_frequency, [], np.zeros(3)
    for n in range(round(seconds / STEP)):
        place = ride.place_at(ahead)
        way[n + late] = place.shear, place.height, place.roll
        rate += STEP * omega * (omega * (way[n] - served) - 2 * path.actuator_damping * rate)
        served += STEP * rate
        asked = -(K @ served + C @ rate)
        force += (1 - exp(-STEP / path.lag)) * (asked - force)
        ride.step(Springs(*force.tolist()))
        size.append(np.abs([*ride.place]).max())
        if size[-1] > 10.0:
            return np.inf
    half = len(size) // 2
    return max(size[-half // 2 :]) / max(size[half // 2 : half])


@pytest.mark.slow
@pytest.mark.parametrize("ahead", [0.0, 0.9, 1.1])
@pytest.mark.parametrize("latency", [10 * ms, 29 * ms, 120 * ms])
def test_margins_say_which_loops_swing_by_themselves(ahead, latency):
    """The loop is let go in time, and grows where a margin is negative or a gain margin below 1."""
    K, C = np.diag([330e3, 1000e3, 1000e3]), np.diag([5e3, 30e3, 30e3])
    path = Path(20 * ms, latency, 5 * ms, 25.0, 0.7, 1 * ms)
    H = path.response(FREQUENCIES, ahead * path.delay)
    found = margins(FREQUENCIES, loci(FREQUENCIES, linear(CAR, MASS, G), K, C, H))
    if abs(found.phase) < 0.03 or abs(found.gain - 1) < 0.15:
        pytest.skip("too near to the edge to be told in half a minute")
    grows = swings(path, ahead * path.delay, K, C) > 1.0
    assert grows == (found.phase < 0 or found.gain < 1)


def test_a_delay_is_what_the_response_has_at_low_frequencies():
    path = path_of(OURS)
    f = np.array([0.01])
    assert -np.angle(path.response(f, 0.0)) / (2 * pi * f) == pytest.approx(path.delay, rel=1e-3)
    assert abs(np.angle(path.response(f, path.delay))) < 1e-6


@pytest.mark.parametrize("load", ["AW0", "AW3"])
def test_the_ride_is_given_on_our_bench_and_refused_where_everything_comes_late(monkeypatch, load):
    case = ordinary().load(load)
    assert margins_of(case, OURS).enough
    monkeypatch.setattr(coupling, "LATENCY", 200 * ms)
    assert not margins_of(case, OURS).enough


def test_springs_stand_as_the_car_has_them_and_tell_what_they_do():
    place, home = Place(0.05, 4 * mm, -0.015), Home(1 * mm, -1 * mm)
    at = setpoints_of(place, home, OURS)
    left, right = (at[f"vertical_{side}.displacement_setpoint"] for side in ("left", "right"))
    bolster, platform = 0.5 * (left - right - 2 * mm), at["platform.roll_setpoint"]
    middle = 0.5 * (left + right)
    values = {
        "left.height": np.array(middle + bolster - platform),
        "right.height": np.array(middle - bolster + platform),
        "platform.roll": np.array(platform),
        "lateral.displacement": np.array(at["lateral.displacement_setpoint"]),
        "lateral.force": np.array(0.0),
    }
    assert geometry.shear_of(values, OURS) == pytest.approx(place.shear, abs=1e-12)
    assert geometry.roll_of(values, OURS) == pytest.approx(place.roll, abs=1e-12)
    assert middle == pytest.approx(place.height, abs=1e-12)
    assert abs(geometry.stop_travel_of(values, OURS)) < OURS["stop_gap"]


def test_forces_come_from_the_cells():
    """As the plant's cells have it, from a load on each spring and a shear force."""
    F_left, F_right, F_y, M = 60e3, 47e3, -8e3, 900.0
    h, z = OURS["column_height"], OURS["load_cell.5 up"]
    tilt = ((F_left - F_right) + M - h * F_y + z * F_y) / 4
    cells = {
        f"load_cell.{k}": 0.25 * (F_left + F_right) + (tilt if k in (1, 3) else -tilt) for k in range(1, 5)
    }
    found = springs_of({**cells, "load_cell.5": F_y / 2, "load_cell.6": F_y / 2}, OURS)
    assert found == pytest.approx((F_y, F_left + F_right, F_left - F_right + M))


def test_what_comes_later_is_seen_to():
    t = HOST_STEP * np.arange(4000)
    assert lateness(np.sin(7 * t), np.sin(7 * (t - 3 * ms))) == pytest.approx(3 * ms, rel=0.01)
