"""Penalised least squares by Levenberg and Marquardt, with few simulations.

Theory of operation
-------------------
The fit minimises the penalised χ²: Σ|r|² of the whitened residuals plus the squares of the parameters' distances from
their priors (`linear.py`). Nearly all of the time is spent on simulations for difference quotients. So columns are
computed only when needed, in the order of their cost (`ColumnSource`):

* the columns of the nuisances are copied from another fit, and whitened again if its noise differs, because they hardly
  differ between models;
* the columns of the effects are corrected after each step by Broyden's rule, so that they explain the last change;
* if a step gains clearly less than the linear model predicts, new columns of the effects are computed; if it fails,
  with central differences;
* if these fail too, the step is shortened by damping. Along a narrow curved valley good steps are short: the damping
  decreases slowly, and if a step fails after good ones, a shorter step is tried before new columns;
* if a shorter step fails too, the columns of the nuisances are computed again, which takes the most time;
* a fit whose linear model cannot reach the best other fit gets no new columns of the nuisances, and one that stays
  above a ``ceiling`` no central differences, because its exact χ² does not matter.

The fit ends when the predicted decrease of the next step is below the resolution of the finite differences.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from diagnosis.contracts import Array, DiagnosisError
from diagnosis.engine.config import (
    BROYDEN_SHARE,
    DOUBTFUL_DAMPING,
    FIT_RELATIVE_TOLERANCE,
    FIT_STEPS,
    FIT_TOLERANCE,
    GOOD_STEP,
    HOPELESS_STEP,
    LEAST_STEP,
    POOR_STEP,
    TWO_SIGMA_CHI2,
    WORTH_NEW_COLUMNS,
)
from diagnosis.engine.fitting.linear import Linearisation, Prior, prior_of
from diagnosis.engine.fitting.linearise import linearise
from diagnosis.engine.fitting.point import Coordinate, Point
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.noise import Noise
from diagnosis.engine.whitening import Filter, filters


class ColumnSource(IntEnum):
    """The source of the columns of a linearisation, in the order of cost and accuracy."""

    BORROWED = 0  #: an earlier point
    OWN = 1  #: differences at this point for the effects' own numbers
    CENTRAL = 2  #: central differences of these
    FRESH = 3  #: and differences at this point for all other numbers


@dataclass(frozen=True, slots=True, eq=False)
class FittedModel:
    """A fitted model. ``predictions`` (n, c) are the outputs of each run, in SI."""

    replay: Replay
    noise: Noise
    linearisation: Linearisation
    predictions: tuple[Array, ...]
    converged: bool

    @property
    def point(self) -> Point:
        """The point of the optimum."""
        return self.linearisation.point

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects and surfaces in the model."""
        return self.point.owners

    @property
    def samples(self) -> int:
        """The number of samples that count."""
        return sum(int(run.counted.sum()) for run in self.replay.runs)

    @property
    def bic(self) -> float:
        """Penalised χ² at the optimum plus ln N for each parameter of an effect. Only differences have a meaning."""
        extra = sum(1 for c in self.point.coordinates if c.owner)
        return self.penalised_chi2 + extra * math.log(self.samples)

    @property
    def penalised_chi2(self) -> float:
        """χ² of the data and squared distances from the priors, divided by the dispersion."""
        return self.linearisation.penalised_chi2 / self.noise.dispersion

    def covariance(self) -> Array:
        """Return the covariance (k, k) of the numbers of the point, by Laplace's approximation."""
        return self.noise.dispersion * self.linearisation.covariance()

    def deviation(self, coordinate: Coordinate) -> float:
        """Return the standard deviation of a parameter in its own unit. For a logarithmic parameter it is that of its
        logarithm.
        """
        place = self.point.place(coordinate)
        return float(math.sqrt(max(self.covariance()[place, place], 0.0))) * coordinate.scale


def fit(
    replay: Replay,
    noise: Noise,
    start: Point,
    known: Linearisation | None = None,
    *,
    prior: Prior | None = None,
    refresh: bool = False,
    target: float = math.inf,
    ceiling: float = math.inf,
    steps: int = FIT_STEPS,
) -> FittedModel:
    """Fit every free number of a model to the runs of a replay, from ``start``. ``prior`` replaces the prior of the
    parameters.

    ``known`` may hold columns of the nuisances, computed under any noise. ``refresh`` computes all columns again at the
    end. A fit that stays far above ``target``, the penalised χ² of another model, ends early. A fit whose predicted χ²
    stays above ``ceiling`` ends when new columns of the effects do not help. ``steps`` is the largest number of steps.
    Raises ``DiagnosisError`` if the outputs at the start are not finite.
    """
    whiten = filters(noise, replay.runs)
    predictions = replay.predictions(start)
    _check(replay, predictions, start)
    prior = (prior or prior_of(start)).times(noise.dispersion)
    first = linearise(replay, whiten, start, predictions, prior, known)
    source = ColumnSource.BORROWED if known else ColumnSource.FRESH
    descent = _Descent(replay, noise, whiten, prior, target, first, predictions, source)
    samples = sum(int(run.counted.sum()) for run in replay.runs)
    converged = False
    for _ in range(steps):
        at = descent.at
        trial = at.point.at(at.point.numbers + at.step(descent.damping))
        decrease = at.predicted_decrease(trial.numbers - at.point.numbers)
        tolerance = max(FIT_TOLERANCE * noise.dispersion, FIT_RELATIVE_TOLERANCE * (at.chi2 - samples))
        if decrease < max(tolerance, HOPELESS_STEP * (at.penalised_chi2 - noise.dispersion * target)):
            if descent.damping > 0.0:
                if descent.renewed():
                    continue
                # No step is short enough, because the model is rougher than its differences; the fit is final.
                converged = at.predicted_decrease(at.step()) < max(TWO_SIGMA_CHI2, tolerance)
                break
            if descent.source >= ColumnSource.FRESH or not refresh:
                converged = decrease < tolerance
                break
            descent.linearise(ColumnSource.FRESH)
        else:
            hopeless = at.penalised_chi2 - decrease > noise.dispersion * ceiling
            if not descent.attempt(trial, decrease, hopeless):
                converged = not hopeless
                break
    return FittedModel(replay, noise, descent.at, tuple(descent.predictions), converged)


