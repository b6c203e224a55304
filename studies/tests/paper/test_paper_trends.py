"""The paper's statements about its figures, in the paper's layer, and cases in which its formulas contradict them."""

from dataclasses import replace
from math import tau

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from astb_studies.paper.closed_form import (
    combined,
    damping_of,
    diaphragm_stiffness,
    dynamic_stiffness,
    equivalent_volume,
    gas_stiffness,
    lateral_area,
    layered_stiffness,
    orifice_damping,
    peak_damping,
    peak_ratio,
    roll_factor,
)
from astb_studies.paper.parameters import load_paper
from bench_protocol.units import bar, mm

PAR = load_paper("paper", "AW0").spring

relaxed = settings(deadline=None)  # two slow cores, shared
OMEGA = tau * 1.2

offsets = st.floats(0.0, 0.1)
pressures = st.floats(1.1 * bar, 10 * bar)
diameters = st.floats(5 * mm, 30 * mm)
angles = st.floats(-0.2, 0.2)


@relaxed
@given(offsets, pressures, pressures)
def test_stiffness_rises_with_pressure(y, p, q):
    """T1: in proportion."""
    low, high = sorted((p, q))
    stiffness = diaphragm_stiffness(y, np.array([low, high]), PAR)
    assert stiffness[1] / stiffness[0] == pytest.approx(high / low, rel=1e-14)
    assert stiffness[0] > 0.0


def test_stiffness_rises_by_membrane_length_per_pressure(aw0, aw3):
    """A14: dK/dp within 20 % of the plant's κ_0 = 0.35 m; in series with the emergency spring 0.28 m."""
    rise = aw3.pressure - aw0.pressure
    K = [diaphragm_stiffness(0.0, par.pressure, par) for par in (aw0, aw3)]
    series = [combined(k, layered_stiffness(aw0), "series") for k in K]
    assert (K[1] - K[0]) / rise == pytest.approx(0.325, abs=0.001)
    assert (series[1] - series[0]) / rise == pytest.approx(0.280, abs=0.001)
    assert 0.8 * 0.35 <= (K[1] - K[0]) / rise <= 1.2 * 0.35


def test_heavier_car_stiffer_spring(aw0, aw3):
    """A15 and T3: 1.6 to 2.3 for the diaphragm and in series; the paper's parallel emergency spring hides it."""
    K = [diaphragm_stiffness(0.0, par.pressure, par) for par in (aw0, aw3)]
    K_e = layered_stiffness(aw0)
    ratio = {
        topology: combined(K[1], K_e, topology) / combined(K[0], K_e, topology)
        for topology in ("series", "parallel")
    }
    assert K[1] / K[0] == pytest.approx(2.146, abs=1e-3)
    assert 1.6 < ratio["series"] < 2.3
    assert 1.0 < ratio["parallel"] < 1.06


@relaxed
@given(offsets, offsets, pressures)
def test_stiffness_falls_with_offset(y, x, p):
    """T7, and even in y."""
    near, far = sorted((y, x))
    stiffness = diaphragm_stiffness(np.array([near, far, -far]), p, PAR)
    assert stiffness[1] <= stiffness[0]
    assert stiffness[1] == stiffness[2]


def test_fall_with_offset_at_60_mm(aw0):
    """A17: 5 to 30 %."""
    K = diaphragm_stiffness(np.array([0.0, 60 * mm]), aw0.pressure, aw0)
    assert 1.0 - K[1] / K[0] == pytest.approx(0.182, abs=1e-3)
    series = combined(K, layered_stiffness(aw0), "series")
    assert 0.05 < 1.0 - series[1] / series[0] < 0.30


@relaxed
@given(st.floats(1e-3, 0.1), st.floats(1e-3, 0.1))
def test_volume_grows_far_faster_than_the_area_falls(y, x):
    """T6."""
    for at in (y, x):
        area, volume = (
            lateral_area(at, PAR) / PAR.lateral_area,
            equivalent_volume(at, PAR) / PAR.bellows_volume,
        )
        assert area < 1.0 < volume
        assert volume - 1.0 > 3.0 * (1.0 - area)


@relaxed
@given(diameters)
def test_damping_rises_and_falls_with_the_pressure_ratio(d):
    """T4: one maximum, inside, of ΔK/2ω whatever the orifice."""
    r = np.linspace(0.53, 0.9994, 4000)
    c = orifice_damping(OMEGA, r, d, PAR.pressure, PAR)
    best = peak_ratio(OMEGA, d, PAR)
    assert np.all(np.diff(c[r < best]) > 0.0)
    assert np.all(np.diff(c[r > best]) < 0.0)
    limit = peak_damping(OMEGA, PAR.pressure, PAR)
    assert np.all(c <= limit * (1.0 + 1e-12))
    if best < 0.9994:
        assert orifice_damping(OMEGA, best, d, PAR.pressure, PAR) == pytest.approx(limit, rel=1e-9)


