"""Effects of sensors, acquisition and rig against closed forms: true values, later, larger or coarser."""

import numpy as np
import pytest

from bench_sim.model.algebraic import Algebraic
from bench_sim.model.layout import HISTORY, Input, Mode, Sensor, State
from bench_sim.model.plant import Plant
from bench_sim.model.wiring import (
    DISPLACEMENTS,
    FORCES,
    LATERAL_CELLS,
    PRESSURES,
    TRANSDUCERS,
    VERTICAL_CELLS,
)
from bench_sim.parameters.effects import with_effects

LEFT = Sensor.LEFT_BELLOWS_PRESSURE
MS = 1e-3


@pytest.fixture
def rig(parameters):
    """Make a bench at rest without noise and converters, with effects: ``rig({"force_lag": {"lag": 5e-3}})``.

    Without friction too: where it turns, a reading and what the step then begins with differ by 0.1 N.
    """

    def build(effects=None, without=("noise", "friction"), **changes) -> Plant:
        return Plant.at_rest(with_effects(parameters("AW0", without, **changes), effects or {}).record)

    return build


def shaken(plant: Plant, steps: int = 400) -> np.ndarray:
    """Readings after every step while all is moved; the mechanics of all plants is the same, to the bit."""
    rows = np.empty((steps, len(Sensor)))
    forces = plant.inputs[Input.VERTICAL_LEFT_COMMAND : Input.LATERAL_COMMAND + 1].copy()
    for k in range(steps):
        plant.inputs[Input.VERTICAL_LEFT_COMMAND : Input.LATERAL_COMMAND + 1] = forces + 300.0 * np.sin(
            0.04 * k
        )
        plant.inputs[Input.PLATFORM_VERTICAL] = 4e-3 * np.sin(0.03 * k)
        plant.inputs[Input.PLATFORM_LATERAL] = 3e-3 * np.sin(0.02 * k)
        plant.step()
        rows[k] = plant.measure()
    return rows


def earlier(rows: np.ndarray, delay: np.ndarray | float) -> np.ndarray:
    """The same readings ``delay`` seconds earlier, by Newton's backward differences of third order.

    Not those of before the fourth row, where the bench was still at rest.
    """
    back = np.broadcast_to(delay, len(rows)) / MS
    whole = np.floor(back + 1e-9)
    place = np.maximum(np.arange(len(rows)) - whole.astype(int), 3)
    part = (back - whole)[:, None]
    first, second = rows[place] - rows[place - 1], rows[place] - 2.0 * rows[place - 1] + rows[place - 2]
    third = second - (rows[place - 1] - 2.0 * rows[place - 2] + rows[place - 3])
    return (
        rows[place]
        - part * first
        + 0.5 * part * (part - 1.0) * second
        - part * (part - 1.0) * (part - 2.0) / 6.0 * third
    )


@pytest.mark.parametrize("delay", [0.2 * MS, 1.0 * MS, 3.7 * MS, 90.0 * MS])
@pytest.mark.parametrize(
    ("name", "late"),
    [
        ("force_latency", FORCES),
        ("pressure_latency", [*PRESSURES, Sensor.SUPPLY_PRESSURE]),
        ("displacement_latency", DISPLACEMENTS),
    ],
)
def test_delayed_readings_equal_earlier_ones(rig, name, late, delay):
    healthy, given = shaken(rig()), shaken(rig({name: {"delay": delay}}))
    skip = round(delay / MS) + 4
    expected = earlier(healthy, delay)[skip:, late]
    np.testing.assert_allclose(given[skip:, late], expected, rtol=1e-12, atol=1e-7)
    others = np.setdiff1d(np.arange(len(Sensor)), late)
    np.testing.assert_array_equal(given[:, others], healthy[:, others])
    moved = np.ptp(healthy[:, late], axis=0)
    assert np.count_nonzero(moved) >= 4 and np.all(moved[:4] > 0.0)


def test_at_the_start_the_past_was_at_rest(rig):
    given = shaken(rig({"pressure_latency": {"delay": 50 * MS}}), 40)[:, PRESSURES]
    np.testing.assert_allclose(given, np.broadcast_to(given[0], given.shape), rtol=1e-12)


def test_a_slow_clock_falls_behind_until_the_history_ends(rig):
    skew = 2e-3
    plants = rig(), rig({"clock_skew": {"skew": skew}})
    for plant in plants:
        plant.memory.time = plant.memory.solved_time = 100.0  # 0.2 s behind
    healthy, given = (shaken(plant, 600) for plant in plants)
    delay = skew * (100.0 + MS * np.arange(1, 601))
    np.testing.assert_allclose(
        given[250:, PRESSURES], earlier(healthy, delay)[250:][:, PRESSURES], rtol=1e-10, atol=1e-5
    )
    for plant in plants:
        plant.memory.time = plant.memory.solved_time = 1000.0  # 2 s behind: more than is kept
    healthy, given = (shaken(plant, 600) for plant in plants)
    longest = MS * (HISTORY - 3)
    np.testing.assert_allclose(
        given[300:, PRESSURES], earlier(healthy, longest)[300:][:, PRESSURES], rtol=1e-10
    )


