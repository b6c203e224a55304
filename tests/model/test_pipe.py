"""The connecting pipe: surge frequencies, dynamic stiffness, its limits, and conservation."""

import numpy as np
import pytest

from bench_protocol.units import bar, litre, mm, ms
from bench_sim.model import experiments
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.experiments import VERTICAL, ImposedMotion, dynamic_stiffness, impose, isolate
from bench_sim.model.kernel import derivative
from bench_sim.model.layout import STATES, Input, State
from bench_sim.model.orifice import nozzle_flow
from bench_sim.model.pipe import expansion, pipe_acceleration
from bench_sim.parameters import ParameterError
from tests.refusals import refuses

A, A_1, V_B, V_A, KAPPA, R, P_ATM, T = 0.26, -0.20, 30 * litre, 70 * litre, 1.4, 287.05, 101325.0, 293.15
LOADS = {"AW0": 53.5e3, "AW3": 145e3}
BARE = ("emergency_spring", "rubber")
BOTH = pytest.mark.parametrize("load_case", list(LOADS))
SOUND = np.sqrt(KAPPA * R * T)
BORE, LENGTH = np.pi / 4 * 0.05**2, 1.5
SURGE = SOUND / (2 * np.pi) * np.sqrt(BORE / LENGTH * (1 / V_B + 1 / V_A))
AUXILIARY = SOUND / (2 * np.pi) * np.sqrt(BORE / LENGTH / V_A)
PIPE = {"pipe_length": LENGTH}


def closed_stiffness(load_case):
    """κ p A²/V_b, the gas alone."""
    return KAPPA * (LOADS[load_case] / A + P_ATM) * A * A / V_B


def membrane_stiffness(load_case):
    """−p_g A_1, what A_e(ζ) adds."""
    return -LOADS[load_case] / A * A_1


# -- surge against closed forms ------------------------------------------------------------------------------------


def oscillation(plant, places):
    """Frequency in Hz of the oscillating eigenvalue of ∂(dx/dt)/∂x over the given states alone."""

    def slope(x):
        dx = np.empty(STATES)
        derivative(0.0, x, plant.memory, plant.inputs, plant.parameters, dx)
        return dx[places]

    jacobian = np.empty((len(places), len(places)))
    for column, place in enumerate(places):
        change = np.zeros(STATES)
        change[place] = 1e-6 * plant.state[place] if plant.state[place] else 1e-9
        difference = slope(plant.state + change) - slope(plant.state - change)
        jacobian[:, column] = difference / (2 * change[place])
    values = np.linalg.eigvals(jacobian)
    value = values[np.argmax(values.imag)]
    assert abs(value.real) < 1e-3 * value.imag, "a column of air at rest has no loss"
    return value.imag / (2 * np.pi)


@BOTH
@pytest.mark.parametrize("side", [0, 1])
def test_the_surge_frequencies_are_those_of_the_closed_forms_under_any_load(resting, load_case, side):
    assert round(SURGE, 1) == 13.6
    assert round(AUXILIARY, 1) == 7.5
    plant = resting(load_case, (*BARE, "heat"), **PIPE)
    auxiliary = [State.AUXILIARY_MASS + side, State.AUXILIARY_ENERGY + side, State.PIPE_FLOW + side]
    bellows = [State.BELLOWS_MASS + side, State.BELLOWS_ENERGY + side]
    # The omitted states are constant: the bolster, and for the second the pressure in the bellows.
    assert oscillation(plant, bellows + auxiliary) == pytest.approx(SURGE, rel=1e-4)
    assert oscillation(plant, auxiliary) == pytest.approx(AUXILIARY, rel=1e-4)


