"""Ride comfort: W_d and W_b against standard and digital form, and the index of rides known in closed form."""

from math import inf, pi, sqrt, tau

import numpy as np
import pytest

from astb_studies.paper.comfort import (
    W_B,
    W_D,
    NotARide,
    block_percentiles,
    describe_continuous_comfort,
    describe_mean_comfort,
    lateral_percentiles,
    mean_comfort,
    sections,
    weighted,
    weighting,
    window_rms,
)
from astb_studies.paper.hybrid.floor import (
    COMFORT,
    COMFORT_OF_BOTH,
    COMFORT_UPWARD,
    JUDGED_OF,
    RISES,
    finely,
    ridden,
)
from tests.refusals import refuses

RATE = 1000.0

#: ISO 8041-1:2017, tables B.1 and B.3: factor in each third-octave band from 10^(-10/10) to 10^(26/10) Hz.
TABLE_W_B = """
    0.02494 0.03941 0.06198 0.09645 0.1464 0.2113 0.28 0.3347 0.3666 0.3808 0.3853 0.3864 0.3916 0.4168 0.496 0.6653
    0.885 1.026 1.054 1.026 0.9745 0.9042 0.8144 0.7088 0.5973 0.4906 0.395 0.3118 0.2389 0.1734 0.1154 0.06929 0.03818
    0.01999 0.0102 0.005154 0.002591
"""
TABLE_W_D = """
    0.06242 0.09867 0.1553 0.242 0.3682 0.533 0.7097 0.854 0.9443 0.9914 1.011 1.007 0.9707 0.8913 0.7733 0.6398 0.5143
    0.4081 0.3226 0.255 0.2017 0.1597 0.1266 0.1004 0.07958 0.06299 0.04965 0.03872 0.02946 0.0213 0.01414 0.008478
    0.004668 0.002442 0.001246 0.0006293 0.0003164
"""
BANDS = 10.0 ** (np.arange(-10, 27) / 10.0)


@pytest.mark.parametrize(("by", "table"), [(W_B, TABLE_W_B), (W_D, TABLE_W_D)], ids=["W_b", "W_d"])
def test_third_octave_factors_of_iso_8041(by, table):
    """All 37 bands to the four digits that are printed, and at 100 rad/s what its table 1 has."""
    printed = np.array(table.split(), float)
    np.testing.assert_allclose(np.abs(weighting(BANDS, by)), printed, rtol=6e-4)
    reference = {W_B: 0.8126, W_D: 0.1261}[by]
    assert np.abs(weighting(100.0 / tau, by)) == pytest.approx(reference, rel=5e-4)


def test_phases_of_w_b():
    """ISO 8041-1:2017, table B.1, in degrees: they distinguish an upward step from a mirrored one."""
    printed = {-10: 160.0, -3: 75.73, 0: 42.42, 4: 46.57, 8: 1.77, 12: -49.93, 16: -101.7, 19: -150.9}
    found = np.degrees(np.angle(weighting(10.0 ** (np.array(list(printed)) / 10.0), W_B)))
    np.testing.assert_allclose(found, list(printed.values()), atol=0.06)


def test_gains_of_iso_2631():
    """A26: within 1 % of the table."""
    f = np.array([0.5, 1.0, 2.0, 4.0, 8.0, 16.0])
    np.testing.assert_allclose(np.abs(weighting(f)), [0.853, 1.011, 0.890, 0.512, 0.253, 0.125], rtol=0.01)
    np.testing.assert_allclose(np.abs(weighting(f)), [0.853, 1.011, 0.890, 0.512, 0.253, 0.125], atol=5e-4)