def test_held_pressures_are_a_staircase(rig):
    healthy = shaken(rig())[:, LEFT]
    stairs = shaken(rig({"sample_and_hold": {"hold": 1.0, "period": 20 * MS}}))[:, LEFT]
    time = np.arange(1, len(healthy) + 1)
    fresh = time % 20 == 0
    np.testing.assert_allclose(stairs[fresh], healthy[fresh], rtol=1e-12)
    held = stairs[19:-1].reshape(-1, 20)  # each row begins with a fresh sample
    np.testing.assert_allclose(held, np.repeat(held[:, :1], 20, axis=1), rtol=1e-12)
    half = shaken(rig({"sample_and_hold": {"hold": 0.5, "period": 20 * MS}}))[:, LEFT]
    age = 0.5 * MS * (time % 20)
    np.testing.assert_allclose(half[20:], earlier(healthy[:, None], age)[20:, 0], rtol=1e-10)


@pytest.mark.parametrize(
    ("name", "lagging", "slow"), [("force_lag", FORCES, 5 * MS), ("pressure_lag", PRESSURES, 10 * MS)]
)
def test_a_lag_is_a_first_order_filter(rig, name, lagging, slow):
    """By an independent discretisation, at a hundredth of the step, of τ ẏ + y = s with s linear between samples."""
    silent = np.zeros(len(Sensor))
    healthy = shaken(rig(sensor_lag=silent))
    given = shaken(rig({name: {"lag": slow}}, sensor_lag=silent))
    fine = np.arange(1, len(healthy), 0.01)
    for sensor in lagging[:4]:
        s = np.interp(fine, np.arange(len(healthy)), healthy[:, sensor])
        y = np.empty_like(s)
        y[0] = given[1, sensor]
        decay = np.exp(-0.01 * MS / slow)
        for k in range(1, len(s)):
            y[k] = decay * y[k - 1] + (1.0 - decay) * 0.5 * (s[k - 1] + s[k])
        span = np.ptp(healthy[:, sensor])
        np.testing.assert_allclose(given[1:, sensor], y[::100], atol=1e-4 * span + 1e-9)


def test_gains_offsets_and_drift_are_linear(rig):
    healthy = shaken(rig(), 50)
    time = MS * np.arange(1, 51)
    for name, values, sensors, expected in (
        ("force_gain", {"gain": 0.03}, FORCES, 1.03 * healthy),
        ("pressure_gain", {"gain": -0.02}, PRESSURES, 0.98 * healthy),
        ("pressure_offset.right", {"offset": 900.0}, [Sensor.RIGHT_BELLOWS_PRESSURE], healthy + 900.0),
        ("pressure_drift.left", {"rate": 7.0}, [LEFT], healthy + 7.0 * time[:, None]),
    ):
        given = shaken(rig({name: values}), 50)
        np.testing.assert_allclose(given[:, sensors], expected[:, sensors], rtol=1e-12, err_msg=name)
        others = np.setdiff1d(np.arange(len(Sensor)), sensors)
        np.testing.assert_array_equal(given[:, others], healthy[:, others], err_msg=name)


def test_an_offset_under_one_spring_moves_its_force_by_the_whole(rig):
    healthy, given = shaken(rig(), 5), shaken(rig({"force_offset.left": {"offset": 800.0}}), 5)
    change = (given - healthy)[:, VERTICAL_CELLS]
    np.testing.assert_allclose(change.sum(axis=1), 800.0)
    np.testing.assert_allclose(change @ [1.0, -1.0, 1.0, -1.0], 800.0, err_msg="all of it left of the middle")


def test_crosstalk_is_a_share_of_the_vertical_force(rig):
    healthy, given = shaken(rig(), 50), shaken(rig({"crosstalk": {"share": 0.01}}), 50)
    change = (given - healthy)[:, LATERAL_CELLS].sum(axis=1)
    np.testing.assert_allclose(change, 0.01 * healthy[:, VERTICAL_CELLS].sum(axis=1), rtol=1e-9)
    np.testing.assert_allclose(change[0], 0.01 * 2 * 53.5e3, rtol=1e-3)


def test_coarse_converters_read_multiples_of_their_step(rig, parameters):
    share = 2.0**-12
    rows = shaken(rig({"quantisation": {"step": share}}, without=()), 50)
    record = parameters().record
    for sensor in (*FORCES, *PRESSURES):
        step = max(
            share * (record.sensor_high[sensor] - record.sensor_low[sensor]), record.sensor_resolution[sensor]
        )
        counts = rows[:, sensor] / step
        np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    assert share * (record.sensor_high[LEFT] - record.sensor_low[LEFT]) > record.sensor_resolution[LEFT]


