"""Step 6: the state of the search for causes, from the problem to the result.

`Problem` is the question and never changes. Every hypothesis is compared with `CurrentModel`, which is replaced
whenever an effect enters or leaves. `Trial` is the result of fitting one more model. `SearchState` is passed between
the passes of the search; `SearchResult` is the final result.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from diagnosis.contracts import Array, Hypothesis, MeasuredRun
from diagnosis.engine.config import Config
from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.fitting.point import Point
from diagnosis.engine.fitting.predict import Prediction
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.footprints import Footprints
from diagnosis.engine.screening import Screening


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """The search problem: simulator on the fit runs, validation runs, hypotheses by name, and thresholds."""

    replay: Replay
    select: tuple[MeasuredRun, ...]
    hypotheses: Mapping[str, Hypothesis]
    config: Config


@dataclass(frozen=True, slots=True, eq=False)
class CurrentModel:
    """The base model with the accepted effects, fitted under its own noise, and the scores of all other effects.

    ``prediction`` is that of the validation runs; None if there are none. ``explained_chi2`` is the penalised χ² that
    the accepted effects have explained so far.
    """

    model: FittedModel
    screening: Screening
    footprints: Footprints
    prediction: Prediction | None
    explained_chi2: float = 0.0

    @property
    def effects(self) -> tuple[str, ...]:
        """The accepted effects, in the order of their entry."""
        return self.model.effects


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """The result of fitting a model with ``effect`` in it. ``failed`` is the reason why it failed a gate; "" if it
    passed all.
    """

    effect: str
    point: Point
    covariance: Array  #: of the point's numbers (k, k)
    penalised_chi2: float
    bic: float  #: with the surcharge of a richer member of a family
    lpd: float  #: of the validation runs; NaN where there are none, or where a better trial made it needless
    failed: str = ""
    physical: bool = True
    rough: bool = False  #: it failed only by the possible error of earlier causes


@dataclass(frozen=True, slots=True, eq=False)
class ForwardStep:
    """One forward step: the effects in the model, the scores of all others, and the trials of those above the
    threshold.
    """

    effects: tuple[str, ...]
    screening: Screening
    trials: tuple[Trial, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SearchState:
    """The state of the search, which each pass receives and returns."""

    current: CurrentModel
    floors: Array  #: (c,) standard deviation left by noise alone in each channel
    steps: tuple[ForwardStep, ...] = ()
    #: Where each effect was last fitted in a forward step: a later fit of it starts there.
    last_fit: Mapping[str, Point] = field(default_factory=dict)
    #: Other effects that explained a good part when an accepted one entered, best first; they may replace it.
    alternatives: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    #: Physical models with another effect instead of an accepted one, best first, under the present noise.
    rivals: Mapping[str, tuple[Trial, ...]] = field(default_factory=dict)
    #: Why effects left the model again after they had entered.
    left: Mapping[str, str] = field(default_factory=dict)
    #: Effects in the model when they left it.
    beside: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    #: Effects that entered by the test at finite sizes.
    finite: frozenset[str] = frozenset()

    def after(self, trials: tuple[Trial, ...]) -> SearchState:
        """Return the state after the trials of a forward step."""
        return replace(
            self,
            steps=(*self.steps, ForwardStep(self.current.effects, self.current.screening, trials)),
            last_fit={**self.last_fit, **{trial.effect: trial.point for trial in trials}},
        )

    def with_further(self, trials: tuple[Trial, ...]) -> SearchState:
        """Return the state with further trials of its last forward step."""
        *before, last = self.steps
        return replace(
            self,
            steps=(*before, replace(last, trials=(*last.trials, *trials))),
            last_fit={**self.last_fit, **{trial.effect: trial.point for trial in trials}},
        )

    def without_columns(self) -> SearchState:
        """Return the state without the columns of all candidates, which are large and not needed for trials."""
        bare = self.current.footprints.without_columns()
        return replace(self, current=replace(self.current, footprints=bare))


@dataclass(frozen=True, slots=True, eq=False)
class Accepted:
    """An accepted effect: its score z, its λ, how much it improves the model, and its rivals."""

    effect: str
    score: float
    lambda_: float
    bic_gain: float
    lpd_gain: float  #: NaN where there are no validation runs
    rivals: tuple[Trial, ...]  #: physical models with another effect in its place, best first

    @property
    def explained(self) -> float:
        """The χ² that the effect explains on the fit runs and the validation runs. Without validation runs their part
        is 0.
        """
        # NaN counts as none: it is never the larger one.
        return self.lambda_**2 + max(0.0, 2.0 * self.lpd_gain)

    def near(self, bic: float, gap: float) -> list[Trial]:
        """Return the rivals with a BIC below ``bic`` + ``gap``; ``bic`` is that of the model with this effect."""
        return [trial for trial in self.rivals if trial.bic - bic < gap]


@dataclass(frozen=True, slots=True, eq=False)
class SearchResult:
    """The result of the search: its last state, and the accepted effects.

    ``without`` holds for each accepted effect the model without it.
    """

    state: SearchState
    accepted: tuple[Accepted, ...]
    without: Mapping[str, FittedModel]

    @property
    def steps(self) -> tuple[ForwardStep, ...]:
        """The forward steps. In the first one the model has no effects."""
        return self.state.steps

    @property
    def model(self) -> FittedModel:
        """The base model with the accepted effects."""
        return self.state.current.model

    @property
    def floors(self) -> Array:
        """The standard deviation (c,) of the noise alone in each channel."""
        return self.state.floors

    def without_footprints(self) -> SearchResult:
        """Return the result without the columns of all candidates, which are large."""
        return replace(self, state=self.state.without_columns())

    def ambiguous(self, gap: float) -> list[tuple[Accepted, Trial]]:
        """Return pairs of an accepted effect and a rival whose BIC is within ``gap``."""
        return [(a, r) for a in self.accepted for r in a.near(self.model.bic, gap)]
