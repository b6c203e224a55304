"""The ride itself: conservation, convergence, other integrators, and the bench's springs under the car."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_simpson, simpson, solve_ivp

from bench_protocol.units import kN, mm
from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.car import RideChannel, TrackShape, car_derivative, damper_force, track_wave
from bench_sim.model.experiments import LATERAL, VERTICAL, ImposedMotion, impose, isolate
from bench_sim.model.layout import STATES, Input, State
from bench_sim.model.plant import Plant
from bench_sim.model.spring import coupling_stiffness
from bench_sim.parameters import load
from tests.plain_python import compiled_and_plain
from tests.refusals import refuses

SHUT = [Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE]
NOTHING_LOST = ("track", "losses", "damper")
SMOOTH = {"laminar_limit": 0.9}


def stop_energy(car, travel):
    """∫F dx of the bump stop, exact for its table."""
    points = np.concatenate([car.bump_stop_travel[car.bump_stop_travel < abs(travel)], [abs(travel)]])
    forces = np.interp(points, car.bump_stop_travel, car.bump_stop_force)
    return float(np.sum(0.5 * (forces[1:] + forces[:-1]) * np.diff(points)))


def stored_energy(v, ride):
    """Kinetic and potential energy in J of car body, gas, atmosphere, rubber and weight, row by row."""
    par, car = v.parameters, v.car
    y, z, roll = (ride.of(c) for c in (RideChannel.LATERAL, RideChannel.VERTICAL, RideChannel.ROLL))
    speeds = [
        ride.of(c) for c in (RideChannel.LATERAL_SPEED, RideChannel.VERTICAL_SPEED, RideChannel.ROLL_SPEED)
    ]
    masses = [v.mass, v.mass, par.bolster_inertia]
    E = sum(0.5 * m * s**2 for m, s in zip(masses, speeds, strict=True))
    E = (
        E
        + v.mass * par.gravity * (z - 0.5 * par.centre_height * roll**2)
        + 0.5 * car.anti_roll_stiffness * roll**2
    )
    E = E + [stop_energy(car, s) for s in y + car.bump_stop_depth * roll]
    saturated = par.coupling_angle * np.tanh(roll / par.coupling_angle)
    for i in range(2):
        p, V = ride.spring(Algebraic.PRESSURE, i), ride.spring(Algebraic.VOLUME, i)
        zb, yb = ride.spring(Algebraic.BELLOWS_VERTICAL, i), ride.spring(Algebraic.BELLOWS_LATERAL, i)
        E = E + p * V / (par.heat_capacity_ratio - 1.0) + par.atmospheric_pressure * V
        E = E + 0.5 * par.shell_stiffness_vertical[i] * zb**2 + 0.5 * par.shell_stiffness_lateral[i] * yb**2
        gauge = par.nominal_preload[i] / par.effective_area[i]
        E = E + 0.5 * (par.torsional_stiffness[i] + par.torsional_stiffness_slope[i] * gauge) * roll**2
        E = E + par.coupling_sign * coupling_stiffness(par, i) * (y + par.centre_height * roll) * saturated
        F_z, F_y = ride.spring(Algebraic.STACK_VERTICAL, i), ride.spring(Algebraic.STACK_LATERAL, i)
        excess = F_z - par.nominal_preload[i]
        k_z, k_y = par.emergency_stiffness_vertical[i], par.emergency_stiffness_lateral[i]
        # Compressed by excess/k_z against a force that starts at the preload.
        E = E + (par.nominal_preload[i] + 0.5 * excess) * excess / k_z + 0.5 * F_y**2 / k_y
    return E


@pytest.mark.parametrize("load_case", ["AW0", "AW3"])
@pytest.mark.parametrize("bar", [0.0, 940e3])
def test_a_free_car_keeps_its_energy(vehicle, load_case, bar):
    """Without losses, released from a lean against the bump stop: gas, rubber, weight and motion exchange all."""
    v = vehicle(load_case, NOTHING_LOST, car={"anti_roll_stiffness": bar})
    v.lean(12 * kN)
    v.inputs[SHUT] = 0.0
    v.state[State.BOLSTER_VERTICAL_SPEED] = 0.05
    ride = v.ride(0.0, 10.0, springs=True)
    E = stored_energy(v, ride)
    swing = 0.5 * v.mass * np.max(ride.of(RideChannel.LATERAL_SPEED) ** 2)
    assert np.min(ride.of(RideChannel.BUMP_STOP)) < -10 < 10 < np.max(ride.of(RideChannel.BUMP_STOP))
    assert swing > 100
    assert np.ptp(E) < 2e-4 * swing


def test_the_wind_s_work_is_stored_or_damped(vehicle):
    v = vehicle("AW0", ("track", "losses"))
    v.inputs[SHUT] = 0.0
    t = v.dt * np.arange(8001)
    force = 8 * kN * np.sin(2 * np.pi * 0.7 * t) ** 2
    ride = v.ride(force, 8.0, interval=v.dt, springs=True)
    work = cumulative_simpson(
        ride.of(RideChannel.WIND)
        * (ride.of(RideChannel.LATERAL_SPEED) - v.car.wind_height * ride.of(RideChannel.ROLL_SPEED)),
        dx=v.dt,
        initial=0.0,
    )
    at_damper = ride.of(RideChannel.LATERAL_SPEED) + v.car.damper_depth * ride.of(RideChannel.ROLL_SPEED)
    damped = cumulative_simpson(-ride.of(RideChannel.DAMPER) * at_damper, dx=v.dt, initial=0.0)
    assert np.all(np.diff(damped) > -1e-9)
    E = stored_energy(v, ride)
    assert damped[-1] > 100
    assert np.max(np.abs(E - E[0] + damped - work)) < 1e-3 * np.max(np.abs(work))


def test_momentum_changes_by_the_impulse_of_all_forces(vehicle):
    v = vehicle("AW0")
    ride = v.ride([0.0, 15 * kN, 2 * kN, 6 * kN], 6.0, interval=2.0, springs=True)
    F_y = sum(ride.spring(Algebraic.LATERAL_FORCE, i) for i in range(2))
    F_z = sum(ride.spring(Algebraic.VERTICAL_FORCE, i) for i in range(2))
    horizontal = (
        F_y + ride.of(RideChannel.WIND) + ride.of(RideChannel.DAMPER) + ride.of(RideChannel.BUMP_STOP)
    )
    vertical = F_z - v.mass * v.parameters.gravity
    scale = v.mass * np.max(np.abs(ride.of(RideChannel.LATERAL_SPEED)))
    assert np.min(ride.of(RideChannel.BUMP_STOP)) < -100
    for force, channel in ((horizontal, RideChannel.LATERAL_SPEED), (vertical, RideChannel.VERTICAL_SPEED)):
        change = v.mass * (ride.of(channel)[-1] - ride.of(channel)[0])
        assert simpson(force, dx=v.dt) == pytest.approx(change, abs=1e-5 * scale)


@pytest.mark.parametrize("load_case", ["AW0", "AW3"])
def test_the_springs_are_the_bench_s(vehicle, load_case):
    """A car too heavy to move, a bogie that shakes: the springs see the bench's imposed motion, and answer alike."""
    v = vehicle(
        load_case,
        car={"track_shape": TrackShape.HARMONIC, "track_vertical": -8 * mm, "track_lateral": -20 * mm},
        options={"dpv": False},
    )
    frequency = v.car.train_speed / v.car.track_wavelength
    v.parameters.bolster_mass = v.parameters.bolster_inertia = 1e16
    v.parameters.gravity = 0.0
    ride = v.ride(0.0, 3.0, springs=True)

    plant = Plant.at_rest(load("astb").under(load_case).record)
    isolate(plant)
    course = impose(
        plant, [ImposedMotion(VERTICAL, 8 * mm, frequency), ImposedMotion(LATERAL, 20 * mm, frequency)], 3.0
    )
    for side in range(2):
        for quantity in (
            Algebraic.VERTICAL_FORCE,
            Algebraic.LATERAL_FORCE,
            Algebraic.ROLL_MOMENT,
            Algebraic.PRESSURE,
            Algebraic.AUXILIARY_PRESSURE,
            Algebraic.ORIFICE_FLOW,
        ):
            bench = course.of(quantity, side)
            assert np.ptp(bench) > 0
            assert np.max(np.abs(ride.spring(quantity, side) - bench)) < 1e-7 * np.max(np.abs(bench))


