"""A car in the tick: what moves it is measured, what it moves is the springs, and it ends as any program does."""

from dataclasses import asdict

import numpy as np
import pytest

from bench_protocol.car import MovingCar, move_car, track_wave
from bench_protocol.rates import TICK
from bench_protocol.units import Hz, kN, m, mm, ms
from bench_protocol.words import CONTROL_MODES, Program
from bench_sim.rig.controls import Target

FORCE, DISPLACEMENT = (CONTROL_MODES.index(mode) for mode in ("force", "displacement"))
STOP = {f"car_stop_travel_{k}": (20 + 5 * k) * mm for k in range(1, 10)}
#: A car that no spring moves: its track alone moves them.
HEAVY = {
    "car_mass": 1e9, "car_roll_gyration": 1.3 * m, "car_track_frequency": 1.2 * Hz, "car_track_waves": 6,
    "car_piston_lead": 14 * ms, "car_platform_lead": 8 * ms, **STOP,
}  # fmt: skip
#: One that they do move, and that wind moves.
LIGHT = HEAVY | {
    "car_mass": 3000, "car_centre_height": 0.67 * m, "car_damper_rate": 30 * kN, "car_damper_depth": 1.1 * m,
    "car_bump_stop_depth": 1.1 * m, "car_anti_roll_stiffness": 940 * kN, "car_wind_height": 0.4 * m,
}  # fmt: skip
NAMES = (
    "car.shear", "car.height", "car.roll", "car.wind", "left.height", "right.height", "lateral.displacement",
    "rig.program", "rig.generator_cycle",
)  # fmt: skip


@pytest.fixture
def floating(commander):
    """A bench whose springs carry the bolster, which its actuators hold where it is."""
    commander.arm()
    commander.hold_height()
    commander.apply(lateral_control=DISPLACEMENT)
    return commander


def watch(commander, seconds):
    rows = []
    for _ in range(round(seconds / 0.02)):
        commander.cycle()
        rows.append([commander.read(name) for name in NAMES])
    return dict(zip(NAMES, np.array(rows).T, strict=True))


def begin(commander, car, **more):
    commander.apply(**car | more)
    assert commander.coil("program_car")[0] == 5


def test_springs_follow_a_track_that_moves_under_a_car_that_stands(floating):
    begin(floating, HEAVY, car_track_vertical=5 * mm)
    found = watch(floating, 7.5)
    there = np.isfinite(found["car.height"])
    assert there.sum() == pytest.approx(6 / 1.2 * 50, abs=2)
    asked = found["car.height"][there]
    assert asked.min() == pytest.approx(-5 * mm, abs=0.02 * mm)
    moved = 0.5 * (found["left.height"] + found["right.height"])[there]
    assert moved - moved[0] == pytest.approx(asked, abs=0.4 * mm)
    assert found["rig.program"][-1] == Program.IDLE
    assert found["rig.generator_cycle"][-1] == 6


def test_a_track_in_roll_rolls_the_springs(floating):
    begin(floating, HEAVY, car_track_roll=4e-3)
    found = watch(floating, 7.5)
    there = np.isfinite(found["car.roll"])
    b = floating.rig.plant.parameters.spring_half_spacing
    rolled = 0.5 * (found["left.height"] - found["right.height"])[there] / b
    assert found["car.roll"][there].min() == pytest.approx(-4e-3, abs=2e-5)
    assert rolled - rolled[0] == pytest.approx(found["car.roll"][there], abs=0.4e-3)


def test_the_tick_moves_the_car_as_the_law_in_python_does(floating):
    """Tick by tick, by what the tick felt: the same motion to the last digits."""
    begin(floating, LIGHT, car_track_lateral=3 * mm)
    floating.cycle(60, car_wind_setpoint=400.0)
    rig = floating.rig
    for _ in range(60):
        before, phase = car_of(rig), float(rig._controls["phase"][0])
        rig.run(1)
        after = car_of(rig)
        assert after.wind == pytest.approx(400.0)
        assert after.track[0] == pytest.approx(3 * mm * track_wave(phase))
        for name in ("wind", "track", "track_rate", "springs"):
            setattr(before, name, getattr(after, name))
        move_car(before, TICK)
        for name in ("place", "speed", "acceleration"):
            assert getattr(before, name) == pytest.approx(getattr(after, name), rel=1e-12), name
    assert max(map(abs, after.springs)) > 1.0  # it did feel them