def test_weighting_at_its_ends():
    """Second order below the band, third above: two of the low pass and one of the transition."""
    assert weighting(0.0) == 0.0
    low, high = np.abs(weighting(np.array([0.001, 0.01]))), np.abs(weighting(np.array([1e4, 1e5])))
    assert low[1] / low[0] == pytest.approx(100.0, rel=0.01)
    assert high[0] / high[1] == pytest.approx(1000.0, rel=0.01)
    corner = np.abs(1.0 + 0.2j) / np.abs(1.0 - 0.2**2 + 0.2j / 0.63)
    assert np.abs(weighting(0.4)) == pytest.approx(sqrt(0.5) * corner, rel=1e-6), (
        "half the power of the transition"
    )


@pytest.mark.parametrize(
    ("by", "rate", "up_to", "error"),
    [
        (W_D, 1000.0, 16.0, 1e-3),
        (W_D, 1000.0, 100.0, 0.04),
        (W_D, 500.0, 10.0, 2e-3),
        (W_B, 1000.0, 16.0, 5e-3),
    ],
)
def test_digital_filter_follows_the_exact_response(by, rate, up_to, error):
    from scipy.signal import sosfreqz

    f = np.geomspace(0.05, up_to, 200)
    _, response = sosfreqz(sections(rate, by), f, fs=rate)
    assert np.max(np.abs(np.abs(response) / np.abs(weighting(f, by)) - 1.0)) < error


def test_digital_filter_gets_better_with_the_rate():
    from scipy.signal import sosfreqz

    f = np.geomspace(1.0, 20.0, 50)
    errors = []
    for rate in (1000.0, 2000.0, 4000.0):
        _, response = sosfreqz(sections(rate), f, fs=rate)
        errors.append(np.max(np.abs(response - weighting(f))))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.15)


@pytest.mark.parametrize("f", [0.6, 1.2, 5.0])
def test_index_of_a_sine(f):
    """N = 6 |W_d| a/√2: three, six and twenty-five cycles in each window."""
    t, a = np.arange(300_000) / RATE, 0.2
    found = lateral_percentiles(a * np.sin(tau * f * t), RATE)
    assert found.shape == (1,)
    assert mean_comfort(found)[0] == pytest.approx(6.0 * np.abs(weighting(f)) * a / sqrt(2.0), rel=2e-3)


def test_steady_lean_is_no_discomfort():
    assert np.max(np.abs(weighted(np.full(300_000, 0.7), RATE))) < 1e-9, "from the first sample on"


def test_weighting_of_noise_against_its_fourier_transform():
    n = 60_000
    rng = np.random.default_rng(3)
    f = np.fft.rfftfreq(n, 1.0 / RATE)
    spectrum = np.where((f > 0.3) & (f < 30.0), rng.normal(size=len(f)) + 1j * rng.normal(size=len(f)), 0.0)
    noise = np.fft.irfft(spectrum, n)
    exact = np.fft.irfft(spectrum * weighting(f), n)
    found = weighted(np.tile(noise, 2), RATE)[n:]
    assert np.std(found - exact) < 5e-3 * np.std(exact)


def test_windows_and_percentile():
    """Sixty windows of rms 1 … 60: linear between ranks gives 1 + 0.95·59."""
    steps = np.repeat(np.arange(1.0, 61.0), 5000)
    signs = np.where(np.arange(len(steps)) % 2, 1.0, -1.0)
    rms = window_rms(steps * signs, RATE)
    np.testing.assert_allclose(rms, np.arange(1.0, 61.0))
    assert block_percentiles(rms) == pytest.approx([57.05])
    assert block_percentiles(np.tile(rms, 3)[:-1]) == pytest.approx([57.05, 57.05]), "whole blocks only"
    assert len(window_rms(np.ones(9_999), RATE)) == 1


def test_a_ride_is_judged_linearly():
    ride = np.random.default_rng(4).normal(size=300_000)
    assert lateral_percentiles(3.0 * ride, RATE) == pytest.approx(3.0 * lateral_percentiles(ride, RATE))


def test_three_axes():
    assert mean_comfort(2.0, 1.0, 2.0) == pytest.approx(18.0)
    np.testing.assert_allclose(mean_comfort(np.array([0.1, 0.2])), [0.6, 1.2])


