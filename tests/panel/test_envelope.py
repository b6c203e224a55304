"""The envelope of the last minutes against the samples themselves, kept in a list."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from astb.panel.envelope import LEVELS, Envelope
from bench_protocol.units import NS

SAMPLES = st.lists(
    st.tuples(st.integers(0, 400 * NS), st.integers(0, 2), st.floats(-1e6, 1e6, width=32)),
    min_size=1,
    max_size=60,
)


@settings(max_examples=40, deadline=None)
@given(SAMPLES, st.sampled_from([10.0, 100.0, 600.0, 3600.0]), st.integers(1, 7))
def test_every_stretch_has_the_smallest_and_the_greatest_of_its_samples(samples, span, blocks):
    """In any order, in any blocks: what a picture shows is what lies in its stretch of time."""
    samples.sort(key=lambda one: one[0] // (30 * NS))  # late by up to 30 s
    envelope = Envelope(3)
    for block in np.array_split(np.arange(len(samples)), blocks):
        times, rows, values = (np.array([samples[k][part] for k in block]) for part in range(3))
        envelope.take(times.astype(np.int64), rows.astype(np.int64), values.astype(np.float32))
    scale = envelope.scale(span, 500)
    assert scale.head == max(time for time, *_ in samples) // round(scale.width * NS)
    first = max(0, scale.head - round(60 / scale.width))
    low, high = scale.read(np.arange(3), first)
    assert low.shape == high.shape == (3, scale.head + 1 - first)
    for stretch in range(first, scale.head + 1):
        for row in range(3):
            inside = [
                value
                for time, one, value in samples
                if one == row and time // round(scale.width * NS) == stretch
            ]
            told = low[row, stretch - first], high[row, stretch - first]
            if inside:
                assert told == (np.float32(min(inside)), np.float32(max(inside)))
            else:
                assert np.isnan(told).all()


def test_an_hour_of_thirty_signals_takes_what_it_took_at_first():
    envelope = Envelope(30)
    held = lambda: sum(one._low.nbytes + one._high.nbytes for one in envelope._levels)  # noqa: E731
    before = held()
    rows = np.repeat(np.arange(30), 1000)
    for second in range(0, 3700, 20):
        times = np.tile(second * NS + np.arange(1000) * 20_000_000, 30)
        envelope.take(times, rows, np.full(times.size, float(second), np.float32))
    assert held() == before < 40e6
    scale = envelope.scale(3600.0, 1000)
    low, _ = scale.read(np.array([29]), scale.head - 900)
    assert np.nanmin(low) < 500.0, "an hour ago is still there"
    assert not np.isnan(low).any()


def test_a_time_step_discards_older_values():
    envelope = Envelope(1)
    one = lambda time, value: envelope.take(  # noqa: E731
        np.array([time], np.int64), np.array([0]), np.array([value], np.float32)
    )
    one(1 * NS, 1.0)
    one(round((LEVELS[-1][1] * 3 + 1) * NS), 2.0)
    for span in (10.0, 3600.0):
        scale = envelope.scale(span, 1000)
        low, _ = scale.read(np.array([0]), scale.head + 1 - scale.most)
        assert low[~np.isnan(low)].tolist() == [2.0]


@pytest.mark.parametrize("span", [1.0, 30.0, 119.0, 600.0, 3600.0])
def test_a_picture_has_about_as_many_stretches_as_columns(span):
    scale = Envelope(1).scale(span, 1000)
    assert min(500, span / LEVELS[0][0]) <= span / scale.width <= 2000
