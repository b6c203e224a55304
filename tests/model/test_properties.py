"""The bench returns finite numbers for any command."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench_sim.model.layout import Input, State
from bench_sim.model.plant import Plant
from bench_sim.parameters import load
from tests.refusals import refuses

BASE = load("astb")


def unit(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False)


MODES = st.integers(0, 2)
INPUTS = st.fixed_dictionaries(
    {
        Input.SUPPLY: st.integers(0, 1),
        Input.LEFT_LEVELING: st.integers(0, 1),
        Input.RIGHT_LEVELING: st.integers(0, 1),
        Input.LEFT_SERVICE_VALVE: unit(-1, 1),
        Input.RIGHT_SERVICE_VALVE: unit(-1, 1),
        Input.LEFT_RESERVOIR_VALVE: st.integers(0, 1),
        Input.RIGHT_RESERVOIR_VALVE: st.integers(0, 1),
        Input.DPV_CONNECTED: st.integers(0, 1),
        Input.VERTICAL_LEFT_MODE: MODES,
        Input.VERTICAL_RIGHT_MODE: MODES,
        Input.LATERAL_MODE: MODES,
        # Wide enough to be newtons for one mode and far beyond every stroke for the other.
        Input.VERTICAL_LEFT_COMMAND: unit(-3e5, 3e5) | unit(-0.2, 0.2),
        Input.VERTICAL_RIGHT_COMMAND: unit(-3e5, 3e5) | unit(-0.2, 0.2),
        Input.LATERAL_COMMAND: unit(-1e5, 1e5) | unit(-0.2, 0.2),
        Input.PLATFORM_VERTICAL: unit(-0.03, 0.03),
        Input.PLATFORM_LATERAL: unit(-0.03, 0.03),
        Input.PLATFORM_ROLL: unit(-0.05, 0.05),
    }
)


@pytest.mark.slow
@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.sampled_from(["AW0", "AW3"]),
    st.booleans(),
    st.lists(st.tuples(INPUTS, st.integers(1, 1500)), min_size=1, max_size=6),
)
def test_no_input_makes_the_bench_lose_its_numbers(load_case, empty, acts):
    start = Plant.depressurised if empty else Plant.at_rest
    plant = start(BASE.under(load_case).record, seed=1)
    for inputs, steps in acts:
        for place, value in inputs.items():
            plant.inputs[place] = value
        plant.step(steps)
        assert np.isfinite(plant.state).all()
        readings = plant.measure()
        assert np.isfinite(readings).all()
        assert (readings >= plant.parameters.sensor_low).all()
        assert (readings <= plant.parameters.sensor_high).all()
        truth = plant.truth()
        for chamber in ("pressure", "auxiliary_pressure"):
            assert truth[f"{chamber}[0]"] > 0.0
        assert (plant.state[: State.BELLOWS_WALL] > 0.0).all()
        assert 100.0 < truth["temperature[0]"] < 1200.0
        assert abs(plant.state[State.BOLSTER_VERTICAL]) < 0.3
        assert abs(plant.state[State.BOLSTER_LATERAL]) < 0.5


@settings(max_examples=20, deadline=None)
@given(INPUTS, st.integers(1, 400))
def test_the_same_inputs_give_the_same_bytes(inputs, steps):
    ends = []
    for pieces in ((steps,), (steps // 2, steps - steps // 2)):
        plant = Plant.at_rest(BASE.record, seed=2)
        for place, value in inputs.items():
            plant.inputs[place] = value
        for n in pieces:
            plant.step(n)
        ends.append(plant.state.tobytes() + plant.memory_array.tobytes() + plant.measure().tobytes())
    assert ends[0] == ends[1]


def test_another_seed_is_another_noise_but_the_same_motion():
    one, two = (Plant.at_rest(BASE.record, seed=seed) for seed in (1, 2))
    one.step(10)
    two.step(10)
    assert one.state.tobytes() == two.state.tobytes()
    assert not np.array_equal(one.measure(), two.measure())


def test_an_unstable_step_is_refused():
    with refuses(ValueError, "dt 5 ms 0 2.5 ms"):
        Plant(BASE.record, dt=5e-3)
