"""Closed forms against their limits, their derivatives taken numerically, and the compiled plant's own orifice."""

from dataclasses import replace
from math import pi, tau

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from astb_studies.paper.closed_form import (
    critical_ratio,
    damping_of,
    diaphragm_stiffness,
    flow_resistance,
    gas_stiffness,
    mass_flow,
    nozzle_function,
    nozzle_slope,
    orifice_damping,
    pressure_gradient,
    stiffness_step,
    surge_frequencies,
    time_constant,
    unilateral_cosine,
)
from astb_studies.paper.parameters import load_paper
from bench_protocol.units import bar, mm
from bench_sim.model.orifice import effective_flow_area, nozzle_flow
from bench_sim.model.orifice import nozzle_function as compiled_nozzle_function

PAR = load_paper("paper", "AW0").spring

relaxed = settings(deadline=None)  # two slow cores, shared


def test_choked_flow():
    assert critical_ratio(1.4) == pytest.approx(0.5283, abs=5e-5)
    assert nozzle_function(0.3, 1.4) == pytest.approx(0.6847, abs=5e-5)
    assert nozzle_function(1.0, 1.4) == 0.0
    np.testing.assert_array_equal(nozzle_slope(np.array([0.0, 0.5, critical_ratio(1.4)]), 1.4), 0.0)


@relaxed
@given(st.floats(1e-6, 1.0), st.floats(1.1, 1.67))
def test_nozzle_function_is_that_of_the_plant(r, kappa):
    assert nozzle_function(r, kappa) == pytest.approx(compiled_nozzle_function(r, kappa), abs=1e-12)


@relaxed
@given(st.floats(1.0, 10.0), st.floats(1e-6, 1.0))
def test_mass_flow_is_that_of_the_plant(p_up, r):
    p_up *= bar
    area = effective_flow_area(PAR.orifice_diameter, PAR.discharge_coefficient)
    plant = nozzle_flow(p_up, 293.15, r * p_up, area, PAR.gas_constant, 1.4, PAR.laminar_limit)
    assert mass_flow(p_up, 293.15, r * p_up, PAR) == pytest.approx(plant, abs=1e-12)


@relaxed
@given(st.floats(0.54, 0.9994))
def test_resistance_is_the_slope_of_the_flow(r):
    """(18) against a central difference of (17) at its own mean pressure."""
    p, h = 3e5, 1.0
    slope = (mass_flow(p, 293.15, r * p - h, PAR) - mass_flow(p, 293.15, r * p + h, PAR)) / (2.0 * h)
    assert 1.0 / flow_resistance(r, PAR.orifice_diameter, PAR) == pytest.approx(slope, rel=1e-3)


def test_resistance_of_the_two_sides_agrees_only_close_to_one():
    """(18) writes one resistance for the difference of the pressures: 2 % off at r = 0.98, 13 % at 0.9."""
    p, h = 3e5, 1.0
    for r, excess in ((0.98, 0.021), (0.9, 0.127)):
        upstream = (mass_flow(p + h, 293.15, r * p, PAR) - mass_flow(p - h, 293.15, r * p, PAR)) / (2.0 * h)
        ratio = upstream * flow_resistance(r, PAR.orifice_diameter, PAR)
        assert ratio - 1.0 == pytest.approx(excess, abs=1e-3)


def test_laminar_regularisation_keeps_the_resistance_finite():
    R = flow_resistance(np.array([0.9996, 1.0]), 0.013, PAR)
    assert R[0] == R[1] > 0.0
    assert np.isinf(flow_resistance(0.4, 0.013, PAR))


def test_pressure_gradient_is_that_of_a_polytrope():
    """(9): p V^n = const along dV = A dy."""
    p, h, n = PAR.pressure, 1e-6, PAR.polytropic_exponent
    V, A = PAR.bellows_volume, PAR.lateral_area
    numeric = (p * (V / (V + A * h)) ** n - p * (V / (V - A * h)) ** n) / (2.0 * h)
    assert pressure_gradient(0.0, p, PAR) == pytest.approx(numeric, rel=1e-6)
    assert diaphragm_stiffness(0.0, p, PAR) == pytest.approx(-numeric * A, rel=1e-6)


