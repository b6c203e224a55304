"""Independent judges of the compiled step: its plain-Python twin, scipy's integrators, the order of convergence."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bench_protocol.units import kN, mm
from bench_sim.model.kernel import derivative
from bench_sim.model.layout import STATES, Input, Mode, State
from bench_sim.model.plant import Plant
from tests.plain_python import compiled_and_plain

#: Everything at once: valves, mode changes, platform, noise. Runs compiled here and as plain Python in the twin.
SCENARIO = """
import sys
import numpy as np
from bench_sim.model.layout import Input, Mode
from bench_sim.model.plant import Plant
from bench_sim.parameters import load

def run():
    plant = Plant.at_rest(load("astb", "AW0").as_built(3).record, seed=5)
    rows = []
    for n in range(60):
        plant.inputs[Input.PLATFORM_VERTICAL] = 5e-3 * np.sin(0.2 * n)
        plant.inputs[Input.PLATFORM_ROLL] = 0.02
        plant.inputs[Input.LATERAL_COMMAND] = 4e4 * np.sin(0.1 * n)
        plant.inputs[Input.LEFT_SERVICE_VALVE] = 1.0 if n > 20 else -1.0
        plant.inputs[Input.LEFT_LEVELING] = 1.0
        plant.inputs[Input.RIGHT_RESERVOIR_VALVE] = 0.0 if n > 40 else 1.0
        if n == 30:
            plant.inputs[Input.VERTICAL_LEFT_MODE] = Mode.DISPLACEMENT
            plant.inputs[Input.VERTICAL_LEFT_COMMAND] = 5e-3
        plant.step(2)
        rows.append(np.concatenate([plant.state, plant.measure()]))
    return np.array(rows)
"""


@pytest.mark.slow
def test_the_plain_python_twin_agrees(tmp_path: Path):
    compiled, twin = compiled_and_plain(SCENARIO, tmp_path)
    scale = np.max(np.abs(twin), axis=0) + 1e-9
    # The last bit may differ (a sum in another order inside a power), a quantised reading by one step of it.
    assert np.max(np.abs(compiled[:, :STATES] - twin[:, :STATES]) / scale[:STATES]) < 1e-11
    assert np.mean(compiled[:, STATES:] == twin[:, STATES:]) > 0.999


#: A replay and an imposed motion of a bench that has every state: creep, pipes, extra branches, late readings.
MOVED = """
import sys
import numpy as np
from bench_sim.model.experiments import ROLL, VERTICAL, ImposedMotion, impose
from bench_sim.model.layout import INPUTS, Input
from bench_sim.model.plant import Plant
from bench_sim.model.replay import DIRECTIONS, Gas, Motion, replay
from bench_sim.parameters import load
from bench_sim.parameters.effects import with_effects

EFFECTS = {
    "creep": {"ratio": 0.1, "time": 5.0},
    "maxwell_two": {"ratio": 0.5},
    "friction_distributed": {"force": 300.0},
    "compliance": {"compliance": 2.5e-9},
    "force_latency": {"delay": 5e-3},
}

def run():
    par = with_effects(load("astb", "AW3").with_values(pipe_length=1.5), EFFECTS).record
    t = np.arange(8) * 5e-3
    displacement = np.zeros((8, DIRECTIONS))
    displacement[:, 0] = 4e-3 * np.sin(30 * t)
    displacement[:, 1] = 3e-3 * np.sin(20 * t)
    inputs = np.zeros((8, INPUTS))
    inputs[:, [Input.SUPPLY, Input.LEFT_RESERVOIR_VALVE, Input.LEFT_LEVELING]] = 1.0
    pressure = par.nominal_preload / par.effective_area + par.atmospheric_pressure
    gas = Gas(np.r_[pressure, 0.99 * pressure], np.full(4, 294.0))
    readings = replay(par, Motion.through(displacement, 5e-3), inputs, np.full(8, 9e5), gas)
    motions = [ImposedMotion(VERTICAL, 6e-3, 5.0), ImposedMotion(ROLL, 3e-3, 7.0)]
    return np.r_[readings.ravel(), impose(Plant.at_rest(par), motions, 0.04).states.ravel()]
