"""Scores: their threshold against brute force, its scores under chance, its estimates where the truth is known."""

import numpy as np
import pytest
from scipy.stats import kstest, norm

from diagnosis.engine.fitting.fit import fit
from diagnosis.engine.fitting.point import base_point
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.footprints import candidates, footprints
from diagnosis.engine.screening import fit_and_screen, signs
from diagnosis.engine.threshold import threshold
from diagnosis.engine.whitening import filters


@pytest.mark.slow
def test_threshold_of_correlated_scores_against_brute_force():
    """Scores of random data on random columns, none of the formulas used."""
    rng = np.random.default_rng(2)
    columns = rng.standard_normal((50, 6)) @ rng.standard_normal((6, 8))
    columns /= np.linalg.norm(columns, axis=0)
    one_sided = np.arange(8) % 2 == 0
    z = rng.standard_normal((1_000_000, 50), dtype=np.float32) @ columns.astype(np.float32)
    z[:, ~one_sided] = np.abs(z[:, ~one_sided])
    brute = np.quantile(z.max(axis=1), 0.99)
    found = [threshold(columns.T @ columns, one_sided, 0.01, seed) for seed in range(5)]
    assert np.mean(found) == pytest.approx(brute, abs=0.012), "three standard deviations of a million draws"
    assert found == pytest.approx([brute] * 5, abs=0.02)


@pytest.mark.parametrize("one_sided", [True, False])
@pytest.mark.parametrize("alpha", [0.003, 0.05])
def test_threshold_of_equal_or_unrelated_scores(one_sided, alpha):
    """Closed forms of 70 scores, to a hundredth of a standard deviation whatever the seed."""
    sides = np.full(70, one_sided)
    for cosines, independent in ((np.ones((70, 70)), 1), (np.eye(70), 70)):
        single = -np.expm1(np.log1p(-alpha) / independent)
        exact = norm.isf(single if one_sided else single / 2)
        assert [threshold(cosines, sides, alpha, seed) for seed in range(3)] == pytest.approx(
            [exact] * 3, abs=0.01
        )


def test_no_candidate_no_alarm():
    assert threshold(np.zeros((0, 0)), np.zeros(0, bool), 0.01, 1) == np.inf


def test_only_the_physical_sign_scores(oscillator):
    catalogue = oscillator().catalogue
    effects = [catalogue[name] for name in ("coulomb", "coulomb", "cubic", "cubic")]
    assert signs(effects, np.array([2.0, -2.0, 2.0, -2.0])) == pytest.approx([1.0, 1.0, 1.0, -1.0])


def screened(lab, data, **settings):
    replay = Replay(lab.simulator, data.of("fit"), 1)
    start = base_point(lab.simulator.nuisances, replay.names)
    noise = fit_and_screen(replay, footprints(replay, start, ()), alpha=0.01, seed=1).model.noise
    near = fit(replay, noise, start).point
    entries = candidates(list(lab.simulator.catalogue.values()))
    return fit_and_screen(replay, footprints(replay, near, entries), alpha=0.01, seed=1)


@pytest.mark.slow
@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_scores_of_nulls_are_standard_normal(laboratory, colour):
    lab = laboratory(samples=800)
    z = []
    for seed in range(120):
        found = screened(lab, lab.measure(seed, colour=colour))
        z.append(found.screening.projection.z)
    for column in np.transpose(z):
        assert kstest(column, "norm").pvalue > 1e-3
        assert np.var(column) < 1.5


def test_a_score_estimates_the_amplitude(laboratory):
    lab = laboratory()
    truth = 0.05
    screen = screened(lab, lab.measure(5, {"force_gain": {"amplitude": truth}})).screening
    i = screen.best("force_gain")
    # An offset and a stiffness hide most of a gain, and the noise estimate is that of the linear model.
    assert screen.amplitude[i] == pytest.approx(truth, rel=0.1)
    assert screen.exceeding[0] == max(range(len(screen.z)), key=lambda k: screen.z[k])


def test_noise_of_a_large_effect_in_the_library_is_still_noise(laboratory):
    """An effect thirty times the noise must not be called noise."""
    lab = laboratory()
    model = screened(lab, lab.measure(6, {"drift": {"amplitude": 3.0}})).model
    assert model.linearisation.chi2 > 2.0 * model.samples
    assert model.noise.channels[1].deviation == pytest.approx(1.0, rel=0.05)


def test_a_fit_starts_near_its_end(laboratory):
    """The start makes room for the effect: its cost is below that of the model without it."""
    lab = laboratory()
    found = screened(lab, lab.measure(7, {"maxwell": {"amplitude": 40.0, "tau": 0.1}}))
    i = found.screening.best("maxwell")
    start = found.screening.start(found.model.point, i)
    replay = found.model.replay
    errors = replay.residuals(replay.predictions(start))
    whiten = filters(found.model.noise, replay.runs)
    cost = sum(np.sum(f(e) ** 2) for f, e in zip(whiten, errors, strict=True))
    assert cost < found.model.linearisation.chi2
