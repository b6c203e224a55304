"""First harmonics, secants and loops against closed forms."""

from math import pi, tau

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from test_plans.analysis import (
    NotMeasured,
    distortion,
    dynamic_stiffness,
    first_harmonic,
    loop_energy,
    secant_stiffness,
    straight_line,
    whole_cycles,
    without_drift,
    without_inertia,
)
from test_plans.description import ours
from test_plans.steps.air import _settled
from tests.refusals import refuses

RATE = 200.0


def grid(seconds):
    return np.arange(round(seconds * RATE)) / RATE


@given(
    re=st.floats(-10, 10),
    im=st.floats(-10, 10),
    mean=st.floats(-100, 100),
    drift=st.floats(-5, 5),
    frequency=st.floats(0.5, 12.0),
    cycles=st.integers(1, 6),
    start=st.floats(0, 50),
)
def test_the_amplitude_comes_back_whatever_the_mean_and_the_drift(
    re, im, mean, drift, frequency, cycles, start
):
    t = start + grid(cycles / frequency + 1 / RATE)
    amplitude = complex(re, im)
    x = mean + drift * t + (amplitude * np.exp(1j * tau * frequency * t)).real
    assert first_harmonic(t, x, frequency) == pytest.approx(amplitude, abs=1e-6)


def test_higher_harmonics_do_not_leak_into_the_first():
    t = grid(2.0)
    x = np.cos(tau * t) + 0.3 * np.cos(3 * tau * t + 0.4)
    assert abs(first_harmonic(t, x, 1.0)) == pytest.approx(1.0, abs=0.01)


def test_noise_averages_out_as_the_root_of_the_number_of_samples():
    t, sigma = grid(5.0), 0.1
    errors = [
        abs(
            first_harmonic(t, np.sin(tau * t) + np.random.default_rng(seed).normal(0, sigma, t.size), 1.0)
            + 1j
        )
        for seed in range(60)
    ]
    # Two quadratures of variance 2σ²/n each (the trend column takes a little more).
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(sigma * np.sqrt(4 / t.size), rel=0.3)