def test_gas_stiffness_at_rest_and_at_infinity():
    """Both chambers, then the bellows alone; the difference is ΔK of (19) with the lateral area."""
    K_r = diaphragm_stiffness(0.0, PAR.pressure, PAR)
    at_rest, at_infinity = gas_stiffness(np.array([0.0, 1e9]), K_r, PAR)
    assert at_rest == pytest.approx(complex(K_r * 0.03 / 0.10))
    assert at_infinity == pytest.approx(complex(K_r))
    assert (at_infinity - at_rest).real == pytest.approx(stiffness_step(PAR.pressure, PAR, PAR.lateral_area))


def test_a_choked_orifice_is_a_closed_one():
    K = gas_stiffness(np.array([1.0, 10.0]), 100e3, PAR, r=0.4)
    np.testing.assert_array_equal(K, 100e3)
    assert orifice_damping(1.0, 0.4, 0.013, PAR.pressure, PAR) == 0.0
    assert np.isinf(orifice_damping(0.0, 0.4, 0.013, PAR.pressure, PAR))


@relaxed
@given(st.floats(0.1, 300.0), st.floats(0.6, 0.999), st.floats(5.0, 30.0))
def test_damping_coefficient_is_the_loss_of_the_total_stiffness(omega, r, d):
    """(19) with the lateral area is K″/ω of (23): two equations, one element."""
    K_r = diaphragm_stiffness(0.0, PAR.pressure, PAR)
    K = gas_stiffness(omega, K_r, PAR, r, d * mm)
    c = orifice_damping(omega, r, d * mm, PAR.pressure, PAR, PAR.lateral_area)
    assert damping_of(K, omega) == pytest.approx(c, rel=1e-6)


@relaxed
@given(st.floats(0.1, 300.0), st.floats(0.6, 0.999))
def test_gas_stiffness_solves_the_mass_balance(omega, r):
    """(23) against the two balances themselves, with pipe: C_b ṗ_b = −G − C_b p′ẏ, C_a ṗ_a = G, Z G = p_b − p_a."""
    par = replace(PAR, pipe_length=1.5)
    C_b, C_a, A = par.bellows_capacity, par.auxiliary_capacity, par.lateral_area
    gradient = pressure_gradient(0.0, par.pressure, par)
    Z = flow_resistance(r, par.orifice_diameter, par) + 1j * omega * par.pipe_inertance
    s = 1j * omega
    p_b, _, _ = np.linalg.solve(
        np.array([[s * C_b, 0.0, 1.0], [0.0, s * C_a, -1.0], [1.0, -1.0, -Z]]),
        np.array([s * C_b * gradient, 0.0, 0.0]),
    )
    K = gas_stiffness(omega, diaphragm_stiffness(0.0, par.pressure, par), par, r)
    assert -p_b * A == pytest.approx(complex(K), rel=1e-6)


def test_surge_without_losses():
    """With the resistance gone the stiffness vanishes at the first frequency and has its pole at the second."""
    par = replace(PAR, pipe_length=1.5, orifice_diameter=1.0)
    first, second = surge_frequencies(par)
    assert abs(gas_stiffness(tau * first, 1.0, par)) < 2e-3
    assert abs(gas_stiffness(tau * second, 1.0, par)) > 300.0
    speed_of_sound = np.sqrt(1.4 * par.gas_constant * par.gas_temperature)
    pipe = (pi / 4.0 * 0.05**2) / 1.5
    assert second == pytest.approx(speed_of_sound / tau * np.sqrt(pipe * (1.0 / 0.03 + 1.0 / 0.07)))


def test_time_constant_falls_with_the_square_of_the_diameter():
    tau_13, tau_26 = time_constant(0.98, np.array([0.013, 0.026]), PAR)
    assert tau_13 == pytest.approx(4.0 * tau_26)


@relaxed
@given(st.floats(0.1, 20.0), st.integers(1, 5), st.floats(-0.05, 0.05))
def test_unilateral_cosine(omega, cycles, amplitude):
    end = cycles * tau / omega
    t = np.linspace(-0.5 * end, 1.5 * end, 2001)
    z = unilateral_cosine(t, amplitude, omega, cycles)
    assert np.all(z * np.sign(amplitude) >= 0.0)
    assert np.all(z[(t < 0.0) | (t > end * (1.0 + 1e-9))] == 0.0)
    assert unilateral_cosine(pi / omega, amplitude, omega, cycles) == pytest.approx(amplitude)
    np.testing.assert_allclose(unilateral_cosine(t, 3.0 * amplitude, omega, cycles), 3.0 * z, atol=1e-15)
    slope = np.abs(np.diff(z)) / np.diff(t)
    assert np.all(slope <= 0.5 * abs(amplitude) * omega * (1.0 + 1e-9)), "it starts and ends without a step"
