"""Constancy of a cause: Chow's statistic against brute force, its mean, and what it keeps from a name and what not."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2 as chi2_distribution

from diagnosis.contracts import Experiment, MeasuredRun, Parameter
from diagnosis.engine.columns import columns_of, packing_of
from diagnosis.engine.config import CLEAR_OF_FORM, CONSTANCY_ALPHA, STRETCHES
from diagnosis.engine.constancy import changes, inconstancy, owed_to_form
from diagnosis.engine.fitting.linear import Block, Linearisation, prior_of
from diagnosis.engine.fitting.point import Coordinate, Point
from diagnosis.engine.model_error import widened

RUNS, SAMPLES = 3, 400
#: Two parameters that have nothing to do with the cause, one that imitates most of it, and the cause.
STRANGE, ROOM, CAUSE = 0, 2, 3
COLUMNS = 4


def point():
    base = tuple(Coordinate(Parameter(f"p{i}", "", 0.0, 1e6)) for i in range(COLUMNS - 1))
    return Point((*base, Coordinate(Parameter("size", "", 0.0, 1e6), "cause")), np.zeros(COLUMNS))


def fitted(seed, drift=0.0, drifting=CAUSE, sound=1.0):
    """A linear model at its optimum; one of its parameters grows by ``drift`` in the course of each run.

    Of sound rigs it is known that the stretches of their runs show ``sound`` times the χ² of chance.
    """
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((RUNS, COLUMNS, SAMPLES))
    X[:, CAUSE] = 0.9 * X[:, ROOM] + 0.4 * X[:, CAUSE]
    residual = rng.standard_normal((RUNS, SAMPLES))
    residual += drift * X[:, drifting] * np.linspace(-0.5, 0.5, SAMPLES)
    flat = np.concatenate(list(X), axis=1)
    residual -= np.einsum("k,rkn->rn", np.linalg.lstsq(flat.T, residual.ravel())[0], X)
    time = 0.01 * np.arange(SAMPLES)
    everywhere = np.ones(SAMPLES, bool)
    blocks = []
    for r in range(RUNS):
        run = MeasuredRun(Experiment(f"{r}", time, {}), residual[r, :, None], everywhere, ~everywhere)
        packing = packing_of(run)
        parts = (
            (tuple(range(CAUSE)), columns_of(packing, X[r, :CAUSE, :, None])),
            ((CAUSE,), columns_of(packing, X[r, CAUSE:, :, None])),
        )
        blocks.append(Block(f"{r}", packing, residual[r], parts))
    where = point()
    model = SimpleNamespace(
        linearisation=Linearisation(where, prior_of(where), tuple(blocks)),
        noise=SimpleNamespace(dispersion=1.0),
        replay=SimpleNamespace(
            simulator=SimpleNamespace(catalogue={"cause": SimpleNamespace(overdispersion=sound)})
        ),
    )
    return model, X, residual


def by_brute_force(X, residual, parts):
    """How far χ² falls if each stretch has separate amounts of the cause and of its imitation, beyond chance.

    A least-squares fit of each stretch, and the trace of what the common fit, with its priors, leaves of white noise.
    """
    flat = np.concatenate(list(X), axis=1)
    information = flat @ flat.T + np.eye(COLUMNS)
    imitation = np.linalg.solve(information[:CAUSE, :CAUSE], information[:CAUSE, CAUSE]) @ flat[:CAUSE]
    both = np.array([flat[CAUSE], imitation])
    left = np.eye(flat.shape[1]) - flat.T @ np.linalg.solve(information, flat)
    fall, mean = 0.0, 0.0
    for own in np.split(np.arange(flat.shape[1]), RUNS * parts):
        projector = both[:, own].T @ np.linalg.pinv(both[:, own].T)
        fall += float(residual.ravel()[own] @ projector @ residual.ravel()[own])
        mean += float(np.trace(projector @ left[np.ix_(own, own)]))
    return fall, mean


@pytest.mark.parametrize("drift", [0.5, 1.0])
def test_the_excess_is_that_of_a_fit_to_each_stretch(drift):
    model, X, residual = fitted(1, drift)
    falls = [by_brute_force(X, residual, parts) for parts in STRETCHES]
    excess = [
        fall - mean
        for fall, mean in falls
        if chi2_distribution.sf(fall, round(mean)) < CONSTANCY_ALPHA / len(STRETCHES)
    ]
    assert excess
    assert inconstancy(model, "cause") == pytest.approx(max(excess), rel=1e-4)


def test_a_constant_cause_is_seldom_called_inconstant():
    """Twice what the level allows, and more, would be a chance of one in a thousand."""
    assert sum(inconstancy(fitted(seed)[0], "cause") > 0.0 for seed in range(150)) <= 16


def test_what_sound_rigs_show_speaks_against_no_cause():
    """A larger deviation counts further, and a drift within the range of sound rigs does not count."""
    chi2, freedom = np.transpose(changes(fitted(1, 1.0)[0], "cause"))
    excess = inconstancy(fitted(1, 1.0, sound=1.5)[0], "cause")
    assert excess == pytest.approx(np.max(chi2 - 1.5 * freedom))
    assert 0.0 < excess < inconstancy(fitted(1, 1.0)[0], "cause")
    assert inconstancy(fitted(1, 1.0, sound=1.01 * float(np.max(chi2 / freedom)))[0], "cause") == 0.0


def test_only_a_drift_in_an_imitating_parameter_contradicts_a_cause():
    """A drift contradicts a cause in the parameter that imitates it, and in another at most as noise does."""
    in_the_way = [inconstancy(fitted(seed, 1.0, ROOM)[0], "cause") for seed in range(6)]
    elsewhere = [inconstancy(fitted(seed, 1.0, STRANGE)[0], "cause") for seed in range(6)]
    assert min(in_the_way) > 60.0
    assert sum(excess > 0.0 for excess in elsewhere) <= 1


def test_a_cause_must_be_clear_of_what_the_form_owes():
    model, _, _ = fitted(1, 1.0)
    limit = CLEAR_OF_FORM * np.sqrt(inconstancy(model, "cause"))
    assert owed_to_form(model, [SimpleNamespace(effect="cause", lambda_=0.99 * limit)]) == ("cause",)
    assert owed_to_form(model, [SimpleNamespace(effect="cause", lambda_=1.01 * limit)]) == ()
    assert owed_to_form(fitted(1)[0], [SimpleNamespace(effect="cause", lambda_=1.0)]) == ()


def test_the_interval_of_a_cause_that_drifts_holds_what_half_of_the_data_would_say():
    model, X, residual = fitted(1, 2.0)
    covariance = np.linalg.inv(model.linearisation.information)
    model.covariance, model.point, model.effects = lambda: covariance, model.linearisation.point, ("cause",)
    model.replay.runs = [SimpleNamespace(experiment=SimpleNamespace(record="one", name="one"))] * RUNS
    model.replay.simulator.unseen_errors = ()
    wide = widened(model, ())
    half = slice(SAMPLES // 2, SAMPLES)
    there = np.concatenate(list(X[:, :, half]), axis=1)
    (*_, amount) = np.linalg.lstsq(there.T, residual[:, half].ravel())[0]
    assert amount > 3.0 * np.sqrt(covariance[CAUSE, CAUSE])
    assert amount < 1.96 * np.sqrt(wide[CAUSE, CAUSE])
    assert wide[STRANGE, STRANGE] < 1.5 * covariance[STRANGE, STRANGE]
    model.replay.simulator.catalogue = {}
    assert widened(model, ()) == pytest.approx(covariance)
