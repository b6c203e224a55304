"""The whole bench: rest, equilibrium, actuators, load cells, platform, bump stop, and what its sensors add."""

import numpy as np
import pytest

from bench_protocol.units import kN, mm
from bench_sim.model import sensors
from bench_sim.model.bolster import bump_stop_force
from bench_sim.model.layout import ACTUATORS, Input, Mode, Sensor, State
from bench_sim.model.noise import normal
from bench_sim.model.plant import Plant
from bench_sim.model.rest import settle_sensors

CELLS = [Sensor.LOAD_CELL_1 + k for k in range(6)]
WEIGHT = 1200 * 9.80665


@pytest.mark.parametrize("load_case", ["AW0", "AW3"])
def test_no_motion_at_rest(resting, load_case):
    plant = resting(load_case)
    before = plant.state.copy()
    plant.step(60_000)
    assert np.abs(plant.state - before) == pytest.approx(0.0, abs=1e-8 * np.max(np.abs(before)))
    relative = np.abs(plant.state - before)[before != 0.0] / np.abs(before[before != 0.0])
    assert relative.max() < 1e-8
    assert np.abs((plant.state - before)[before == 0.0]).max() < 1e-10


@pytest.mark.parametrize("load_case", ["AW0", "AW3"])
def test_the_empty_bench_lies_on_its_emergency_springs(parameters, load_case):
    plant = Plant.depressurised(parameters(load_case).record)
    before = plant.state.copy()
    plant.step(20_000)
    assert np.abs(plant.state - before).max() < 1e-7
    truth = plant.truth()
    assert truth["contact[0]"] > 0.0
    assert truth["left_bellows_pressure"] == pytest.approx(0.0, abs=1.0)
    assert sum(truth[f"load_cell_{k}"] for k in range(1, 5)) == pytest.approx(WEIGHT, rel=1e-6)
    for side, (length, slope) in enumerate(
        zip(plant.parameters.membrane_length, plant.parameters.membrane_length_slope, strict=True)
    ):
        assert length + slope * truth[f"bellows_vertical[{side}]"] > 0.0


def excited(resting):
    """A bench on which everything is loaded: unequal preload, lateral force, platform rolled, all settled."""
    plant = resting("AW0")
    plant.inputs[Input.VERTICAL_LEFT_COMMAND] += 4 * kN
    plant.inputs[Input.LATERAL_COMMAND] = 3 * kN
    plant.inputs[Input.PLATFORM_ROLL] = 0.005
    plant.step(40_000)
    return plant, plant.truth()


def test_load_cells_weigh_what_the_actuators_press(resting):
    plant, truth = excited(resting)
    par = plant.parameters
    pressed = truth["vertical_left_force"] + truth["vertical_right_force"]
    cells = [truth[f"load_cell_{k}"] for k in range(1, 7)]
    assert sum(cells[:4]) == pytest.approx(pressed + WEIGHT, rel=1e-4)
    assert cells[4] + cells[5] == pytest.approx(-truth["lateral_force"], rel=1e-3)
    # Moment about the middle of the platform: M_x = Σ y_k F_k − z_c ΣF_y is what the springs' feet bring.
    M_x = par.load_cell_y * (cells[0] - cells[1] + cells[2] - cells[3]) - par.load_cell_height * (
        cells[4] + cells[5]
    )
    brought = sum(
        truth[f"roll_moment[{i}]"]
        + s * par.spring_half_spacing * truth[f"vertical_force[{i}]"]
        - par.column_height * truth[f"lateral_force[{i}]"]
        for i, s in ((0, 1.0), (1, -1.0))
    )
    assert M_x == pytest.approx(brought, rel=1e-9)


def test_the_bolster_is_in_equilibrium(resting):
    plant, truth = excited(resting)
    par = plant.parameters
    moment = (
        sum(
            s * par.spring_half_spacing * truth[f"vertical_force[{i}]"]
            + par.centre_height * truth[f"lateral_force[{i}]"]
            + truth[f"roll_moment[{i}]"]
            - s * par.actuator_half_spacing * truth[f"actuator_force[{i}]"]
            for i, s in ((0, 1.0), (1, -1.0))
        )
        - par.lateral_actuator_height * truth["actuator_force[2]"]
    )
    assert abs(moment) < 1e-3 * par.lateral_actuator_height * 3 * kN
    # More load on the left brings the left down; the lateral force brings the bolster left.
    assert truth["left_height"] < truth["right_height"]
    assert plant.state[State.BOLSTER_LATERAL] > 5 * mm