@BOTH
def test_a_difference_of_pressure_swings_with_the_surge_frequency(resting, load_case):
    """In time, with the bolster held: counts the flow's passages through zero."""
    plant = resting(load_case, (*BARE, "heat"), orifice_diameter=50 * mm, pipe_friction=0, **PIPE)
    isolate(plant)
    plant.state[State.AUXILIARY_MASS] *= 1 + 1e-6  # so small that the quadratic loss is negligible
    plant.state[State.AUXILIARY_ENERGY] *= 1 + 1e-6
    course = impose(plant, [], 2.0)
    flow = course.of(Algebraic.ORIFICE_FLOW)
    rising = np.flatnonzero((flow[:-1] < 0) & (flow[1:] >= 0))
    passed = course.time[rising] - flow[rising] * 1e-3 / (flow[rising + 1] - flow[rising])
    assert 1 / np.mean(np.diff(passed)) == pytest.approx(SURGE, rel=1e-4)


@pytest.mark.parametrize("frequency", [0.5, 2.0, 5.0, 7.5, 10.0, 12.0, 16.0, 20.0, 28.0])
def test_the_stiffness_of_a_pipe_without_loss(resting, frequency):
    """K = K_∞ (ω² − ω_a²)/(ω² − ω_s²) − p_g A_1: zero of the gas at the one frequency, pole at the other."""
    omega, surge, auxiliary = (2 * np.pi * f for f in (frequency, SURGE, AUXILIARY))
    amplitude = 1e-4 * mm  # the quadratic loss is negligible
    plant = resting("AW0", (*BARE, "heat"), orifice_diameter=50 * mm, pipe_friction=0, **PIPE)
    # Nothing dies away without loss: start in the steady oscillation.
    gas = closed_stiffness("AW0")
    swing = -BORE / LENGTH * gas * amplitude * omega / (A * (surge**2 - omega**2))
    plant.state[State.PIPE_FLOW] = swing
    cycles = max(2, round(frequency))
    K, _ = dynamic_stiffness(plant, amplitude, frequency, cycles, longest_step=0.25 * ms)
    expected = gas * (omega**2 - auxiliary**2) / (omega**2 - surge**2) + membrane_stiffness("AW0")
    assert K.real == pytest.approx(expected, rel=3e-3, abs=1e-3 * gas)
    assert abs(K.imag) < 3e-3 * max(abs(expected), gas)


@BOTH
@pytest.mark.parametrize("without", [BARE, ()], ids=["gas", "whole spring"])
def test_stiffness_dips_peaks_and_settles_with_frequency(resting, load_case, without):
    """0.5 mm through a plate of 30 mm: the experiment that separates inertia from every other effect."""

    def stiffness(frequency, **changes):
        plant = resting(load_case, without, **({"orifice_diameter": 30 * mm} | PIPE | changes))
        if not changes.get("pipe_length", 1):
            plant.inputs[[Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE]] = 0.0
        return abs(dynamic_stiffness(plant, 0.5 * mm, frequency, 25)[0])

    f = np.array([2, 4, 6, 6.5, 7, 7.5, 8, 10, 12, 13, 14, 14.5, 15, 15.5, 16, 17, 20, 24, 28])
    K = np.array([stiffness(one) for one in f])
    closed = stiffness(20.0, pipe_length=0.0)
    low, high = np.argmin(K), np.argmax(K)
    assert f[low] == pytest.approx(7.0, abs=0.6)
    assert f[high] == pytest.approx(15.0, abs=1.1)
    assert K[high] / closed > 1.3
    assert (np.diff(K[: low + 1]) < 0).all()
    assert (np.diff(K[low : high + 1]) > 0).all()
    assert (np.diff(K[high:]) < 0).all()
    assert K[-1] / closed == pytest.approx(1.0, abs=0.25)
    if without:  # an independent implementation gave 0.46 and 1.8
        K_0 = closed_stiffness(load_case) * V_B / (V_A + V_B) + membrane_stiffness(load_case)
        assert K[low] / K_0 == pytest.approx(0.46, abs=0.025)
        assert K[high] / closed == pytest.approx(1.8, abs=0.05)