@relaxed
@given(diameters, st.floats(1.01, 2.0), st.floats(0.55, 0.9994))
def test_damping_falls_with_the_diameter_above_the_best_ratio_only(d, factor, r):
    """T5 is half of the truth: below r* a larger orifice damps more."""
    wide = factor * d
    c = orifice_damping(OMEGA, r, np.array([d, wide]), PAR.pressure, PAR)
    if r > peak_ratio(OMEGA, d, PAR):
        assert c[1] < c[0]
    if r < peak_ratio(OMEGA, wide, PAR):
        assert c[1] > c[0]


def test_damping_falls_with_the_diameter_at_the_default_ratio(aw0, aw3):
    """T5: d = 13 to 22 mm at 1.2 Hz."""
    d = np.array([13, 14, 16, 18, 22]) * mm
    for par in (aw0, aw3):
        assert np.all(np.diff(orifice_damping(OMEGA, par.pressure_ratio, d, par.pressure, par)) < 0.0)


@relaxed
@given(st.floats(0.55, 0.999), diameters)
def test_at_a_fixed_ratio_damping_has_no_maximum_over_frequency(r, d):
    """T10 does not follow from (19): c falls from ω = 0 on. `finite_amplitude` has the maximum."""
    omega = np.geomspace(1e-3, 1e3, 300)
    c = orifice_damping(omega, r, d, PAR.pressure, PAR)
    assert np.all(np.diff(c) < 0.0)


@relaxed
@given(angles, angles)
def test_stiffness_rises_with_roll_of_either_sign(phi, psi):
    """T8: even, rising, bounded."""
    small, large = sorted((abs(phi), abs(psi)))
    factor = roll_factor(np.array([small, large, -large]), PAR)
    assert factor[0] <= factor[1] == factor[2]
    assert np.all((factor >= 1.0) & (factor <= 1.0 + PAR.roll_hardening))


def test_rise_with_roll_is_over_at_the_knee(aw0):
    """A19: at least 20 % to 0.05 rad, less than a tenth of that to 0.08 rad."""
    at_rest, knee, beyond = roll_factor(np.array([0.0, 0.05, 0.08]), aw0)
    assert at_rest == 1.0
    assert knee - 1.0 == pytest.approx(0.3436, abs=1e-4)
    assert 0.0 < beyond - knee < 0.1 * (knee - 1.0)


@relaxed
@given(st.floats(0.9, 0.999), diameters)
def test_stiffness_rises_with_frequency(r, d):
    """T9, the first half: without a pipe it only rises."""
    K = dynamic_stiffness(np.geomspace(1e-2, 1e4, 200), 0.0, PAR.pressure, PAR, topology="series", r=r, d=d)
    assert np.all(np.diff(K.real) > -1e-9 * K.real[1:])
    assert np.all(K.imag > 0.0)


def test_with_a_pipe_the_stiffness_overshoots_and_comes_back(aw0):
    """T9, the second half, with the figures of A21: a minimum near 7 Hz, a peak near 15 Hz, within 25 % at 28 Hz."""
    par = replace(aw0, pipe_length=1.5, orifice_diameter=30 * mm, pressure_ratio=0.9995)
    f = np.linspace(0.1, 28.0, 2791)
    K_r = diaphragm_stiffness(0.0, par.pressure, par)
    K = np.abs(gas_stiffness(tau * f, K_r, par))
    assert 5.5 < f[np.argmin(K)] < 8.0
    assert K.min() < 0.85 * K[0]
    assert 12.5 < f[np.argmax(K)] < 16.0
    assert K.max() > 1.3 * K_r
    assert abs(K[-1] / K_r - 1.0) < 0.25
    assert np.abs(gas_stiffness(tau * 300.0, K_r, par)) == pytest.approx(K_r, rel=0.01)


def test_rubber_adds_its_damping(aw0):
    rubber = replace(aw0, rubber_damping=1234.0)
    plain, damped = (
        dynamic_stiffness(OMEGA, 0.0, par.pressure, par, topology="series") for par in (aw0, rubber)
    )
    assert damping_of(damped, OMEGA) - damping_of(plain, OMEGA) == pytest.approx(1234.0)
    assert damped.real == plain.real


def test_roll_multiplies_the_stiffness(aw0):
    K = dynamic_stiffness(OMEGA, 0.0, aw0.pressure, aw0, topology="series", phi=np.array([0.0, 0.05]))
    assert K[1] / K[0] == pytest.approx(complex(roll_factor(0.05, aw0)))


def test_arguments_and_parameters_broadcast(aw0):
    """A sensitivity study in one call: 3 areas, 4 offsets, 5 frequencies."""
    par = replace(aw0, lateral_area=np.array([0.08, 0.0835, 0.09])[:, None, None])
    y, omega = np.linspace(0.0, 0.06, 4)[:, None], np.geomspace(1.0, 100.0, 5)
    K = dynamic_stiffness(omega, y, par.pressure, par, topology="parallel")
    assert K.shape == (3, 4, 5)
    one = dynamic_stiffness(omega[2], y[1, 0], aw0.pressure, aw0, topology="parallel")
    assert K[1, 1, 2] == pytest.approx(complex(one))