def test_rolling_the_whole_rig_strains_no_spring(resting):
    plant = resting("AW0")
    phi = 0.03
    par = plant.parameters
    plant.state[State.BOLSTER_ROLL] = plant.state[State.PLATFORM_ROLL] = phi
    plant.state[State.BOLSTER_LATERAL] = -(par.column_height + par.centre_height) * phi
    truth = plant.truth()
    for name in ("height[0]", "height[1]", "lateral[0]", "lateral[1]", "roll[0]"):
        assert truth[name] == pytest.approx(0.0, abs=1e-15)


def test_force_control_is_a_delayed_second_order_lag(resting):
    plant = resting("AW0", actuator_force_rate=1e8)
    start = plant.state[State.ACTUATOR]
    plant.inputs[Input.VERTICAL_LEFT_COMMAND] = start + 2 * kN
    response = []
    for _ in range(60):
        plant.step()
        response.append((plant.state[State.ACTUATOR] - start) / (2 * kN))
    omega, zeta, delay = 2 * np.pi * 25, 0.7, 4e-3
    t = np.maximum(np.arange(1, 61) * 1e-3 - delay, 0.0)
    damped = omega * np.sqrt(1 - zeta**2)
    expected = 1 - np.exp(-zeta * omega * t) * (
        np.cos(damped * t) + zeta * omega / damped * np.sin(damped * t)
    )
    assert response == pytest.approx(expected, abs=2e-5)


def test_displacement_control_moves_the_bolster_and_takes_over_without_a_bump(resting):
    plant = resting("AW0")
    before = plant.truth()
    for j in (0, 1):
        plant.inputs[Input.VERTICAL_LEFT_MODE + j] = Mode.DISPLACEMENT
        plant.inputs[Input.VERTICAL_LEFT_COMMAND + j] = before["vertical_left_displacement"]
    plant.step(1)
    for j, name in ((0, "vertical_left_force"), (1, "vertical_right_force")):
        assert plant.truth()[name] == pytest.approx(before[name], rel=1e-6), j
    plant.inputs[[Input.VERTICAL_LEFT_COMMAND, Input.VERTICAL_RIGHT_COMMAND]] = 10 * mm
    plant.step(3000)
    truth = plant.truth()
    assert truth["vertical_left_displacement"] == pytest.approx(10 * mm, abs=1e-6)
    # The laser sees less: the frame gives by force over stiffness.
    give = truth["vertical_left_force"] / 100e6
    assert truth["left_height"] == pytest.approx(10 * mm + give, abs=2e-6)
    for j in (0, 1):
        plant.inputs[Input.VERTICAL_LEFT_MODE + j] = Mode.FORCE
        plant.inputs[Input.VERTICAL_LEFT_COMMAND + j] = truth["vertical_left_force"]
    plant.step(1)
    assert plant.truth()["vertical_left_force"] == pytest.approx(truth["vertical_left_force"], rel=1e-5)


def test_off_unloads_softly(resting):
    plant = resting("AW0")
    for j in range(ACTUATORS):
        plant.inputs[Input.VERTICAL_LEFT_MODE + j] = Mode.OFF
    forces = []
    for _ in range(3000):
        plant.step()
        forces.append(plant.state[State.ACTUATOR])
    drops = -np.diff(forces) / 1e-3
    assert drops.max() < 1.05 * 30 * kN
    assert abs(forces[-1]) < 1.0


def test_limits_hold(resting):
    plant = resting("AW0")
    plant.inputs[Input.LATERAL_COMMAND] = 500 * kN
    plant.inputs[Input.VERTICAL_LEFT_MODE] = Mode.DISPLACEMENT
    plant.inputs[Input.VERTICAL_LEFT_COMMAND] = -1.0
    speeds = []
    for _ in range(400):
        plant.step(5)
        speeds.append(plant.state[State.ACTUATOR_RATE])
        truth = plant.truth()
        assert abs(truth["lateral_force"]) < 200 * kN
        assert abs(plant.state[State.ACTUATOR]) < 121 * mm
    assert np.max(np.abs(speeds)) < 0.6 * 1.1
    assert plant.state[State.ACTUATOR + 2] < 52.5 * kN


def test_bump_stop_table(parameters):
    par = parameters("AW0").record
    table = {25: 0, 30: 600, 35: 1760, 40: 3730, 45: 6870, 50: 11580, 55: 17170, 60: 29200, 65: 230000}
    for travel, force in table.items():
        assert bump_stop_force(travel * mm, par) == pytest.approx(-force)
        assert bump_stop_force(-travel * mm, par) == pytest.approx(force)
    assert bump_stop_force(0.01, par) == 0.0
    assert bump_stop_force(66 * mm, par) == pytest.approx(-(230000 + (230000 - 29200) / 5))


def test_the_platform_follows_its_command_whatever_it_carries(resting):
    light, heavy = resting("AW0"), resting("AW3")
    for plant in (light, heavy):
        plant.inputs[Input.PLATFORM_VERTICAL] = 5 * mm
        plant.step(500)
    assert light.state[State.PLATFORM_VERTICAL] == heavy.state[State.PLATFORM_VERTICAL]
    assert light.state[State.PLATFORM_VERTICAL] == pytest.approx(5 * mm, rel=1e-6)