@dataclass(slots=True, eq=False)
class _Descent:
    """The state of a fit: the linearised model, its predictions, the source of its columns, and the damping."""

    replay: Replay
    noise: Noise
    whiten: Sequence[Filter]
    prior: Prior
    target: float
    at: Linearisation
    predictions: Sequence[Array]
    source: ColumnSource
    damping: float = 0.0
    trusted: bool = False  #: the last step was good, though damped

    def attempt(self, trial: Point, decrease: float, hopeless: bool) -> bool:
        """Simulate a step. Take the step if it is good enough, otherwise prepare a better one. Return False if a better
        one is not worth its cost.

        ``decrease`` is the predicted decrease of the penalised χ². If the fit is ``hopeless``, only columns of the
        effects are computed again.
        """
        predictions = self.replay.predictions(trial)
        there = _follow(self.at, trial, self.whiten, self.replay, predictions)
        gain = (self.at.penalised_chi2 - there.penalised_chi2) / decrease
        if gain > LEAST_STEP:
            self.at, self.predictions, self.source = there, predictions, ColumnSource.BORROWED
            if gain < POOR_STEP:
                self.linearise(self._cheapest)
            self.damping = self.damping / 3.0 if self.damping > 1e-6 else 0.0
            self.trusted = gain > GOOD_STEP and self.damping > 0.0
        elif self.source >= ColumnSource.OWN and decrease < WORTH_NEW_COLUMNS * self.noise.dispersion:
            return not hopeless and self.renewed()
        elif self.trusted:
            self.damping, self.trusted = 2.0 * max(self.damping, 1e-6), False
        elif hopeless and ColumnSource.OWN <= self.source < ColumnSource.FRESH:
            return False
        elif self.source < ColumnSource.CENTRAL:
            self.linearise(max(ColumnSource(self.source + 1), self._cheapest))
        elif not (self.damping >= DOUBTFUL_DAMPING and self.renewed()):
            self.damping = max(10.0 * self.damping, 1e-3)
        return True

    def renewed(self) -> bool:
        """Compute all columns again if shorter steps failed with old columns of the nuisances. Return whether this was
        done.

        It is done only if the linear model predicts a χ² below the target.
        """
        if self.damping == 0.0 or not ColumnSource.OWN <= self.source < ColumnSource.FRESH:
            return False
        decrease, dispersion = self.at.predicted_decrease(self.at.step()), self.noise.dispersion
        worth = decrease > WORTH_NEW_COLUMNS * dispersion
        if not (worth and self.at.penalised_chi2 - decrease < dispersion * self.target):
            return False
        self.damping = 0.0
        self.linearise(ColumnSource.FRESH)
        return True

    def linearise(self, source: ColumnSource) -> None:
        """Compute columns again at the present point; those of the nuisances only if ``source`` is FRESH."""
        if source == ColumnSource.FRESH:
            self._compute(None)
        if self._has_own:
            self._compute(self.at, central=source >= ColumnSource.CENTRAL)
        self.source = source

    def _compute(self, known: Linearisation | None, *, central: bool = False) -> None:
        self.at = linearise(
            self.replay, self.whiten, self.at.point, self.predictions, self.prior, known, central=central
        )

    @property
    def _has_own(self) -> bool:
        """Whether free parameters of effects have columns."""
        return any(c.owner and not c.held for c in self.at.point.coordinates)

    @property
    def _cheapest(self) -> ColumnSource:
        """The cheapest source of new columns."""
        return ColumnSource.OWN if self._has_own else ColumnSource.FRESH


def _follow(
    old: Linearisation, trial: Point, whiten: Sequence[Filter], replay: Replay, predictions: Sequence[Array]
) -> Linearisation:
    """Return the linearisation at a new point. Broyden's rule corrects the columns of the effects by the change of the
    last step.
    """
    moved = trial.numbers - old.point.numbers
    blocks = []
    for block, filter_, residual in zip(old.blocks, whiten, replay.residuals(predictions), strict=True):
        white = filter_(residual)
        (common, nuisances), (own, columns) = block.parts
        mine = moved[list(own)]
        square = float(mine @ mine)
        if square > BROYDEN_SHARE * float(moved @ moved) and np.isfinite(white).all():
            surprise = block.residual - white - block.along(moved)
            columns = columns.plus(surprise, mine / square)
        blocks.append(replace(block, residual=white, parts=((common, nuisances), (own, columns))))
    return Linearisation(trial, old.prior, tuple(blocks))


def _check(replay: Replay, predictions: Sequence[Array], point: Point) -> None:
    """Raise DiagnosisError if an output of a model at its start is not finite."""
    for run, predicted in zip(replay.runs, predictions, strict=True):
        if not np.isfinite(predicted[run.counted]).all():
            raise DiagnosisError(
                f"{replay.simulator.name} returns NaN or infinity for the run {run.experiment.name} at "
                f"{dict(zip((c.label for c in point.coordinates), point.values().tolist(), strict=True))}; "
                "outputs must be finite in the whole range of the parameters"
            )
