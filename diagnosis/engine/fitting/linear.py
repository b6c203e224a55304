"""Least squares on whitened residuals and sensitivities, kept run by run: gradients, projections, covariances.

The unknown step δ minimises Σ|r − X δ|² + (u + δ − m)ᵀ W (u + δ − m), where u are the numbers of the point, m their
prior mean and W its precision: a prior is one more observation. Columns of one run's own nuisances live in that run's
block only. Columns (k, n, c) are kept one after the other, each as the samples (n, c) of a run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from diagnosis.contracts import Array
from diagnosis.engine.config import EIGENVALUE_FLOOR
from diagnosis.engine.fitting.point import Point


class Columns:
    """Whitened sensitivities (k, n, c) of one run, with their inner products; many linearisations may share them."""

    def __init__(self, values: Array) -> None:
        self.values = values
        self.flat: Array = values.reshape(len(values), values.shape[1] * values.shape[2])

    @cached_property
    def gram(self) -> Array:
        """Inner products (k, k)."""
        return self.flat @ self.flat.T


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """One run, whitened: residual (n, c) and sensitivities, all 0 where nothing counts.

    ``parts`` are columns with the coordinates of the point they belong to: those that many models share, then those
    that are the model's own.
    """

    run: str
    residual: Array
    parts: tuple[tuple[tuple[int, ...], Columns], ...]

    @property
    def places(self) -> list[int]:
        """Return the coordinates of all columns, in their order."""
        return [place for places, _ in self.parts for place in places]

    @property
    def gram(self) -> Array:
        """Inner products (k, k) of all columns."""
        columns = [columns for _, columns in self.parts]
        return np.block([[a.gram if a is b else a.flat @ b.flat.T for b in columns] for a in columns])

    def against(self, values: Array) -> Array:
        """Return the inner products (k, m) of all columns with m further ones (m, n c)."""
        return np.concatenate([columns.flat @ values.T for _, columns in self.parts])

    def along(self, numbers: Array) -> Array:
        """Return the sum (n, c) of all columns, each times the number of its coordinate of the point."""
        made = sum(numbers[list(places)] @ columns.flat for places, columns in self.parts)
        return np.asarray(made).reshape(self.residual.shape)


@dataclass(frozen=True, slots=True, eq=False)
class Projection:
    """Extra columns after everything that the linearisation can explain has been taken out of them.

    ``information`` (m, m) are their inner products, ``score`` (m,) those with the residual, ``raw`` (m,) their norms
    before the projection, ``regression`` (k, m) the coefficients with which the coordinates imitate them best.
    """

    information: Array
    score: Array
    raw: Array
    regression: Array

    @property
    def norm(self) -> Array:
        """Norms |s| (m,); 0 where nothing but rounding is left of a column."""
        square = np.diagonal(self.information)
        return np.sqrt(np.where(square > 1e-10 * self.raw**2, square, 0.0))

    @property
    def z(self) -> Array:
        """Normalised scores sᵀr/|s| (m,): standard normal where the effect is absent; 0 for an invisible one."""
        norm = self.norm
        return np.divide(self.score, norm, out=np.zeros_like(norm), where=norm > 0.0)

    @property
    def cosines(self) -> Array:
        """Cosines (m, m) between the projected columns; 0 with an invisible one."""
        norm = self.norm
        product = np.outer(norm, norm)
        return np.divide(self.information, product, out=np.eye(len(norm)), where=product > 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """What is known of the numbers of a point without these data: normal, with mean (k,) and precision (k, k)."""

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
    """The model around a point: what each run leaves, and what each coordinate would change."""

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
            gradient[block.places] += block.against(block.residual.reshape(1, -1))[:, 0]
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
        """Return the step (k,) to the optimum, as Levenberg and Marquardt damp it.

        A number that would leave its range goes to the end of it, and the others make the best of that.
        """
        damped = self.information + damping * np.diag(np.diagonal(self.information))
        ranges = np.array([c.range for c in self.point.coordinates]).reshape(-1, 2)
        low, high = (ranges - self.point.numbers[:, None]).T
        step = solve(damped, self.gradient)
        if ((step >= low) & (step <= high)).all():
            return step
        from scipy.optimize import lsq_linear

        scale, values, vectors = _spectrum(damped)
        keep = values > EIGENVALUE_FLOOR * values.max(initial=0.0)
        root = vectors[:, keep] * np.sqrt(values[keep])
        right = vectors[:, keep].T @ (scale * self.gradient) / np.sqrt(values[keep])
        return scale * lsq_linear(root.T, right, (low / scale, high / scale), method="bvls").x

    def predicted_decrease(self, step: Array) -> float:
        """Return how much a step would lower the penalised χ² if the model were linear."""
        return float(2.0 * step @ self.gradient - step @ self.information @ step)

    def covariance(self) -> Array:
        """Return the covariance (k, k) of the numbers by Laplace's approximation."""
        return inverse(self.information)

    def project(self, extra: Sequence[NDArray[np.floating]]) -> Projection:
        """Project whitened columns (m, n, c) of each run onto what no coordinate can imitate."""
        size, width = len(self.point.numbers), len(extra[0])
        mixed, own, score = np.zeros((size, width)), np.zeros((width, width)), np.zeros(width)
        for block, further in zip(self.blocks, extra, strict=True):
            columns = further.reshape(width, block.residual.size).astype(np.float64, copy=False)
            mixed[block.places] += block.against(columns)
            own += columns @ columns.T
            score += columns @ block.residual.ravel()
        regression = solve(self.information, mixed)
        return Projection(
            own - mixed.T @ regression,
            score - regression.T @ self.gradient,
            np.sqrt(np.diagonal(own)),
            regression,
        )


def solve(gram: Array, right: Array) -> Array:
    """Solve a symmetric, perhaps singular system by eigenvalues of the equilibrated matrix; the unseen stays 0."""
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
