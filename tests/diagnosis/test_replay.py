"""A replay against the free bench: moved as the bench has moved, its springs and sensors do the same."""

from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest

from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.layout import INPUTS, SENSORS, Input, Mode, Sensor, State
from bench_sim.model.plant import Plant
from bench_sim.model.quantities import PARAMETERS
from bench_sim.model.replay import DIRECTIONS, Gas, Motion, ParameterChanges, between, replay
from bench_sim.parameters import load
from bench_sim.rig.turn import take
from tests.refusals import refuses

INTERVAL = 5e-3
TURNED = 300
#: Pressures, temperatures, load cells: what a replay predicts from heights, without any acceleration.
DIRECT = [*range(Sensor.LEFT_BELLOWS_PRESSURE, Sensor.VERTICAL_LEFT_FORCE)]
DIRECT += [*range(Sensor.LOAD_CELL_1, Sensor.LATERAL_ACCELERATION)]
INERTIAL = [Sensor.VERTICAL_LEFT_FORCE, Sensor.VERTICAL_RIGHT_FORCE, Sensor.LATERAL_FORCE]


def drive(t):
    """Set-points of the actuators (left, right, lateral) and of the platform's height at ``t``."""
    fade = min(t, 1.0)
    heave = fade * (4e-3 * np.sin(2 * np.pi * 1.2 * t) + 1e-3 * np.sin(2 * np.pi * 5.0 * t))
    roll = fade * 2e-3 * np.sin(2 * np.pi * 0.7 * t)
    return (
        heave + roll,
        heave - roll,
        fade * 5e-3 * np.sin(2 * np.pi * 0.9 * t),
        fade * 1e-3 * np.sin(12.0 * t),
    )


@pytest.fixture(scope="module")
def free():
    return free_bench()


def free_bench(**turned):
    """Four seconds of the free bench under displacement control: motion, readings without noise, and what is needed.

    After ``TURNED`` samples its parameters are those that are ``turned``.
    """
    record = load("astb").with_values(sensor_noise=0.0, sensor_resolution=0.0).record
    plant = Plant.at_rest(record)
    plant.inputs[Input.VERTICAL_LEFT_MODE : Input.LATERAL_MODE + 1] = Mode.DISPLACEMENT
    plant.inputs[Input.DPV_CONNECTED] = 0.0
    stand = plant.ideal()[Sensor.VERTICAL_LEFT_DISPLACEMENT : Sensor.LATERAL_DISPLACEMENT + 1]
    plant.inputs[Input.VERTICAL_LEFT_COMMAND : Input.LATERAL_COMMAND + 1] = stand
    plant.step(5000)
    began = plant.ideal()
    n = 801
    readings, displacement = np.empty((n, SENSORS)), np.empty((n, DIRECTIONS))
    for i in range(n):
        if i == TURNED and turned:
            take(plant, turned)
        readings[i] = plant.measure()
        displacement[i, :3] = plant.state[State.BOLSTER_LATERAL : State.BOLSTER_LATERAL + 3]
        displacement[i, 3:] = plant.state[State.PLATFORM_LATERAL : State.PLATFORM_LATERAL + 3]
        for k in range(5):
            *actuators, table = drive(i * INTERVAL + k * 1e-3)
            plant.inputs[Input.VERTICAL_LEFT_COMMAND : Input.LATERAL_COMMAND + 1] = stand + actuators
            plant.inputs[Input.PLATFORM_VERTICAL] = table
            plant.step()
    gas = Gas(
        began[Sensor.LEFT_BELLOWS_PRESSURE : Sensor.SUPPLY_PRESSURE] + record.atmospheric_pressure,
        began[Sensor.LEFT_BELLOWS_TEMPERATURE : Sensor.VERTICAL_LEFT_FORCE],
    )
    return SimpleNamespace(
        record=record,
        motion=Motion.through(displacement, INTERVAL),
        readings=readings,
        inputs=np.tile(plant.inputs, (n, 1)),
        supply=np.full(n, plant.state[State.SUPPLY_LINE]),
        gas=gas,
    )


def again(free, **changes):
    return replay(free.record, free.motion, free.inputs, free.supply, free.gas, **changes)


def test_accelerations_between_samples_go_along_a_spline():
    """Half-way they are off by (ωh)⁴/384 at 12.5 Hz, which is 0.006 %; where a run begins or ends, by more."""
    time = INTERVAL * np.arange(200)
    omega = 2 * np.pi * 12.5
    motion = Motion.through(np.zeros((200, DIRECTIONS)), INTERVAL).accelerated(4, np.cos(omega * time))
    for n in range(20, 180):
        for part in (0.0, 0.3, 0.5, 1.0):
            expected = np.cos(omega * (time[n] + part * INTERVAL))
            assert abs(between(n, part, motion, 4) - expected) < (7e-5 if 0.0 < part < 1.0 else 1e-12)
            assert between(n, part, motion, 3) == 0.0


@pytest.mark.parametrize("acceleration", [np.zeros(199), np.array([*np.zeros(199), np.nan])])
def test_an_acceleration_that_does_not_fit_its_motion_is_refused(acceleration):
    motion = Motion.through(np.zeros((200, DIRECTIONS)), INTERVAL)
    with refuses(ValueError, "acceleration"):
        motion.accelerated(0, acceleration)