def test_the_platens_mass_is_felt_as_the_platform_moves(rig):
    """Acceleration by second differences of the platform's own transducers, after a step of its command."""

    def stepped(plant: Plant) -> np.ndarray:
        plant.inputs[Input.PLATFORM_VERTICAL], plant.inputs[Input.PLATFORM_LATERAL] = 2e-3, 1e-3
        rows = []
        for _ in range(100):
            plant.step()
            rows.append(plant.measure())
        return np.array(rows)

    silent = np.zeros(len(Sensor))
    healthy = stepped(rig(sensor_lag=silent))
    given = stepped(rig({"platen_inertia": {"mass": 150.0}}, sensor_lag=silent))
    for sensors, axis in (
        (VERTICAL_CELLS, Sensor.PLATFORM_VERTICAL),
        (LATERAL_CELLS, Sensor.PLATFORM_LATERAL),
    ):
        acceleration = np.diff(healthy[:, axis], 2) / MS**2
        felt = (given - healthy)[1:-1, sensors].sum(axis=1)
        assert np.ptp(felt) > 1000.0
        np.testing.assert_allclose(felt, 150.0 * acceleration, atol=0.005 * np.ptp(felt))


def test_a_soft_frame_gives_way_in_proportion_to_the_force(rig):
    compliance = 2e-8
    healthy, given = shaken(rig(), 100), shaken(rig({"frame_compliance": {"compliance": compliance}}), 100)
    sense = np.array([-1.0, -1.0, 1.0])
    places = [
        Sensor.VERTICAL_LEFT_DISPLACEMENT,
        Sensor.VERTICAL_RIGHT_DISPLACEMENT,
        Sensor.LATERAL_DISPLACEMENT,
    ]
    np.testing.assert_allclose(
        (given - healthy)[:, places], compliance * sense * healthy[:, TRANSDUCERS], rtol=1e-6, atol=1e-15
    )


def test_the_coupling_scales_with_its_factor(rig):
    def lateral_force(error: float) -> float:
        plant = rig({"coupling": {"error": error}})
        plant.state[State.BOLSTER_ROLL] = 0.02
        plant.ideal()
        return float(plant.truth()["lateral_force[0]"])

    none, full, more = lateral_force(-1.0), lateral_force(0.0), lateral_force(0.5)
    assert abs(full - none) > 100.0
    assert more - none == pytest.approx(1.5 * (full - none), rel=1e-6)


@pytest.mark.parametrize("error", [-0.5, 0.0, 1.0])
def test_the_emergency_spring_gives_way_by_its_factor(rig, error):
    plant = rig({"emergency_compliance": {"error": error}})
    plant.state[State.BOLSTER_VERTICAL] += 8e-3
    plant.state[State.BOLSTER_LATERAL] += 9e-3
    truth = plant.truth()
    k_z, k_y = 6e6, 2e6
    z = truth[f"{Algebraic.BELLOWS_VERTICAL.name.lower()}[0]"] - truth["height[0]"]
    y = truth[f"{Algebraic.BELLOWS_LATERAL.name.lower()}[0]"] - truth["lateral[0]"]
    assert z == pytest.approx((1.0 + error) * (truth["stack_vertical[0]"] - 53.5e3) / k_z, rel=1e-4)
    assert y == pytest.approx((1.0 + error) * truth["stack_lateral[0]"] / k_y, rel=1e-4)
    assert abs(z) > 1e-5 and abs(y) > 1e-5


@pytest.mark.parametrize("error", [-0.4, 0.0, 0.5])
def test_an_actuator_answers_a_step_of_command_as_its_natural_frequency_says(rig, error):
    """x = a (1 − e^{−ζωt} (cos ω_d t + ζω/ω_d sin ω_d t)), after the delay."""
    plant = rig({"actuator_tracking": {"error": error}}, actuator_speed_limit=5.0)
    par = plant.parameters
    start = plant.ideal()[Sensor.VERTICAL_LEFT_DISPLACEMENT]
    plant.inputs[Input.VERTICAL_LEFT_MODE] = Mode.DISPLACEMENT
    plant.inputs[Input.VERTICAL_LEFT_COMMAND] = start + 1e-3
    moved = []
    for _ in range(80):
        plant.step()
        moved.append(plant.state[State.ACTUATOR] - start)
    omega, zeta = 2.0 * np.pi * 25.0 * (1.0 + error), par.actuator_damping[0]
    damped = omega * np.sqrt(1.0 - zeta**2)
    t = np.maximum(MS * np.arange(1, 81) - par.actuator_delay[0], 0.0)
    expected = 1e-3 * (
        1.0 - np.exp(-zeta * omega * t) * (np.cos(damped * t) + zeta * omega / damped * np.sin(damped * t))
    )
    np.testing.assert_allclose(moved, expected, atol=5e-6)
