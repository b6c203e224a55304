"""The bolster's accelerometer against the motion of the point where it stands, seen along its own axis."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_sim.model.bolster import felt_acceleration
from bench_sim.model.layout import Input, Mode, Sensor, State
from bench_sim.model.plant import Plant
from bench_sim.model.replay import DIRECTIONS, Motion
from bench_sim.parameters import load
from diagnosis.systems.air_spring.runs import _of_the_centre

BENCH = load("astb")
G = 9.80665


def read(height, roll, lateral, vertical, angular):
    """The model's, by its record."""
    return felt_acceleration(
        roll, lateral, vertical, angular, BENCH.with_values(accelerometer_height=height).record
    )


waves = st.tuples(st.floats(-1.0, 1.0), st.floats(0.5, 30.0), st.floats(0.0, 6.0))


@settings(deadline=None)  # the first call compiles
@given(waves, waves, waves, st.floats(-1.0, 1.0), st.floats(0.0, 2.0))
def test_a_point_on_a_body_that_rolls_feels_what_moves_it_less_gravity(lateral, vertical, roll, height, t):
    """Independently: the point's path in the hall by trigonometry, differentiated twice, on the axis as it leans.

    The model is of first order in the roll, so what may differ is of the second.
    """
    size = np.array([5e-3, 5e-3, 0.02])
    (part, omega, phase) = (np.array(one) for one in zip(lateral, vertical, roll, strict=True))
    reach = size * part

    def path(at):
        y, z, phi = reach * np.sin(omega * at + phase)
        return np.array([y - height * np.sin(phi), z + height * np.cos(phi)])

    h = 1e-4
    acceleration = (path(t + h) - 2 * path(t) + path(t - h)) / h**2
    phi = reach[2] * np.sin(omega[2] * t + phase[2])
    axis = np.array([np.cos(phi), np.sin(phi)])  # left side up: the axis to the left points up
    felt = float(axis @ (acceleration - np.array([0.0, -G])))
    second = -reach * omega**2 * np.sin(omega * t + phase)
    model = read(height, phi, *second)
    rate = abs(reach[2] * omega[2])
    bound = phi**2 * (abs(second[0]) + G * abs(phi) + abs(height * second[2])) + abs(height * phi) * rate**2
    # The second difference is off by h²/12 of the fourth derivative, and by what rounding leaves of the path.
    truncated = h**2 / 12 * np.sum(abs(reach * omega**4))
    assert model == pytest.approx(felt, abs=2 * bound + truncated + 1e-6)


def test_a_bolster_that_rests_rolled_reads_its_lean():
    """36 mrad are 0.35 m/s², which no motion made."""
    plant = Plant.at_rest(BENCH.with_values(sensor_noise=0.0, sensor_resolution=0.0).record)
    stand = plant.ideal()[Sensor.VERTICAL_LEFT_DISPLACEMENT : Sensor.LATERAL_DISPLACEMENT + 1]
    plant.inputs[Input.VERTICAL_LEFT_MODE : Input.LATERAL_MODE + 1] = Mode.DISPLACEMENT
    plant.inputs[Input.DPV_CONNECTED] = 0.0
    plant.inputs[Input.VERTICAL_LEFT_COMMAND : Input.LATERAL_COMMAND + 1] = stand + np.array(
        [0.036, -0.036, 0.0]
    )
    plant.step(10_000)
    roll = plant.state[State.BOLSTER_ROLL]
    assert roll == pytest.approx(0.036, abs=1e-3)
    assert plant.ideal()[Sensor.LATERAL_ACCELERATION] == pytest.approx(G * roll, abs=1e-4)


@settings(deadline=None)  # the first call compiles
@given(st.floats(-1.0, 1.0), st.integers(0, 1000))
def test_a_replay_inverts_the_accelerometer_equation(height, seed):
    """From the readings of an accelerometer anywhere, a diagnosis knows how the centre is accelerated."""
    record = BENCH.with_values(accelerometer_height=height).record
    motion = Motion.through(1e-2 * np.random.default_rng(seed).normal(size=(12, DIRECTIONS)), 5e-3)
    y, z, phi = motion.acceleration[:, :3].T
    told = [felt_acceleration(*one, record) for one in zip(motion.displacement[:, 2], y, z, phi, strict=True)]
    assert _of_the_centre(np.array(told), motion, record) == pytest.approx(y, rel=1e-9, abs=1e-9)
