"""Step 4, scores: how well the footprint of every candidate matches the residual of a fitted model.

Theory of operation
-------------------
The part of a footprint that parameters of the model can imitate does not support its candidate. It is projected out
(`Linearisation.project`). With s the rest of a whitened footprint and r the whitened residual, the score is z =
sᵀr/|s|, standard normal where the effect is missing. |s| per unit of amplitude is the square root of the Fisher
information on the amplitude once everything else is fitted; times the amplitude it is λ. This is the score test with
the shape parameters, which are absent under the null, on a grid (Davies 1977, 1987).

A score is divided by its scatter. The scatter grows by overdispersion (`noise_estimate.overdispersion`), and by errors
of the simulator or of its measured inputs that imitate the effect (`Hypothesis.imitated`). If only one sign of an
amplitude is physical, the score of the other sign is negative.

`fit_and_screen` performs steps 2 to 5 for one model: noise from the footprints, fit under it, scores, threshold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from diagnosis.contracts import Array, Hypothesis
from diagnosis.engine.columns import Columns
from diagnosis.engine.config import FIT_STEPS
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.linear import Linearisation, Projection
from diagnosis.engine.fitting.linearise import from_quotients
from diagnosis.engine.fitting.point import Point
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.footprints import Candidate, Footprints
from diagnosis.engine.memory import give_back
from diagnosis.engine.noise_estimate import leftover_noise, overdispersion
from diagnosis.engine.omnibus import Omnibus, score_tests
from diagnosis.engine.threads import in_threads
from diagnosis.engine.threshold import threshold
from diagnosis.engine.whitening import Filter, filters


@dataclass(frozen=True, eq=False)
class Screening:
    """Scores of m candidates against a fitted model.

    ``inflation`` (m,) is the variance of each score relative to whitened noise. The threshold is for the false-alarm
    rate ``alpha``; it is computed with the random ``seed``.
    """

    candidates: tuple[Candidate, ...]
    projection: Projection
    inflation: Array
    alpha: float
    seed: int

    @cached_property
    def threshold(self) -> float:
        """The limit that the largest score exceeds by chance with probability ``alpha`` (`threshold.py`)."""
        one_sided = np.array([c.effect.one_sided for c in self.candidates], dtype=bool)
        return threshold(self.projection.cosines, one_sided, self.alpha, self.seed)

    @cached_property
    def scatter(self) -> Array:
        """Standard deviations of the scores (m,) if the effects are missing, relative to whitened noise."""
        imitated = np.array([c.imitated / c.amplitude.scale for c in self.candidates])
        return np.sqrt(self.inflation + (imitated * self.projection.norm) ** 2)

    @cached_property
    def z(self) -> Array:
        """Scores (m,): standard normal where the effect is missing; negative where the sign is not physical."""
        return self.projection.z * self._signs / self.scatter

    @cached_property
    def root_information(self) -> Array:
        """Square root of the Fisher information on each amplitude (m,) after the fit of the nuisances. Times an
        amplitude it is the expected score λ.
        """
        scales = np.array([c.amplitude.scale for c in self.candidates])
        return self.projection.norm / scales / self.scatter

    @property
    def amplitude(self) -> Array:
        """The amplitude (m,) estimated from each score, in its own unit."""
        norm = self.projection.norm
        scales = np.array([c.amplitude.scale for c in self.candidates])
        return scales * np.divide(self.projection.z, norm, out=np.zeros_like(norm), where=norm > 0.0)

    def start(self, point: Point, i: int) -> Point:
        """Return a start point for the fit of candidate ``i``: the amplitude from its score, and the other numbers
        adapted to this amplitude.
        """
        candidate = self.candidates[i]
        extended = candidate.added_to(point)
        effect = candidate.effect.amplitude
        inside = candidate.amplitude.to_number(
            float(np.clip(self.amplitude[i], 0.95 * effect.low, 0.95 * effect.high))
        )
        numbers = extended.numbers.copy()
        numbers[: len(point.numbers)] -= inside * self.projection.regression[:, i]
        numbers[len(point.numbers)] = inside
        return extended.at(numbers)

    @property
    def exceeding(self) -> list[int]:
        """Indices of the candidates above the threshold, highest score first. Each effect is listed once, with the best
        point of its grid.
        """
        best: dict[str, int] = {}
        for i in np.argsort(-self.z, kind="stable"):
            if self.z[i] > self.threshold:
                best.setdefault(self.candidates[i].effect.name, int(i))
        return list(best.values())

    def best(self, effect: str) -> int:
        """Return the index of the candidate with the highest score among the grid points of one effect."""
        mine = [i for i, c in enumerate(self.candidates) if c.effect.name == effect]
        return max(mine, key=lambda i: float(self.z[i]))

    @property
    def _signs(self) -> Array:
        return signs([c.effect for c in self.candidates], self.projection.score)


@dataclass(frozen=True, slots=True, eq=False)
class ScreenedModel:
    """A model fitted under its noise, the scores of all candidates, and the test of each surface."""

    model: FittedModel
    screening: Screening
    tests: tuple[Omnibus, ...]


def signs(effects: Sequence[Hypothesis], scores: Array) -> Array:
    """Return ±1 (m,): the physical sign of a one-sided effect, otherwise the sign of the score."""
    physical = [0.0 if not e.one_sided else 1.0 if e.amplitude.low >= 0.0 else -1.0 for e in effects]
    return np.where(np.array(physical) == 0.0, np.where(scores < 0.0, -1.0, 1.0), physical)


def fit_and_screen(
    replay: Replay,
    around: Footprints,
    *,
    alpha: float,
    seed: int,
    steps: int = FIT_STEPS,
    last: bool = False,
) -> ScreenedModel:
    """Estimate the noise from the residual of a model, fit the model under this noise, and score every candidate
    against the fitted model.

    If this is the ``last`` use of the footprints, their memory is released.
    """
    give_back()  # The simulations for the footprints were larger than these.
    count = len(around.candidates)
    noise = leftover_noise(replay, around)
    give_back()  # Free memory between used blocks adds up: it is returned before each of the largest steps.
    whiten = filters(noise, replay.runs)
    workers = replay.workers

    def whitened(r: int) -> Columns:
        white = whiten[r].columns(around.looked_for[r])
        for part in around.looked_for[r] if last else ():
            part.let_go()
        return white

    columns = in_threads(workers, whitened, range(len(whiten)))
    known = _linear(replay, around, whiten)
    give_back()
    model = fit(replay, noise, around.point, known)
    projection = model.linearisation.project(columns, workers)
    inflation = overdispersion(model.linearisation, columns, projection, workers=workers)
    noise = replace(noise, dispersion=float(np.median(inflation)) if len(inflation) else 1.0)
    give_back()
    model = fit(replay, noise, model.point, model.linearisation, steps=steps)
    projection = model.linearisation.project(columns, workers)
    surfaces = replay.simulator.surfaces if around.surface_columns else ()
    return ScreenedModel(
        model,
        Screening(around.candidates, projection.of(slice(count)), inflation[:count], alpha, seed),
        score_tests(model.linearisation, surfaces, columns, projection, count, workers),
    )


def _linear(replay: Replay, around: Footprints, whiten: Sequence[Filter]) -> Linearisation:
    """Return the linearisation of the model, from the footprints of its parameters."""
    residuals = replay.residuals(around.predictions)
    return from_quotients(replay, around.point, whiten, residuals, around.parameter_columns)
