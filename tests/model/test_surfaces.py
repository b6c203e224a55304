"""Terms without a name: B-spline surfaces that are one, linear, held at their ends, and take nothing from nowhere."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from bench_protocol.units import bar, mm
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.experiments import LATERAL as SHEAR
from bench_sim.model.experiments import ROLL, VERTICAL, ImposedMotion, impose, isolate
from bench_sim.model.layout import SURFACE, State
from bench_sim.model.surface import surface

FORCE = {"force_surface_displacement": [-10 * mm, 10 * mm], "force_surface_speed": [-0.2, 0.2]}
FLOW = {"flow_surface_difference": [-0.5 * bar, 0.5 * bar], "flow_surface_pressure": [2 * bar, 5 * bar]}
HEAT = {"heat_surface_pressure": [2 * bar, 5 * bar], "heat_surface_temperature": [-20.0, 20.0]}
GENERATOR = np.random.default_rng(4)


def oracle(coefficients, a, a_span, b, b_span):
    """The same surface by scipy's B-splines."""

    def basis(value, span, count):
        h = (span[1] - span[0]) / (count - 2)
        knots = span[0] + h * np.arange(-2, count + 1)
        value = min(max(value, span[0]), span[1] - 1e-12 * h)
        return BSpline.design_matrix([value], knots, 2).toarray()[0]

    return basis(a, a_span, SURFACE[0]) @ coefficients @ basis(b, b_span, SURFACE[1])


def test_surfaces_are_those_of_scipy():
    coefficients = GENERATOR.normal(size=SURFACE)
    a_span, b_span = np.array([-0.3, 1.1]), np.array([2.0, 7.0])
    for a, b in GENERATOR.uniform((-0.6, 1.0), (1.4, 8.0), (200, 2)):
        found = surface(coefficients, a, a_span, b, *b_span)
        assert found == pytest.approx(oracle(coefficients, a, a_span, b, b_span), abs=1e-9)
    assert surface(np.ones(SURFACE), 0.5, a_span, 3.3, *b_span) == pytest.approx(1.0, abs=1e-14)


def shaken(plant):
    isolate(plant)
    return impose(plant, [ImposedMotion(VERTICAL, 8 * mm, 1.5)], 1.0)


def test_a_force_surface_is_a_force(resting):
    base = shaken(resting())
    coefficients = GENERATOR.normal(scale=100.0, size=SURFACE)
    found = shaken(resting(force_surface=coefficients, **FORCE))
    extra = found.of(Algebraic.VERTICAL_FORCE) - base.of(Algebraic.VERTICAL_FORCE)
    v_0 = 0.01
    for k in range(0, len(extra), 37):
        expected = oracle(
            coefficients,
            base.of(Algebraic.HEIGHT)[k],
            FORCE["force_surface_displacement"],
            np.arcsinh(base.of(Algebraic.HEIGHT_SPEED)[k] / v_0),
            np.arcsinh(np.array(FORCE["force_surface_speed"]) / v_0),
        )
        assert extra[k] == pytest.approx(expected, abs=1e-6)
    assert np.array_equal(found.of(Algebraic.PRESSURE), base.of(Algebraic.PRESSURE)), (
        "it leaves the gas alone"
    )


LATERAL_SPANS = {
    "shear_surface_shear": [-10 * mm, 10 * mm],
    "shear_surface_speed": [-0.2, 0.2],
    "roll_surface_roll": [-5e-3, 5e-3],
    "roll_surface_shear": [-10 * mm, 10 * mm],
    "moment_surface_roll": [-5e-3, 5e-3],
    "moment_surface_shear": [-10 * mm, 10 * mm],
}


def test_lateral_surfaces_are_a_force_and_a_moment(resting):
    def rolled(plant):
        isolate(plant)
        return impose(plant, [ImposedMotion(SHEAR, 8 * mm, 1.5), ImposedMotion(ROLL, 4e-3, 1.1)], 1.0)

    names = ("shear_surface", "roll_surface", "moment_surface")
    shear, roll, moment = (GENERATOR.normal(scale=100.0, size=SURFACE) for _ in names)
    base = rolled(resting())
    found = rolled(resting(shear_surface=shear, roll_surface=roll, moment_surface=moment, **LATERAL_SPANS))
    force = found.of(Algebraic.LATERAL_FORCE) - base.of(Algebraic.LATERAL_FORCE)
    turning = found.of(Algebraic.ROLL_MOMENT) - base.of(Algebraic.ROLL_MOMENT)
    spans = LATERAL_SPANS
    for k in range(0, len(force), 37):
        y, v, theta = (
            base.of(one)[k] for one in (Algebraic.LATERAL, Algebraic.LATERAL_SPEED, Algebraic.ROLL)
        )
        speeds = np.arcsinh(np.array(spans["shear_surface_speed"]) / 0.01)
        expected = oracle(shear, y, spans["shear_surface_shear"], np.arcsinh(v / 0.01), speeds)
        expected += oracle(roll, theta, spans["roll_surface_roll"], y, spans["roll_surface_shear"])
        assert force[k] == pytest.approx(expected, abs=1e-6)
        expected = oracle(moment, theta, spans["moment_surface_roll"], y, spans["moment_surface_shear"])
        assert turning[k] == pytest.approx(expected, abs=1e-6)


def test_a_flow_surface_takes_from_one_chamber_what_it_gives_to_the_other(resting):
    base = shaken(resting())
    found = shaken(resting(flow_surface=GENERATOR.normal(scale=5e-3, size=SURFACE), **FLOW))
    for side in range(2):
        mass = found.states[:, State.BELLOWS_MASS + side] + found.states[:, State.AUXILIARY_MASS + side]
        assert np.ptp(mass) < 1e-12 * mass[0]
    assert np.ptp(found.of(Algebraic.PRESSURE) - base.of(Algebraic.PRESSURE)) > 100.0


def test_a_heat_surface_heats(resting):
    plant = resting("AW0", ("heat", "emergency_spring"), heat_surface=50.0, orifice_diameter=1 * mm, **HEAT)
    isolate(plant)
    course = impose(plant, [], 1.0, every=1000, rows=1)
    before = course.states[0, State.BELLOWS_ENERGY] + course.states[0, State.AUXILIARY_ENERGY]
    after = plant.state[State.BELLOWS_ENERGY] + plant.state[State.AUXILIARY_ENERGY]
    assert after - before == pytest.approx(50.0, rel=1e-6)


def test_without_a_span_there_is_no_surface(resting):
    plant, other = resting(), resting(force_surface=1e3, flow_surface=1.0, heat_surface=1e4)
    assert shaken(plant).algebraic.tobytes() == shaken(other).algebraic.tobytes()
