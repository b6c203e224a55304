"""Innovations against the joint distribution of a whole segment, and against unpredicted channels."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from bench_sim.model.rubber import friction_curve
from diagnosis.twin.innovations import BINS, Columns, Estimate, friction_goes_on, judge


def columns(
    rng: np.random.Generator, blocks: int, channels: int, parameters: int
) -> tuple[Columns, np.ndarray]:
    n = blocks * BINS
    H = rng.normal(size=(n, channels, parameters))
    noise = rng.uniform(0.5, 2.0, channels) ** 2
    count = rng.integers(1, 4, (n, channels))
    theta = rng.normal(size=parameters)
    errors = H @ theta + rng.normal(size=(n, channels)) * np.sqrt(noise / count)
    zero = np.zeros((n, channels))
    return Columns(count, errors, zero, H, zero, noise), theta


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_innovations_of_one_channel_give_the_joint_likelihood(seed):
    # A product of what each block adds to those before it is the density of all together (the chain rule).
    rng = np.random.default_rng(seed)
    of, _ = columns(rng, 3, 1, 2)
    told = judge(of, Estimate(np.zeros(2), np.eye(2)), np.zeros((3 * BINS, 1)))
    H, R = of.parameters[:, 0], np.diag(of.noise[0] / of.samples[:, 0])
    joint = multivariate_normal(cov=H @ H.T + R).logpdf(of.measured[:, 0])
    estimate, total = Estimate(np.zeros(2), np.eye(2)), 0.0
    for b in range(3):
        rows = slice(b * BINS, (b + 1) * BINS)
        S = H[rows] @ estimate.covariance @ H[rows].T + R[rows, rows]
        total += -0.5 * np.sum(told.white[b, 0] ** 2) - 0.5 * np.linalg.slogdet(2.0 * np.pi * S)[1]
        part = of._replace(
            samples=of.samples[rows],
            measured=of.measured[rows],
            simulated=of.simulated[rows],
            parameters=H[rows][:, None],
            inputs=of.inputs[rows],
        )
        estimate = judge(part, estimate, np.zeros((BINS, 1))).estimate
    assert np.isclose(total, joint, rtol=1e-9)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_parameters_are_learnt_as_bayes_would(seed):
    rng = np.random.default_rng(seed)
    of, _ = columns(rng, 4, 3, 5)
    estimate = judge(of, Estimate(np.zeros(5), np.eye(5)), np.zeros((4 * BINS, 3))).estimate
    H, w = of.parameters.reshape(-1, 5), (of.samples / of.noise).reshape(-1)
    covariance = np.linalg.inv(np.eye(5) + (H * w[:, None]).T @ H)
    assert np.allclose(estimate.covariance, covariance)
    assert np.allclose(estimate.mean, covariance @ (H.T @ (w * of.measured.reshape(-1))))


def test_they_are_standard_normal_while_the_model_holds():
    squares = []
    for seed in range(40):
        of, _ = columns(np.random.default_rng(seed), 5, 3, 4)
        squares.append(judge(of, Estimate(np.zeros(4), np.eye(4)), np.zeros((5 * BINS, 3))).white ** 2)
    mean = np.mean(squares)
    assert abs(mean - 1.0) < 4.0 * np.sqrt(2.0 / np.size(squares))


def test_unread_channels_have_no_innovations():
    of, _ = columns(np.random.default_rng(1), 2, 2, 3)
    of.samples[:, 1] = 0
    told = judge(of, Estimate(np.zeros(3), np.eye(3)), np.zeros((2 * BINS, 2)))
    assert np.isnan(told.white[:, 1]).all() and np.isfinite(told.white[:, 0]).all()


@settings(deadline=None)  # the first call compiles
@given(
    level=st.floats(-0.1, 0.1),
    past=st.floats(0.0, 0.1),
    sense=st.sampled_from((1.0, -1.0)),
    way=st.floats(0.5, 20.0),
)
def test_friction_goes_on_along_the_curve_on_which_it_is(level, past, sense, way):
    """Against Berg's law itself, to second order in its memory: the last reversal, and the travel since then."""
    travel = 4.0
    place = sense * np.linspace(0.0, way, 50)
    force, curve, turned = friction_goes_on(place, travel)
    assert not turned.any()
    was = [friction_curve(sense * past + x, 0.0, level, travel)[0] for x in place]
    anew = [friction_curve(x, 0.0, 0.0, travel)[0] for x in place]
    rest = 1.0 - sense * level
    u = 1.0 - sense * was[0]
    remembered = sense * (1.0 - u) * force - (rest**2 / u - 1.0) * curve
    small = abs(level) + past / travel
    np.testing.assert_allclose(np.subtract(was, anew), remembered, rtol=0.0, atol=3.0 * small**2 + 1e-12)
