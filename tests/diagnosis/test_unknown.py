"""The unknown: a surface finds effects outside the catalogue, is zero without one, and is never a cause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

from diagnosis.engine.fitting.fit import fit
from diagnosis.engine.fitting.point import base_point
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.footprints import candidates, footprints, with_surfaces
from diagnosis.engine.noise import white
from diagnosis.engine.screening import fit_and_screen
from diagnosis.engine.unknown import explain


def fitted(laboratory, surface, seed, effects=None, **noise):
    lab = laboratory()
    data = lab.measure(seed, effects, **noise)
    replay = Replay(replace(lab.simulator, surfaces=(surface,)), data.of("fit"), 1)
    entries = candidates(list(lab.simulator.catalogue.values()))
    near = fit(
        replay, white([c.noise for c in data.channels]), base_point(lab.simulator.nuisances, replay.names)
    )
    around = with_surfaces(replay, footprints(replay, near.point, entries))
    screened = fit_and_screen(replay, around, alpha=0.01, seed=0)
    return data, screened.model, screened.screening, screened.tests[0]


STOP = {"stop": {"amplitude": 300.0, "gap": 0.012}}


@pytest.mark.slow
def test_omnibus_is_silent_on_nulls(laboratory, force_surface):
    p = [fitted(laboratory, force_surface, seed)[3].p for seed in range(16)]
    assert np.mean(np.array(p) < 0.05) <= 0.2
    assert kstest(p, "uniform", alternative="greater").pvalue > 1e-3


def test_a_stop_that_no_catalogue_knows_is_seen_fitted_and_located(laboratory, force_surface):
    data, model, screen, test = fitted(laboratory, force_surface, 3, STOP)
    assert test.p < 1e-6
    extended, unknown = explain(model, test, screen, data.of("select"))
    assert unknown.kept and unknown.lpd_gain > 10
    assert extended.effects == ("force",)
    assert "not kept" not in unknown.sentence and "valid only for" in unknown.sentence


def test_a_force_over_one_state_is_clearest_along_this_state(laboratory, force_surface):
    """A stop that the sum of all coefficients would leave in doubt."""
    small = {"stop": {"amplitude": 2.0, "gap": 0.012}}
    clear = fitted(laboratory, force_surface, 3, small)[3]
    blurred = fitted(laboratory, replace(force_surface, centres=()), 3, small)[3]
    assert clear.freedom < blurred.freedom
    assert clear.p < 0.1 * blurred.p


@pytest.mark.slow
def test_a_surface_of_noise_is_not_kept(laboratory, force_surface):
    kept = []
    for seed in range(4):
        data, model, screen, test = fitted(laboratory, force_surface, seed)
        same, unknown = explain(model, test, screen, data.of("select"))
        kept.append(unknown.kept)
        assert unknown.kept or same is model
    assert np.mean(kept) < 0.5


def test_a_named_effect_is_the_nearest_of_its_own_surface(laboratory, force_surface):
    data, model, screen, test = fitted(laboratory, force_surface, 1, {"cubic": {"amplitude": 3e5}})
    _, unknown = explain(model, test, screen, data.of("select"))
    assert test.p < 1e-6
    assert unknown.nearest[0].effect == "cubic" and unknown.nearest[0].cosine > 0.9