def test_only_inertia_lets_the_auxiliary_chamber_swing_further_than_the_bellows(resting):
    ratios = {}
    for length in (0.0, LENGTH):
        plant = resting("AW0", orifice_diameter=30 * mm, pipe_length=length)
        _, last = dynamic_stiffness(plant, 0.5 * mm, 7.0, 20)
        a, b = (last.of(q) for q in (Algebraic.AUXILIARY_PRESSURE, Algebraic.PRESSURE))
        ratios[length] = experiments.first_harmonic(a) / experiments.first_harmonic(b)
    assert abs(ratios[0.0]) < 1.0
    assert abs(ratios[LENGTH]) > 1.5
    assert -90 < np.degrees(np.angle(ratios[0.0])) < 0


def test_at_the_damping_maximum_a_pipe_adds_little(resting):
    for diameter in (13 * mm, 20 * mm, 30 * mm):
        loss = [
            dynamic_stiffness(
                resting("AW0", BARE, orifice_diameter=diameter, pipe_length=length), 5 * mm, 1.2, 12
            )[0].imag
            for length in (0.0, LENGTH)
        ]
        assert -0.003 < loss[1] / loss[0] - 1 < 0.047


# -- the loss --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("r", [0.9999, 0.99, 0.9, 0.6, 0.528, 0.3, 0.05])
@pytest.mark.parametrize("forward", [True, False])
def test_the_steady_flow_is_that_of_the_nozzle_choked_or_not(parameters, r, forward):
    par = parameters(pipe_friction=0, **PIPE).record
    p, warm, cold, area = 5 * bar, 330.0, 280.0, 8e-5
    laminar = 1 - 1e-12
    if forward:
        flow, ends = nozzle_flow(p, warm, r * p, area, R, KAPPA, laminar), (p, warm, r * p, cold)
    else:
        flow, ends = -nozzle_flow(p, warm, r * p, area, R, KAPPA, laminar), (r * p, cold, p, warm)

    def acceleration(G):
        return pipe_acceleration(G, *ends, area, 0, par)

    assert abs(acceleration(flow)) < 1e-6 * abs(acceleration(0.0))
    assert acceleration(1.01 * flow) * flow < 0 < acceleration(0.99 * flow) * flow


def test_the_expansion_is_continuous_and_keeps_small_differences():
    r = np.linspace(0.01, 1.0, 100_001)
    squeeze = np.array([expansion(one, KAPPA) for one in r])
    assert squeeze[-1] == 1.0
    assert (np.diff(squeeze) > 0).all()
    assert np.max(np.diff(squeeze)) < 3e-5


def test_friction_of_the_pipe_follows_darcy(parameters):
    par = parameters(pipe_friction=0.05, **PIPE).record
    p, drop, area = 4 * bar, 100.0, 1e3  # an orifice that offers nothing
    density = p / (R * T)
    flow = BORE * np.sqrt(2 * drop * density * 0.05 / (0.05 * LENGTH))
    assert pipe_acceleration(flow, p, T, p - drop, T, area, 0, par) == pytest.approx(0, abs=1e-9)
    assert pipe_acceleration(0.0, p, T, p - drop, T, area, 0, par) == pytest.approx(drop * BORE / LENGTH)
    # Air that flows on against the pressure is braked by both.
    braked = -(drop + drop * p / (p - drop)) * BORE / LENGTH
    assert pipe_acceleration(-flow, p - drop, T, p, T, area, 0, par) == pytest.approx(0, abs=1e-9)
    assert pipe_acceleration(flow, p - drop, T, p, T, area, 0, par) == pytest.approx(braked, rel=1e-6)


@pytest.mark.parametrize("frequency", [1.2, 10.0])
@pytest.mark.parametrize("diameter", [5 * mm, 13 * mm])
def test_a_short_pipe_is_no_pipe(resting, frequency, diameter):
    """Its flow is as fast as the step admits (`PIPE_RATE`) and none of that shows."""
    with_it, without = (
        dynamic_stiffness(
            resting("AW0", BARE, orifice_diameter=diameter, pipe_friction=0, pipe_length=length),
            5 * mm,
            frequency,
            12,
        )[0]
        for length in (50 * mm, 0.0)
    )
    assert abs(with_it - without) < 1.5e-3 * abs(without)


