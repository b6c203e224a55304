"""Effects of rubber, gas and flow against closed forms and limits."""

import numpy as np
import pytest

from bench_protocol.units import kN, litre, mm
from bench_sim.model import spring
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.effects.gas import sonic_conductance
from bench_sim.model.effects.rubber import TIMES, ladder
from bench_sim.model.experiments import LATERAL, VERTICAL, ImposedMotion, dynamic_stiffness, impose, isolate
from bench_sim.model.layout import Input, State
from bench_sim.model.orifice import AIR_VISCOSITY
from bench_sim.model.plant import Plant
from bench_sim.model.vehicle import Vehicle
from bench_sim.parameters import load
from bench_sim.parameters.effects import with_effects
from bench_sim.parameters.vehicle import load_vehicle

P_ATM = 101325.0
A, A_1, V_B, V_A, KAPPA, R, T = 0.26, -0.20, 30 * litre, 70 * litre, 1.4, 287.05, 293.15
LOADS = {"AW0": 53.5 * kN, "AW3": 145 * kN}
RIGID = ("emergency_spring",)
BARE = ("emergency_spring", "rubber", "heat")
BOTH = pytest.mark.parametrize("load_case", list(LOADS))
K_SHELL = 45e3
#: Nothing lateral but the shell.
SHELL = {
    "membrane_length": 0,
    "membrane_length_slope": 0,
    "shell_stiffness_lateral": K_SHELL,
    "maxwell_ratio": 0,
    "coupling_sign": 0,
}


@pytest.fixture
def given(parameters):
    """Make a sealed bench at rest with one effect: ``given("leak.left", {"area": 1e-7}, "AW3", BARE)``."""

    def build(name, values, load_case="AW0", without=(), **changes) -> Plant:
        plant = Plant.at_rest(with_effects(parameters(load_case, without, **changes), {name: values}).record)
        isolate(plant)
        return plant

    return build


def shut(plant):
    plant.inputs[[Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE]] = 0.0
    return plant


def closed_stiffness(load_case, V, *, compliance=0.0, slope=A_1):
    """K = κ p A²/(V + κ C_V p) − p_g A_1 in N/m."""
    gauge = LOADS[load_case] / A
    p = gauge + P_ATM
    return KAPPA * p * A * A / (V + KAPPA * compliance * p) - gauge * slope


# -- rubber --------------------------------------------------------------------------------------------------------


def lateral_stiffness(plant, f):
    return dynamic_stiffness(plant, 5 * mm, f, max(4, round(20 * f)), direction=LATERAL)[0]


@pytest.mark.parametrize("f", [0.2, 1.0, 5.0])
def test_maxwell_branches_have_their_complex_stiffness(given, f):
    def branch(tau):
        return 2j * np.pi * f * tau / (1.0 + 2j * np.pi * f * tau)

    bare = ("emergency_spring", "friction")
    one = given("maxwell", {"ratio": 0.4, "time": 0.2}, without=bare, **SHELL)
    assert lateral_stiffness(one, f) == pytest.approx(K_SHELL * (1 + 0.4 * branch(0.2)), rel=2e-3)
    values = {"ratio": 0.5, "time_fast": 0.05, "time_slow": 0.8, "share": 0.3}
    two = given("maxwell_two", values, without=bare, **SHELL)
    expected = K_SHELL * (1 + 0.15 * branch(0.05) + 0.35 * branch(0.8))
    assert lateral_stiffness(two, f) == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("order", [0.1, 0.3, 0.5, 0.7])
def test_the_fractional_ladder_is_a_power_of_the_frequency(order):
    f = np.geomspace(0.003, 30.0, 400)
    iwt = 2j * np.pi * f[:, None] * TIMES
    found = (iwt / (1.0 + iwt)) @ ladder(order)
    error = np.abs(found / (1j * f) ** order - 1.0)
    assert error.max() < 0.07
    assert np.sqrt(np.mean(error**2)) < 0.04
    assert np.all(ladder(order) > 0.0)
    assert np.allclose(ladder(order + 1e-6), ladder(order), rtol=1e-4), "smooth in the order"


