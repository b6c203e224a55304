"""The finding: the result of a diagnosis with its evidence, as JSON for people and programs.

Numbers are in the unit that is stored with them; only ``models`` is in SI. Unknown values are null, because JSON has no
NaN.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Final

import msgspec

from diagnosis.contracts import DataQuality, DiagnosisError

#: Status of a cause: *named* if it improves the prediction of runs that nothing was fitted to.
NAMED: Final = "named"
SUSPECTED: Final = "suspected"
#: Outcome of an effect whose score an accepted cause explains.
EXPLAINED: Final = "below the threshold in the final model"


class Verdict(StrEnum):
    """The possible verdicts. A diagnosis is never forced to name a cause."""

    NO_EFFECT = "no effect"
    NAMED = "named"
    AMBIGUOUS = "ambiguous"
    UNRESOLVED = "unresolved"
    UNKNOWN = "unknown"
    DOUBTFUL = "data in doubt"  #: no effect was found, in data that are in doubt
    REMAINDER = "named + unexplained remainder"


class Estimate(msgspec.Struct, frozen=True, kw_only=True):
    """A fitted number with its standard deviation and its 95 % interval from ``low`` to ``high``.

    A number that the samples do not resolve has only an upper bound, ``below``.
    """

    name: str
    unit: str
    value: float | None
    sd: float | None
    low: float | None
    high: float | None
    below: float | None = None


class Cause(msgspec.Struct, frozen=True, kw_only=True):
    """A named effect that explains an error of the base model.

    ``strength`` is λ, the norm of its footprint in standard deviations of the noise after a refit of the base model.
    ``score`` is z. ``bic_gain`` (fit runs) and ``lpd_gain`` (log predictive density of the validation runs) state how
    much the effect improves the model. ``gained`` is the part of the explainable squared error that it removes on
    unseen runs, over all channels. If there are ``laws``, only the ``phenomenon`` is certain; the cause is then its
    simplest sufficient law. ``status`` is *named*, or *suspected* if it does not improve the prediction of any unseen
    run.
    """

    effect: str
    title: str
    family: str
    parameters: list[Estimate]
    strength: float | None
    score: float | None
    bic_gain: float | None
    lpd_gain: float | None
    gained: float | None = None
    equation: str = ""
    source: str = ""
    plain: str = ""  #: consequence, a clause without full stop; "": the title is enough
    phenomenon: str = ""  #: the phenomenon; "": no other law of it in the catalogue
    laws: list[Rival] = []  #: others of the phenomenon that these runs cannot separate from it
    separated_by: str = ""  #: what would distinguish them; "" if nothing must be distinguished
    status: str = NAMED


class Rival(msgspec.Struct, frozen=True, kw_only=True):
    """An effect that explains the data as well as a cause. ``bic_gap`` is its BIC minus that of the cause, usually
    below 10.

    The gap may exceed 10 if the model error exceeds the noise and the rival predicts unseen runs equally well.
    """

    effect: str
    title: str
    family: str
    instead_of: str
    parameters: list[Estimate]
    bic_gap: float | None
    cosine: float | None


class Suspect(msgspec.Struct, frozen=True, kw_only=True):
    """A likely candidate if no cause is named. ``why`` completes the sentence "it is a candidate, but …".

    ``strength`` is λ in the model from which the effect was removed; null if it was never in a model.
    """

    effect: str
    title: str
    family: str
    parameters: list[Estimate]
    strength: float | None
    why: str


class Score(msgspec.Struct, frozen=True, kw_only=True):
    """The score z of one candidate against the base model, at the best point of its shape grid.

    ``strength`` is the λ estimated from the score, before overdispersion reduces z. ``outcome`` is the result in the
    search: below the threshold, accepted, or the gate that it failed.
    """

    effect: str
    title: str
    family: str
    score: float | None
    strength: float | None
    shape: str = ""
    outcome: str = ""


class Gain(msgspec.Struct, frozen=True, kw_only=True):
    """The improvement by the extended model in one channel on the test runs, without another fit. ``channel`` may be
    "all".

    ``floor`` is the RMS of the noise alone, ``noise_ratio`` the RMSE after over the floor. ``fraction`` is the removed
    part of the explainable error, (RMSE0² − RMSE1²)/(RMSE0² − floor²), with its 95 % interval.
    """

    channel: str
    unit: str
    rmse_before: float | None
    rmse_after: float | None
    floor: float | None
    nrmse_before: float | None
    nrmse_after: float | None
    noise_ratio_before: float | None
    noise_ratio: float | None
    fraction: float | None
    fraction_low: float | None
    fraction_high: float | None


class CheckPrediction(msgspec.Struct, frozen=True, kw_only=True):
    """A figure of a test plan: predicted by the stock, tuned and extended models, and measured if an unseen run
    contains it.

    The ``stock`` model has its nominal parameters, the ``tuned`` one is the best base model. ``uncertainty`` is half of
    the 95 % interval of ``extended``. Without a ``run`` the figure is for a planned experiment.
    """

    name: str
    unit: str
    stock: float | None
    tuned: float | None
    extended: float | None
    uncertainty: float | None
    measured: float | None = None
    run: str = ""

    @property
    def differs(self) -> bool:
        """Whether the tuned and the extended model differ by more than the uncertainty of the prediction."""
        if self.tuned is None or self.extended is None or self.uncertainty is None:
            return False
        return abs(self.extended - self.tuned) > self.uncertainty


class Coverage(msgspec.Struct, frozen=True, kw_only=True):
    """The share of samples of the test runs whose error is within the noise band of a nominal ``level``, before and
    after.
    """

    level: float
    before: float | None
    after: float | None


class Trace(msgspec.Struct, frozen=True, kw_only=True):
    """Measured values, and the values predicted before and after, in one channel of a test run.

    ``times`` to ``after`` show in detail the part of the run with the largest errors before. ``error_times`` to
    ``error_after`` show the extremes of the error over the whole run.
    """

    run: str
    channel: str
    unit: str
    times: list[float]
    measured: list[float | None]
    before: list[float | None]
    after: list[float | None]
    error_times: list[float]
    error_before: list[float | None]
    error_after: list[float | None]
    noise: float | None


class Unseen(msgspec.Struct, frozen=True, kw_only=True):
    """The detection limit of an effect that was not found: the size that is found in 95 % of cases.

    ``smallest`` is null if these runs do not show the effect at any allowed size, or if the residual exceeds the noise.
    ``hidden_by`` names the parameter or accepted effect that imitates most of its footprint.
    """

    effect: str
    title: str
    family: str
    unit: str
    smallest: float | None
    visible: float | None
    hidden_by: str
    sentence: str


class Pair(msgspec.Struct, frozen=True, kw_only=True):
    """Two effects, and whether the fit runs distinguish them: the predicted BIC gap is λ²(1 − cosine²)."""

    first: str
    second: str
    cosine: float | None
    bic_gap: float | None
    separable: bool


class Confusability(msgspec.Struct, frozen=True, kw_only=True):
    """Cosines between the footprints of effects after a refit of the base model: 1 means the same footprint."""

    effects: list[str]
    cosines: list[list[float | None]]
    pairs: list[Pair] = []


class NextRun(msgspec.Struct, frozen=True, kw_only=True):
    """A run that the rig could do, and how well it separates the rivals: predicted BIC gap, and gap per minute."""

    experiment: str
    minutes: float
    bic_gap: float | None
    per_minute: float | None
    pair: str = ""


class NextSensor(msgspec.Struct, frozen=True, kw_only=True):
    """A parameter whose calibration would separate rivals, and the BIC gap that results from it."""

    name: str
    bic_gap: float | None
    sentence: str


class Shift(msgspec.Struct, frozen=True, kw_only=True):
    """A parameter of the base model, fitted without the causes (``before``) and with them (``after``).

    ``sigmas`` is the shift in standard deviations of the fit without the causes. It shows how wrong that uncertainty
    was.
    """

    name: str
    unit: str
    before: float | None
    after: float | None
    sd_before: float | None
    sd_after: float | None
    sigmas: float | None
    run: str = ""


class Imitation(msgspec.Struct, frozen=True, kw_only=True):
    """A parameter of the base model that imitates a missing cause: near its prior with the causes, far from it without
    them.

    ``expected`` and ``sd`` describe the prior. ``before`` and ``after`` are the values fitted without and with the
    causes. ``sigmas`` and ``sigmas_after`` are their distances from ``expected`` in units of ``sd``.
    """

    name: str
    unit: str
    before: float
    after: float
    expected: float
    sd: float
    sigmas: float
    sigmas_after: float
    run: str = ""


class Summary(msgspec.Struct, frozen=True, kw_only=True):
    """The first screen: the error and its size, its certainty, the evidence, and the next steps."""

    wrong: str
    sure: str
    evidence: str
    next: str


class Series(msgspec.Struct, frozen=True, kw_only=True):
    """Points of a figure: ``x``, ``y``, and ``z`` for a map."""

    name: str
    x: list[float | None]
    y: list[float | None]
    z: list[float | None] = []


class Figure(msgspec.Struct, frozen=True, kw_only=True):
    """The figure of a test: bars, points, lines, or a map of z over x and y; ``limit`` is the limit of chance."""

    kind: str
    x_label: str
    y_label: str
    series: list[Series]
    z_label: str = ""
    limit: float | None = None
    logarithmic: bool = False


class PanelRow(msgspec.Struct, frozen=True, kw_only=True):
    """One test of the errors of the base model. It shows an error and its place, but no cause.

    ``p`` is the probability of an equally large statistic if the model is right; ``q`` is p corrected for all tests of
    the panel (Benjamini and Hochberg). If a test does not apply, ``sentence`` states the reason.
    """

    test: str
    title: str
    run: str
    channel: str
    statistic: float | None
    p: float | None
    sentence: str
    points_to: str
    q: float | None = None
    significant: bool = False
    figure: Figure | None = None


class Region(msgspec.Struct, frozen=True, kw_only=True):
    """The range of one coordinate in which an unknown term acts, and the range that the runs covered."""

    coordinate: str
    low: float | None
    high: float | None
    visited_low: float | None
    visited_high: float | None


class Nearest(msgspec.Struct, frozen=True, kw_only=True):
    """A named effect, and the similarity of its footprint to that of an unknown term."""

    effect: str
    cosine: float | None


class Unknown(msgspec.Struct, frozen=True, kw_only=True):
    """A term without a name, fitted as a surface because no named effect explains the residual.

    It is no cause, and is valid only inside the range that the runs covered. ``kept`` is True if it improves the
    prediction of the validation runs.
    """

    surface: str
    title: str
    statistic: float | None
    freedom: int
    p: float | None
    kept: bool
    lpd_gain: float | None
    regions: list[Region]
    nearest: list[Nearest]
    sentence: str
    figure: Figure | None = None


class Models(msgspec.Struct, frozen=True, kw_only=True):
    """The models before and after, with SI values: parameters that all runs share, parameters of each run, and effects.

    Report runs are among the runs. Parts of one record are one run, under the name of the record.
    """

    before: dict[str, float]
    after: dict[str, float]
    effects: dict[str, dict[str, float]] = {}
    before_runs: dict[str, dict[str, float]] = {}
    after_runs: dict[str, dict[str, float]] = {}


class Provenance(msgspec.Struct, frozen=True, kw_only=True):
    """The information needed to reproduce the finding."""

    simulator: str
    identity: str = ""  #: which file the simulator is, where it is one
    seed: int
    fit: list[str]
    select: list[str]
    report: list[str]
    digest: str = ""
    sources: list[str] = []
    versions: dict[str, str] = {}
    config: dict[str, float | int | str | bool | list[str] | None] = {}


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """All results of a diagnosis. ``quality`` holds the results of the data checks.

    ``suspects`` are the best candidates if no cause is named. By chance the largest score exceeds ``threshold`` with
    probability ``alpha``. ``remains``, ``doubts`` and ``readings`` are sentences: on unexplained errors; on data or
    priors that cannot be right (printed before the verdict); on how files were read. ``imitations``, the largest first,
    are parameters by which the base model imitates the causes. ``checks`` are predicted figures of plans. ``summary``
    is None in findings of earlier versions.
    """

    verdict: Verdict
    sentence: str
    causes: list[Cause]
    threshold: float
    alpha: float
    provenance: Provenance
    models: Models
    ambiguous_with: list[Rival] = []
    suspects: list[Suspect] = []
    scores: list[Score] = []
    gains: list[Gain] = []
    coverage: list[Coverage] = []
    not_seen: list[Unseen] = []
    next_runs: list[NextRun] = []
    next_sensors: list[NextSensor] = []
    shifts: list[Shift] = []
    panel: list[PanelRow] = []
    confusability: Confusability | None = None
    unknowns: list[Unknown] = []
    remains: list[str] = []
    traces: list[Trace] = []
    doubts: list[str] = []
    readings: list[str] = []
    quality: list[DataQuality] = []
    imitations: list[Imitation] = []
    checks: list[CheckPrediction] = []
    summary: Summary | None = None

    def __post_init__(self) -> None:
        named = self.verdict in {Verdict.NAMED, Verdict.REMAINDER, Verdict.AMBIGUOUS}
        if named and not self.causes:
            raise DiagnosisError(f"the verdict is {self.verdict.value!r}, but no cause is given")
        if self.causes and self.verdict in {Verdict.NO_EFFECT, Verdict.DOUBTFUL}:
            raise DiagnosisError(f"the verdict is {self.verdict.value!r}, but causes are given: {self.names}")
        if self.suspects and self.verdict is not Verdict.UNRESOLVED:
            raise DiagnosisError(f"the verdict is {self.verdict.value!r}, but suspects are given")
        if (self.verdict is Verdict.AMBIGUOUS) != bool(self.ambiguous_with):
            raise DiagnosisError(
                f"the verdict is {self.verdict.value!r}, but the number of rival causes is {len(self.ambiguous_with)}"
            )

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the causes, in the order of acceptance."""
        return tuple(cause.effect for cause in self.causes)

    @property
    def suspected(self) -> bool:
        """Whether there are causes, and all of them are only suspected."""
        return bool(self.causes) and all(cause.status == SUSPECTED for cause in self.causes)

    @property
    def first_screen(self) -> Summary:
        """The summary. Findings of earlier versions have none; for these it holds only ``sentence``."""
        return self.summary or Summary(wrong=self.sentence, sure="", evidence="", next="")

    def to_json(self) -> bytes:
        """Return the finding as indented JSON. Equal findings give equal bytes."""
        return msgspec.json.format(msgspec.json.encode(self), indent=1) + b"\n"

    @staticmethod
    def from_json(data: bytes) -> Finding:
        """Return the finding that ``to_json`` wrote. Raises ``DiagnosisError`` for other data."""
        try:
            return msgspec.json.decode(data, type=Finding)
        except (msgspec.MsgspecError, UnicodeError, RecursionError) as error:
            raise DiagnosisError(
                f"this is not a finding of a diagnosis: {error}; use a finding.json"
            ) from error
