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
    """Two shared numbers (one with a prior), one of each run: the linearisation, and X (N, k), r (N,) in full."""
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


def shaken(rng, symmetric):
    """The same matrix, each entry moved by up to 1e-10 of the root of both diagonal elements."""
    noise = rng.uniform(-1e-10, 1e-10, symmetric.shape)
    root = np.sqrt(np.diagonal(symmetric))
    return symmetric + (noise + noise.T) / 2 * np.outer(root, root)


class Shaken(Columns):
    """Columns whose inner products are wrong in the tenth digit, as those of another order of summation are."""

    def __init__(self, columns, rng, grams):
        super().__init__(columns.size, columns.traces)
        self.rng, self.grams = rng, grams

    @property
    def gram(self):
        full = sum(t.values @ t.values.T for t in self.traces)
        return shaken(self.rng, full) if self.grams else full

    def against(self, other):
        pairs = zip(self.traces, other.traces, strict=True)
        both = np.hstack([np.concatenate((t.values, o.values)) for t, o in pairs])
        return shaken(self.rng, both @ both.T)[: self.size, self.size :]


@pytest.mark.parametrize("grams", [True, False])
def test_rounding_moves_no_score(grams):
    """Nuisances and candidates of which many are alike, to 1e-3, 1e-6 and the last digit: scores do not notice."""
    rng = np.random.default_rng(8)
    base = rng.standard_normal((6, 400, 1))
    alike = 1e3 * (base + 1e-3 * rng.standard_normal((6, 400, 1)))
    nuisances = np.concatenate((base, alike, base[:3] + base[3:], alike[:2] - 1e3 * base[:2]))
    nuisances = np.concatenate((nuisances, base + 7e-7 * rng.standard_normal((6, 400, 1))))
    unit = nuisances / np.linalg.norm(nuisances, axis=1, keepdims=True)
    mixed = np.tensordot(rng.standard_normal((30, len(nuisances))), unit, 1)
    own = mixed + 0.05 * rng.standard_normal((30, 400, 1)) * np.logspace(-2, 1, 30)[:, None, None]
    footprints = np.concatenate((own, own[::2], own[:9] + own[9:18], mixed[:5]))
    coordinates = tuple(
        Coordinate(Parameter(f"n{i}", "1", 0.0, 1.0), penalised=False) for i in range(len(nuisances))
    )
    point, residual = Point(coordinates, np.zeros(len(coordinates))), rng.standard_normal(400)

    def projected(wrap):
        parts = (tuple(range(len(nuisances))), wrap(packed(nuisances))), ((), packed(nuisances[:0]))
        block = Block("a", packing(400, 1), residual, parts)
        prior = Prior(np.zeros(len(nuisances)), np.zeros((len(nuisances),) * 2))
        return Linearisation(point, prior, (block,)).project([wrap(packed(footprints))])

    exact = projected(lambda columns: columns)
    assert np.count_nonzero(exact.norm) >= 45 and not exact.norm[-5:].any()
    for seed in range(5):
        other = projected(lambda columns, seed=seed: Shaken(columns, np.random.default_rng(seed), grams))
        assert other.z == pytest.approx(exact.z, abs=0.02)
        assert other.norm == pytest.approx(exact.norm, rel=0.01)
        made = [p.estimate @ p.information @ p.estimate for p in (exact, other)]
        assert made[1] == pytest.approx(made[0], abs=0.1)


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


def test_undetermined_unknowns_of_a_singular_system_are_zero():
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
