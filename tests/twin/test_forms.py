"""Forms of a cause against closed forms: a growing one is the sum of small steps, several are fitted as by lstsq."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from diagnosis.twin.fitting import Fit
from diagnosis.twin.forms import growing
from diagnosis.twin.innovations import BINS, Columns, Estimate

N = 400


def at_once(begin: int) -> np.ndarray:
    """A sensor that is off."""
    return (np.arange(N) + 0.5 >= begin)[:, None].astype(float)


def adding_up(begin: int) -> np.ndarray:
    """Air that is lost."""
    return np.clip(np.arange(N) + 0.5 - begin, 0.0, None)[:, None]


@settings(max_examples=30, deadline=None)
@given(begin=st.integers(20, 150), lasts=st.integers(40, 200), gap=st.integers(5, 30))
def test_a_ramp_is_composed_of_steps(begin, lasts, gap):
    places = range(10, N - 20, gap)
    t = np.arange(N) + 0.5
    share = np.clip((t - begin) / lasts, 0.0, 1.0)
    offset = growing({place: at_once(place) for place in places}, begin, begin + lasts)[:, 0]
    assert np.allclose(offset[: places[-1]], share[: places[-1]])
    lost = growing({place: adding_up(place) for place in places}, begin, begin + lasts)[:, 0]
    truth = np.where(t < begin + lasts, 0.5 * share * (t - begin).clip(0.0), 0.5 * lasts + t - begin - lasts)
    assert np.abs(lost - truth)[: places[-1]].max() < gap**2 / lasts, "one cell at each end is met in part"


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), exponent=st.integers(-12, 12))
def test_several_causes_are_fitted_as_least_squares_do_whatever_their_units(seed, exponent):
    rng = np.random.default_rng(seed)
    n, c, p = 4 * BINS, 2, 3
    H, zero = rng.normal(size=(n, c, p)), np.zeros((n, c))
    made = [rng.normal(size=(n, c)), 10.0**exponent * rng.normal(size=(n, c))]
    errors = rng.normal(size=(n, c)) + made[0] + made[1] * 10.0**-exponent
    columns = Columns(np.ones((n, c), np.int64), errors, zero, H, zero, np.ones(c))
    fits = Fit(columns, Estimate(np.zeros(p), np.eye(p))).together(made)
    variance = 1.0 + BINS * 0.4**2
    A = np.concatenate([H.reshape(-1, p), *(one.reshape(-1, 1) for one in made)], axis=1) / np.sqrt(variance)
    prior = np.concatenate([np.eye(p), np.zeros((p, 2))], axis=1)
    scale = np.array([1.0] * p + [1.0, 10.0**exponent])
    A, y = (
        np.concatenate([A, prior]) / scale,
        np.concatenate([errors.reshape(-1) / np.sqrt(variance), np.zeros(p)]),
    )
    best, left, *_ = np.linalg.lstsq(A, y)
    assert [one.size for one in fits] == pytest.approx(list((best / scale)[p:]), rel=1e-6)
    assert fits[0].left == pytest.approx(float(left[0]), rel=1e-6)
