"""The step that stands a connecting pipe: its division, stability, convergence, other integrators, its plain twin."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from bench_protocol.units import litre, mm, ms
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.experiments import VERTICAL, ImposedMotion, dynamic_stiffness, impose, isolate
from bench_sim.model.kernel import derivative
from bench_sim.model.layout import STATES, Input, State
from bench_sim.model.orifice import effective_flow_area, nozzle_flow
from bench_sim.model.pipe import PIPE_RATE, pipe_steps
from bench_sim.model.plant import Plant
from bench_sim.parameters import load
from tests.plain_python import compiled_and_plain

A, A_1, V_B, V_A, KAPPA, R, P_ATM, T = 0.26, -0.20, 30 * litre, 70 * litre, 1.4, 287.05, 101325.0, 293.15
LOADS = {"AW0": 53.5e3, "AW3": 145e3}
BARE = ("emergency_spring", "rubber")
BOTH = pytest.mark.parametrize("load_case", list(LOADS))
BORE, LENGTH = np.pi / 4 * 0.05**2, 1.5
PIPE = {"pipe_length": LENGTH}


def test_a_pipe_divides_the_step(parameters):
    for length, steps in ((0.0, 1), ([0.0, 1.5], 4), (1.5, 4)):
        record = parameters(pipe_length=length).record
        assert pipe_steps(record, 1 * ms) == steps
    assert pipe_steps(record, 0.25 * ms) == 1
    for dt in (0.3 * ms, 0.7 * ms, 2.5 * ms):
        assert PIPE_RATE * dt / pipe_steps(record, dt) <= 2.0 + 1e-9


@BOTH
@pytest.mark.parametrize("diameter", [10 * mm, 13 * mm, 20 * mm, 30 * mm])
@pytest.mark.parametrize("frequency", [8.0, 25.0])
def test_the_step_of_1_ms_is_stable_and_converged(resting, load_case, diameter, frequency):
    for amplitude in (0.5 * mm, 10 * mm):
        coarse, fine = (
            dynamic_stiffness(
                resting(load_case, BARE, orifice_diameter=diameter, **PIPE),
                amplitude,
                frequency,
                12,
                longest_step=step,
            )[0]
            for step in (1 * ms, 0.125 * ms)
        )
        # First harmonics of a gas that warms up over the cycle: the residual is that of the evaluation.
        assert abs(coarse - fine) < 3e-4 * abs(fine)


def test_scipy_takes_the_whole_bench_with_pipes_to_the_same_end(resting):
    def shaken():
        plant = resting("AW0", ("friction",), actuator_delay=0.0, orifice_diameter=20 * mm, **PIPE)
        plant.inputs[Input.PLATFORM_VERTICAL] = 3 * mm
        plant.inputs[Input.PLATFORM_ROLL] = 0.3e-3
        return plant

    ours, start = shaken(), shaken()
    ours.step(250)

    def slope(t, x):
        dx = np.empty(STATES)
        derivative(t, x, start.memory, start.inputs, start.parameters, dx)
        return dx

    scale = np.maximum(np.abs(start.state), np.abs(ours.state)) + 0.03 * mm
    found = solve_ivp(slope, (0.0, 0.25), start.state, "DOP853", rtol=1e-10, atol=1e-11 * scale)
    assert found.success
    assert np.max(np.abs(found.y[:, -1] - ours.state) / scale) < 1e-5
    assert np.abs(ours.state[State.PIPE_FLOW]) > 1e-3


def judge(load_case, diameter, amplitude, frequency, times):
    """The same spring, written down once more and integrated by scipy as it is: no bound on any rate."""
    p_0 = LOADS[load_case] / A + P_ATM
    area = 0.62 * np.pi / 4 * diameter**2
    c_v, c_p = R / (KAPPA - 1), KAPPA * R / (KAPPA - 1)

    def slope(t, state):
        m_b, m_a, T_b, T_a, G = state
        w = 2 * np.pi * frequency
        zeta, speed = amplitude * np.sin(w * t), amplitude * w * np.cos(w * t)
        V, V_rate = V_B + A * zeta + 0.5 * A_1 * zeta**2, (A + A_1 * zeta) * speed
        p_b, p_a = m_b * R * T_b / V, m_a * R * T_a / V_A
        p_up, T_up, p_down = (p_b, T_b, p_a) if G > 0 else (p_a, T_a, p_b)
        r = min(p_down / p_up, 1.0)
        choked = max(r, (2 / (KAPPA + 1)) ** (KAPPA / (KAPPA - 1)))
        psi2 = 2 * KAPPA / (KAPPA - 1) * (choked ** (2 / KAPPA) - choked ** ((KAPPA + 1) / KAPPA))
        squeeze = psi2 / (2 * (1 - r)) if r < 1 - 1e-7 else 1.0
        loss = R * T_up / p_up * (1 / (2 * squeeze * area**2) + 0.02 * LENGTH / (2 * BORE**2 * 0.05))
        heat_b = G * c_v * T_b - G * c_p * T_up - p_b * V_rate
        heat_a = G * c_p * T_up - G * c_v * T_a
        return [
            -G,
            G,
            heat_b / (m_b * c_v),
            heat_a / (m_a * c_v),
            BORE / LENGTH * (p_b - p_a - loss * G * abs(G)),
        ]

    start = [p_0 * V_B / (R * T), p_0 * V_A / (R * T), T, T, 0.0]
    found = solve_ivp(slope, (0, times[-1]), start, "Radau", times, rtol=1e-8, atol=1e-11)
    assert found.success
    return found.y


@pytest.mark.parametrize("frequency", [5.0, 25.0])
@pytest.mark.parametrize("diameter", [10 * mm, 30 * mm])
def test_an_implicit_integrator_of_other_equations_agrees(resting, diameter, frequency):
    plant = resting("AW0", (*BARE, "heat"), orifice_diameter=diameter, **PIPE)
    isolate(plant)
    course = impose(plant, [ImposedMotion(VERTICAL, 10 * mm, frequency)], 3 / frequency)
    m_b, _, T_b, T_a, G = judge("AW0", diameter, 10 * mm, frequency, course.time)
    assert course.states[:, State.PIPE_FLOW] == pytest.approx(G, abs=2e-4 * np.ptp(G))
    assert course.states[:, State.BELLOWS_MASS] == pytest.approx(m_b, abs=2e-4 * np.ptp(m_b))
    assert course.of(Algebraic.TEMPERATURE) == pytest.approx(T_b, abs=2e-4 * np.ptp(T_b))
    assert course.of(Algebraic.AUXILIARY_TEMPERATURE) == pytest.approx(T_a, abs=5e-4 * np.ptp(T_a))


@pytest.mark.parametrize("diameter", [5 * mm, 10 * mm, 13 * mm, 30 * mm])
def test_a_full_spring_empties_as_through_the_orifice(resting, diameter):
    """Choked, faster than `PIPE_RATE`, and still the flow of the nozzle after a few milliseconds."""
    flows, masses = [], []
    for length in (0.0, LENGTH):
        plant = resting(
            "AW3", (*BARE, "heat"), orifice_diameter=diameter, pipe_length=length, pipe_friction=0
        )
        isolate(plant)
        share = P_ATM / (LOADS["AW3"] / A + P_ATM)
        plant.state[[State.AUXILIARY_MASS, State.AUXILIARY_ENERGY]] *= share
        course = impose(plant, [], 1.0)
        flows.append(course.of(Algebraic.ORIFICE_FLOW))
        masses.append(course.states[:, State.BELLOWS_MASS])
        assert np.isfinite(course.states).all()
    area = effective_flow_area(diameter, 0.62)
    first = nozzle_flow(LOADS["AW3"] / A + P_ATM, T, P_ATM, area, R, KAPPA, 0.9995)
    assert flows[0][0] == pytest.approx(first)
    if diameter <= 13 * mm:
        assert flows[1][5:] == pytest.approx(flows[0][5:], rel=0.02)
        assert np.max(flows[1]) < 1.01 * first
    # What the column's inertia costs in the first milliseconds, no more.
    assert np.max(np.abs(masses[1] - masses[0])) < 0.05 * np.ptp(masses[0])


def test_partly_open_valves_are_as_stable_as_any_other(resting):
    plant = resting("AW3", orifice_diameter=10 * mm, **PIPE)
    isolate(plant)
    for opening in (1e-300, 0.5e-3, 1.5e-3, 0.01, 0.1, 0.5, 1.0, 0.02):
        plant.inputs[[Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE]] = opening
        course = impose(plant, [ImposedMotion(VERTICAL, 10 * mm, 5.0)], 0.4)
        area = opening * effective_flow_area(10 * mm, 0.62)
        p = course.of(Algebraic.PRESSURE).max()
        most = nozzle_flow(p, 280.0, 0.8 * p, area, R, KAPPA, 0.9995)
        assert np.abs(course.of(Algebraic.ORIFICE_FLOW)[100:]).max() <= most


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.sampled_from(["AW0", "AW3"]),
    st.booleans(),
    st.floats(5 * mm, 40 * mm),
    st.sampled_from([0.05, 0.2, 1.5, 20.0]),
    st.lists(
        st.tuples(
            st.floats(-1, 1),
            st.floats(-1, 1),
            st.floats(0, 1),
            st.sampled_from([0.0, 1.0]),
            st.floats(-0.03, 0.03),
            st.floats(-0.05, 0.05),
            st.integers(1, 1000),
        ),
        min_size=1,
        max_size=5,
    ),
)
def test_no_input_makes_a_bench_with_pipes_lose_its_numbers(load_case, empty, diameter, length, acts):
    start = Plant.depressurised if empty else Plant.at_rest
    base = load("astb", load_case).with_values(pipe_length=length, orifice_diameter=diameter)
    plant = start(base.record, seed=1)
    plant.inputs[Input.SUPPLY] = 1.0
    for left, right, valve, other, vertical, roll, steps in acts:
        plant.inputs[[Input.LEFT_SERVICE_VALVE, Input.RIGHT_SERVICE_VALVE]] = left, right
        plant.inputs[[Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE]] = valve, other
        plant.inputs[Input.PLATFORM_VERTICAL] = vertical
        plant.inputs[Input.PLATFORM_ROLL] = roll
        plant.step(steps)
        assert np.isfinite(plant.state).all()
        assert (plant.state[: State.BELLOWS_WALL] > 0.0).all()
        truth = plant.truth()
        assert 100.0 < truth["temperature[0]"] < 1200.0
        assert abs(truth["orifice_flow[0]"]) < 5.0


#: Runs compiled here and as plain Python in the twin: pipe on one side only, exhaust, a valve that shuts.
SCENARIO = """
import sys
import numpy as np
from bench_sim.model.layout import Input
from bench_sim.model.plant import Plant
from bench_sim.parameters import load