def test_scipy_integrates_the_same_derivative_to_the_same_end(vehicle):
    wind = 6 * kN
    ours = vehicle("AW0", ("track", "friction"), **SMOOTH)
    ours.ride(wind, 1.0)
    v = vehicle("AW0", ("track", "friction"), **SMOOTH)
    out = np.empty(ALGEBRAICS)

    def slope(t, x):
        dx = np.empty(STATES)
        car_derivative(t, x, v.memory_array, v.inputs, v.parameter_array, v.car_array, wind, dx, out)
        return dx

    scale = np.maximum(np.abs(v.state), np.abs(ours.state)) + 1e-4
    result = solve_ivp(slope, (0.0, 1.0), v.state.copy(), method="DOP853", rtol=1e-10, atol=1e-11 * scale)
    assert result.success
    assert np.max(np.abs(result.y[:, -1] - ours.state) / scale) < 1e-6


def test_the_step_converges_with_fourth_order(vehicle):
    ends = []
    for dt in (2e-3, 1e-3, 0.5e-3, 0.125e-3):
        v = vehicle("AW0", ("friction",), options={"dt": dt}, emergency_spring=0, **SMOOTH)
        v.ride(2 * kN, 0.4)
        ends.append(v.state[State.BOLSTER_LATERAL : State.PLATFORM_LATERAL].copy())
    found = [np.max(np.abs(end - ends[-1]) / np.abs(ends[-1])) for end in ends[:-1]]
    assert np.log2(found[0] / found[1]) == pytest.approx(4.0, abs=0.4)
    assert found[1] < 1e-6


