"""Identification: estimate all parameters of a simulator from runs and priors, and predict the accuracy with further
runs.

Theory of operation
-------------------
Identification is the first part of a diagnosis, without effects: the base model is fitted (step 2) with wide priors
under the noise of its residual (step 3). The surfaces of step 7 show the errors of its equations, and the scatter
between runs shows its other errors. Both widen the intervals (`model_error.py`). If the interval of a parameter is much
narrower than its prior, these runs determine the parameter. Otherwise its value is little more than its prior.

The same linear model predicts the accuracy with further runs. The columns of these runs add information to that of the
priors and the existing runs. Their noise is that of the existing runs or of the data sheets.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from diagnosis.contracts import Array, Dataset, Experiment, MeasuredRun, Parameter, Simulator
from diagnosis.engine.base_model import fit_base_model
from diagnosis.engine.config import IDENTIFIED, LEAST_REPEATS, UNKEPT_SURFACE_P, Config
from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.fitting.linear import Prior, prior_of
from diagnosis.engine.fitting.linearise import linearise
from diagnosis.engine.fitting.point import Point, base_point
from diagnosis.engine.fitting.predict import transferred
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.footprints import footprints, with_surfaces
from diagnosis.engine.memory import share_heap
from diagnosis.engine.model_error import widened
from diagnosis.engine.noise import Noise, white
from diagnosis.engine.prior_conflict import contradicted
from diagnosis.engine.runs import measured_channels
from diagnosis.engine.screening import ScreenedModel, fit_and_screen
from diagnosis.engine.simulation import completed
from diagnosis.engine.threads import algebra_on_one_core
from diagnosis.engine.whitening import filters

Progress = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class Identified:
    """A parameter identified from runs: its value and standard deviation, in SI."""

    parameter: Parameter
    value: float
    deviation: float

    @property
    def share(self) -> float:
        """The standard deviation after the runs as a part of that of the prior."""
        return self.deviation / self.parameter.spread

    @property
    def determined(self) -> bool:
        """Whether the runs determine the parameter."""
        return self.share < IDENTIFIED


@dataclass(frozen=True, slots=True, eq=False)
class Identification:
    """A fitted model, and the covariance (k, k) of its numbers. The covariance includes errors of the model.

    ``doubts`` are sentences on contradictions between the data and the assumptions.
    """

    model: FittedModel
    covariance: Array
    doubts: tuple[str, ...] = ()

    @property
    def parameters(self) -> tuple[Identified, ...]:
        """All parameters that the runs share, in the order of the simulator."""
        point = self.model.point
        return tuple(
            Identified(
                c.parameter,
                c.to_value(float(number)),
                c.scale * sqrt(max(float(self.covariance[k, k]), 0.0)),
            )
            for k, (c, number) in enumerate(zip(point.coordinates, point.numbers, strict=True))
            if not c.record
        )

    def joint(self, names: Sequence[str]) -> tuple[Array, Array]:
        """Return values (m,) and covariance (m, m) of the named parameters in SI. They must be shared by all runs and
        not logarithmic.
        """
        coordinates = self.model.point.coordinates
        places = [next(k for k, c in enumerate(coordinates) if c.parameter.name == name) for name in names]
        scales = np.array([coordinates[k].scale for k in places])
        return self.model.point.values()[places], self.covariance[np.ix_(places, places)] * np.outer(
            scales, scales
        )


@algebra_on_one_core
def identify(
    dataset: Dataset,
    simulator: Simulator,
    *,
    seed: int = 1,
    workers: int = 2,
    progress: Progress = lambda _text, _part: None,
) -> Identification:
    """Identify all parameters of a simulator from all runs of a dataset, whatever their roles.

    Raises ``DiagnosisError`` for data that cannot be replayed.
    """
    share_heap()
    data, model = measured_channels(dataset, simulator)
    replay = Replay(model, data.runs, workers)
    progress("fitting all parameters", 0.0)
    point = fit_base_model(replay)
    progress("estimating the noise, and the errors of the model", 0.5)
    around = with_surfaces(replay, footprints(replay, point, ()))
    screened = fit_and_screen(replay, around, alpha=Config().alpha, seed=seed, last=True)
    doubts = (*data.doubts, *contradicted(screened.model), *_of_form(screened))
    return Identification(screened.model, widened(screened.model, screened.tests), doubts)


def _of_form(screened: ScreenedModel) -> Iterator[str]:
    """Yield sentences on contradictions with the model itself, and on intervals that are too narrow."""
    runs = len(screened.model.replay.runs)
    if runs < LEAST_REPEATS:
        yield (
            f"{runs} run{'' if runs == 1 else 's'}: {LEAST_REPEATS} or more would show by their scatter how far errors "
            "of the model and of its inputs go; without that, intervals are too narrow where noise is not all there is"
        )
    if not screened.model.converged:
        yield "the fit did not come to rest: its intervals are not reliable"
    clearest = min(screened.tests, key=lambda test: test.p, default=None)
    if clearest is not None and clearest.p < UNKEPT_SURFACE_P:
        yield (
            f"the model is incomplete: the residual resembles an {clearest.surface.title}; intervals include "
            "this error; run a diagnosis with the identified model to find its cause"
        )


def believed(simulator: Simulator, experiments: Sequence[Experiment], *, workers: int = 2) -> Identification:
    """Return the expected identification from planned ``experiments`` alone, with the sensor noise of the data sheets.

    The values are the nominal ones; only the covariance is of interest.
    """
    blank = Replay(completed(simulator), tuple(_blank(one, simulator) for one in experiments), workers)
    point = base_point(simulator.nuisances, blank.records)
    noise = white([sqrt(c.noise**2 + c.resolution**2 / 12.0) for c in simulator.channels])
    model = _linear(_foreseen(blank, point), noise, point, prior_of(point))
    return Identification(model, widened(model, ()))


def expected(known: Identification, experiments: Sequence[Experiment]) -> Identification:
    """Return the expected identification if ``experiments`` are added to the runs of an existing one."""
    fitted = known.model
    blank = fitted.replay.of(_blank(one, fitted.replay.simulator) for one in experiments)
    point, prior = transferred(fitted, blank, fixed=False)
    model = _linear(_foreseen(blank, point), fitted.noise, point, prior)
    return Identification(model, widened(model, ()))


def _linear(replay: Replay, noise: Noise, point: Point, prior: Prior) -> FittedModel:
    """Return the linear model at a point as a fitted model, for runs whose outputs equal its predictions."""
    predictions = replay.predictions(point)
    whiten = filters(noise, replay.runs)
    linear = linearise(replay, whiten, point, predictions, prior.times(noise.dispersion))
    return FittedModel(replay, noise, linear, tuple(predictions), converged=True)


def _foreseen(replay: Replay, point: Point) -> Replay:
    """Return the runs with the predictions of a model as outputs; NaN where a sample would not count in a record."""
    simulator = replay.simulator
    runs = []
    for run, outputs in zip(replay.runs, replay.predictions(point), strict=True):
        counts = simulator.counted(run.experiment, outputs)
        runs.append(replace(run, outputs=np.where(counts, outputs, np.nan)))
    return replay.of(runs)


def _blank(experiment: Experiment, simulator: Simulator) -> MeasuredRun:
    always = np.ones(experiment.time.size, dtype=bool)
    outputs = np.zeros((experiment.time.size, len(simulator.channels)))
    return MeasuredRun(experiment, outputs, always, ~always)