def test_a_lag_delays_a_ramp_by_its_time_constant(resting):
    plant = resting("AW0", ("noise",))
    for tau in (0.0, 1e-5, 0.3e-3, 5e-3, 50e-3):
        plant.parameters.sensor_lag[:] = tau
        plant.memory.sensor_output[:] = 0.0
        plant.memory.sensor_input[:] = 0.0
        plant.memory.sensor_input_before[:] = 0.0
        plant.memory.sensor_input_earlier[:] = 0.0
        for n in range(2001):
            values = np.full(27, 1e-3 * n)
            sensors.follow(plant.memory, plant.parameters, values, 1e-3)
        assert plant.memory.sensor_output[0] == pytest.approx(2.0 - tau, abs=1e-9)


@pytest.mark.parametrize("step", [1e-3, 2.5e-3])
@pytest.mark.parametrize(
    ("lag", "delay"), [(1e-3, 0.0), (5e-3, 0.0), (0.2, 0.0), (0.0, 1.3e-3), (0.0, 7.7e-3)]
)
def test_lags_and_delays_of_a_sine_are_right_to_the_third_order_of_the_step(resting, lag, delay, step):
    """Against e^{−iωD}/(1 + iωτ), whose ω²τ²/2 separates a lag from a delay: straight lines err by ω²h²/12 and more."""
    plant, omega = resting("AW0", ("noise",)), 2.0 * np.pi * 5.0
    par, mem = plant.parameters, plant.memory
    par.sensor_lag[:], par.force_latency = lag, delay
    settle_sensors(mem, par, np.zeros(len(Sensor)), step)
    time = step * np.arange(round((0.5 + 15.0 * lag) / step))
    read = np.empty(len(time))
    for n, s in enumerate(np.sin(omega * time)):
        values = np.full(len(Sensor), s)
        sensors.deliver(mem, par, values)
        read[n] = values[Sensor.LOAD_CELL_1]
        sensors.follow(mem, par, np.full(len(Sensor), s), step)
        mem.step += 1
    expected = np.exp(1j * omega * (time - delay)) / (1.0 + 1j * omega * lag)
    settled = time > 0.2 + 14.0 * lag
    np.testing.assert_allclose(read[settled], expected.imag[settled], rtol=0, atol=0.07 * (omega * step) ** 3)


def test_noise_is_normal_and_repeats():
    many = np.array([[normal(7, counter, channel) for channel in range(5)] for counter in range(4000)])
    assert many.mean() == pytest.approx(0.0, abs=0.03)
    assert many.std() == pytest.approx(1.0, abs=0.02)
    assert np.mean(many**4) == pytest.approx(3.0, abs=0.25)
    assert np.abs(np.corrcoef(many.T) - np.eye(5)).max() < 0.07
    assert np.abs(np.mean(many[1:, 0] * many[:-1, 0])) < 0.06
    assert normal(7, 12, 3) == many[12, 3]
    assert normal(8, 12, 3) != many[12, 3]
    assert normal(7 + 2**33, 12, 3) != many[12, 3]


def test_readings_scatter_about_the_truth_and_come_in_steps(resting):
    plant = resting("AW0")
    plant.step(10)
    truth = plant.ideal()
    readings = np.array([plant.measure() for _ in range(2000)])
    par = plant.parameters
    sigma = np.hypot(par.sensor_noise, par.sensor_resolution / np.sqrt(12))
    assert np.abs(readings.mean(axis=0) - truth) == pytest.approx(0.0, abs=1e12)
    assert np.all(np.abs(readings.mean(axis=0) - truth) < 5 * sigma / np.sqrt(2000) + 1e-12)
    assert readings.std(axis=0) == pytest.approx(sigma, rel=0.08)
    steps = readings / par.sensor_resolution
    assert steps == pytest.approx(np.round(steps), abs=1e-6)


def test_each_fault_of_a_sensor_does_what_it_says(parameters):
    k = Sensor.LEFT_BELLOWS_PRESSURE
    faults = {"sensor_gain": 0.02, "sensor_bias": 3000.0, "sensor_drift": 50.0}
    healthy = Plant.at_rest(parameters("AW0", ("noise",)).record)
    healthy.step(4000)
    p = healthy.measure()[k]
    for name, expected in (
        ("sensor_gain", 1.02 * p),
        ("sensor_bias", p + 3000.0),
        ("sensor_drift", p + 4.0 * 50.0),
    ):
        plant = Plant.at_rest(parameters("AW0", ("noise",)).with_values(**{name: {k: faults[name]}}).record)
        plant.step(4000)
        assert plant.measure()[k] == pytest.approx(expected, rel=1e-9)
        assert np.array_equal(np.delete(plant.measure(), k), np.delete(healthy.measure(), k))
    clipped = Plant.at_rest(parameters("AW0", ("noise",)).with_values(sensor_high={k: 1e5}).record)
    assert clipped.measure()[k] == 1e5