def test_halving_the_step_hardly_changes_a_ride_with_everything(vehicle):
    ends = []
    for dt in (1e-3, 0.5e-3):
        v = vehicle("AW0", options={"dt": dt})
        ride = v.ride([0.0, 16 * kN, 4 * kN, 9 * kN], 8.0, interval=2.0, every=round(5e-3 / dt))
        ends.append(ride.lateral_acceleration(v.car.floor_depth))
    assert np.sqrt(np.mean((ends[0] - ends[1]) ** 2)) < 2e-3 * np.std(ends[1])


#: Runs compiled here and as plain Python in the twin.
SCENARIO = """
import sys
import numpy as np
from bench_sim.model.vehicle import Vehicle
from bench_sim.parameters import load
from tests.plain_python import compiled_and_plain
from bench_sim.parameters.vehicle import load_vehicle

def run():
    v = Vehicle(load("astb", "AW0").record, load_vehicle().record, leveling=True)
    v.lean(6e3)
    return v.ride([6e3, 2e4, -1e4], 0.1, interval=0.05).rows
"""


@pytest.mark.slow
def test_the_plain_python_twin_agrees(tmp_path):
    rows, twin = compiled_and_plain(SCENARIO, tmp_path)
    assert np.max(np.abs(rows - twin) / (np.max(np.abs(twin), axis=0) + 1e-6)) < 1e-7


def test_rides_in_pieces_are_one_ride(vehicle):
    whole, pieces = vehicle("AW0"), vehicle("AW0")
    a = whole.ride(5 * kN, 2.0).rows
    b = np.concatenate([pieces.ride(5 * kN, 1.0).rows, pieces.ride(5 * kN, 1.0).rows])
    assert np.array_equal(a, b)
    first, second = (vehicle("AW0").ride(5 * kN, 0.5, springs=True).algebraic for _ in range(2))
    assert np.array_equal(first, second)
    assert np.all(first[:, Algebraic.ACTUATOR_FORCE : Algebraic.BUMP_STOP] == 0.0)
    assert np.array_equal(vehicle("AW0").ride(5 * kN, 2.0, every=7).rows, a[::7])


