"""The actuator as a system: closed forms of its terms, and the contract that every effect has to keep."""

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from diagnosis.contracts import Experiment
from diagnosis.systems.piston import PISTON, lagged
from diagnosis.systems.piston_effects import friction_state

STEP = 0.01
SETTINGS = {"bore": 25e-3, "stroke_from": -5e-3, "stroke_to": 45e-3, "ambient_pressure": 101_325.0}


def strokes(pressure: float = 5e5, speed: float = 10e-3, seconds: float = 20.0) -> Experiment:
    clock = np.arange(0.0, seconds, STEP)
    x = 17e-3 + 20e-3 * (2.0 / pi) * np.arcsin(np.sin(pi * speed / 40e-3 * clock))
    p = np.full_like(clock, pressure) + 5e3 * np.sign(np.gradient(x))
    inputs = PISTON.prepare(STEP, clock, {"displacement": x, "pressure": p})
    return Experiment("strokes", clock, inputs)


@pytest.fixture(scope="module")
def piston():
    return PISTON.simulator(SETTINGS, (PISTON.outputs[0].channel(0.1, 0.0),))


EFFECTS = sorted(PISTON.simulator(SETTINGS, ()).catalogue)


def shapes_of(effect) -> dict[str, float]:
    return {parameter.name: value for parameter, value in zip(effect.shapes, effect.grid[0], strict=True)}


def test_without_effects_force_is_pressure_times_area(piston) -> None:
    run = strokes()
    force = piston.run(run, {"area_error": 0.02, "force_zero": 3.0}, {})
    assert force[:, 0] == pytest.approx(1.02 * pi / 4 * 25e-3**2 * run.inputs["pressure"] + 3.0)


@pytest.mark.parametrize("name", EFFECTS)
def test_an_amplitude_of_zero_is_the_base_model_bit_for_bit(piston, name: str) -> None:
    effect = piston.catalogue[name]
    run = strokes()
    absent = piston.run(run, {}, {name: {effect.amplitude.name: 0.0} | shapes_of(effect)})
    assert absent.tobytes() == piston.run(run, {}, {}).tobytes()


@pytest.mark.parametrize("name", EFFECTS)
def test_output_is_smooth_in_the_amplitude_at_zero(piston, name: str) -> None:
    effect = piston.catalogue[name]
    run = strokes()
    base = piston.run(run, {}, {})

    def slope(size: float):
        return (piston.run(run, {}, {name: {effect.amplitude.name: size} | shapes_of(effect)}) - base) / size

    step = effect.amplitude.difference
    near, far = slope(0.1 * step), slope(step)
    assert np.abs(near).max() > 0.0
    assert np.abs(far - near).max() <= 2e-3 * np.abs(near).max()


def test_grids_shapes_and_relatives_of_the_effects_fit_together(piston) -> None:
    for effect in piston.catalogue.values():
        assert {*effect.confusers, *effect.richer} <= set(piston.catalogue)
        for point in effect.grid:
            for parameter, value in zip(effect.shapes, point, strict=True):
                assert parameter.low <= value <= parameter.high


def test_friction_state_has_the_loop_and_the_loss_of_berg() -> None:
    # Force amplitude and loss per cycle in closed form: M. Berg 1999.
    x_2, x_0 = 0.3, 1.0
    x = x_0 * np.sin(2.0 * pi * np.arange(0.0, 60.0, 1e-4))
    alpha = friction_state(x, x_2)
    mu = 0.5 / x_2 * (np.sqrt(x_2**2 + x_0**2 + 6.0 * x_2 * x_0) - x_2 - x_0)
    last = slice(-10_001, None)
    assert np.abs(alpha[last]).max() == pytest.approx(mu, rel=1e-4)
    loss = np.trapezoid(alpha[last], x[last])
    width = x_2 * (1.0 + mu)
    assert loss == pytest.approx(
        2.0 * (2.0 * x_0 - width * (1.0 + mu) * np.log((width + 2.0 * x_0) / width)), rel=1e-3
    )


@given(
    steps=st.lists(st.floats(-1e-3, 1e-3), min_size=2, max_size=80),
    x_2=st.floats(1e-5, 1e-2),
)
def test_friction_state_stays_within_one_and_follows_the_motion(steps: list[float], x_2: float) -> None:
    x = np.cumsum(steps)
    alpha = friction_state(x, x_2)
    assert np.abs(alpha).max() <= 1.0 + 1e-12
    assert np.all(np.diff(alpha) * np.diff(x) >= -1e-15)
    assert friction_state(-x, x_2) == pytest.approx(-alpha, abs=1e-12)


def test_coulomb_friction_is_the_limit_without_presliding(piston) -> None:
    run = strokes()
    sharp = piston.run(run, {}, {"coulomb": {"force": 5.0}})
    limit = {"force_at_4_bar": 5.0, "share_growing_with_pressure": 0.0, "presliding_distance": 1e-6}
    assert sharp == pytest.approx(piston.run(run, {}, {"seal_presliding": limit}))
    sliding = np.abs(run.inputs["speed"]) > 9.9e-3
    sliding[:100] = False
    friction = (sharp - piston.run(run, {}, {}))[sliding, 0]
    assert friction == pytest.approx(5.0 * np.sign(run.inputs["speed"][sliding]), abs=0.05)


def test_seal_friction_is_affine_in_the_pressure(piston) -> None:
    def half_loop(pressure: float) -> float:
        run = strokes(pressure)
        effects = {"seal_friction": {"force_at_4_bar": 8.0, "share_growing_with_pressure": 0.75}}
        friction = piston.run(run, {}, effects) - piston.run(run, {}, {})
        return float(np.median(np.abs(friction)))

    assert half_loop(0.0) == pytest.approx(2.0, abs=0.1)
    assert half_loop(4e5) == pytest.approx(8.0, abs=0.1)
    assert half_loop(6e5) == pytest.approx(11.0, abs=0.1)


def test_a_lag_follows_a_ramp_as_it_does_in_closed_form() -> None:
    t = np.arange(0.0, 2.0, STEP)
    lag = 0.07
    exact = t - lag * (1.0 - np.exp(-t / lag))
    assert lagged(t, lag, STEP) == pytest.approx(exact, abs=1e-12)
    # Far below the step it is a straight delay of the line, with a slope that a fit can see.
    assert lagged(t, 1e-5, STEP)[1:] == pytest.approx((t - 1e-5)[1:], abs=1e-12)


def test_surfaces_add_up_to_a_constant_and_follow_a_plane(piston) -> None:
    run = strokes()
    base = piston.run(run, {}, {})
    for splines in piston.splines:
        ones = {parameter.name: 1.0 for parameter in splines.surface.coefficients}
        assert piston.run(run, {}, {splines.name: ones}) - base == pytest.approx(np.ones_like(base))
    over_x = piston.splines[0]
    knots = over_x.first.knots
    width = knots[1] - knots[0]
    plane = {
        f"c_{i}_{j}": knots[0] + (i - 0.5) * width
        for i in range(len(knots) + 1)
        for j in range(len(over_x.second.knots) + 1)
    }
    assert (piston.run(run, {}, {over_x.name: plane}) - base)[:, 0] == pytest.approx(
        run.inputs["displacement"]
    )


def test_rest_is_where_the_piston_stands_still() -> None:
    clock = np.arange(0.0, 10.0, STEP)
    x = np.where(clock < 5.0, 0.0, 10e-3 * (clock - 5.0))
    rest = PISTON.rest(STEP, clock, {"displacement": x})
    assert rest[: round(4.3 / STEP)].all() and not rest[round(4.6 / STEP) :].any()