def test_a_pipe_is_longer_than_it_is_wide_or_there_is_none(parameters):
    with refuses(ParameterError, "pipe_length 0.02 m pipe_diameter 0.05 m"):
        parameters(pipe_length=[1.5, 0.02])
    assert parameters(pipe_length=[1.5, 0]).record.pipe_length.tolist() == [1.5, 0.0]


def test_no_pipe_is_fitted_unless_asked_for(resting):
    plant = resting("AW0")
    assert (plant.parameters.pipe_length == 0).all()
    plant.inputs[Input.PLATFORM_VERTICAL] = 5 * mm
    plant.step(300)
    assert (plant.state[State.PIPE_FLOW :][:2] == 0).all()
    assert np.ptp(plant.state[State.AUXILIARY_MASS :][:2]) == 0


# -- valve, conservation, rest ---------------------------------------------------------------------------------------


def test_a_shut_valve_has_no_flow(resting):
    plants = [resting("AW0", **changes) for changes in ({}, PIPE)]
    for plant in plants:
        plant.inputs[[Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE]] = 0.0
    stiffness = [dynamic_stiffness(plant, 5 * mm, 5.0, 10)[0] for plant in plants]
    assert stiffness[1] == pytest.approx(stiffness[0], rel=1e-5)
    assert (plants[1].state[State.PIPE_FLOW :][:2] == 0.0).all()


def test_a_valve_that_shuts_stops_the_flow_and_loses_no_air(resting):
    plant = resting("AW0", orifice_diameter=30 * mm, **PIPE)
    isolate(plant)
    impose(plant, [ImposedMotion(VERTICAL, 10 * mm, 10.0)], 0.125)
    places = [State.BELLOWS_MASS, State.AUXILIARY_MASS]
    assert abs(plant.state[State.PIPE_FLOW]) > 0.05
    before = plant.state[places]
    plant.inputs[[Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE]] = 0.0
    impose(plant, [], 10 * ms)
    assert plant.state[places] == pytest.approx(before, rel=1e-14)
    assert abs(plant.state[State.PIPE_FLOW]) < 1e-8


@BOTH
def test_sealed_springs_with_pipes_keep_their_air_and_account_for_every_joule(resting, load_case):
    plant = resting(load_case, orifice_diameter=20 * mm, **PIPE)
    isolate(plant)
    course = impose(plant, [ImposedMotion(VERTICAL, 5 * mm, 8.0)], 8.0, dt=0.25 * ms)
    mass = course.states[:, State.BELLOWS_MASS] + course.states[:, State.AUXILIARY_MASS]
    assert np.ptp(mass) / mass[0] < 1e-12
    assert np.ptp(course.of(Algebraic.ORIFICE_FLOW)) > 0.05
    energy = course.states[:, State.BELLOWS_ENERGY] + course.states[:, State.AUXILIARY_ENERGY]
    power = (
        course.of(Algebraic.HEAT)
        + course.of(Algebraic.AUXILIARY_HEAT)
        - course.of(Algebraic.PRESSURE)
        * course.of(Algebraic.AREA)
        * course.of(Algebraic.BELLOWS_VERTICAL_SPEED)
    )
    given_ = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]))]) * 0.25 * ms
    assert np.max(np.abs(energy - energy[0] - given_)) < 1e-5 * np.sum(np.abs(power)) * 0.25 * ms


@BOTH
def test_no_motion_at_rest_with_pipes(resting, load_case):
    plant = resting(load_case, **PIPE)
    before = plant.state.copy()
    plant.step(20_000)
    assert np.abs(plant.state - before).max() < 1e-8 * np.abs(before).max()
    assert np.abs(plant.state[State.PIPE_FLOW :][:2]).max() < 1e-9