@given(
    forces=st.lists(st.floats(-80e3, 80e3), min_size=2, max_size=6),
    leveling=st.booleans(),
    load_case=st.sampled_from(["AW0", "AW3"]),
)
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_no_storm_breaks_the_arithmetic(vehicle, forces, leveling, load_case):
    v = vehicle(load_case, options={"leveling": leveling})
    ride = v.ride(forces, 3.0, interval=0.5, springs=True)
    assert np.isfinite(ride.rows).all()
    assert np.isfinite(ride.algebraic).all()
    assert ride.algebraic[:, Algebraic.PRESSURE].min() > 0


@pytest.mark.parametrize("shape", [TrackShape.COSINE, TrackShape.HARMONIC])
def test_the_bogie_follows_the_track(vehicle, shape):
    v = vehicle("AW0", car={"track_shape": shape, "track_waves": 2.0, "track_lateral": 3 * mm})
    ride = v.ride(0.0, 4.0)
    omega = 2 * np.pi * (100 / 3.6) / 23.15
    assert omega / (2 * np.pi) == pytest.approx(1.2, rel=1e-4)
    wave = (1 - np.cos(omega * ride.time)) / 2 if shape == TrackShape.COSINE else np.sin(omega * ride.time)
    wave = np.where(omega * ride.time < 4 * np.pi, wave, 0.0)
    assert ride.of(RideChannel.BOGIE_VERTICAL) == pytest.approx(5 * mm * wave, abs=1e-12)
    assert ride.of(RideChannel.BOGIE_LATERAL) == pytest.approx(3 * mm * wave, abs=1e-12)
    place, speed = track_wave(0.3, v.car)
    ahead, behind = (track_wave(0.3 + s, v.car)[0] for s in (1e-6, -1e-6))
    assert speed == pytest.approx((ahead - behind) / 2e-6, rel=1e-6)
    assert place > 0


def test_the_track_shakes_the_car_like_a_mass_on_two_springs(vehicle, stiffness):
    """Steady state of a small bounce under a harmonic track: z/z_t = 2K/(2K − mω²)."""
    track = {
        "track_shape": TrackShape.HARMONIC,
        "track_lateral": 0.0,
        "track_vertical": 0.1 * mm,
        "track_wavelength": 10.0,
    }
    v = vehicle("AW0", ("losses", "damper"), car=track)
    v.inputs[SHUT] = 0.0
    K = 2 * stiffness(v, "closed adiabatic")[0]
    omega = 2 * np.pi * v.car.train_speed / 10.0
    gain = K / (K - v.mass * omega**2)
    assert gain < -0.5
    # Started on the steady state, so that nothing has to die out.
    v.state[State.BOLSTER_VERTICAL_SPEED] = gain * 0.1 * mm * omega
    ride = v.ride(0.0, 2.0)
    assert ride.of(RideChannel.VERTICAL) == pytest.approx(
        gain * 0.1 * mm * np.sin(omega * ride.time), abs=1e-3 * mm
    )


def test_a_two_slope_damper(vehicle):
    v = vehicle(car={"damper_rate": 58.8e3, "damper_knee": 0.15, "damper_rate_beyond": 6.1e3})
    x = np.zeros(STATES)
    for speed in (-0.4, -0.1, 0.0, 0.05, 0.15, 1.0):
        x[State.BOLSTER_LATERAL_SPEED] = speed + 0.2
        x[State.PLATFORM_LATERAL_SPEED] = 0.2
        expected = -np.sign(speed) * (58.8e3 * min(abs(speed), 0.15) + 6.1e3 * max(abs(speed) - 0.15, 0.0))
        assert damper_force(x, v.car) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("wind", "interval", "message"),
    [
        ([], 1.0, "shape"),
        ([1.0, np.nan], 1.0, "gaps"),
        ([1.0, 2.0], 0.0, "sampling"),
        ([[1.0]], 1.0, "shape"),
    ],
)
def test_a_wind_that_is_none_is_refused(vehicle, wind, interval, message):
    with refuses(ValueError, message):
        vehicle().ride(wind, 1.0, interval=interval)
