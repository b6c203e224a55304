"""Grey-box fits: least squares with priors by Levenberg and Marquardt, and how well a fit predicts unseen runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from diagnosis.contracts import Array, DiagnosisError
from diagnosis.engine.fitting.linear import Block, Columns, Linearisation, Prior, prior_of
from diagnosis.engine.fitting.linearise import linearise
from diagnosis.engine.fitting.point import Coordinate, Point
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.noise import Filter, Noise, filters

ITERATIONS: Final = 30  #: steps that a fit may take
PATIENT: Final = 150  #: the same of a model that is reported
COARSE: Final = 1e-5  #: the same per unit of misfit beyond the noise, of which differences see no finer part
FAIR: Final = 0.75  #: a step that gains less than this part of its promise was taken with poor columns
GOOD: Final = 0.9  #: a step that gains this part of its promise had good columns
ENOUGH: Final = 0.01  #: a fit ends where the next step promises less than this, in units of χ²
HOPELESS: Final = 0.02  #: a step that closes less than this part of the gap to a better model is the last one
ROUGH: Final = 4.0  #: so much χ² may lie below a fit that comes to no better: two standard deviations
IDLE: Final = 1.0  #: what a step failed to gain is not worth better columns below this, in units of χ²
LEADING: Final = 0.01  #: part of a step² that the own numbers must make for their columns to learn from it

#: Where the columns of a fit come from: an earlier point, differences at this point for the effects' own numbers or for
#: all, central differences of the effects' own or, without effects, of all.
BORROWED, OWN, FRESH, CENTRAL = range(4)


@dataclass(frozen=True, slots=True, eq=False)
class FittedModel:
    """A model at its best fit. ``predictions`` (n, c) are those of the replayed runs, in their own units."""

    replay: Replay
    noise: Noise
    linearisation: Linearisation
    predictions: tuple[Array, ...]
    converged: bool

    @property
    def point(self) -> Point:
        """Where the fit ended."""
        return self.linearisation.point

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects and surfaces in the model."""
        return self.point.owners

    @property
    def samples(self) -> int:
        """How many samples count."""
        return sum(int(run.counted.sum()) for run in self.replay.runs)

    @property
    def bic(self) -> float:
        """χ² and priors at the optimum, and ln N for each parameter of an effect; only differences mean something."""
        extra = sum(1 for c in self.point.coordinates if c.owner)
        return self.penalised_chi2 + extra * math.log(self.samples)

    @property
    def penalised_chi2(self) -> float:
        """χ² of the data, as far as they count, and of the priors."""
        return self.linearisation.penalised_chi2 / self.noise.dispersion

    def covariance(self) -> Array:
        """Return the covariance (k, k) of the numbers of the point, by Laplace's approximation."""
        return self.noise.dispersion * self.linearisation.covariance()

    def deviation(self, coordinate: Coordinate) -> float:
        """Return the standard deviation of a parameter in its own unit; of its logarithm where it is fitted as such."""
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
    steps: int = ITERATIONS,
) -> FittedModel:
    """Fit every number of a model to the runs of a replay, from ``start``; ``prior`` replaces the priors.

    The nuisances' columns are those of ``known`` (whitened by the same noise) if it is given. Those of the effects
    follow the steps by Broyden's rule and are computed anew where a step does not keep its promise; all columns are
    where it fails and, on ``refresh``, at the end; where it fails again, by central differences. A fit that stays far
    above the cost ``target`` of another model is not carried to the last digit; none takes more than so many ``steps``.
    Along a narrow curved valley they are short: the damping falls slowly, and a step that fails after good ones is
    tried shorter before columns are doubted. Raises ``DiagnosisError`` where the
    model fails at the start.
    """
    whiten = filters(noise, replay.runs)
    predictions = replay.predictions(start)
    _check(replay, predictions, start)
    prior = (prior or prior_of(start)).times(noise.dispersion)
    here = linearise(replay, whiten, start, predictions, prior, known)
    columns = BORROWED if known else FRESH
    samples = sum(int(run.counted.sum()) for run in replay.runs)
    damping, converged, trusted = 0.0, False, False
    for _ in range(steps):
        trial = here.point.at(here.point.numbers + here.step(damping))
        promise = here.predicted_decrease(trial.numbers - here.point.numbers)
        enough = max(ENOUGH * noise.dispersion, COARSE * (here.chi2 - samples))
        if promise < max(enough, HOPELESS * (here.penalised_chi2 - noise.dispersion * target)):
            if damping > 0.0:
                # No step is short enough: the model is rougher than its differences. As good as it gets.
                converged = here.predicted_decrease(here.step()) < max(ROUGH, enough)
                break
            if columns >= FRESH or not refresh:
                converged = promise < enough
                break
            here, columns = linearise(replay, whiten, here.point, predictions, prior), FRESH
            continue
        tried = replay.predictions(trial)
        there = _follow(here, trial, whiten, replay, tried)
        gain = (here.penalised_chi2 - there.penalised_chi2) / promise
        if gain > 0.01:
            here, predictions, columns = there, tried, BORROWED
            if gain < FAIR:
                columns = OWN if trial.owners else FRESH
                known = here if columns == OWN else None
                here = linearise(replay, whiten, trial, predictions, prior, known)
            damping = damping / 3.0 if damping > 1e-6 else 0.0
            trusted = gain > GOOD and damping > 0.0
        elif columns >= OWN and promise < IDLE * noise.dispersion:
            converged = True
            break
        elif trusted:
            damping, trusted = 2.0 * max(damping, 1e-6), False
        elif columns < CENTRAL:
            columns = max(columns + 1, OWN if trial.owners else FRESH)
            known = here if trial.owners and columns != FRESH else None
            here = linearise(
                replay, whiten, here.point, predictions, prior, known, central=columns == CENTRAL
            )
        else:
            damping = max(10.0 * damping, 1e-3)
    return FittedModel(replay, noise, here, tuple(predictions), converged)


def _follow(
    here: Linearisation, trial: Point, whiten: Sequence[Filter], replay: Replay, predictions: Sequence[Array]
) -> Linearisation:
    """Return the linearisation at a new point whose own columns agree with the change just seen (Broyden)."""
    moved = trial.numbers - here.point.numbers
    blocks = []
    for block, filter_, residual in zip(here.blocks, whiten, replay.residuals(predictions), strict=True):
        white = filter_(residual)
        (common, nuisances), (own, columns) = block.parts
        mine = moved[list(own)]
        square = float(mine @ mine)
        if square > LEADING * float(moved @ moved) and np.isfinite(white).all():
            surprise = block.residual - white - block.along(moved)
            columns = Columns(columns.values + surprise * (mine / square)[:, None, None])
        blocks.append(Block(block.run, white, ((common, nuisances), (own, columns))))
    return Linearisation(trial, here.prior, tuple(blocks))


def _check(replay: Replay, predictions: Sequence[Array], point: Point) -> None:
    """Refuse a model that has no finite output where it starts."""
    for run, predicted in zip(replay.runs, predictions, strict=True):
        if not np.isfinite(predicted[run.counted]).all():
            raise DiagnosisError(
                f"{replay.simulator.name} returns NaN or infinity for the run {run.experiment.name} at "
                f"{dict(zip((c.label for c in point.coordinates), point.values().tolist(), strict=True))}; "
                "a simulator must be finite wherever its parameters are allowed to be"
            )
