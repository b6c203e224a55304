"""Air in and out: flow laws, filling times, leaks, leveling and differential pressure valves."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_protocol.units import bar, kN, litre, mm
from bench_sim.model import orifice, valves
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.experiments import VERTICAL, ImposedMotion, impose, isolate
from bench_sim.model.layout import Input, Mode, State
from bench_sim.model.plant import Plant

P_ATM = 101325.0
KAPPA = 1.4
BOTH_SERVICE = [Input.LEFT_SERVICE_VALVE, Input.RIGHT_SERVICE_VALVE]
BOTH_LEVELING = [Input.LEFT_LEVELING, Input.RIGHT_LEVELING]
STILL = ImposedMotion(VERTICAL, 0.0, 1.0)


@settings(deadline=None)
@given(st.floats(1e-6, 1.0), st.floats(1.05, 1.67))
def test_nozzle_function_is_the_isentropic_one(r, kappa):
    critical = (2.0 / (kappa + 1.0)) ** (kappa / (kappa - 1.0))
    held = max(r, critical)
    bracket = held ** (2.0 / kappa) - held ** ((kappa + 1.0) / kappa)
    expected = np.sqrt(2.0 * kappa / (kappa - 1.0) * max(bracket, 0.0))
    assert orifice.nozzle_function(r, kappa) == pytest.approx(expected, rel=1e-7, abs=1e-7)


def test_choked_nozzle_constant():
    assert orifice.nozzle_function(0.1, KAPPA) == pytest.approx(0.6847, abs=5e-5)
    assert orifice.nozzle_function(0.5283, KAPPA) == pytest.approx(
        orifice.nozzle_function(0.2, KAPPA), rel=1e-8
    )


@settings(deadline=None)
@given(st.floats(0.9e5, 11e5), st.floats(0.9e5, 11e5), st.floats(230, 350), st.floats(230, 350))
def test_flow_reverses_with_the_pressure_and_falls_with_the_ratio(p_1, p_2, T_1, T_2):
    there = orifice.orifice_between(p_1, T_1, p_2, T_2, 1e-4, 287.05, KAPPA, 0.9995)
    back = orifice.orifice_between(p_2, T_2, p_1, T_1, 1e-4, 287.05, KAPPA, 0.9995)
    assert there == -back
    assert there * (p_1 - p_2) >= 0.0
    assert orifice.valve_between(p_1, T_1, p_2, T_2, 1e-8, 0.3, 0.9995) * (p_1 - p_2) >= 0.0


@pytest.mark.parametrize("limit", [0.99, 0.9995])
def test_the_laminar_zone_joins_without_a_step(limit):
    for law in (
        lambda r: orifice.nozzle_flow(3e5, 293.15, 3e5 * r, 1e-4, 287.05, KAPPA, limit),
        lambda r: orifice.iso_flow(3e5, 293.15, 3e5 * r, 1e-8, 0.3, limit),
    ):
        assert law(limit + 1e-12) == pytest.approx(law(limit - 1e-12), rel=1e-6)
        assert law(0.5 * (1.0 + limit)) == pytest.approx(0.5 * law(limit), rel=1e-6)


def test_an_iso_valve_and_a_nozzle_agree_when_choked():
    C = 2e-8
    area = C * orifice.ISO_DENSITY * np.sqrt(287.05 * 293.15) / orifice.nozzle_function(0.1, KAPPA)
    assert orifice.iso_flow(9e5, 310.0, 1e5, C, 0.3, 0.9995) == pytest.approx(
        orifice.nozzle_flow(9e5, 310.0, 1e5, area, 287.05, KAPPA, 0.9995), rel=1e-12
    )


@pytest.mark.parametrize(
    ("heat", "seconds"),
    [({}, 17.0), ({"h": 1000.0}, 21.2), ({"h": 0.0}, 15.2)],
    ids=["table", "isothermal", "adiabatic"],
)
def test_time_to_fill_from_empty_to_crush_load_at_locked_height(resting, heat, seconds):
    both = {"bellows_heat_transfer": heat["h"], "auxiliary_heat_transfer": heat["h"]} if heat else {}
    # The service valve, as small as a leveling valve, is a leveling valve that stands fully open.
    plant = resting("AW0", ("emergency_spring",), service_conductance=2e-8, **both)
    isolate(plant)
    plant.inputs[BOTH_SERVICE] = 1.0
    course = impose(plant, [STILL], 25.0, every=10)
    full = int(np.argmax(course.of(Algebraic.AUXILIARY_PRESSURE) >= 145 * kN / 0.26 + P_ATM))
    assert course.time[full] == pytest.approx(seconds, rel=0.05)
    if not heat:
        mass = course.states[full, [State.BELLOWS_MASS, State.AUXILIARY_MASS]]
        T = course.algebraic[full, [Algebraic.TEMPERATURE, Algebraic.AUXILIARY_TEMPERATURE]]
        assert mass @ T / mass.sum() - 273.15 == pytest.approx(54.0, abs=2.0)


def test_supply_cannot_be_filled_by_a_spring(resting):
    plant = resting("AW3")
    plant.inputs[Input.SUPPLY] = 0.0
    plant.step(2000)  # the closed valve vents the line
    plant.inputs[BOTH_SERVICE] = 1.0
    plant.step(3000)
    truth = plant.truth()
    assert truth["supply_pressure"] < 0.01 * bar
    assert truth["left_auxiliary_pressure"] == pytest.approx(5.577 * bar, rel=1e-3)


def leak_time_constant(plant, within):
    """Time constant of ln p_abs in s while the leak is choked, over the first ``within`` s."""
    isolate(plant)
    course = impose(plant, [STILL], within, every=100, dt=10e-3)
    choked = course.of(Algebraic.PRESSURE) > P_ATM / 0.5
    slope, _ = np.polyfit(course.time[choked], np.log(course.of(Algebraic.PRESSURE)[choked]), 1)
    return -1.0 / slope


def test_a_choked_leak_is_a_straight_line_in_the_logarithm(resting):
    leaking = {"leak_conductance": 1e-9}
    warm = leaking | {"bellows_heat_transfer": 1000.0, "auxiliary_heat_transfer": 1000.0}
    tau = 100 * litre / (1e-9 * orifice.ISO_DENSITY * 287.05 * 293.15)
    assert tau == pytest.approx(1003.0, abs=0.5)
    assert leak_time_constant(resting("AW3", ("emergency_spring",), **warm), 1180.0) == pytest.approx(
        tau, rel=2e-3
    )
    # With the heat exchange of the table the gas first cools, and the pressure falls a little faster.
    early = leak_time_constant(resting("AW3", ("emergency_spring",), **leaking), 200.0)
    assert 0.98 * tau < early < tau


def test_a_laminar_leak_goes_with_the_difference_of_squares(resting):
    k, volume = 1e-15, 100 * litre
    plant = resting(
        "AW0", ("emergency_spring",), leak_laminar=k, bellows_heat_transfer=1000, auxiliary_heat_transfer=1000
    )
    isolate(plant)
    start = plant.truth()["pressure[0]"]
    course = impose(plant, [STILL], 200.0, every=100, dt=10e-3)
    # dp/dt = −(k R T/V)(p² − p_a²): artanh(p_a/p) grows linearly.
    rate = k * 287.05 * 293.15 / volume
    expected = P_ATM / np.tanh(np.arctanh(P_ATM / start) + P_ATM * rate * course.time)
    assert course.of(Algebraic.PRESSURE) == pytest.approx(expected, rel=2e-4)


def test_leveling_latch_and_opening():
    deadband, hysteresis, span = 4 * mm, 1 * mm, 10 * mm
    latch = 0
    seen = []
    for lever in np.array([0, 3.9, 4.1, 3.5, 3.1, 2.9, 3.9, 4.1, -3.9, -4.1, -3.1, -2.9]) * mm:
        latch = valves.leveling_latch(lever, latch, deadband, hysteresis)
        seen.append(latch)
    assert seen == [0, 0, 1, 1, 1, 0, 0, 1, 0, -1, -1, 0]
    assert valves.leveling_opening(8 * mm, 1, deadband, hysteresis, span) == pytest.approx(0.5)
    assert valves.leveling_opening(-20 * mm, -1, deadband, hysteresis, span) == -1.0
    assert valves.leveling_opening(8 * mm, 0, deadband, hysteresis, span) == 0.0


def switched(differences, opening=1.2 * bar, reclosing=1.0 * bar, latch=0):
    """Shares of the steps that begin with these differences for which the differential pressure valve is open."""
    memory = SimpleNamespace(dpv_latch=latch, dpv_share=0.0, dpv_difference=0.0)
    record = SimpleNamespace(dpv_opening=opening, dpv_reclosing=reclosing)
    shares = []
    for difference in differences:
        valves.switch_dpv.py_func(difference, memory, record)
        shares.append(memory.dpv_share)
    return shares


@pytest.mark.parametrize(
    ("differences", "shares"),
    [
        # a step that begins a quarter of its way below the opening is open for three of them
        ([1.15e5, 1.19e5, 1.23e5], [0.0, 0.75, 1.0]),
        ([-1.15e5, -1.19e5, -1.23e5], [0.0, 0.75, 1.0]),
        # and one that begins an eighth of its way above the reclosing for an eighth
        ([1.25e5, 1.17e5, 1.09e5, 1.01e5, 0.93e5], [1.0, 1.0, 1.0, 0.125, 0.0]),
        # in the first step nothing is known of the one before
        ([1.19e5], [0.0]),
        ([1.21e5], [1.0]),
        # both sides change places
        ([0.5e5, 0.2e5, -0.2e5, -0.5e5], [0.0, 0.0, 0.0, 0.0]),
        ([1.5e5, 0.2e5], [1.0, 0.0]),
    ],
)
def test_the_dpv_opens_and_shuts_within_a_step(differences, shares):
    assert switched(differences) == pytest.approx(shares)


@pytest.mark.parametrize("differences", [[3000.0, 1000.0, 300.0], [200.0, 20.0, -20.0, -200.0], [0.0, 0.0]])
def test_a_dpv_that_is_stuck_open_or_never_recloses_stays_open(differences):
    assert set(switched(differences, opening=-1.0, reclosing=-1.0)) == {1.0}
    assert set(switched(differences, reclosing=0.0, latch=1)) == {1.0}


def test_dpv_moves_between_opening_and_reclosing(resting):
    plant = resting("AW0")
    plant.inputs[Input.RIGHT_SERVICE_VALVE] = 0.3
    course = impose(plant, [STILL], 60.0)
    apart = course.of(Algebraic.AUXILIARY_PRESSURE, 1) - course.of(Algebraic.AUXILIARY_PRESSURE)
    open_ = course.of(Algebraic.DPV_FLOW) != 0.0
    opens = np.flatnonzero(open_[1:] & ~open_[:-1])
    closes = np.flatnonzero(~open_[1:] & open_[:-1])
    assert len(opens) >= 2
    assert apart[opens] / bar == pytest.approx(1.2, abs=2e-3)
    assert apart[closes] / bar == pytest.approx(1.0, abs=2e-3)
    assert np.all(course.of(Algebraic.DPV_FLOW)[open_] < 0.0)


def test_dpv_isolated_lets_the_difference_grow(resting):
    plant = resting("AW0")
    isolate(plant)
    plant.inputs[Input.RIGHT_SERVICE_VALVE] = 0.3
    course = impose(plant, [STILL], 60.0)
    apart = course.of(Algebraic.AUXILIARY_PRESSURE, 1) - course.of(Algebraic.AUXILIARY_PRESSURE)
    assert apart[-1] > 3 * bar
    assert not course.of(Algebraic.DPV_FLOW).any()


def unequal_preload(plant, difference):
    """Shift load from left to right at constant sum."""
    force = 53.5 * kN - 0.5 * 1200 * 9.80665
    plant.inputs[Input.VERTICAL_LEFT_COMMAND] = force - 0.5 * difference
    plant.inputs[Input.VERTICAL_RIGHT_COMMAND] = force + 0.5 * difference


def test_dpv_opens_at_its_pressure_times_area_with_leveling_active(parameters):
    plant = Plant.at_rest(parameters("AW0").record)
    plant.inputs[BOTH_LEVELING] = 1.0
    force = 0.0
    for force in np.arange(24.0, 36.0, 0.2) * kN:
        unequal_preload(plant, force)
        plant.step(10_000)
        if plant.memory.dpv_latch:
            break
    assert force == pytest.approx(31.2 * kN, rel=0.02)


@pytest.mark.parametrize(("load_case", "roll", "difference"), [("AW0", 0.081, 45.6), ("AW3", 0.038, 42.7)])
def test_sealed_slow_roll_by_unequal_preload_reaches_the_dpv(resting, load_case, roll, difference):
    # The contact on the emergency spring, which AW0 just meets there, is taken out of the way.
    plant = resting(
        load_case, contact_height=-85 * mm, bellows_heat_transfer=1000, auxiliary_heat_transfer=1000
    )
    isolate(plant)
    middle = plant.inputs[Input.VERTICAL_LEFT_COMMAND]
    force, apart, truth = 0.0, 0.0, {}
    for force in np.arange(36.0, 50.0, 0.1) * kN:
        plant.inputs[Input.VERTICAL_LEFT_COMMAND] = middle - 0.5 * force
        plant.inputs[Input.VERTICAL_RIGHT_COMMAND] = middle + 0.5 * force
        plant.step(1000)
        truth = plant.truth()
        apart = truth["auxiliary_pressure[1]"] - truth["auxiliary_pressure[0]"]
        if apart > 1.2 * bar:
            break
    assert truth["roll[0]"] == pytest.approx(roll, rel=0.03)
    assert force == pytest.approx(difference * kN, rel=0.03)


def test_leveling_brings_the_bench_from_empty_to_its_height(parameters):
    plant = Plant.depressurised(parameters("AW0").record)
    plant.inputs[Input.SUPPLY] = 1.0
    plant.inputs[BOTH_LEVELING] = 1.0
    for j in (0, 1):
        plant.inputs[Input.VERTICAL_LEFT_MODE + j] = Mode.FORCE
        plant.inputs[Input.VERTICAL_LEFT_COMMAND + j] = 53.5 * kN - 0.5 * 1200 * 9.80665
    plant.step(120_000)
    truth = plant.truth()
    # It stops at the lower edge of the dead zone, and the area there is a little larger.
    assert -4.1 * mm < truth["left_height"] < -2.9 * mm
    assert truth["left_bellows_pressure"] == pytest.approx(2.058 * bar, rel=0.01)
    assert truth["left_bellows_pressure"] < 2.058 * bar


def test_the_supply_sawtooth(parameters):
    par = parameters("AW0", supply_sawtooth=1).record
    at = [valves.source_pressure(t, par) / bar for t in (0.0, 960.0, 1920.0, 1980.0, 2040.0, 2040.0 + 960.0)]
    assert at == pytest.approx([10.1, 9.085, 8.07, 9.085, 10.1, 9.085])
