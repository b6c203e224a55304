"""The chamber as a system: leaks and heat against closed forms and an independent integrator."""

import numpy as np
import pytest

from diagnosis.contracts import Experiment
from diagnosis.systems.chamber import CHAMBER
from diagnosis.systems.chamber_effects import KAPPA, R_AIR, RHO_0, T_0

VOLUME, AIR, STEP = 1e-3, 101_325.0, 0.1
SETTINGS = {"volume": VOLUME, "ambient_pressure": AIR, "ambient_temperature": T_0}
CHANNELS = tuple(signal.channel(0.0, 0.0) for signal in CHAMBER.outputs)


def hold(seconds: float = 60.0, start: float = 7e5) -> Experiment:
    clock = np.arange(0.0, seconds, STEP)
    return Experiment("hold", clock, {"time": clock}, {"start_pressure": start})


@pytest.fixture(scope="module")
def chamber():
    return CHAMBER.simulator(SETTINGS, CHANNELS)


def shapes_of(effect) -> dict[str, float]:
    return {parameter.name: value for parameter, value in zip(effect.shapes, effect.grid[0], strict=True)}


EFFECTS = sorted(CHAMBER.simulator(SETTINGS, CHANNELS).catalogue)


def test_a_sealed_chamber_keeps_pressure_and_temperature(chamber) -> None:
    outputs = chamber.run(hold(), {}, {})
    assert outputs[:, 0] == pytest.approx(7e5, abs=1e-6)
    assert outputs[:, 1] == pytest.approx(T_0)


@pytest.mark.parametrize("name", EFFECTS)
def test_an_amplitude_of_zero_is_the_base_model_bit_for_bit(chamber, name: str) -> None:
    effect = chamber.catalogue[name]
    absent = chamber.run(hold(), {}, {name: {effect.amplitude.name: 0.0} | shapes_of(effect)})
    assert absent.tobytes() == chamber.run(hold(), {}, {}).tobytes()


@pytest.mark.parametrize("name", EFFECTS)
def test_output_is_smooth_in_the_amplitude_at_zero(chamber, name: str) -> None:
    effect = chamber.catalogue[name]
    others = {"leak_linear": {"conductance": 3e-10}} if name == "heat_exchange" else {}
    base = chamber.run(hold(), {}, others)

    def slope(size: float):
        values = {effect.amplitude.name: size} | shapes_of(effect)
        return (chamber.run(hold(), {}, {**others, name: values}) - base)[:, 0] / size

    step = effect.amplitude.difference
    near, far = slope(0.1 * step), slope(step)
    assert np.abs(near).max() > 0.0
    assert np.abs(far - near).max() <= 5e-3 * np.abs(near).max()


def test_a_choked_leak_empties_exponentially(chamber) -> None:
    conductance = 3e-10
    outputs = chamber.run(
        hold(20.0), {}, {"leak_orifice": {"conductance": conductance, "critical_ratio": 0.5}}
    )
    rate = conductance * RHO_0 * R_AIR * T_0 / VOLUME
    absolute = outputs[:, 0] + AIR
    choked = absolute > AIR / 0.5
    assert choked.sum() > 100
    assert absolute[choked] == pytest.approx((7e5 + AIR) * np.exp(-rate * hold(20.0).time)[choked], rel=1e-6)


def test_a_linear_leak_empties_the_gauge_pressure_exponentially(chamber) -> None:
    conductance = 5e-10
    outputs = chamber.run(hold(), {}, {"leak_linear": {"conductance": conductance}})
    rate = conductance * R_AIR * T_0 / VOLUME
    assert outputs[:, 0] == pytest.approx(7e5 * np.exp(-rate * hold().time), rel=1e-4)


def test_a_laminar_leak_follows_its_closed_form(chamber) -> None:
    # ṗ = −c (p² − p_a²)  ⇒  (p − p_a)/(p + p_a) falls exponentially.
    conductance = 1e-15
    absolute = chamber.run(hold(), {}, {"leak_laminar": {"conductance": conductance}})[:, 0] + AIR
    rate = 2.0 * AIR * conductance * R_AIR * T_0 / VOLUME
    ratio = (absolute - AIR) / (absolute + AIR)
    assert ratio == pytest.approx(ratio[0] * np.exp(-rate * hold().time), rel=1e-4)


def test_pores_are_laminar_at_small_flow_and_follow_forchheimer(chamber) -> None:
    laminar = chamber.run(hold(), {}, {"leak_laminar": {"conductance": 1e-16}})
    slow = chamber.run(hold(), {}, {"leak_inertial": {"conductance": 1e-16, "transition": 1e9}})
    assert slow == pytest.approx(laminar, rel=1e-6)
    conductance, transition = 1e-15, 3e5
    absolute = chamber.run(
        hold(), {}, {"leak_inertial": {"conductance": conductance, "transition": transition}}
    )[:, 0]
    absolute = absolute + AIR
    flow = -np.gradient(absolute, STEP) * VOLUME / (R_AIR * T_0)
    squares = flow / conductance + (flow / (conductance * transition)) ** 2
    inside = slice(2, -2)
    assert squares[inside] == pytest.approx((absolute**2 - AIR**2)[inside], rel=1e-3)


def test_heat_agrees_with_an_independent_integrator(chamber) -> None:
    from scipy.integrate import solve_ivp

    tau, conductance = 4.0, 5e-10

    def slope(_: float, state):
        mass, theta = state
        temperature = T_0 + theta
        flow = conductance * (mass * R_AIR * temperature / VOLUME - AIR)
        return [-flow, -theta / tau - (KAPPA - 1.0) * temperature * flow / mass]

    run = hold()
    mass = (7e5 + AIR) * VOLUME / (R_AIR * T_0)
    truth = solve_ivp(
        slope, (0.0, 60.0), [mass, 0.0], t_eval=run.time, rtol=1e-10, atol=1e-14, method="DOP853"
    ).y
    effects = {"leak_linear": {"conductance": conductance}, "heat_exchange": {"time_constant": tau}}
    outputs = chamber.run(run, {}, effects)
    assert outputs[:, 1] == pytest.approx(T_0 + truth[1], abs=2e-3)
    assert outputs[:, 0] + AIR == pytest.approx(truth[0] * R_AIR * (T_0 + truth[1]) / VOLUME, rel=2e-5)


def test_without_heat_from_the_wall_the_gas_expands_adiabatically(chamber) -> None:
    effects = {"leak_linear": {"conductance": 5e-10}, "heat_exchange": {"time_constant": 1e6}}
    outputs = chamber.run(hold(), {}, effects)
    absolute, temperature = outputs[:, 0] + AIR, outputs[:, 1]
    expected = T_0 * (absolute / absolute[0]) ** ((KAPPA - 1.0) / KAPPA)
    assert temperature == pytest.approx(expected, rel=1e-4)


def test_warm_gas_cools_at_constant_mass(chamber) -> None:
    effects = {"filling_heat": {"excess_temperature": 30.0, "time_constant": 10.0}}
    outputs = chamber.run(hold(), {}, effects)
    mass = (outputs[:, 0] + AIR) / outputs[:, 1]
    assert mass == pytest.approx(mass[0], rel=1e-12)
    assert outputs[-1, 1] == pytest.approx(T_0 + 30.0 * np.exp(-hold().time[-1] / 10.0))