def run():
    changed = load("astb", "AW0").with_values(pipe_length=[1.5, 0.0], orifice_diameter=[0.03, 0.013])
    plant = Plant.at_rest(changed.record, seed=5)
    rows = []
    for n in range(40):
        plant.inputs[Input.PLATFORM_VERTICAL] = 5e-3 * np.sin(0.2 * n)
        plant.inputs[Input.LEFT_SERVICE_VALVE] = -1.0 if n > 15 else 0.0
        plant.inputs[Input.LEFT_RESERVOIR_VALVE] = 0.0 if n > 30 else 1.0
        plant.step(2)
        rows.append(plant.state.copy())
    return np.array(rows)
"""


@pytest.mark.slow
def test_the_plain_python_twin_agrees_with_a_pipe_on_one_side(tmp_path: Path):
    compiled, twin = compiled_and_plain(SCENARIO, tmp_path)
    assert np.abs(twin[:, State.PIPE_FLOW]).max() > 0.01
    assert (twin[:, State.PIPE_FLOW + 1] == 0).all()
    scale = np.max(np.abs(twin), axis=0) + 1e-9
    assert np.max(np.abs(compiled - twin) / scale) < 1e-11


def test_the_same_inputs_give_the_same_bytes_however_the_steps_are_counted(resting):
    ends = []
    for pieces in ((400,), (1,) * 400, (100, 300)):
        plant = resting("AW0", orifice_diameter=16 * mm, **PIPE)
        plant.inputs[Input.PLATFORM_VERTICAL] = 5 * mm
        for n in pieces:
            plant.step(n)
        ends.append(plant.state.tobytes() + plant.memory_array.tobytes())
    assert ends[0] == ends[1] == ends[2]
