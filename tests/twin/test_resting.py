"""Where a twin takes the bench to rest: where nothing moves, slowly or to and fro, whatever noise the sensors have."""

from types import SimpleNamespace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from diagnosis.systems.motion import SENSORS
from diagnosis.twin.stretches import STEP, resting

GRID = STEP * np.arange(100)
NOISE = 0.01e-3


def record_of(times, values, noise):
    """As much of a record as is looked at: one height, with noise."""
    values = values + noise * np.random.default_rng(1).standard_normal(len(times))
    return SimpleNamespace(
        signals=dict.fromkeys(SENSORS[:1]),
        series=lambda name: (times, values) if name == SENSORS[0] else (np.empty(0), np.empty(0)),
    )


@given(
    rate=st.sampled_from((20.0, 50.0, 200.0)),
    share=st.floats(0.015, 0.45),
    amplitude=st.floats(0.3e-3, 50e-3),
    phase=st.floats(0.0, 2.0 * np.pi),
)
def test_no_motion_to_and_fro_is_a_rest(rate, share, amplitude, phase):
    times = np.arange(0.0, 10.0, 1.0 / rate)
    wave = amplitude * np.sin(2.0 * np.pi * share * rate * times + phase)
    assert not resting(record_of(times, wave, NOISE), GRID)[5:-5].any()


@given(rate=st.sampled_from((20.0, 50.0, 200.0)), drift=st.floats(-0.02e-3, 0.02e-3))
def test_noise_and_what_creeps_are_a_rest(rate, drift):
    times = np.arange(0.0, 10.0, 1.0 / rate)
    assert resting(record_of(times, drift * times, NOISE if rate > 20.0 else 0.1 * NOISE), GRID).all()