def test_the_replay_reads_what_the_free_bench_read(free):
    noise = load("astb").record.sensor_noise
    error = (again(free) - free.readings) / noise
    assert np.sqrt(np.mean(error[:, DIRECT] ** 2, axis=0)).max() < 0.03
    # The commands change every millisecond; what that does to accelerations lies beyond 200 samples a second.
    assert np.sqrt(np.mean(error[:, INERTIAL] ** 2, axis=0)).max() < 0.5
    # With the step of the bench itself nothing is left but the motion between the samples, and friction that turns
    # a micrometre earlier or later: tenths of a newton.
    fine = np.sqrt(np.mean(((again(free, step=1e-3) - free.readings) / noise)[:, DIRECT] ** 2, axis=0))
    assert np.median(fine) < 5e-4
    assert fine.max() < 0.02


@pytest.mark.parametrize(
    "turned",
    [
        {"auxiliary_volume": np.array([0.03, 0.07])},
        {"orifice_diameter": np.array([4e-3, 6e-3])},
        {"sensor_bias": 500.0 * (np.arange(SENSORS) == Sensor.LOAD_CELL_1)},
        {"sensor_drift": 1e3 * (np.arange(SENSORS) == Sensor.LEFT_BELLOWS_PRESSURE)},
    ],
    ids=lambda turned: next(iter(turned)),
)
def test_a_replay_rotates_like_the_free_bench(turned):
    free = free_bench(**turned)
    after = np.array([free.record], PARAMETERS)
    for name, value in turned.items():
        after[name] = value
    noise = load("astb").record.sensor_noise
    error = (again(free, changes=ParameterChanges(np.array([TURNED]), after)) - free.readings) / noise
    error[TURNED : TURNED + 10] = 0.0  # lags of transducers begin a tick of the bench earlier or later
    assert np.sqrt(np.mean(error[:, DIRECT] ** 2, axis=0)).max() < 0.03
    never = (again(free) - free.readings) / noise
    assert np.sqrt(np.mean(never[:, DIRECT] ** 2, axis=0)).max() > 3.0
    assert np.array_equal(never[:TURNED], error[:TURNED])


def test_a_wrong_spring_does_not_read_the_same(free):
    """The bound above is no formality: one percent of a volume moves the pressure by six times as much."""
    other = load("astb").with_values(bellows_volume=0.0303, sensor_noise=0.0, sensor_resolution=0.0).record
    error = replay(other, free.motion, free.inputs, free.supply, free.gas) - free.readings
    assert np.std(error[:, Sensor.LEFT_BELLOWS_PRESSURE]) > 0.15 * load("astb").record.sensor_noise[2]


def test_the_integration_is_of_fourth_order(free):
    """Without a corner or a separate tolerance, halving the step divides the error by 16.

    So without friction and emergency spring, and with an orifice whose flow is linear as far as the pressures go.
    """
    smooth = load("astb").with_values(
        friction_vertical=0.0,
        friction_lateral=0.0,
        friction_lateral_slope=0.0,
        emergency_spring=0.0,
        laminar_limit=0.9,
        orifice_diameter=0.03,
        sensor_noise=0.0,
        sensor_resolution=0.0,
        sensor_lag=0.0,
    )
    runs = [
        replay(smooth.record, free.motion, free.inputs, free.supply, free.gas, step=step)
        for step in (2.5e-3, 1.25e-3, 0.3125e-3)
    ]
    coarse, fine = (np.abs(run - runs[2])[:, Sensor.LEFT_BELLOWS_PRESSURE].max() for run in runs[:2])
    assert 10.0 < coarse / fine < 25.0


def test_no_air_is_lost_where_every_valve_is_shut(free):
    rows = np.zeros((len(free.supply), ALGEBRAICS))
    again(free, rows=rows)
    for side in range(2):
        mass = rows[:, Algebraic.PRESSURE + side] * rows[:, Algebraic.VOLUME + side]
        mass /= rows[:, Algebraic.TEMPERATURE + side]
        mass += (
            rows[:, Algebraic.AUXILIARY_PRESSURE + side]
            * free.record.auxiliary_volume[side]
            / rows[:, Algebraic.AUXILIARY_TEMPERATURE + side]
        )
        assert np.ptp(mass) < 1e-9 * mass[0]


def test_at_rest_everything_stays_where_it_settled(free):
    still = Motion.through(np.tile(free.motion.displacement[0], (200, 1)), INTERVAL)
    warm = Gas(free.gas.pressure, np.full(4, free.record.ambient_temperature))
    readings = replay(free.record, still, free.inputs[:200], free.supply[:200], warm)
    moved = np.ptp(readings, axis=0) / np.abs(readings[0]).clip(1e-3)
    assert moved.max() < 1e-9
    gauge = readings[0, Sensor.LEFT_BELLOWS_PRESSURE : Sensor.SUPPLY_PRESSURE]
    assert gauge + free.record.atmospheric_pressure == pytest.approx(warm.pressure, rel=1e-12)


