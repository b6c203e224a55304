"""Least squares on whitened residuals and sensitivities, kept run by run: gradients, projections, covariances.

The unknown step δ minimises Σ|r − X δ|² + (u + δ − m)ᵀ W (u + δ − m), where u are the numbers of the point, m their
prior mean and W its precision: a prior is one more observation. Columns of one run's own nuisances are only in the
block of that run.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import lsq_linear

from diagnosis.contracts import Array
from diagnosis.engine.columns import Columns, Packing
from diagnosis.engine.config import EIGENVALUE_FLOOR, VISIBLE_PART
from diagnosis.engine.fitting.point import Point
from diagnosis.engine.threads import in_threads
from diagnosis.engine.whitening import Filter

#: Columns with the coordinates of the point that they belong to.
Part = tuple[tuple[int, ...], Columns]


@dataclass(frozen=True, slots=True, eq=False)
class Raw:
    """Columns before whitening, and the filter that whitened them. Other filters can be applied to them too."""

    columns: Columns
    passed: Filter


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """One run after whitening: residual (N,) and sensitivities of the samples that count.

    The first of the ``parts`` holds columns that many models share. ``raw`` holds these columns before whitening if
    other models may copy them. The second part holds the model's own columns.
    """

    run: str
    packing: Packing
    residual: Array
    parts: tuple[Part, Part]
    raw: Raw | None = None

    @property
    def places(self) -> list[int]:
        """The index of the coordinate of each column."""
        return [place for places, _ in self.parts for place in places]

    @property
    def gram(self) -> Array:
        """Inner products (k, k) of all columns."""
        (_, shared), (_, own) = self.parts
        mixed = shared.against(own)
        return np.block([[shared.gram, mixed], [mixed.T, own.gram]])

    def multiplied(self) -> Block:
        """Compute the inner products of the columns, so that they are cached, and return the block."""
        _ = self.gram
        return self

    def against(self, further: Columns) -> Array:
        """Return the inner products (k, m) of all columns with m further ones."""
        return np.concatenate([columns.against(further) for _, columns in self.parts])

    def times(self, samples: Array) -> Array:
        """Return the inner products (k,) of all columns with packed samples (N,)."""
        return np.concatenate([columns.times(samples) for _, columns in self.parts])

    def along(self, numbers: Array) -> Array:
        """Return the sum (N,) of all columns, each times the number of its coordinate of the point."""
        return np.asarray(sum(columns.along(numbers[list(places)]) for places, columns in self.parts))


@dataclass(frozen=True, slots=True, eq=False)
class Projection:
    """Extra columns after projection: the part that the linearisation can explain is subtracted.

    ``information`` (m, m) are the inner products of the projected columns, ``score`` (m,) those with the residual.
    ``gram`` (m, m) are the inner products before the projection. ``regression`` (k, m) are the coefficients with which
    the coordinates imitate the columns best.
    """

    information: Array
    score: Array
    gram: Array
    regression: Array

    def along(self, directions: Array) -> Projection:
        """Return the projection of v weighted sums of the columns. Each row of ``directions`` (v, m) holds the weights
        of one sum.
        """
        return Projection(
            directions @ self.information @ directions.T,
            directions @ self.score,
            directions @ self.gram @ directions.T,
            self.regression @ directions.T,
        )

    def of(self, inside: slice) -> Projection:
        """Return the projection of the columns ``inside``."""
        return Projection(
            self.information[inside, inside],
            self.score[inside],
            self.gram[inside, inside],
            self.regression[:, inside],
        )

    @property
    def raw(self) -> Array:
        """Norms (m,) of the columns before the projection."""
        return np.sqrt(np.diagonal(self.gram))

    @property
    def norm(self) -> Array:
        """Norms (m,) of the projected columns; 0 if the rest of a column is not above its numerical error
        ("invisible").
        """
        square = np.diagonal(self.information)
        return np.sqrt(np.where(square > VISIBLE_PART * np.diagonal(self.gram), square, 0.0))

    @property
    def estimate(self) -> Array:
        """Least-squares amplitudes (m,) of all columns together; 0 for an invisible column.

        Many columns are similar. A ridge of the size of their numerical errors keeps combinations below these errors
        near 0.
        """
        seen = self.norm > 0.0
        ridge = VISIBLE_PART * np.diagonal(self.gram)[seen]
        amplitudes = np.zeros(len(seen))
        amplitudes[seen] = solve(self.information[np.ix_(seen, seen)] + np.diag(ridge), self.score[seen])
        return amplitudes

    @property
    def z(self) -> Array:
        """Normalised scores sᵀr/|s| (m,): standard normal if the effect is missing; 0 for an invisible one."""
        norm = self.norm
        return np.divide(self.score, norm, out=np.zeros_like(norm), where=norm > 0.0)

    @property
    def cosines(self) -> Array:
        """Cosines (m, m) between the projected columns; 0 if one of the two is invisible."""
        norm = self.norm
        product = np.outer(norm, norm)
        return np.divide(self.information, product, out=np.eye(len(norm)), where=product > 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Normal prior of the numbers of a point, with mean (k,) and precision (k, k)."""

    mean: Array
    precision: Array

    def times(self, factor: float) -> Prior:
        """Return the prior with its precision multiplied by a factor."""
        return Prior(self.mean, factor * self.precision)


