"""Constancy of parameters: Chow's statistic against brute force and its distribution, and what it keeps from a name."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from diagnosis.contracts import Experiment, MeasuredRun, Parameter
from diagnosis.engine.columns import columns_of, packing_of
from diagnosis.engine.config import STRETCHES
from diagnosis.engine.constancy import inconstancy, owed_to_form
from diagnosis.engine.fitting.linear import Block, Linearisation, prior_of
from diagnosis.engine.fitting.point import Coordinate, Point

RUNS, SAMPLES, COLUMNS = 3, 800, 4


def point():
    names = [Parameter(f"p{i}", "", 0.0, 1e6) for i in range(COLUMNS)]
    return Point(tuple(Coordinate(one) for one in names), np.zeros(COLUMNS))


def fitted(seed, drift=0.0):
    """A linear model at its optimum; its first parameter grows by ``drift`` in the course of each run."""
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((RUNS, COLUMNS, SAMPLES, 1))
    residual = rng.standard_normal((RUNS, SAMPLES, 1))
    residual += drift * X[:, 0] * np.linspace(-0.5, 0.5, SAMPLES)[None, :, None]
    flat = np.concatenate([x.reshape(COLUMNS, -1) for x in X], axis=1)
    residual -= np.einsum("k,rkns->rns", np.linalg.lstsq(flat.T, residual.ravel())[0], X)
    time = 0.01 * np.arange(SAMPLES)
    everywhere = np.ones(SAMPLES, bool)
    blocks = []
    for r in range(RUNS):
        run = MeasuredRun(Experiment(f"{r}", time, {}), residual[r], everywhere, ~everywhere)
        packing = packing_of(run)
        parts = (
            (tuple(range(COLUMNS - 1)), columns_of(packing, X[r, :-1])),
            ((COLUMNS - 1,), columns_of(packing, X[r, -1:])),
        )
        blocks.append(Block(f"{r}", packing, residual[r, :, 0], parts))
    where = point()
    model = SimpleNamespace(
        linearisation=Linearisation(where, prior_of(where), tuple(blocks)),
        noise=SimpleNamespace(dispersion=1.0),
    )
    return model, X[..., 0], residual[..., 0]


def by_brute_force(X, residual, parts):
    """How far χ² falls if each stretch has parameters of its own: nothing but a least-squares fit of each."""
    fall = 0.0
    for x, r in zip(X, residual, strict=True):
        for own, left in zip(np.split(x, parts, axis=1), np.split(r, parts), strict=True):
            fitted_ = np.linalg.lstsq(own.T, left)[0] @ own
            fall += left @ left - np.sum((left - fitted_) ** 2)
    return fall


@pytest.mark.parametrize("drift", [0.4, 1.0])
def test_the_excess_is_that_of_a_fit_to_each_stretch(drift):
    model, X, residual = fitted(1, drift)
    excess = [
        by_brute_force(X, residual, parts) - COLUMNS * (RUNS * parts - 1)
        for parts in STRETCHES
        if (freedom := COLUMNS * (RUNS * parts - 1))
        and chi2.sf(by_brute_force(X, residual, parts), freedom) < 0.05 / len(STRETCHES)
    ]
    assert excess
    assert inconstancy(model) == pytest.approx(max(excess), rel=1e-4)


def test_constant_parameters_are_seldom_called_inconstant():
    """At a level of 5 %, more than 16 of 150 would be a chance of one in a thousand."""
    assert sum(inconstancy(fitted(seed)[0]) > 0.0 for seed in range(150)) <= 16


def test_a_cause_must_be_clear_of_what_the_form_owes():
    causes = [SimpleNamespace(effect="faint", lambda_=19.0), SimpleNamespace(effect="clear", lambda_=21.0)]
    assert owed_to_form(causes, 100.0) == ("faint",)
    assert owed_to_form(causes, 0.0) == ()
