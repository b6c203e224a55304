"""The car in the loop: its equations and its margins by themselves, then on the virtual rig against the car alone."""

from dataclasses import replace
from math import exp, pi

import numpy as np
import pytest

from astb_studies.paper.hybrid import coupling
from astb_studies.paper.hybrid.agreement import Agreement, followed
from astb_studies.paper.hybrid.car import STEP, Car, Ride, linear
from astb_studies.paper.hybrid.coupling import (
    FORCES,
    HOST_STEP,
    Course,
    Delay,
    path_of,
    springs_of,
)
from astb_studies.paper.hybrid.loop import FREQUENCIES, Path, loci, margins
from astb_studies.paper.hybrid.simulated_ride import NoModel, SimulatedSprings, simulate_ride
from astb_studies.paper.plans.ride import CAR, longest_delay, margins_of
from bench_protocol.car import move_car
from bench_protocol.geometry import STILL, SpringPose, Springs, setpoints_of
from bench_protocol.units import mm, ms
from bench_sim.model.bolster import bump_stop_force
from bench_sim.model.car import RideChannel
from bench_sim.model.vehicle import Vehicle
from bench_sim.parameters import load as parameters
from bench_sim.parameters.vehicle import load_vehicle
from test_plans.analysis import geometry
from test_plans.description import lag_of, ours
from test_plans.specimen import ordinary
from tests.refusals import refuses

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
        own = CAR.at_rest(MASS, G)
        own.place[0] = travel
        move_car(own, 0.0)
        assert own.bump_stop == pytest.approx(bump_stop_force(travel, record), abs=1e-9)


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
    ride.now.place = [4 * mm, 6 * mm, 2e-3]
    start = np.array(
        [ride.now.place[0] + CAR.centre_height * ride.now.place[2], *ride.now.place[1:], 0.0, 0.0, 0.0]
    )
    M, C_car, K_car = linear(CAR, MASS, G)
    A = np.zeros((6, 6))
    A[:3, 3:] = np.eye(3)
    A[3:, :3], A[3:, 3:] = -np.linalg.solve(M, K_car + K), -np.linalg.solve(M, C_car + C)
    for _ in range(1000):
        ride.step(linear_springs(ride.now.place, ride.now.speed, K, C))
    q = expm(A * 1000 * STEP) @ start
    found = [ride.now.place[0] + CAR.centre_height * ride.now.place[2], *ride.now.place[1:]]
    assert np.array(found) == pytest.approx(q[:3], abs=0.01 * 6 * mm)


