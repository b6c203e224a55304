"""A load cell that counts in 8 N and is stated to count in 25 N, in the noise of 20 N."""

import numpy as np
import pytest

from bench_sim.parameters import load
from diagnosis.systems.air_spring.simulator import AirSpring
from diagnosis.systems.records import _twice_rounded
from diagnosis.systems.twice_rounded import twice_rounded

CONVERTER, WIRE, NOISE = 8.0, 25.0, 20.0


def read(force, seed, converter=CONVERTER, wire=WIRE):
    """Return the reading of a force (n,)."""
    noisy = force + NOISE * np.random.default_rng(seed).standard_normal(len(force))
    if converter:
        noisy = converter * np.round(noisy / converter)
    return wire * np.round(noisy / wire)


def swinging(count=40_000):
    k = np.arange(count)
    return np.where(k % 997, 36e3 + 3000.0 * np.sin(0.0113 * k) + 900.0 * np.sin(0.0171 * k), np.nan)


@pytest.mark.parametrize("force", [36_040.0, 36_060.0, 36_111.0, -36_155.0])
def test_the_mean_at_rest_is_right(force):
    """By the codes it is wrong by up to 2.5 N, twenty-five times what the noise leaves of so many."""
    found = twice_rounded(read(swinging(), 1), CONVERTER, NOISE)
    still = read(np.full(60_000, force), 2)
    still[::100] = np.nan
    assert abs(np.nanmean(found.rounded_once(still)) - force) < 0.3
    assert abs(np.nanmean(still) - force) > 1.0
    assert np.isnan(found.rounded_once(np.array([np.nan, 0.0]))).tolist() == [True, False]


def test_corrections_repeat_and_are_odd_about_where_both_grids_meet():
    found = twice_rounded(read(swinging(), 3), CONVERTER, NOISE)
    assert (found.wire, len(found.corrections)) == (WIRE, 8)
    assert found.corrections[1:] == pytest.approx(-found.corrections[:0:-1], abs=1e-9)
    assert np.abs(found.corrections).max() == pytest.approx(5.0, abs=0.2)


@pytest.mark.parametrize(
    ("readings", "converter", "noise"),
    [
        (
            read(swinging(200_000), 4, converter=0.0),
            CONVERTER,
            NOISE,
        ),  # readings contradict the data sheet
        (read(swinging(), 5), 0.0, NOISE),  # nothing is known of a converter
        (read(swinging(), 6), 12.5, NOISE),  # numbers half-way between two codes get either
        (read(swinging(), 6, converter=10.0, wire=16.0), 10.0, NOISE),
        (read(swinging(), 7), 8.1234567, NOISE),  # the grids do not meet
        (read(swinging(), 8), CONVERTER, 5.0),  # the mean of so little noise says nothing
        (np.full(1000, 36e3), CONVERTER, NOISE),
        (np.full(3, np.nan), CONVERTER, NOISE),
    ],
)
def test_values_rounded_once_are_unchanged(readings, converter, noise):
    assert twice_rounded(readings, converter, noise) is None


@pytest.mark.slow
def test_vertical_load_cells_of_the_bench_are_rounded_twice(bench_record):
    from diagnosis.systems.records import read as read_record
    from diagnosis.systems.records import read_records
    from tests.diagnosis.test_records import SHORT

    recorded = bench_record("plain", SHORT[:1])
    simulator = AirSpring(load("astb"), effects={})
    found = _twice_rounded(read_record(recorded.directory), simulator)
    assert set(found) == {f"load_cell.{k}" for k in range(1, 5)}
    dataset = read_records([recorded.directory], simulator)
    for k, channel in enumerate(dataset.channels):
        if channel.name in found:
            told = dataset.runs[0].outputs[:, k]
            told = told[np.isfinite(told)]
            code = np.rint(told / WIRE)
            corrections = found[channel.name].corrections[code.astype(int) % 8]
            assert told == pytest.approx(WIRE * code - corrections, abs=1e-6)
            assert len(np.unique(corrections)) == 8
