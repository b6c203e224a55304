"""The residual panel: uniform p-values where the model is right, and each test detects its kind of error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import kstest

from diagnosis.contracts import Channel, CompleteSimulator, Experiment
from diagnosis.engine.noise import ChannelNoise, Noise, white
from diagnosis.engine.residual.panel import TESTS, benjamini_hochberg, judged
from diagnosis.engine.residual.parity import draw, parities
from diagnosis.engine.residual.residuals import Evidence, NotApplicable, residuals_of
from diagnosis.engine.residual.stretches import holds, swings
from diagnosis.finding import PanelRow

STEP = 0.01
CHANNELS = (
    Channel("force", "N", noise=1.0, kind="force", display="kN", scale=1e3),
    Channel("pressure", "Pa", noise=1.0, kind="pressure"),
)
TEST = {name: function for name, _, function in TESTS}


def motion():
    """Slow and fast sines of one amplitude, a large one, a triangle and a hold; metres."""
    t = np.arange(0.0, 260.0, STEP)
    u = np.zeros_like(t)
    for start, stop, amplitude, frequency in (
        (0, 80, 0.01, 0.05),
        (80, 120, 0.01, 0.2),
        (120, 140, 0.01, 1.0),
        (140, 160, 0.02, 1.0),
        (160, 180, 0.02, 4.0),
    ):
        inside = (t >= start) & (t < stop)
        u[inside] = amplitude * np.sin(2 * np.pi * frequency * (t[inside] - start))
    inside = (t >= 180) & (t < 200)
    u[inside] = 0.01 * 2 / np.pi * np.arcsin(np.sin(2 * np.pi * 0.5 * (t[inside] - 180)))
    inside = t >= 200
    u[inside] = 0.02 * np.clip((t[inside] - 200) / 2, 0, 1)
    return Experiment("run", t, {"height": u})


EXPERIMENT = motion()
U = EXPERIMENT.inputs["height"]
V = np.gradient(U, STEP)


PREDICTED = np.column_stack((1e5 * U, 2e3 * U))
QUIET = residuals_of(EXPERIMENT, CHANNELS, PREDICTED, PREDICTED, np.ones_like(PREDICTED))


def seen(rng, extra=0.0, missing=0.0):
    """Residuals of unit variance with something added to the force."""
    n = U.size
    noise = rng.standard_normal((n, 2))
    noise[:, 0] += extra
    noise[rng.random((n, 2)) < missing] = np.nan
    return replace(QUIET, measured=QUIET.predicted + noise, residual=noise, whitened=noise)


def p_values(extra, seed=1):
    case = seen(np.random.default_rng(seed), extra)
    found = {name: test(case, 0) for name, test in TEST.items()}
    return {name: evidence.p for name, evidence in found.items() if isinstance(evidence, Evidence)}


def test_stretches_are_found_as_they_were_driven():
    found = swings(EXPERIMENT, "height")
    assert [s.sine for s in found] == [True, True, True, True, True, False]
    assert [s.frequency for s in found] == pytest.approx([0.05, 0.2, 1.0, 1.0, 4.0, 0.5], rel=0.01)
    assert [s.amplitude for s in found] == pytest.approx([0.01, 0.01, 0.01, 0.02, 0.02, 0.01], rel=0.02)
    (hold,) = holds(EXPERIMENT)
    assert hold.start * STEP == pytest.approx(202.0, abs=0.6) and hold.stop == U.size


def test_noise_on_the_input_moves_no_stretch():
    noisy = Experiment(
        "n", EXPERIMENT.time, {"height": U + 2e-5 * np.random.default_rng(0).standard_normal(U.size)}
    )
    clean, found = swings(EXPERIMENT, "height"), swings(noisy, "height")
    assert [s.frequency for s in found] == pytest.approx([s.frequency for s in clean], rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(TEST))
def test_p_values_are_uniform_or_careful_where_the_model_is_right(name):
    p = []
    for seed in range(40):
        evidence = TEST[name](seen(np.random.default_rng(seed), missing=0.1 * (seed % 2)), 0)
        assert isinstance(evidence, Evidence)
        p.append(evidence.p)
    # Bonferroni makes a p-value larger, never smaller: only too small ones are an error.
    assert kstest(p, "uniform", alternative="greater").pvalue > 1e-3
    assert np.mean(np.array(p) < 0.05) < 0.15


@pytest.mark.parametrize("name", ["memory", "linear", "even", "odd", "x-v surface"])
def test_p_values_of_single_looks_are_uniform(name):
    p = [TEST[name](seen(np.random.default_rng(seed)), 0).p for seed in range(40)]
    assert kstest(p, "uniform").pvalue > 1e-3


FRICTION = np.sign(V)
CASES = {
    "gain": (
        60 * U,
        {"linear", "size", "x-v surface"},
        {"even", "odd", "even harmonics", "odd harmonics", "hold", "drift"},
    ),
    "area curve": (8e3 * U**2, {"even", "even harmonics"}, {"odd", "odd harmonics", "quasi-static", "drift"}),
    "cubic": (5e5 * U**3, {"odd", "odd harmonics"}, {"even harmonics", "loss", "quasi-static", "drift"}),
    "friction": (
        0.4 * FRICTION,
        {"odd harmonics", "loss", "quasi-static"},
        {"even", "even harmonics", "hold"},
    ),
    "leak": (
        -0.02 * np.arange(U.size) * STEP,
        {"drift", "hold"},
        {"even", "odd", "even harmonics", "odd harmonics", "loss", "quasi-static"},
    ),
    "settling": (
        np.where(EXPERIMENT.time > 202, np.exp(-(EXPERIMENT.time - 202) / 3), 0),
        {"hold"},
        {"loss", "even harmonics", "odd harmonics"},
    ),
}


@pytest.mark.parametrize("name", sorted(CASES))
def test_each_row_reacts_to_what_it_says_and_not_to_others(name):
    extra, reacts, silent = CASES[name]
    p = p_values(extra)
    assert all(p[test] < 1e-3 for test in reacts), p
    assert all(p[test] > 5e-3 for test in silent), p


def test_a_leak_continues_and_a_heat_effect_settles():
    rng = np.random.default_rng(3)
    assert "does not stop" in TEST["hold"](seen(rng, CASES["leak"][0]), 0).sentence
    assert "settles" in TEST["hold"](seen(rng, CASES["settling"][0]), 0).sentence


def test_loop_width_tells_friction_from_viscosity():
    rng = np.random.default_rng(4)
    friction, viscous = (TEST["quasi-static"](seen(rng, e), 0) for e in (FRICTION, 200 * V))
    assert friction.points_to == "Berg or Coulomb friction" and viscous.points_to == "Maxwell, viscous loss"


def test_loss_grows_as_its_mechanism_says():
    rng = np.random.default_rng(5)
    friction, viscous = (TEST["loss"](seen(rng, e), 0) for e in (3 * FRICTION, 300 * V))
    assert friction.points_to == "Coulomb or Berg friction"
    assert viscous.points_to == "viscous loss, or Maxwell branch below its frequency of maximum loss"


def test_the_size_test_names_the_frequency_band():
    t = EXPERIMENT.time
    evidence = TEST["size"](seen(np.random.default_rng(6), 0.5 * np.sin(2 * np.pi * 7 * t)), 0)
    assert "5 to 10 Hz" in evidence.sentence and evidence.p < 1e-6


def test_a_test_without_its_stretch_says_so():
    t = np.arange(0.0, 30.0, STEP)
    still = Experiment("still", t, {"height": np.zeros_like(t)})
    noise = np.random.default_rng(0).standard_normal((t.size, 2))
    case = residuals_of(still, CHANNELS, noise, np.zeros_like(noise), noise)
    for name in ("linear", "even harmonics", "loss", "hold", "x-v surface", "x-p surface"):
        assert isinstance(TEST[name](case, 0), NotApplicable), name


class Combination(CompleteSimulator):
    """Force less pressure, as a bellows has it."""

    def parity(self, experiment, outputs):
        return {"rubber": outputs[:, 0] - outputs[:, 1] ** 2 / 40}


@pytest.mark.slow
@pytest.mark.parametrize(
    "noise", [white((1.0, 1.0)), Noise((ChannelNoise((1.0, 0.6)), ChannelNoise((1.0, 0.9))))]
)
def test_parity_is_silent_on_noise_and_sees_a_drift(noise):
    n = U.size
    predicted = np.column_stack((1e5 * U, 2e3 * U + 500))
    p = []
    for seed in range(40):
        drawn = draw(noise, n, np.random.default_rng(seed))
        case = residuals_of(EXPERIMENT, CHANNELS, predicted + drawn, predicted, drawn)
        p.append(parities(case, noise, Combination(), seed=0)["rubber"].p)
    # Its own floor is drawn, so that p is not exactly uniform; it must not be small by chance.
    assert np.mean(np.array(p) < 0.02) < 0.12
    drawn[:, 0] += 30 * np.arange(n) / n
    case = residuals_of(EXPERIMENT, CHANNELS, predicted + drawn, predicted, drawn)
    assert parities(case, noise, Combination(), seed=0)["rubber"].p < 1e-3


def test_noise_is_drawn_as_it_was_described():
    noise = Noise((ChannelNoise((4.0, 2.4, 1.44)),))
    drawn = draw(noise, 200_000, np.random.default_rng(0))[:, 0]
    assert drawn.var() == pytest.approx(4.0, rel=0.05)
    assert np.mean(drawn[1:] * drawn[:-1]) == pytest.approx(2.4, rel=0.05)
    assert np.abs(np.corrcoef(lfilter([1, -0.6], [1], drawn)[1:], drawn[:-1])[0, 1]) < 0.01


def row(test, p, statistic=1.0):
    return PanelRow(
        test=test, title=test, run="r", channel="c", statistic=statistic, p=p, sentence="s", points_to=""
    )


def test_benjamini_and_hochberg_keep_the_false_part_small():
    rng = np.random.default_rng(0)
    false_part = []
    for _ in range(400):
        p = np.concatenate((rng.random(80), rng.random(20) * 1e-4))
        found = benjamini_hochberg(p) < 0.1
        false_part.append(found[:80].sum() / max(found.sum(), 1))
    assert np.mean(false_part) == pytest.approx(0.08, abs=0.02)  # α times the part that is null


def test_rows_that_do_not_apply_are_skipped():
    rows = judged([row("a", 0.004), row("b", None, None), row("c", 0.9)], alpha=0.01)
    assert rows[0].q == pytest.approx(0.008) and rows[0].significant
    assert rows[1].q is None and not rows[1].significant