def test_fractional_rubber_is_in_the_bench(given):
    for f in (0.5, 5.0):
        K = lateral_stiffness(
            given(
                "fractional", {"ratio": 0.3, "order": 0.4}, without=("emergency_spring", "friction"), **SHELL
            ),
            f,
        )
        assert abs(K - K_SHELL * (1 + 0.3 * (1j * f) ** 0.4)) < 0.05 * abs(0.3 * K_SHELL * f**0.4)


def loop_of(F_max, x_2, x_0):
    """Amplitude and loss per cycle of a Berg element."""
    F_0 = F_max / (2 * x_2) * (np.sqrt(x_2**2 + x_0**2 + 6 * x_2 * x_0) - x_2 - x_0)
    mu = F_0 / F_max
    return F_0, 2 * F_max * (
        2 * x_0 - x_2 * (1 + mu) ** 2 * np.log((x_2 * (1 + mu) + 2 * x_0) / (x_2 * (1 + mu)))
    )


@pytest.mark.parametrize("x_0", [1 * mm, 6 * mm])
@pytest.mark.parametrize(
    ("name", "values", "elements"),
    [
        ("friction", {"force": 500.0, "travel": 4 * mm}, [(500.0, 4 * mm)]),
        (
            "friction_distributed",
            {"force": 600.0, "travel_short": 1 * mm, "travel_long": 9 * mm, "share": 0.25},
            [(150.0, 1 * mm), (450.0, 9 * mm)],
        ),
    ],
)
def test_amplitude_and_loss_of_friction_loops(given, name, values, elements, x_0):
    without = ("emergency_spring", "friction")
    plant = given(name, values, without=without, **(SHELL | {"shell_stiffness_lateral": 0}))
    impose(plant, [ImposedMotion(LATERAL, x_0, 1.0)], 40.0, rows=0)
    loop = impose(plant, [ImposedMotion(LATERAL, x_0, 1.0)], 1.001)
    F, y = -loop.of(Algebraic.LATERAL_FORCE), loop.of(Algebraic.LATERAL)
    amplitude, loss = np.sum([loop_of(*element, x_0) for element in elements], axis=0)
    assert 0.5 * np.ptp(F) == pytest.approx(amplitude, rel=3e-3)
    assert np.sum(0.5 * (F[1:] + F[:-1]) * np.diff(y)) == pytest.approx(loss, rel=5e-3)


def test_creep_ends_at_its_share_of_the_deflection(given):
    ratio, tau, k = 0.2, 5.0, 6e6
    plant = given("creep", {"ratio": ratio, "time": tau}, "AW3", ("heat", "friction"))
    course = impose(plant, [], 60.0, every=100)
    q = course.states[:, State.CREEP]
    F = course.of(Algebraic.STACK_VERTICAL)
    assert q[-1] == pytest.approx(ratio * F[-1] / k, rel=1e-4)
    assert q[50] / q[-1] == pytest.approx(1 - np.exp(-course.time[50] / tau), abs=0.01)
    sag = course.of(Algebraic.BELLOWS_VERTICAL) - course.of(Algebraic.HEIGHT)
    assert sag == pytest.approx((F - LOADS["AW3"]) / k + q, abs=1e-9)
    assert F[-1] < F[0] - 100.0, "a longer bellows at the same height of the spring presses less"


@pytest.mark.parametrize("y", [-18 * mm, 5 * mm, 18 * mm])
def test_the_extra_stop_is_linear_beyond_its_gap(given, y):
    plant = given("bump_stop", {"stiffness": 80e3, "gap": 10 * mm})
    course = impose(plant, [ImposedMotion(LATERAL, 0.0, 1.0, offset=y)], 0.01)
    expected = -np.sign(y) * 80e3 * max(abs(y) - 10 * mm, 0.0)
    assert course.of(Algebraic.BUMP_STOP)[-1] == pytest.approx(expected, abs=1e-9)


# -- gas -----------------------------------------------------------------------------------------------------------