def prior_of(point: Point) -> Prior:
    """Return the prior of the parameters of a point: nominal value and spread, independent of each other."""
    return Prior(np.zeros(len(point.numbers)), np.diag([c.weight for c in point.coordinates]))


@dataclass(frozen=True, slots=True, eq=False)
class Linearisation:
    """The linear model around a point: the residual of each run, and the change of its outputs by each coordinate."""

    point: Point
    prior: Prior
    blocks: tuple[Block, ...]
    information: Array = field(init=False)  #: XᵀX + W (k, k)
    gradient: Array = field(init=False)  #: Xᵀr − W (u − m) (k,): downhill

    def __post_init__(self) -> None:
        information = self.prior.precision.copy()
        gradient = -self.prior.precision @ (self.point.numbers - self.prior.mean)
        for block in self.blocks:
            information[np.ix_(block.places, block.places)] += block.gram
            gradient[block.places] += block.times(block.residual)
        object.__setattr__(self, "information", information)
        object.__setattr__(self, "gradient", gradient)

    @property
    def chi2(self) -> float:
        """χ² of the data."""
        return float(sum(np.vdot(b.residual, b.residual) for b in self.blocks))

    @property
    def penalised_chi2(self) -> float:
        """χ² of the data and the priors."""
        away = self.point.numbers - self.prior.mean
        return self.chi2 + float(away @ self.prior.precision @ away)

    def step(self, damping: float = 0.0) -> Array:
        """Return the step (k,) to the optimum, with the damping of Levenberg and Marquardt.

        A number that would leave its range is set to the end of it, and the others are optimised again.
        """
        damped = self.information + damping * np.diag(np.diagonal(self.information))
        ranges = np.array([c.range for c in self.point.coordinates]).reshape(-1, 2)
        low, high = (ranges - self.point.numbers[:, None]).T
        step = solve(damped, self.gradient)
        if ((step >= low) & (step <= high)).all():
            return step
        scale, values, vectors = _spectrum(damped)
        keep = values > EIGENVALUE_FLOOR * values.max(initial=0.0)
        root = vectors[:, keep] * np.sqrt(values[keep])
        right = vectors[:, keep].T @ (scale * self.gradient) / np.sqrt(values[keep])
        return scale * lsq_linear(root.T, right, (low / scale, high / scale), method="bvls").x

    def predicted_decrease(self, step: Array) -> float:
        """Return the decrease of the penalised χ² by a step of the linear model."""
        return float(2.0 * step @ self.gradient - step @ self.information @ step)

    def covariance(self) -> Array:
        """Return the covariance (k, k) of the numbers by Laplace's approximation."""
        return inverse(self.information)

    def project(self, extra: Iterable[Columns], workers: int = 1) -> Projection:
        """Return the projection of the ``extra`` whitened columns of each run: the part that the coordinates can
        imitate is subtracted. Use ``workers`` threads.
        """

        def products(pair: tuple[Block, Columns]) -> tuple[Array, Array, Array]:
            block, further = pair
            mixed = np.zeros((len(self.point.numbers), further.size))
            mixed[block.places] = block.against(further)
            return mixed, further.gram, further.times(block.residual)

        runs = in_threads(workers, products, zip(self.blocks, extra, strict=True))
        mixed, own, score = (np.sum(parts, axis=0) for parts in zip(*runs, strict=True))
        regression = solve(self.information, mixed)
        return Projection(
            own - mixed.T @ regression,
            score - regression.T @ self.gradient,
            own,
            regression,
        )


def solve(gram: Array, right: Array) -> Array:
    """Solve a symmetric system that may be singular, by eigenvalues of the scaled matrix. The solution has no part in
    null directions.
    """
    scale, values, vectors = _spectrum(gram)
    keep = values > EIGENVALUE_FLOOR * values.max(initial=0.0)
    basis = vectors[:, keep] / np.sqrt(values[keep])
    return (scale * (basis @ (basis.T @ (scale * right.T).T)).T).T


def inverse(gram: Array) -> Array:
    """Return the (pseudo-)inverse of a symmetric positive semi-definite matrix."""
    return solve(gram, np.eye(len(gram)))


def _spectrum(gram: Array) -> tuple[Array, Array, Array]:
    diagonal = np.diagonal(gram)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(gram * np.outer(scale, scale))
    return scale, values, vectors
