"""The closed-form layer gives the numbers that were computed for it independently."""

from dataclasses import replace
from math import tau

import numpy as np
import pytest

from astb_studies.paper.closed_form import (
    angular_frequency,
    combined,
    coupling_stiffness,
    diaphragm_stiffness,
    equivalent_volume,
    lateral_area,
    layered_stiffness,
    peak_damping,
    peak_ratio,
    surge_frequencies,
)
from bench_protocol.units import kN, mm
from tests.refusals import refuses

OFFSETS = np.array([0.0, 20.0, 40.0, 60.0]) * mm
OMEGA = tau * 1.2


def test_pressure_that_carries_the_load(aw0, aw3):
    assert aw0.pressure - 101325.0 == pytest.approx(2.058e5, rel=5e-4)
    assert aw3.pressure - 101325.0 == pytest.approx(5.577e5, rel=5e-4)


def test_diaphragm_stiffness_at_offsets(aw0, aw3):
    """Three digits: half of the last one."""
    soft, stiff = (diaphragm_stiffness(OFFSETS, par.pressure, par) for par in (aw0, aw3))
    np.testing.assert_allclose(soft, [99.9e3, 97.6e3, 91.1e3, 81.7e3], atol=50.0)
    np.testing.assert_allclose(stiff, [214e3, 210e3, 196e3, 175e3], atol=600.0)


def test_term_of_the_shrinking_area_at_60_mm(aw0, aw3):
    for par, expected in ((aw0, -14e3), (aw3, -39e3)):
        p = par.pressure
        term = diaphragm_stiffness(60 * mm, p, par, area_term=True) - diaphragm_stiffness(60 * mm, p, par)
        assert term == pytest.approx(expected, abs=500.0)


def test_vertical_area_would_be_far_too_stiff(aw0, aw3):
    """Why the lateral area is a separate number."""
    for par, expected in ((aw0, 969e3), (aw3, 2079e3)):
        vertical = replace(par, lateral_area=par.effective_area)
        assert diaphragm_stiffness(0.0, par.pressure, vertical) == pytest.approx(expected, rel=1e-3)


def test_area_and_volume_at_60_mm(aw0):
    """A18: the area falls by 1 to 5 %, the volume grows by more than three times as much."""
    shrinks = 1.0 - lateral_area(60 * mm, aw0) / aw0.lateral_area
    grows = equivalent_volume(60 * mm, aw0) / aw0.bellows_volume - 1.0
    assert shrinks == pytest.approx(0.0252)
    assert grows == pytest.approx(0.162)
    assert 0.01 < shrinks < 0.05
    assert grows > 3.0 * shrinks


def test_coupling_stiffness(aw0, aw3):
    """With the quasi-static lateral stiffness of the plant, bellows and emergency spring in series."""
    for par, K_yy, expected in ((aw0, 111e3, 37.8e3), (aw3, 214e3, 93.9e3)):
        found = coupling_stiffness(K_yy, par.nominal_preload, par.column_height)
        assert found == pytest.approx(expected, abs=60.0)


def test_emergency_spring_is_that_of_the_plant(aw0):
    assert layered_stiffness(aw0) == pytest.approx(2.0e6)
    twice = replace(aw0, rubber_layers=2.0 * aw0.rubber_layers)
    assert layered_stiffness(twice) == pytest.approx(1.0e6), "layers under the same force add compliance"


def test_in_series_the_emergency_spring_takes_a_twentieth(aw0):
    K_r, K_e = diaphragm_stiffness(0.0, aw0.pressure, aw0), layered_stiffness(aw0)
    assert combined(K_r, K_e, "series") == pytest.approx(95.2e3, abs=50.0)
    assert combined(K_r, K_e, "parallel") == pytest.approx(2099.9e3, abs=50.0)
    with refuses(ValueError, "'stacked' 'series' 'parallel'"):
        combined(K_r, K_e, "stacked")


def test_pressure_ratio_of_the_largest_damping(aw0, aw3):
    """T4, three diameters; no matter which load."""
    d = np.array([10.0, 14.0, 18.0]) * mm
    np.testing.assert_allclose(peak_ratio(OMEGA, d, aw0), [0.9924, 0.9727, 0.9348], atol=6e-5)
    np.testing.assert_array_equal(peak_ratio(OMEGA, d, aw0), peak_ratio(OMEGA, d, aw3))


def test_largest_damping(aw0, aw3):
    assert peak_damping(OMEGA, aw0.pressure, aw0) == pytest.approx(45.0 * kN, rel=1e-3)
    assert peak_damping(OMEGA, aw3.pressure, aw3) == pytest.approx(96.5 * kN, rel=1e-3)


def test_surge_frequencies(aw0, aw3):
    for par in (aw0, aw3):
        minimum, peak = surge_frequencies(replace(par, pipe_length=1.5))
        assert minimum == pytest.approx(7.5, abs=0.05)
        assert peak == pytest.approx(13.6, abs=0.05)


def test_wave_length_of_the_track():
    assert angular_frequency(100 / 3.6, 23.1) == pytest.approx(OMEGA, rel=3e-3)