@BOTH
def test_ln_p_of_a_choked_leak_falls_on_a_line(given, load_case):
    area = 1e-6
    plant = shut(given("leak.left", {"area": area}, load_case, RIGID, bellows_heat_transfer=1000))
    course = impose(plant, [], 10.0, every=10)
    p = course.of(Algebraic.PRESSURE)
    assert p[-1] > P_ATM / 0.5, "choked to the end"
    tau = V_B / (sonic_conductance(area, R) * 1.185 * R * T)
    slope = np.polyfit(course.time[100:], np.log(p[100:]), 1)[0]
    assert slope == pytest.approx(-1.0 / tau, rel=5e-3)
    assert np.ptp(course.of(Algebraic.PRESSURE, 1)) < 1.0, "the other spring does not leak"
    assert sonic_conductance(0.1e-6, R) == pytest.approx(1.99e-10, rel=2e-3)


def test_a_laminar_leak_passes_what_its_equation_says(given):
    k = 2e-14
    course = impose(given("leak_laminar.right", {"coefficient": k}, "AW3"), [], 5.0)
    m = course.states[:, State.BELLOWS_MASS + 1] + course.states[:, State.AUXILIARY_MASS + 1]
    flow = k * (course.of(Algebraic.PRESSURE, 1) ** 2 - P_ATM**2)
    assert m[0] - m[-1] == pytest.approx(np.sum(0.5 * (flow[1:] + flow[:-1])) * 1e-3, rel=1e-6)


def test_gas_settles_with_the_changed_heat_exchange(given):
    plant = shut(given("heat", {"change": 0.8}, "AW0", RIGID))
    plant.state[State.BELLOWS_ENERGY] *= 1.002
    course = impose(plant, [], 4.0, every=100)
    excess = course.of(Algebraic.TEMPERATURE) - T
    m = course.states[0, State.BELLOWS_MASS]
    hS = 1.8 * 8.0 * (m / V_B / 3.65) ** 0.67
    tau = m * R / (KAPPA - 1) / hS
    assert np.log(excess[0] / excess[-1]) == pytest.approx(course.time[-1] / tau, rel=2e-3)


@BOTH
@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("compliance", {"compliance": 0.5 * 1e-8}, {"V": V_B, "compliance": 0.5e-8}),
        ("bellows_volume", {"change": 0.1}, {"V": 1.1 * V_B}),
        ("area_slope", {"slope": 0.1}, {"V": V_B, "slope": A_1 + 0.1}),
    ],
)
def test_stiffness_of_a_closed_bellows(given, load_case, name, values, expected):
    plant = shut(given(name, values, load_case, BARE))
    K, _ = dynamic_stiffness(plant, 0.5 * mm, 5.0, 3)
    assert K.real == pytest.approx(closed_stiffness(load_case, **expected), rel=1e-4)
    assert abs(K.imag / K.real) < 1e-6


GROWTH = 296e-9


def pressed_area(load_case, growth=GROWTH, reference=2.06e5):
    """Gauge pressure (Pa) that carries the load, and ∂V/∂ζ = ∂F/∂p (m²), of F = p_g (A + A_p (p_g − p_A))."""
    bare = A - growth * reference
    gauge = max(np.roots([growth, bare, -LOADS[load_case]]).real)
    return gauge, bare + 2.0 * growth * gauge


@BOTH
def test_rest_and_stiffness_where_the_area_grows_with_pressure(given, load_case):
    plant = shut(given("area_pressure", {"growth": GROWTH}, load_case, BARE))
    gauge, area = pressed_area(load_case)
    assert plant.truth()["pressure[0]"] == pytest.approx(gauge + P_ATM, rel=1e-9)
    assert plant.truth()["volume[0]"] == pytest.approx(
        V_B + 2 * GROWTH * (gauge - 2.06e5) * V_B / A, rel=1e-9
    )
    p, V = gauge + P_ATM, V_B + 2.0 * GROWTH * (gauge - 2.06e5) * V_B / A
    expected = KAPPA * p * area**2 / (V + KAPPA * p * 2.0 * GROWTH * V_B / A) - gauge * A_1
    K, _ = dynamic_stiffness(plant, 0.5 * mm, 5.0, 3)
    assert K.real == pytest.approx(expected, rel=1e-4)
    assert abs(K.imag / K.real) < 1e-6
    in_series = shut(given("area_pressure", {"growth": GROWTH}, load_case, ("rubber", "heat")))
    K, _ = dynamic_stiffness(in_series, 0.5 * mm, 5.0, 3)
    assert K.real == pytest.approx(1.0 / (1.0 / expected + 1.0 / 6e6), rel=2e-4)