def test_classes():
    words = [describe_mean_comfort(n) for n in (0.0, 0.999, 1.0, 1.999, 2.0, 4.0, 5.0, inf)]
    assert words == ["very good", "very good", "good", "good", "moderate", "poor", "very poor", "very poor"]
    words = [describe_continuous_comfort(c) for c in (0.1, 0.2, 0.3, 0.4)]
    assert words == ["very comfortable", "comfortable", "medium", "less comfortable"]


def test_refusals():
    with refuses(NotARide, "rate 200 Hz 100 Hz 200 Hz"):
        weighted(np.zeros(10), 200.0)
    with refuses(NotARide, "1 3 samples"):
        weighted(np.array([0.0, np.nan, 0.0]), RATE)
    with refuses(NotARide, "0 0 samples"):
        weighted(np.zeros(0), RATE)
    with refuses(NotARide, "59 5 s 60 300 s"):
        lateral_percentiles(np.zeros(299_999), RATE)


def test_phase_of_the_filter_is_that_of_the_weighting():
    """A lead below, a lag above: the sign convention is e^{+iωt}."""
    t = np.arange(40_000) / RATE
    for f in (0.4, 2.0, 8.0):
        found = weighted(np.sin(tau * f * t), RATE)[20_000:]
        amplitude = 2j * np.mean(found * np.exp(-1j * tau * f * t[20_000:]))
        assert np.angle(amplitude / weighting(f)) == pytest.approx(0.0, abs=pi * f / RATE)


def test_a_floor_that_sways_and_rises_at_once():
    """N_MV = √(N_y² + N_z²), each 6 |W| a/√2 of a sine at its own frequency."""
    t = np.arange(320_000) / RATE
    columns = {
        "acceleration": 0.2 * np.sin(tau * 1.2 * t),
        "rising": 0.3 * np.sin(tau * 2.4 * t),
        "bump_stop": 0.0 * t,
        "roll": 0.0 * t + 0.01,
    }

    class Sines:
        step = 1.0 / RATE

        def of(self, name, since, until):
            return columns[name][round(since * RATE) : round(until * RATE)]

    found = ridden(Sines(), 20.0, 320.0)
    N_y = 6.0 * np.abs(weighting(1.2, W_D)) * 0.2 / sqrt(2.0)
    N_z = 6.0 * np.abs(weighting(2.4, W_B)) * 0.3 / sqrt(2.0)
    assert found[COMFORT] == pytest.approx(N_y, rel=2e-3)
    assert found[COMFORT_UPWARD] == pytest.approx(N_z, rel=2e-3)
    assert found[COMFORT_OF_BOTH] == pytest.approx(np.hypot(N_y, N_z), rel=2e-3)
    assert found[RISES] == pytest.approx(0.3 / sqrt(2.0), rel=1e-3)
    assert set(ridden(Sines(), 0.0, 100.0)) == set(JUDGED_OF) - {COMFORT, COMFORT_UPWARD, COMFORT_OF_BOTH}


@pytest.mark.parametrize(("frequency", "left_out"), [(1.2, 1e-4), (2.4, 1e-3), (4.0, 5e-3)])
def test_fifty_samples_a_second_weigh_like_a_continuous_signal(frequency, left_out):
    step = 0.02
    told = np.sin(2 * np.pi * frequency * step * np.arange(500))
    fine = finely(told, step)
    assert fine.size == 10_000
    assert fine[:: round(step * RATE)] == pytest.approx(told)
    whole = np.sin(2 * np.pi * frequency * np.arange(fine.size) / RATE)
    inside = slice(1000, 9000)
    assert np.sum(fine[inside] * whole[inside]) / np.sum(whole[inside] ** 2) == pytest.approx(1, abs=left_out)
    assert finely(fine, 1 / RATE) is fine
