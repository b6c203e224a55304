"""The noise model against autoregressions of known coefficients, and the filter against the covariance it inverts."""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from diagnosis.contracts import Channel, Experiment, MeasuredRun
from diagnosis.engine.columns import columns_of, packing_of
from diagnosis.engine.config import AR_ORDER
from diagnosis.engine.gates import noise_floors, samples_at_rest
from diagnosis.engine.noise import ChannelNoise, Noise, estimate, white
from diagnosis.engine.whitening import filter_of


def covariance(noise, n):
    """The autocovariances up to lag n − 1 of an autoregression, by its own recursion."""
    return noise._extended(n - 1) if noise.order else np.r_[noise.autocovariance[0], np.zeros(n - 1)]


def packing(counted):
    """How a run in which these samples (n, c) count is packed."""
    time = np.arange(len(counted), dtype=float)
    outputs = np.where(counted, 0.0, np.nan)
    return packing_of(MeasuredRun(Experiment("run", time, {}), outputs, time >= 0.0, time < 0.0))


def ar1(colour, deviation=1.0):
    return ChannelNoise((deviation**2, colour * deviation**2))


def filtered(noise, counted):
    """The whitening matrix (n, n) of one channel, from the filter's answer to every unit vector."""
    n = len(counted)
    whiten = filter_of(Noise((noise,)), packing(counted[:, None]))
    return np.column_stack([whiten.spread(unit[:, None])[:, 0] for unit in np.eye(n)])


@pytest.mark.parametrize(
    "noise",
    [ChannelNoise((4.0,)), ar1(0.9, 3.0), ChannelNoise((1.0, 0.8, 0.75, 0.7))],
    ids=["white", "AR(1)", "AR(3)"],
)
def test_the_filter_is_the_inverse_root_of_the_covariance(noise):
    W = filtered(noise, np.ones(30, bool))
    assert W @ toeplitz(covariance(noise, 30)) @ W.T == pytest.approx(np.eye(30), abs=1e-9)


def test_with_gaps_every_measured_sample_still_counts_and_is_white():
    noise = ar1(0.9)
    counted = np.random.default_rng(1).random(60) > 0.2
    W = filtered(noise, counted)
    assert not W[~counted].any()
    assert not W[:, ~counted].any()
    left = (W @ toeplitz(covariance(noise, 60)) @ W.T)[np.ix_(counted, counted)]
    # Where only the last sample but one is known, an AR(1) needs no other: exactly white.
    assert left == pytest.approx(np.eye(counted.sum()), abs=1e-9)


def test_what_is_missing_may_be_nan():
    noise, counted = Noise((ar1(0.6),)), np.ones((50, 1), bool)
    counted[20:23] = False
    values = np.where(counted, 1.0, np.nan)
    assert np.isfinite(filter_of(noise, packing(counted))(values)).all()


def test_an_autoregression_is_found_again_across_runs_and_gaps():
    rng = np.random.default_rng(2)
    runs = [lfilter([1.0], [1.0, -1.2, 0.5], rng.standard_normal(5200))[200:, None] for _ in range(4)]
    masks = [rng.random((5000, 1)) > 0.1 for _ in runs]
    noise = estimate([Channel("y", "m")], runs, masks)
    coefficients, variance = noise.channels[0].predictor(np.ones(AR_ORDER, bool))
    assert coefficients[:2] == pytest.approx([1.2, -0.5], abs=0.06)
    assert variance == pytest.approx(1.0, rel=0.03)
    for run, mask in zip(runs, masks, strict=True):
        white = filter_of(noise, packing(mask)).spread(run)[:, 0]
        kept = white[mask[:, 0]]
        assert np.mean(kept**2) == pytest.approx(1.0, abs=0.06)
        assert all(abs(np.mean(white[k:] * white[:-k])) < 0.05 for k in range(1, 11))


def test_white_noise_is_called_white():
    rng = np.random.default_rng(3)
    masks = [np.ones((4000, 1), bool)]
    orders = [
        estimate([Channel("y", "m")], [rng.standard_normal((4000, 1))], masks).channels[0].order
        for _ in range(100)
    ]
    # BIC adds a needless coefficient with the chance that χ²₁ exceeds ln N = 8.3, about one in 250 for each order.
    assert sum(order > 0 for order in orders) <= 8


def test_runs_do_not_touch():
    """A jump from the end of one run to the start of the next is no correlation."""
    rng = np.random.default_rng(4)
    runs = [np.full((40, 1), level) + 1e-3 * rng.standard_normal((40, 1)) for level in (1.0, -1.0) * 20]
    (found,) = estimate([Channel("y", "m")], runs, [np.ones((40, 1), bool)] * 40).channels
    assert found.autocovariance[0] == pytest.approx(1.0, rel=1e-3)
    assert found.autocovariance[1] == pytest.approx(1.0, rel=1e-3)


def test_coefficients_that_were_spent_are_counted():
    rng = np.random.default_rng(5)
    basis = np.linalg.qr(rng.standard_normal((400, 80)))[0]
    error = rng.standard_normal((400, 1))
    left = error - basis @ (basis.T @ error)
    (found,) = estimate([Channel("y", "m")], [left], [np.ones((400, 1), bool)], spent=80).channels
    assert found.deviation == pytest.approx(float(np.std(error)), rel=0.08)