@pytest.mark.parametrize("zeta", [-0.04, 0.0, 0.03])
def test_the_wall_of_a_growing_area_keeps_its_energy(given, zeta):
    """Around a closed loop in height and pressure the force's work is that of the gas: ∮ p_g dV = ∮ F dζ."""
    par = given("area_pressure", {"growth": GROWTH}, "AW0", BARE).parameters
    plant = Plant.at_rest(par)

    def force_and_volume(height, gauge):
        V = spring.volume(par, 0, height, 0.0) + spring.stretch(par, 0, height, gauge + P_ATM)
        plant.state[State.BELLOWS_ENERGY] = (gauge + P_ATM) * V / (KAPPA - 1.0)
        out = np.zeros_like(plant._algebraic)
        spring.load_bellows(plant.state, plant.memory, par, 0, height, 0.0, out)
        assert out[Algebraic.PRESSURE] == pytest.approx(gauge + P_ATM, rel=1e-12)
        return out[Algebraic.STACK_VERTICAL], out[Algebraic.VOLUME]

    around = np.linspace(0.0, 2.0 * np.pi, 1201)
    heights, gauges = zeta + 0.01 * np.cos(around), 3.5e5 + 1.5e5 * np.sin(around)
    loads = np.array([force_and_volume(*at) for at in zip(heights, gauges, strict=True)])
    by_force = np.trapezoid(loads[:, 0], heights)
    assert np.trapezoid(gauges, loads[:, 1]) == pytest.approx(by_force, rel=1e-4)
    assert loads[:, 0] == pytest.approx(gauges * (A + A_1 * heights + GROWTH * (gauges - 2.06e5)), rel=1e-9)


@BOTH
def test_a_stretching_bellows_acts_parallel_to_the_emergency_spring(given, load_case):
    """In series with it the tangents must be right too, or Newton's method and the bellows' speed would not be."""
    C = 1e-8
    plant = shut(given("compliance", {"compliance": C}, load_case, ("rubber", "heat")))
    assert plant.truth()["pressure[0]"] == pytest.approx(LOADS[load_case] / A + P_ATM, rel=1e-9)
    K, _ = dynamic_stiffness(plant, 0.5 * mm, 5.0, 3)
    bellows = closed_stiffness(load_case, V_B, compliance=C)
    assert K.real == pytest.approx(1.0 / (1.0 / bellows + 1.0 / 6e6), rel=2e-4)


@BOTH
def test_stiffness_of_both_volumes_in_one(given, load_case):
    plant = given("auxiliary_volume", {"change": 0.2}, load_case, BARE, orifice_diameter=60 * mm)
    K, _ = dynamic_stiffness(plant, 5 * mm, 0.5, 6, longest_step=2.5e-4)
    assert K.real == pytest.approx(closed_stiffness(load_case, V_B + 1.2 * V_A), rel=5e-4)


# -- flow ----------------------------------------------------------------------------------------------------------


def orifice_flow(plant, excess):
    """Flow from bellows to chamber in kg/s while the bellows' pressure is higher by this share."""
    plant.state[[State.BELLOWS_MASS, State.BELLOWS_ENERGY]] *= 1.0 + excess
    return plant.truth()["orifice_flow[0]"]


@pytest.mark.parametrize("excess", [-0.3, -0.01, 0.01, 0.3])
def test_what_the_orifice_passes(given, resting, excess):
    base = orifice_flow(resting(), excess)
    assert orifice_flow(given("discharge", {"change": 0.1}), excess) == pytest.approx(1.1 * base, rel=1e-12)
    directed = 1.08 if excess > 0 else 0.92
    found = orifice_flow(given("asymmetric_orifice", {"asymmetry": 0.08}), excess)
    assert found == pytest.approx(directed * base, rel=1e-12)
    Re = 4 * abs(base) / (np.pi * 13 * mm * AIR_VISCOSITY)
    found = orifice_flow(given("discharge_reynolds", {"k": 20.0}), excess)
    assert found == pytest.approx(base / (1 + 20 / np.sqrt(Re)), rel=1e-12)
    assert found == pytest.approx(base * (1 - 20 / np.sqrt(Re)), rel=1.1 * 400 / Re), "the customary form"


