"""The algebra of whitened least squares against what numpy says of the same problem written out in full."""

import numpy as np
import pytest

from diagnosis.contracts import Experiment, MeasuredRun, Parameter
from diagnosis.engine.columns import Columns, Trace, packing_of
from diagnosis.engine.fitting.linear import Block, Linearisation, Prior, inverse, prior_of, solve
from diagnosis.engine.fitting.point import Coordinate, Point

RUNS = ("a", "b")


def packing(samples, channels):
    return packing_of(
        MeasuredRun(
            Experiment("run", np.arange(float(samples)), {}),
            np.zeros((samples, channels)),
            np.ones(samples, bool),
            np.zeros(samples, bool),
        )
    )


def packed(columns):
    """Columns (k, n, c) in double precision, every channel of them."""
    rows = np.arange(len(columns))
    return Columns(len(columns), [Trace(rows, columns[:, :, c]) for c in range(columns.shape[2])])


def problem(rng, samples=40, channels=3):
    """Two shared numbers (one believed), one of each run: the linearisation, and X (N, k), r (N,) in full."""
    coordinates = (
        Coordinate(Parameter("free", "1", 0.0, np.inf, step=0.01)),
        Coordinate(Parameter("known", "1", 0.0, 1.0)),
        *(Coordinate(Parameter("start", "1", 0.0, 2.0), record=run) for run in RUNS),
    )
    point = Point(coordinates, rng.standard_normal(4))
    blocks, full = [], []
    for run in RUNS:
        places = tuple(point.places_of(run))
        columns = rng.standard_normal((3, samples, channels))
        parts = (places[:1], packed(columns[:1])), (places[1:], packed(columns[1:]))
        blocks.append(Block(run, packing(samples, channels), rng.standard_normal(samples * channels), parts))
        wide = np.zeros((samples * channels, 4))
        wide[:, places] = columns.transpose(0, 2, 1).reshape(3, -1).T
        full.append(wide)
    here = Linearisation(point, prior_of(point), tuple(blocks))
    return here, np.vstack(full), np.concatenate([b.residual for b in blocks])


def stacked(here, X, r):
    """The priors as further observations."""
    w = np.diag(here.prior.precision)
    return np.vstack((X, np.diag(np.sqrt(w)))), np.concatenate((r, -np.sqrt(w) * here.point.numbers))


def test_step_and_covariance_are_those_of_least_squares_with_the_priors_as_observations():
    here, X, r = problem(np.random.default_rng(1))
    X, r = stacked(here, X, r)
    assert here.step() == pytest.approx(np.linalg.lstsq(X, r, rcond=None)[0], rel=1e-10)
    assert here.covariance() == pytest.approx(np.linalg.inv(X.T @ X), rel=1e-9)
    assert here.penalised_chi2 == pytest.approx(r @ r, rel=1e-12)


def test_the_promise_of_a_step_is_kept_by_a_linear_model():
    here, X, r = problem(np.random.default_rng(2))
    X, r = stacked(here, X, r)
    step = here.step(damping=0.3)
    assert here.predicted_decrease(step) == pytest.approx(r @ r - np.sum((r - X @ step) ** 2), rel=1e-9)


def test_projection_is_the_residual_of_a_regression_on_all_columns():
    rng = np.random.default_rng(3)
    here, X, r = problem(rng)
    extra = [rng.standard_normal((5, 40, 3)) for _ in RUNS]
    S = np.vstack([e.transpose(0, 2, 1).reshape(5, -1).T for e in extra])
    X, r = stacked(here, X, r)
    S = np.vstack((S, np.zeros((4, 5))))
    left = S - X @ np.linalg.lstsq(X, S, rcond=None)[0]
    projection = here.project([packed(e) for e in extra])
    assert projection.information == pytest.approx(left.T @ left, rel=1e-9, abs=1e-9)
    assert projection.score == pytest.approx(left.T @ r, rel=1e-9, abs=1e-9)
    assert projection.z == pytest.approx(left.T @ r / np.linalg.norm(left, axis=0), rel=1e-9)


def test_a_column_that_the_model_imitates_exactly_has_no_score():
    rng = np.random.default_rng(4)
    here, _, _ = problem(rng)
    # The unbelieved shared column and nothing else: nothing of it is left.
    extra = [
        Columns(1, [Trace(t.rows, 3.0 * t.values) for t in block.parts[0][1].traces]) for block in here.blocks
    ]
    projection = here.project(extra)
    assert projection.norm == pytest.approx([0.0])
    assert projection.z == pytest.approx([0.0])
    assert projection.gram[0, 0] > 1.0


def test_a_step_stays_in_range_and_the_others_make_the_best_of_it():
    rng = np.random.default_rng(5)
    X = rng.standard_normal((200, 3)) @ np.array([[1.0, 0.9, 0.0], [0.0, 0.5, 0.3], [0.0, 0.0, 1.0]])
    r = X @ np.array([2.0, -1.5, 0.5]) + 0.1 * rng.standard_normal(200)
    coordinates = tuple(Coordinate(Parameter(n, "1", 0.0, 1.0, -0.7, 0.8), penalised=False) for n in "abc")
    point = Point(coordinates, np.zeros(3))
    prior = Prior(np.zeros(3), np.zeros((3, 3)))
    here = Linearisation(
        point,
        prior,
        (
            Block(
                "a",
                packing(200, 1),
                r,
                (((0, 1, 2), packed(X.T[:, :, None])), ((), packed(X.T[:0, :, None]))),
            ),
        ),
    )
    from scipy.optimize import lsq_linear

    assert here.step() == pytest.approx(lsq_linear(X, r, (-0.7, 0.8), tol=1e-12).x, abs=1e-6)


def test_a_singular_system_leaves_the_unseen_at_zero():
    gram = np.array([[2.0, 2.0, 0.0], [2.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
    assert solve(gram, np.array([2.0, 2.0, 0.0])) == pytest.approx([0.5, 0.5, 0.0])
    assert inverse(gram)[2] == pytest.approx([0.0, 0.0, 0.0])


def test_scales_of_columns_do_not_matter():
    """Twelve decades between columns: parameters in pascals and in kilometres."""
    rng = np.random.default_rng(6)
    X = rng.standard_normal((50, 4))
    scale = np.array([1e-6, 1.0, 1e3, 1e6])
    r = rng.standard_normal(50)
    gram = (X * scale).T @ (X * scale)
    assert solve(gram, scale * (X.T @ r)) * scale == pytest.approx(
        np.linalg.lstsq(X, r, rcond=None)[0], rel=1e-9
    )


def test_what_the_columns_make_is_their_product_with_the_numbers():
    here, X, _ = problem(np.random.default_rng(7))
    numbers = np.array([0.3, -1.0, 2.0, 0.7])
    made = np.concatenate([block.along(numbers) for block in here.blocks])
    assert made == pytest.approx(X @ numbers)