def test_crosstalk_leaks_load_into_the_lateral_cells(parameters):
    plant = Plant.at_rest(parameters("AW0", ("noise",), load_cell_crosstalk=0.01).record)
    cells = plant.measure()[CELLS]
    assert cells[4] == pytest.approx(0.01 * 2 * 53.5 * kN, rel=1e-6)
    assert cells[0] == pytest.approx(1.03 * 0.5 * 53.5 * kN, rel=1e-6)


def test_measuring_does_not_disturb(resting):
    watched, alone = resting("AW0"), resting("AW0")
    for plant in (watched, alone):
        plant.inputs[Input.LATERAL_COMMAND] = 5 * kN
        for n in range(200):
            plant.step()
            if plant is watched and n % 3 == 0:
                plant.measure()
                plant.truth()
    assert watched.state.tobytes() == alone.state.tobytes()
    assert watched.memory_array.tobytes() == alone.memory_array.tobytes()


def total_energy(plant):
    """Everything that a bench without heat, friction and relaxation can store, in J, up to a constant."""
    par, x, a = plant.parameters, plant.state, plant.truth()
    z, roll, v_y, v_z, v_roll = x[State.BOLSTER_VERTICAL : State.BOLSTER_ROLL_SPEED + 1]
    energy = 0.5 * par.bolster_mass * (v_y**2 + v_z**2) + 0.5 * par.bolster_inertia * v_roll**2
    energy += par.bolster_mass * par.gravity * z
    for i, s in ((0, 1.0), (1, -1.0)):
        energy += x[State.BELLOWS_ENERGY + i] + x[State.AUXILIARY_ENERGY + i]
        energy += par.atmospheric_pressure * a[f"volume[{i}]"]
        energy += 0.5 * par.shell_stiffness_vertical[i] * a[f"bellows_vertical[{i}]"] ** 2
        energy += 0.5 * par.shell_stiffness_lateral[i] * a[f"bellows_lateral[{i}]"] ** 2
        energy += 0.5 * a[f"stack_vertical[{i}]"] ** 2 / par.emergency_stiffness_vertical[i]
        energy += 0.5 * a[f"stack_lateral[{i}]"] ** 2 / par.emergency_stiffness_lateral[i]
        energy += 0.5 * (8e3 + 8e-3 * 53.5e3 / 0.26) * roll**2
        K = 0.5 * (1.0 / (1.0 / (0.35 * 53.5e3 / 0.26 + 45e3) + 1.0 / 2e6) * par.column_height + 53.5e3)
        energy += K * a[f"lateral[{i}]"] * par.coupling_angle * np.tanh(roll / par.coupling_angle)
        energy += a[f"actuator_force[{i}]"] * (z + s * par.actuator_half_spacing * roll)
    return energy


def test_a_free_bolster_keeps_its_energy_whatever_it_is_exchanged_for(resting):
    """Vertical, lateral, roll, coupling, emergency springs and gas share one potential; orifice loss stays as heat."""
    plant = resting("AW0", ("friction", "heat"), maxwell_ratio=0)
    plant.inputs[Input.DPV_CONNECTED] = 0.0
    plant.state[State.BOLSTER_LATERAL_SPEED] = 0.05
    plant.state[State.BOLSTER_VERTICAL_SPEED] = 0.1
    plant.state[State.BOLSTER_ROLL_SPEED] = 0.15
    start = total_energy(plant)
    kinetic = 0.5 * 1200 * (0.05**2 + 0.1**2) + 0.5 * 900 * 0.15**2
    gas = plant.state[State.BELLOWS_ENERGY : State.BELLOWS_WALL].copy()
    drifts = []
    for _ in range(100):
        plant.step(20)
        drifts.append(abs(total_energy(plant) - start) / kinetic)
    assert max(drifts) < 2e-5
    assert np.abs(plant.state[State.BELLOWS_ENERGY : State.BELLOWS_WALL] - gas).max() > kinetic


def test_power_of_the_coupling_is_what_breaks_with_a_wrong_sign(resting):
    """The same balance sees a coupling force without its moment: it is a test that can fail."""
    plant = resting("AW0", ("friction", "heat"), maxwell_ratio=0, coupling_sign=-1)
    plant.state[State.BOLSTER_LATERAL_SPEED] = 0.2
    plant.state[State.BOLSTER_ROLL_SPEED] = 0.3
    start = total_energy(plant)
    plant.step(300)
    assert abs(total_energy(plant) - start) > 1.0