def car_of(rig):
    """The car of a rig as it is."""
    car = rig._controls["car"]
    return MovingCar(**{name: car[name].tolist() for name in asdict(MovingCar())})


def test_a_ride_that_is_stopped_comes_back_within_a_second(floating):
    rest = floating.read("left.height")
    begin(floating, HEAVY, car_track_vertical=8 * mm)
    watch(floating, 1.4)
    assert rest - floating.read("left.height") > 5 * mm
    assert floating.coil("program_stop")[0] == 5
    found = watch(floating, 1.5)
    assert found["rig.program"][-1] == Program.STOPPED
    assert np.isnan(found["car.shear"][-1])
    assert floating.read("left.height") == pytest.approx(rest, abs=0.3 * mm)


def test_a_ride_that_is_held_goes_on_from_there(floating):
    begin(floating, HEAVY, car_track_vertical=8 * mm)
    watch(floating, 1.4)
    assert floating.coil("program_hold")[0] == 5
    held = watch(floating, 1.0)["left.height"][20:]
    assert np.ptp(held) < 0.5 * mm
    assert floating.coil("program_run")[0] == 5
    found = watch(floating, 6.0)
    assert found["rig.program"][-1] == Program.IDLE
    assert found["rig.generator_cycle"][-1] == 6


@pytest.mark.parametrize("reads", ["nothing", "low"])
def test_a_car_that_feels_no_force_or_too_much_ends_its_ride(floating, reads):
    begin(floating, LIGHT, car_track_lateral=3 * mm)
    watch(floating, 2.0)
    floating.rig.faults.on("broken_wire", {"sensor": "load_cell.5", "reads": reads})
    found = watch(floating, 0.5)
    assert found["rig.program"][-1] == Program.STOPPED
    assert not floating.rig._controls["offset"].any()
    assert np.isfinite(floating.rig.plant.state).all()


@pytest.mark.parametrize(
    "wrong",
    [
        {"car_mass": 0.0}, {"car_roll_gyration": 0.0}, {"car_track_frequency": 0.0}, {"car_stop_travel_4": 0.0},
        {"car_track_vertical": 50 * mm, "car_track_frequency": 6 * Hz},
    ],
)  # fmt: skip
def test_what_is_no_car_or_cannot_be_followed_does_not_ride(floating, wrong):
    floating.apply(**HEAVY | wrong)
    assert floating.coil("program_car")[0] != 5
    assert floating.rig._controls["program"] == Program.IDLE
    begin(floating, HEAVY | dict.fromkeys(wrong, 0.0) | {name: HEAVY.get(name, 0.0) for name in wrong})


def test_actuators_in_force_control_carry_no_car(floating):
    floating.apply(lateral_control=FORCE, **HEAVY)
    assert floating.coil("program_car")[0] != 5


def test_no_wind_stays_behind(floating):
    """Who commands next finds none, and one beyond its range is refused."""
    floating.cycle(3, car_wind_setpoint=5 * kN)
    assert floating.rig._controls["wind"] == pytest.approx(5 * kN)
    refused = floating.read("rig.refused_setpoints")
    floating.cycle(6, car_wind_setpoint=62 * kN)
    assert floating.rig._controls["wind"] == pytest.approx(5 * kN)
    floating.cycle(6, car_wind_setpoint=0.0)
    assert floating.read("rig.refused_setpoints") >= refused + 5
    assert floating.rig._controls["wind"] == 0.0


def test_springs_are_placed_by_the_rigs_own_dimensions(make_rig):
    """A rig with its actuators elsewhere has other set-points for the same place."""
    ours, other = (make_rig(**one).generator._couplings for one in ({}, {"actuator_half_spacing": 1.5 * m}))
    a = (one._to_targets[Target.VERTICAL_LEFT, 2] for one in (ours, other))
    assert next(a) < next(a)
    assert ours.moved.tolist() == [True, True, True, False, False, True]