def swings(path, ahead, K, C, seconds=15.0):
    """Run a car on linear springs along a path; return the motion's growth from its middle to its end."""
    ride = Ride(CAR, MASS, G, still, still)
    ride.now.place = [2 * mm, 2 * mm, 2e-3]
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
        size.append(np.abs([*ride.now.place]).max())
        if size[-1] > 10.0:
            return np.inf
    half = len(size) // 2
    return max(size[-half // 2 :]) / max(size[half // 2 : half])


@pytest.mark.slow
@pytest.mark.parametrize("ahead", [0.0, 0.9, 1.1])
@pytest.mark.parametrize("latency", [10 * ms, 29 * ms, 120 * ms])
def test_margins_say_which_loops_swing_by_themselves(ahead, latency):
    """The loop is released, and its motion grows where a margin is negative or a gain margin below 1."""
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


@pytest.mark.parametrize("by", ["host", "rig"])
@pytest.mark.parametrize("load", ["AW0", "AW3"])
def test_the_ride_is_given_on_our_bench_and_refused_where_everything_comes_late(monkeypatch, load, by):
    case = ordinary().load(load)
    assert margins_of(case, OURS, by=by).enough
    monkeypatch.setitem(coupling.BEATS, by, replace(coupling.BEATS[by], latency=200 * ms))
    assert not margins_of(case, OURS, by=by).enough


def test_the_tick_has_more_gain_left():
    """The lead is a third, and with its square grows what the loop has where the springs' noise is."""
    case = ordinary().load("AW0")
    assert margins_of(case, OURS, by="rig").gain > 3.0 * margins_of(case, OURS).gain


def test_springs_are_placed_as_in_the_car_with_their_readings():
    place = SpringPose(0.05, 4 * mm, -0.015)
    at = setpoints_of(place, OURS)
    left, right = (at[f"vertical_{side}.displacement_setpoint"] for side in ("left", "right"))
    bolster, platform = 0.5 * (left - right), at["platform.roll_setpoint"]
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


def test_delay_and_gain_of_the_springs_are_measured():
    t = HOST_STEP * np.arange(4000)
    late = 3 * ms + lag_of(OURS, "left.height", "right.height") - lag_of(OURS, *FORCES) - 0.5 * HOST_STEP
    asked = np.column_stack([np.sin(7 * t), np.sin(7 * t), np.cos(5 * t)])
    moved = np.column_stack([np.sin(7 * t), 0.99 * np.sin(7 * (t - late)), np.cos(5 * t)])
    found = followed(asked, moved, HOST_STEP, OURS)["up and down"]
    assert found.late == pytest.approx(3 * ms, abs=0.05 * ms)
    assert found.part == pytest.approx(0.99, abs=1e-3)


def test_readings_that_are_held_lie_on_lines_between():
    """A reading that comes every fourth step is no later for that."""
    course = Course(0.0)
    t = HOST_STEP * np.arange(400)
    fast, slow = np.sin(7 * t), np.sin(7 * t)[np.arange(400) // 4 * 4]
    course.commanded = [SpringPose(0.0, 0.0, 0.0)] * 400
    course.read = [[0.0, 0.0, 0.0, one, 0.0] for one in slow.tolist()]
    _, moved = course.places(OURS, 0.0, 390 * HOST_STEP)
    lever = OURS["centre_height"] + OURS["lateral_actuator_height"] + OURS["column_height"]
    assert moved[:, 0] == pytest.approx(lever * fast[:390], abs=5e-3 * lever)


@pytest.mark.parametrize("late", [0.0, 20 * ms, 60 * ms])
@pytest.mark.parametrize("sooner", [-3 * ms, 12 * ms])
def test_a_delay_is_found_of_how_the_springs_followed(late, sooner):
    """Springs rolled by bolster and platform, each late by its own time, come as late as their shares have it."""
    foreseen = Delay.foreseen(OURS)
    at = setpoints_of(SpringPose(0, 0, 1e-3), OURS)
    bolster = at["vertical_left.displacement_setpoint"] / OURS["vertical_left across"]
    roll = (bolster * late - at["platform.roll_setpoint"] * (late - sooner)) / 1e-3
    found = foreseen.after(roll, late, HOST_STEP, OURS)
    assert found.pistons - foreseen.pistons == pytest.approx(late)
    assert found.platform - foreseen.platform == pytest.approx(late - sooner)
    assert path_of(OURS, found).delay == pytest.approx(found.pistons)


def test_a_longer_delay_is_refused_with_the_longest_one():
    case, slow = ordinary().load("AW0"), Delay(140 * ms, 120 * ms, 50 * ms)
    assert not margins_of(case, OURS, slow).enough
    assert margins_of(case, OURS, slow).gain > 0.0  # a locus that goes through 0 has no margin there
    longest = longest_delay(case, OURS, slow)
    assert 60 * ms < longest < 140 * ms
    assert margins_of(case, OURS, replace(slow, pistons=longest)).enough
    assert not margins_of(case, OURS, replace(slow, pistons=longest + 5 * ms)).enough


def test_frames_give_way_to_the_springs_and_pistons_go_further():
    """As forces and moments about the bolster's centre have it: pistons oppose the springs, frames give by F/k."""
    F = Springs(-8e3, 3e3, 900.0)
    still, loaded = (setpoints_of(SpringPose(0, 0, 0), OURS, one) for one in (STILL, F))
    more = {name: loaded[name] - still[name] for name in still}
    k, h = OURS["vertical_frame_stiffness"], OURS["lateral_actuator_height"]
    left, right = (k * more[f"vertical_{side}.displacement_setpoint"] for side in ("left", "right"))
    across = OURS["lateral_frame_stiffness"] * more["lateral.displacement_setpoint"]
    a, e = OURS["vertical_left across"], OURS["centre_height"]
    assert across + F.lateral == pytest.approx(0)
    assert left + right + F.vertical == pytest.approx(0)
    assert a * (left - right) - h * across + F.moment + e * F.lateral == pytest.approx(0)
    assert more["platform.roll_setpoint"] == 0


def test_a_single_car_equals_the_models_vehicle():
    wind = 3e3 * np.sin(0.01 * np.arange(301))
    vehicle = Vehicle(parameters("astb", "AW3").record, load_vehicle().record)
    mass = vehicle.mass
    carried = 0.5 * mass * G
    found = simulate_ride(CAR, mass, SimulatedSprings("astb", "AW3", carried, OURS), wind, 0.01, np.ones(301))
    assert found.of("roll", 0.0, 3.0) == pytest.approx(
        vehicle.ride(wind, 3.0, interval=0.01).of(RideChannel.ROLL), abs=1e-12
    )


def test_springs_that_carry_less_carry_the_car():
    """Without wind and track it is at rest, whatever the files contained; an unreadable file is reported."""
    mass = 2 * 145e3 / G
    quiet = np.zeros(101)
    level = replace(CAR, track_lateral=0.0, track_vertical=0.0)
    less = simulate_ride(level, mass, SimulatedSprings("astb", "AW3", 140e3, OURS), quiet, 0.01, np.ones(101))
    assert np.abs(less.of("roll", 0.0, 1.0)).max() < 1e-9
    assert np.abs(less.of("rising", 0.0, 1.0)).max() < 1e-6
    with refuses(NoModel, "AW7"):
        simulate_ride(CAR, mass, SimulatedSprings("astb", "AW7", 140e3, OURS), quiet, 0.01, np.ones(101))
    with refuses(NoModel, "nowhere.toml"):
        simulate_ride(
            CAR, mass, SimulatedSprings("nowhere.toml", "AW3", 140e3, OURS), quiet, 0.01, np.ones(101)
        )


def test_a_deviation_is_detected_by_its_uncertainty():
    both = Agreement(0.103, 0.100, {"one": 0.6e-3, "other": 0.8e-3})
    assert both.expanded == pytest.approx(2e-3)
    assert both.normalised == pytest.approx(1.5)