def test_a_directed_orifice_parts_the_chambers(given):
    means = []
    for e in (-0.08, 0.0, 0.08):
        course = impose(
            given("asymmetric_orifice", {"asymmetry": e}), [ImposedMotion(VERTICAL, 10 * mm, 1.5)], 20.0
        )
        split = course.of(Algebraic.PRESSURE) - course.of(Algebraic.AUXILIARY_PRESSURE)
        means.append(np.mean(split[-4000:]))
    assert means[0] > means[1] > means[2], (
        "what passes more easily outward leaves the bellows at less pressure"
    )
    assert means[0] - means[1] == pytest.approx(means[1] - means[2], rel=0.05)


@pytest.mark.parametrize("f", [4.0, 8.0, 12.0])
def test_short_inertia_is_that_of_a_fitted_pipe(given, resting, f):
    """Another solver altogether: there the flow is a state and the step is divided."""
    options = {"amplitude": 1 * mm, "frequency": f, "cycles": round(3 * f), "longest_step": 0.25e-3}
    K, _ = dynamic_stiffness(given("pipe_inertia", {"length": 1.5}, "AW0", BARE), **options)
    piped, _ = dynamic_stiffness(resting("AW0", BARE, pipe_length=1.5, pipe_friction=0), **options)
    without, _ = dynamic_stiffness(resting("AW0", BARE), **options)
    assert abs(K - piped) < 0.01 * abs(without - piped), "what the laminar zone, which the pipe lacks, leaves"


def test_the_deadband_shifts_the_opening_and_the_delay_the_lever(given):
    flows = {}
    for change in (0.0, 2 * mm):
        plant = given("leveling_deadband", {"change": change})
        plant.inputs[Input.LEFT_LEVELING] = 1.0
        plant.state[State.LEVER] = 8 * mm
        plant.memory.leveling_latch[0] = 1
        flows[change] = plant.truth()["leveling_flow[0]"]
    assert flows[2 * mm] / flows[0.0] == pytest.approx((8 - 6 + 1) / (8 - 4 + 1), rel=1e-12)
    plant = given("leveling_delay", {"time": 1.5})
    impose(plant, [ImposedMotion(VERTICAL, 0.0, 1.0, offset=3 * mm)], 2.0, rows=0)
    assert plant.state[State.LEVER] == pytest.approx(3 * mm * (1 - np.exp(-2.0 / 2.5)), rel=1e-9)


def test_a_leaking_differential_pressure_valve_levels_the_springs(given):
    plant = given("dpv_leak", {"area": 20e-6})
    plant.inputs[Input.DPV_CONNECTED] = 1.0
    plant.state[[State.BELLOWS_MASS, State.BELLOWS_ENERGY, State.AUXILIARY_MASS, State.AUXILIARY_ENERGY]] *= (
        1.2
    )
    course = impose(plant, [], 60.0, every=100)
    difference = course.of(Algebraic.AUXILIARY_PRESSURE) - course.of(Algebraic.AUXILIARY_PRESSURE, 1)
    assert 5e4 < difference[0] < plant.parameters.dpv_opening, "the valve itself stays closed"
    assert np.all(np.diff(difference) < 0.0)
    assert abs(difference[-1]) < 0.05 * difference[0]


# -- the vehicle on the same springs -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", [e.name for e in CATALOGUE.values() if e.family in ("rubber", "gas", "flow")]
)
def test_every_effect_of_a_spring_reaches_the_vehicle(name):
    effect = CATALOGUE[name]
    base = load("astb")
    values = {effect.amplitude.name: effect.amplitude.typical}
    given = with_effects(base, {f"{name}.left" if effect.places else name: values})
    ends = []
    for parameters in (base, given):
        car = Vehicle(parameters.record, load_vehicle().record, leveling=True)
        car.state[State.LEVER] = 8 * mm
        car.memory.leveling_latch[0] = 1
        car.state[[State.AUXILIARY_MASS, State.AUXILIARY_ENERGY]] *= 1.05
        car.ride(15 * kN, 1.5)
        ends.append(car.state[: State.PLATFORM_LATERAL].copy())
    assert np.any(ends[0] != ends[1])
    assert np.allclose(ends[0], ends[1], rtol=0.3, atol=0.02), "a small cause has a small consequence"