def test_no_channel_is_quieter_than_its_resolution():
    channel = Channel("y", "m", resolution=0.1)
    (found,) = estimate([channel], [np.zeros((100, 1))], [np.ones((100, 1), bool)]).channels
    assert found.deviation == pytest.approx(0.1 / np.sqrt(12.0))


def test_one_column_is_whitened_like_many():
    rng = np.random.default_rng(6)
    values = rng.standard_normal((3, 80, 2))
    apply = filter_of(Noise((ar1(0.5), white([2.0]).channels[0])), packing(np.ones((80, 2), bool)))
    columns = apply.columns([columns_of(apply.packing, values)])
    assert columns.along(np.array([0.0, 1.0, 0.0])) == pytest.approx(apply(values[1]), abs=1e-6)


@pytest.mark.parametrize("colour", [0.3, 0.6, 0.9])
def test_the_order_never_exceeds_what_is_allowed_and_whitens(colour):
    rng = np.random.default_rng(7)
    error = lfilter([1.0], [1.0, -colour], rng.standard_normal(20200))[200:, None]
    counted = np.ones((20000, 1), bool)
    noise = estimate([Channel("y", "m")], [error], [counted])
    assert noise.channels[0].order <= AR_ORDER
    e = filter_of(noise, packing(counted))(error)
    lags = [float(np.mean(e[k:] * e[:-k])) for k in range(1, 21)]
    assert np.mean(e**2) == pytest.approx(1.0, abs=0.04)
    assert np.sum(np.square(lags)) * len(e) < 45.3  # χ²₂₀ at 0.1 %


@pytest.mark.parametrize("colour", [0.0, 0.6])
def test_whitened_columns_have_the_inner_products_of_whitened_samples(colour):
    """Whatever is kept of them, single or double, scaled or filtered, with channels that some do not move."""
    rng = np.random.default_rng(8)
    counted = rng.random((90, 3)) > 0.3
    values = rng.standard_normal((5, 90, 3)) * (rng.random((5, 1, 3)) > 0.4)
    apply = filter_of(Noise((ar1(colour, 2.0), white([3.0]).channels[0], ar1(0.3))), packing(counted))
    full = np.array([apply(one) for one in values])
    columns = apply.columns([columns_of(apply.packing, values)])
    halves = apply.columns([columns_of(apply.packing, values[:2]), columns_of(apply.packing, values[2:])])
    samples, numbers = rng.standard_normal(full.shape[1]), rng.standard_normal(5)
    for mine in (columns, halves):
        assert mine.gram == pytest.approx(full @ full.T, rel=1e-5, abs=1e-5)
        assert mine.against(columns) == pytest.approx(full @ full.T, rel=1e-5, abs=1e-5)
        assert mine.times(samples) == pytest.approx(full @ samples, rel=1e-5, abs=1e-5)
        assert mine.along(numbers) == pytest.approx(numbers @ full, rel=1e-5, abs=1e-5)
        more = mine.plus(samples, numbers)
        assert more.times(samples) == pytest.approx(
            (full + np.outer(numbers, samples)) @ samples, rel=1e-5, abs=1e-5
        )
        assert mine.chosen([3, 1]).gram == pytest.approx(full[[3, 1]] @ full[[3, 1]].T, rel=1e-5, abs=1e-5)
        blocks = mine.by_block(samples, apply.packing.blocks(20))
        assert blocks.sum(axis=1) == pytest.approx(full @ samples, rel=1e-5, abs=1e-5)
        late = apply.packing.spread(samples) * (np.arange(90) >= 80)[:, None]
        assert blocks[:, -1] == pytest.approx(full @ apply.packing.pack(late), rel=1e-5, abs=1e-5)


@pytest.mark.parametrize(
    "noise", [ChannelNoise((4.0,)), ar1(0.9, 3.0), ar1(-0.5), ar1(0.99), ChannelNoise((1.0, 0.8, 0.75, 0.7))]
)
def test_correlations_extend_to_their_decay(noise):
    exact = covariance(noise, 3000) / noise.autocovariance[0]
    known = noise.correlations(2999)
    assert known == pytest.approx(exact[: len(known)])
    assert np.abs(exact[len(known) :]).max(initial=0.0) < 1e-3
    assert len(noise.correlations(7)) <= 8


@pytest.mark.parametrize("lost", [0.0, 0.1, 0.4])
@pytest.mark.parametrize("colour", [0.0, 0.6, 0.9, 0.99])
def test_a_floor_is_the_power_of_the_noise_however_much_of_it_a_line_takes(colour, lost):
    """Of AR(0.99), a line through half a second at rest takes nine tenths of the power. Lost samples do not matter."""
    deviation, run = 2.0, []
    rng = np.random.default_rng(11)
    for k in range(60):
        drawn = rng.standard_normal(1100) * deviation * np.sqrt(1.0 - colour**2)
        values = lfilter([1.0], [1.0, -colour], drawn)[1000:, np.newaxis] + 5.0 * k
        values[rng.random(100) < lost] = np.nan
        time = 5e-3 * np.arange(100)
        run.append(MeasuredRun(Experiment(f"{k}", time, {}), values, time >= 0.0, time >= 0.0))
    channel = Channel("force", "N", noise=1.0)
    noise = Noise((ar1(colour, deviation) if colour else ChannelNoise((deviation**2,)),))
    (floor,) = noise_floors((channel,), run, noise)
    assert floor == pytest.approx(deviation, rel=0.08)
    assert samples_at_rest(run, noise)[0] <= 60 * 98
    assert samples_at_rest([], noise)[0] == np.inf
