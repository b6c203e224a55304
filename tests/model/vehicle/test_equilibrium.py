"""The car at rest and leaning in a steady wind."""

import numpy as np
import pytest

from bench_protocol.units import kN, mm
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.bolster import bump_stop_force
from bench_sim.model.car import RideChannel
from bench_sim.model.layout import BRANCHES, Input, State
from tests.refusals import refuses

BODY = slice(State.BOLSTER_LATERAL, State.BOLSTER_LATERAL_SPEED)


def test_the_springs_carry_half_the_car(vehicle):
    for load_case, preload in (("AW0", 53.5 * kN), ("AW3", 145 * kN)):
        v = vehicle(load_case)
        assert v.mass * 9.80665 == pytest.approx(2 * preload)
        assert np.abs(v.slope()).max() < 1e-9
        assert v.algebraic(Algebraic.VERTICAL_FORCE) == pytest.approx(preload)


@pytest.mark.parametrize("load_case", ["AW0", "AW3"])
@pytest.mark.parametrize("bar", [0.0, 940e3])
def test_a_light_wind_deflects_by_force_over_stiffness(vehicle, sway_matrix, load_case, bar):
    """K (y, φ) = F (1, −h_w); isothermal, because a steady wind leaves the gas all the time it wants."""
    v = vehicle(load_case, ("track",), car={"anti_roll_stiffness": bar})
    force = 50.0
    y, roll = np.linalg.solve(sway_matrix(v, "open isothermal"), [force, -force * v.car.wind_height])
    v.lean(force)
    assert v.state[State.BOLSTER_LATERAL] == pytest.approx(y, rel=1e-4)
    assert v.state[State.BOLSTER_ROLL] == pytest.approx(roll, rel=1e-4)


def test_without_any_lever_the_deflection_is_force_over_two_springs(vehicle, stiffness):
    """Wind, springs and centre of gravity at one height, no coupling: y = F/2K_y and no roll."""
    v = vehicle("AW0", ("track",), car={"centre_height": 0.0, "wind_height": 0.0}, coupling_sign=0.0)
    v.lean(200.0)
    assert v.state[State.BOLSTER_LATERAL] == pytest.approx(
        200.0 / (2 * stiffness(v, "open isothermal")[1]), rel=1e-4
    )
    assert abs(v.state[State.BOLSTER_ROLL]) < 1e-12


@pytest.mark.parametrize("load_case", ["AW0", "AW3"])
def test_forces_and_moments_balance_in_a_gale(vehicle, load_case):
    v = vehicle(load_case)
    wind = 15 * kN
    v.lean(wind)
    car, par = v.car, v.parameters
    y, _, roll = v.state[BODY]
    F_y, F_z, M = (
        np.array([v.algebraic(q, side) for side in range(2)])
        for q in (Algebraic.LATERAL_FORCE, Algebraic.VERTICAL_FORCE, Algebraic.ROLL_MOMENT)
    )
    stop = bump_stop_force(y + car.bump_stop_depth * roll, car)
    assert stop < -500
    weight = v.mass * par.gravity
    assert F_z.sum() == pytest.approx(weight, rel=1e-9)
    assert F_y.sum() + stop + wind == pytest.approx(0.0, abs=1e-4)
    # About the middle between the top plates, where the weight has the lever eφ.
    e, b = car.centre_height, par.spring_half_spacing
    moment = b * (F_z[0] - F_z[1]) + M.sum() + weight * e * roll
    moment -= (car.wind_height + e) * wind
    moment += (car.bump_stop_depth - e) * stop
    moment -= car.anti_roll_stiffness * roll
    assert moment == pytest.approx(0.0, abs=1e-3)
    assert F_z[0] > F_z[1]  # the lee side carries more
    assert roll < 0 < y


def test_left_and_right_are_alike(vehicle):
    left = vehicle("AW0").lean(9 * kN).state[BODY].copy()
    right = vehicle("AW0").lean(-9 * kN).state[BODY]
    assert left == pytest.approx(right * [-1, 1, -1], abs=1e-9)


@pytest.mark.parametrize("load_case", ["AW0", "AW3"])
@pytest.mark.parametrize("wind", [0.0, 14 * kN])
def test_a29_what_rests_stays_at_rest(vehicle, load_case, wind):
    v = vehicle(load_case, ("track",)).lean(wind)
    before = v.state.copy()
    v.ride(wind, 60.0, every=1000)
    scale = np.maximum(np.abs(before), 1.0)
    assert np.max(np.abs(v.state - before) / scale) < 1e-8


def test_time_finds_the_same_equilibrium(vehicle):
    """A free car in a steady wind settles at the solver's equilibrium."""
    wind = 8 * kN
    v = vehicle("AW0", ("track", "friction"))
    v.ride(wind, 480.0, every=1000)
    solved = vehicle("AW0", ("track", "friction")).lean(wind)
    assert v.state[BODY] == pytest.approx(solved.state[BODY], rel=1e-6, abs=1e-9)


def test_friction_stops_the_car_near_its_equilibrium(vehicle):
    wind = 8 * kN
    v = vehicle("AW0", ("track",))
    v.ride(wind, 240.0, every=1000)
    y = vehicle("AW0", ("track",)).lean(wind).state[State.BOLSTER_LATERAL]
    limit = 2 * (350 + 1e-3 * 2.06e5)
    assert 1e-6 < abs(v.state[State.BOLSTER_LATERAL] - y) < limit / 100e3


def test_rubber_is_relaxed(vehicle):
    v = vehicle("AW3").lean(10 * kN)
    v.slope(10 * kN)
    for side in range(2):
        first = State.LATERAL_DASHPOT + side * BRANCHES
        bellows = v.algebraic(Algebraic.BELLOWS_LATERAL, side)
        assert v.state[first : first + BRANCHES] == pytest.approx(bellows, abs=1e-9)


def test_a_wind_that_opens_the_differential_pressure_valve_is_refused(vehicle):
    bare = {"anti_roll_stiffness": 0}
    with refuses(ValueError, "1.2 bar"):
        vehicle("AW3", car=bare).lean(30 * kN)
    vehicle("AW3", car=bare, options={"dpv": False}).lean(30 * kN)
    vehicle("AW3").lean(
        30 * kN
    )  # an anti-roll bar takes so much of the moment that the pressures stay nearer


def test_leveling_valves_set_the_car_upright(vehicle):
    wind = 8 * kN
    bare = {"anti_roll_stiffness": 0}  # a bar holds it nearly upright beforehand
    isolated = vehicle("AW0", ("track",), car=bare).lean(wind)
    active = vehicle("AW0", ("track",), car=bare, options={"leveling": True}).lean(wind)
    assert active.state[BODY] == pytest.approx(isolated.state[BODY])
    active.ride(wind, 300.0, every=1000)
    active.slope(wind)
    heights = [active.algebraic(Algebraic.HEIGHT, side) for side in range(2)]
    assert np.abs(heights).max() < 4 * mm
    assert abs(active.state[State.BOLSTER_ROLL]) < 0.3 * abs(isolated.state[State.BOLSTER_ROLL])
    still = active.ride(wind, 5.0)
    assert np.ptp(still.of(RideChannel.ROLL)) < 1e-4
    assert active.inputs[Input.LEFT_LEVELING] == 1.0