def test_warmer_walls_warm_the_air_at_constant_volume():
    """p/T stays: after many times m c_v/(hS), some 10 s, the air is as warm as walls 20 K above the hall."""
    record = load("astb").with_values(emergency_spring=0.0, wall_temperature_offset=20.0, sensor_noise=0.0)
    n = 60_001
    readings = replay(
        record.record,
        Motion.through(np.zeros((n, DIRECTIONS)), INTERVAL),
        np.tile(np.isin(np.arange(INPUTS), (Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE)), (n, 1))
        * 1.0,
        np.full(n, 9e5),
        Gas(np.full(4, 3e5), np.full(4, 293.15)),
    )
    gauge = readings[:, Sensor.LEFT_BELLOWS_PRESSURE : Sensor.SUPPLY_PRESSURE]
    absolute = gauge + record.record.atmospheric_pressure
    assert absolute[0] == pytest.approx(3e5, rel=1e-9)
    assert absolute[-1] == pytest.approx(3e5 * 313.15 / 293.15, rel=1e-6)
    assert readings[-1, Sensor.LEFT_BELLOWS_TEMPERATURE] == pytest.approx(313.15, abs=1e-3)


def test_bolster_and_platform_follow_a_cubic_exactly():
    """Hermite's cubic through samples of a cubic is that cubic: heights and their lagged readings follow it."""
    record = load("astb").with_values(sensor_noise=0.0, sensor_resolution=0.0, sensor_lag=0.0).record
    time = INTERVAL * np.arange(40)
    height = 1e-3 * (3.0 * time - 40.0 * time**2 + 90.0 * time**3)
    displacement = np.zeros((40, DIRECTIONS))
    displacement[:, 1] = height
    gas = Gas(np.full(4, 3e5), np.full(4, 293.15))
    rows = np.zeros((40, ALGEBRAICS))
    readings = replay(
        record,
        Motion.through(displacement, INTERVAL),
        np.zeros((40, INPUTS)),
        np.full(40, 9e5),
        gas,
        rows=rows,
    )
    assert np.abs(readings[:, Sensor.LEFT_HEIGHT] - height).max() < 1e-12
    speed = 1e-3 * (3.0 - 80.0 * time + 270.0 * time**2)
    assert np.abs(rows[:, Algebraic.HEIGHT_SPEED] - speed).max() < 1e-9


def test_actuators_follow_newton_on_the_bolster():
    """Where the springs' forces are known, m z̈ = ΣF_z − ΣF − m g is an identity of the readings."""
    record = load("astb").with_values(sensor_noise=0.0, sensor_resolution=0.0, sensor_lag=0.0).record
    time = INTERVAL * np.arange(400)
    omega = 2 * np.pi * 2.0
    displacement = np.zeros((400, DIRECTIONS))
    displacement[:, 1] = 1e-3 * np.sin(omega * time)
    gas = Gas(np.full(4, 3e5), np.full(4, 293.15))
    readings = replay(
        record, Motion.through(displacement, INTERVAL), np.zeros((400, INPUTS)), np.full(400, 9e5), gas
    )
    springs = readings[:, Sensor.LOAD_CELL_1 : Sensor.LOAD_CELL_4 + 1].sum(axis=1)
    actuators = readings[:, Sensor.VERTICAL_LEFT_FORCE : Sensor.VERTICAL_RIGHT_FORCE + 1].sum(axis=1)
    acceleration = -omega * omega * displacement[:, 1]
    missing = springs - actuators - record.bolster_mass * (acceleration + record.gravity)
    assert np.abs(missing[5:-5]).max() < 1e-3 * record.bolster_mass * np.abs(acceleration).max()


def test_threads_do_not_disturb_each_other(free):
    alone = again(free)
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(lambda _: again(free), range(6)))
    assert all(np.array_equal(alone, one) for one in together)


def test_sensors_drift_from_when_the_bench_was_switched_on(free):
    drift = load("astb").with_values(
        sensor_drift={Sensor.LEFT_BELLOWS_PRESSURE: 3.0}, sensor_noise=0.0, sensor_resolution=0.0
    )
    late, early = (
        replay(drift.record, free.motion, free.inputs, free.supply, free.gas, start=start)
        for start in (100.0, 0.0)
    )
    difference = late - early
    assert difference[:, Sensor.LEFT_BELLOWS_PRESSURE] == pytest.approx(300.0, abs=1e-6)
    assert np.abs(np.delete(difference, Sensor.LEFT_BELLOWS_PRESSURE, axis=1)).max() < 1e-6


def test_what_cannot_be_replayed_is_refused(free):
    with refuses(ValueError, "least 4 6"):
        Motion.through(np.zeros((3, DIRECTIONS)), INTERVAL)
    holed = free.motion.displacement.copy()
    holed[7, 1] = np.nan
    with refuses(ValueError, "gaps"):
        Motion.through(holed, INTERVAL)
    with refuses(ValueError, "801 samples"):
        replay(free.record, free.motion, free.inputs[:-1], free.supply, free.gas)
    with refuses(ValueError, "3 ms 2.5 ms"):
        again(free, step=3e-3)