"""


@pytest.mark.slow
def test_the_plain_python_twin_of_imposed_motions_agrees(tmp_path: Path):
    compiled, twin = compiled_and_plain(MOVED, tmp_path)
    assert np.max(np.abs(compiled - twin) / (np.abs(twin) + 1e-3)) < 1e-9


#: A laminar zone that no flow leaves: every term is smooth.
SMOOTH = {"laminar_limit": 0.9}


def shaken(resting, step, *, amplitude, until=0.25, **changes):
    """A bench without friction on a platform that is moved by a step of its command."""
    plant = resting("AW0", ("friction",), actuator_delay=0.0, **changes)
    plant.dt = step
    plant.inputs[Input.PLATFORM_VERTICAL] = amplitude
    plant.inputs[Input.PLATFORM_ROLL] = 0.1 * amplitude
    plant.inputs[Input.PLATFORM_LATERAL] = amplitude
    plant.step(round(until / step))
    return plant


@pytest.mark.slow
@pytest.mark.parametrize("method", ["DOP853", "LSODA"])
@pytest.mark.parametrize(("changes", "tolerance"), [(SMOOTH, 1e-6), ({}, 1e-4)], ids=["smooth", "with kinks"])
def test_scipy_integrates_the_same_derivative_to_the_same_end(resting, method, changes, tolerance):
    amplitude = 3 * mm
    ours = shaken(resting, 0.25e-3, amplitude=amplitude, **changes)
    start = shaken(resting, 1e-3, amplitude=amplitude, until=0.0, **changes)

    def slope(t, x):
        dx = np.empty(STATES)
        derivative(t, x, start.memory, start.inputs, start.parameters, dx)
        return dx

    scale = np.maximum(np.abs(start.state), np.abs(ours.state)) + 0.01 * amplitude
    # At 1e-9 DOP853 steps over a corner of the flow law without noticing, and is off by 2e-4 itself.
    result = solve_ivp(slope, (0.0, 0.25), start.state, method=method, rtol=1e-10, atol=1e-11 * scale)
    assert result.success
    assert np.max(np.abs(result.y[:, -1] - ours.state) / scale) < tolerance


def errors(resting, amplitude, steps, **changes):
    reference = shaken(resting, 31.25e-6, amplitude=amplitude, **changes).state
    scale = np.abs(reference) + 0.01 * amplitude
    return [
        np.max(np.abs(shaken(resting, step, amplitude=amplitude, **changes).state - reference) / scale)
        for step in steps
    ]


def test_the_step_converges_with_fourth_order(resting):
    found = errors(resting, 1 * mm, (2e-3, 1e-3, 0.5e-3, 0.25e-3), emergency_spring=0, **SMOOTH)
    orders = np.log2(np.array(found[:-1]) / found[1:])
    assert orders == pytest.approx(4.0, abs=0.3)
    assert orders[-1] == pytest.approx(4.0, abs=0.1)


def test_with_the_emergency_spring_it_does_so_down_to_the_tolerance_of_newton(resting):
    found = errors(resting, 1 * mm, (2e-3, 1e-3, 0.25e-3), **SMOOTH)
    assert np.log2(found[0] / found[1]) == pytest.approx(4.0, abs=0.3)
    assert found[2] < 1e-6


def test_kinks_cost_order_but_not_accuracy(resting):
    # The corner of the flow law at the end of the laminar zone is crossed at instants that no step knows.
    coarse, fine = errors(resting, 3 * mm, (1e-3, 0.125e-3))
    assert coarse < 1e-3
    assert fine < coarse / 8


def test_friction_reversals_converge_at_least_linearly(resting):
    ends = {}
    for step in (2e-3, 1e-3, 0.5e-3, 0.0625e-3):
        # A set-point that jumps: its slew would be a staircase of the step's width, which is of first order.
        plant = resting("AW0", actuator_delay=0.0, actuator_force_rate=1e8)
        plant.dt = step
        plant.inputs[Input.LATERAL_COMMAND] = 5 * kN
        plant.step(round(0.8 / step))
        assert plant.memory.friction_level[1, 0] != 0.0
        ends[step] = plant.state[[State.BOLSTER_LATERAL, State.BOLSTER_LATERAL_SPEED]].copy()
    reference = ends.pop(0.0625e-3)
    found = [np.max(np.abs(end - reference)) / np.max(np.abs(reference)) for end in ends.values()]
    assert found[1] < 1e-4
    assert found[2] < 0.6 * found[1] < 0.36 * found[0]


def test_snapshots_restore_bit_for_bit(resting):
    plant = resting("AW3")
    plant.inputs[Input.LEFT_SERVICE_VALVE] = -0.5
    plant.inputs[Input.VERTICAL_RIGHT_MODE] = Mode.OFF
    plant.step(500)
    plant.measure()
    snapshot = plant.snapshot()
    plant.step(300)
    once = plant.measure(), plant.state.tobytes(), plant.memory_array.tobytes()
    plant.restore(snapshot)
    other = Plant(plant.parameters)
    other.restore(snapshot)
    for one in (plant, other):
        one.step(100)
        one.step(200)
        assert one.measure().tobytes() == once[0].tobytes()
        assert one.state.tobytes() == once[1]
        assert one.memory_array.tobytes() == once[2]