@given(
    k=st.floats(1e5, 2e6),
    c=st.floats(0, 1e5),
    frequency=st.sampled_from([0.5, 1.0, 2.0, 3.0]),
    phase=st.floats(0, 6),
)
def test_a_spring_with_a_dashpot_has_its_own_stiffness_damping_and_loss(k, c, frequency, phase):
    t, a = grid(3 / frequency), 5e-3
    x = a * np.sin(tau * frequency * t + phase)
    v = a * tau * frequency * np.cos(tau * frequency * t + phase)
    K = dynamic_stiffness(t, x, 53_500.0 + k * x + c * v, frequency)
    assert K.storage == pytest.approx(k, rel=1e-6)
    assert K.damping == pytest.approx(c, rel=1e-6, abs=1e-3)
    assert K.amplitude == pytest.approx(a, rel=1e-6)
    assert K.energy == pytest.approx(pi * c * tau * frequency * a**2, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("lags", [(2e-3, 0.0), (4e-3, 3e-3), (1e-3, 5e-3)])
def test_late_sensors_are_neither_damping_nor_stiffness_once_their_lags_are_known(lags):
    t, f = grid(2.0), 3.0
    motion, force = (((1 / (1 + 1j * tau * f * lag)) * -1j * np.exp(1j * tau * f * t)).real for lag in lags)
    assert abs(dynamic_stiffness(t, motion, 7e5 * force, f).loss) > 10e3  # an assumption without a reading
    K = dynamic_stiffness(t, motion, 7e5 * force, f, lags=lags)
    assert K.value == pytest.approx(7e5 + 0j, abs=1.0)


def test_the_secant_joins_the_turning_points_of_a_triangle_with_friction():
    x = 5e-3 * np.concatenate([np.linspace(1, -1, 500), np.linspace(-1, 1, 500)])
    k, friction = 3e5, 200.0
    direction = np.repeat([-1.0, 1.0], 500)
    # A stick-slip element of 1 mm carries the friction over at each turn, so the corners are ±(k a + F).
    turned = np.minimum(1.0, np.abs(x - np.repeat([x[0], x[500]], 500)) / 1e-3)
    force = k * x + friction * direction * (2 * turned - 1)
    assert secant_stiffness(x, force) == pytest.approx(k + friction / 5e-3, rel=0.02)


def test_the_loop_encloses_the_energy_of_an_ellipse():
    angle = np.linspace(0, tau, 1000, endpoint=False)
    x, force = 5e-3 * np.sin(angle), 400.0 * np.sin(angle) + 90.0 * np.cos(angle)
    assert loop_energy(x, force) == pytest.approx(pi * 5e-3 * 90.0, rel=1e-4)
    assert loop_energy(x[::-1], force[::-1]) == pytest.approx(-pi * 5e-3 * 90.0, rel=1e-4)


def test_whole_cycles_begin_where_the_generator_has_counted_the_soft_one():
    t = grid(4.0)
    inside = whole_cycles(t, np.floor(2.0 * t), t >= 0, first=1, count=3, frequency=2.0)
    assert t[inside][0] == pytest.approx(0.5)
    assert np.count_nonzero(inside) == round(3 / 2.0 * RATE)


def test_the_count_of_the_program_before_does_not_begin_the_window():
    t = grid(4.0)
    running = t >= 0.3
    cycle = np.where(running, np.floor(2.0 * (t - 0.3)), 5.0)
    inside = whole_cycles(t, cycle, running, first=1, count=2, frequency=2.0)
    assert t[inside][0] == pytest.approx(0.8)


def test_a_fitted_line_ignores_gaps():
    t = grid(1.0)
    x = np.where(t == t[7], np.nan, 300.0 - 2.0 * t)
    level, slope = straight_line(t, x)
    assert slope == pytest.approx(-2.0)
    assert level == pytest.approx(300.0 - 2.0 * t[t != t[7]].mean())


def test_a_drift_of_a_quarter_of_the_force_leaves_less_than_a_hundredth_in_the_secant():
    angle = np.linspace(0, tau, 1001)
    x, force = 5e-3 * np.sin(angle), 400.0 * np.sin(angle) + 90.0 * np.cos(angle)
    drifted = force + np.linspace(0, 200.0, force.size)
    assert without_drift(x, drifted) == pytest.approx(force + 100.0, abs=8.0)
    assert secant_stiffness(x, without_drift(x, drifted)) == pytest.approx(
        secant_stiffness(x, force), rel=0.01
    )


def test_the_inertia_of_the_bolster_is_taken_off_the_actuator():
    mass, f, k, a = 1200.0, 3.0, 1.7e6, 5e-3
    actuator = k * a - mass * (tau * f) ** 2 * a  # a mass below resonance takes part of the spring's force
    assert without_inertia(complex(actuator), complex(a), mass, f) == pytest.approx(k * a)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda t: first_harmonic(t[:50], t[:50], 1.0), "cycles"),
        (lambda t: first_harmonic(t, np.full_like(t, np.nan), 1.0), "missing"),
        (lambda t: first_harmonic(t, t[:-1], 1.0), "do not fit"),
        (lambda t: first_harmonic(t, t, 150.0), "harmonic"),
        (lambda t: dynamic_stiffness(t, 0 * t, t, 1.0), "nothing"),
        (lambda t: secant_stiffness(0 * t, t), "nothing"),
        (lambda t: secant_stiffness(t * np.nan, t), "missing"),
        (lambda t: straight_line(t, t * np.nan), "few"),
        (lambda t: _settled(ours(), "left.bellows_pressure", t, t * np.nan), "few"),
        (lambda t: without_drift(t, t), "begins"),
        (lambda t: whole_cycles(t, 0 * t, t >= 0, first=1, count=1, frequency=1.0), "complete 1"),
        (lambda t: whole_cycles(t, 0 * t, t >= 0, first=0, count=9, frequency=1.0), "samples"),
    ],
)
def test_what_was_not_measured_is_not_computed(call, says):
    with refuses(NotMeasured, says):
        call(grid(1.5))


@given(part=st.floats(0.0, 0.2), drift=st.floats(-5, 5), phase=st.floats(0, tau))
def test_a_non_sine_is_detected_at_any_drift(part, drift, phase):
    t = grid(2.0)
    motion = 3.0 + drift * t + np.sin(tau * t + phase) + part * np.sin(3 * tau * t)
    assert distortion(t, motion, 1.0) == pytest.approx(part, rel=0.03, abs=1e-9)


@given(part=st.floats(0.0, 0.1), drift=st.floats(-5, 5), phase=st.floats(0, tau))
def test_a_non_triangle_is_detected_at_any_drift(part, drift, phase):
    t = grid(2.0)
    pure = 2 / np.pi * np.arcsin(np.sin(tau * t + phase))
    motion = 3.0 + drift * t + 5.0 * (pure + part * np.sqrt(2 / 3) * np.sin(4 * tau * t))
    assert distortion(t, motion, 1.0, "triangle") == pytest.approx(part, rel=0.1, abs=1e-3)
    assert distortion(t, np.sin(tau * t + phase), 1.0, "triangle") > 0.05
    assert distortion(t, motion, 1.0) > 0.1


def test_a_stall_of_the_set_points_is_no_sine():
    t = grid(5 / 3)
    late = np.where((t > 0.8) & (t < 0.85), 0.8, t)
    assert distortion(t, np.sin(tau * 3.0 * t), 3.0) < 1e-9
    assert distortion(t, np.sin(tau * 3.0 * late), 3.0) > 0.05
    with refuses(NotMeasured):
        distortion(t, np.zeros_like(t), 3.0)
