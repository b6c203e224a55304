"""The judge compares a finding with what was hidden, which it reads after the diagnosis."""

from collections.abc import Sequence
from statistics import NormalDist
from typing import Final

import msgspec

from astb_studies.benchmarks.diagnosis.ground_truth import GroundTruth
from astb_studies.benchmarks.diagnosis.next_of_kin import kin
from diagnosis.contracts import Simulator
from diagnosis.engine.laws import alike_laws
from diagnosis.estimates import Z95
from diagnosis.finding import Estimate, Finding, Verdict

#: From this λ on, what is hidden must be seen.
CLEAR: Final = 10.0
#: No honest interval is missed by so many standard deviations.
FAR: Final = 4.5
#: Levels of the intervals that are checked.
LEVELS: Final = (0.5, 0.8, 0.9, 0.95)


class Judged(msgspec.Struct, frozen=True, kw_only=True):
    """One case: what was hidden, what was said, and how right that was.

    ``weakest`` and ``strongest`` are the least and the largest λ of what was hidden, on the bench in the noise of the
    case; ``apart`` is what next of kin leave of the least one. ``laws`` are others of the phenomenon of a cause, from
    which the finding does not report it. ``errors`` are those of the amplitudes of rightly named causes,
    relative to the truth; ``deviations`` the same in standard deviations as the finding reports them, ``base`` those of
    the parameters of the base model, ``fraction`` and ``noise_ratio`` the gain on the report runs.
    """

    system: str
    seed: int
    kind: str
    condition: str
    weakest: float
    apart: float = 0.0
    hidden: list[str]
    verdict: str
    causes: list[str]
    rivals: list[str]
    suspects: list[str] = []
    laws: list[str] = []
    strongest: float = 0.0
    near: list[str] = []
    errors: list[float] = []
    deviations: list[float] = []
    base: list[float] = []
    fraction: float | None = None
    noise_ratio: float | None = None
    elapsed: float = 0.0
    failure: str = ""  #: why there is no finding: the case counts as neither right nor wrong, and is told

    @property
    def detected(self) -> bool:
        """Whether anything was seen."""
        return self.verdict != Verdict.NO_EFFECT.value

    @property
    def exact(self) -> bool:
        """Whether exactly what was hidden was named, and nothing else was left possible."""
        return sorted(self.causes) == sorted(self.hidden) and not self.rivals and not self.laws

    @property
    def in_family(self) -> bool:
        """Whether what was hidden is among the laws of a phenomenon that is named, of which none is told plainly."""
        told = {*self.causes, *self.rivals, *self.laws}
        open_ = bool(self.rivals or self.laws)
        return open_ and set(self.hidden) <= told <= {*self.hidden, *self.near}

    @property
    def wrong_law(self) -> bool:
        """Whether a next of kin of what was hidden is told plainly in its place."""
        return bool(set(self.causes) & set(self.near)) and not set(self.hidden) <= {
            *self.causes,
            *self.rivals,
            *self.laws,
        }

    @property
    def reported(self) -> bool:
        """Whether all that was hidden is in the finding: as a cause, what may be one instead, or as a suspect."""
        return set(self.hidden) <= {*self.causes, *self.rivals, *self.suspects, *self.laws}

    @property
    def wrong(self) -> list[str]:
        """Causes that are named, are not there, and for which the finding offers no right one instead.

        Next of kin of what is hidden do not count: one relaxation time instead of two is no lie about the cause.
        """
        free = {*self.rivals, *self.laws} & set(self.hidden)
        strange = [c for c in self.causes if c not in self.hidden and c not in self.near]
        return [] if free and len(strange) <= len(free) else strange

    @property
    def amiss(self) -> str:
        """What is wrong with the finding, in a few words; "" if nothing."""
        said = f"{self.verdict}: {', '.join(self.causes)}" if self.causes else self.verdict
        if self.rivals:
            said += f" or {', '.join(self.rivals)}"
        if self.laws:
            said += f", as one law of several with {', '.join(self.laws)}"
        if self.suspects:
            said += f", near: {', '.join(self.suspects)}"
        if self.failure:
            return f"no finding: {self.failure}"
        if self.kind == "null":
            # Of a sibling it is right to see something: it is not the bench of the model.
            wrong = self.causes if self.condition == "sibling" else self.detected
            return f"false alarm: {said}" if wrong else ""
        if self.wrong:
            return f"wrong cause: {said}"
        far = [d for d in self.deviations if abs(d) > FAR]
        missed = f"{said}, off by {far[0]:.3g} standard deviations" if far else ""
        if self.condition == "sibling":
            return missed  # a form that is not that of the model may cost the name
        if self.weakest < CLEAR:
            return ""
        if not self.detected:
            return "not seen"
        if self.kind != "outside" and not self.reported:
            return f"not reported: {said}"
        return missed


def judge(
    finding: Finding, truth: GroundTruth, simulator: Simulator, *, system: str, elapsed: float = 0.0
) -> Judged:
    """Compare a finding with the truth."""
    right = [cause for cause in finding.causes if cause.effect in truth.effects]
    errors, deviations = [], []
    for cause in right:
        parameter = simulator.catalogue[cause.effect].amplitude
        told = next(one for one in cause.parameters if one.name == parameter.name)
        value = truth.effects[cause.effect][parameter.name] / parameter.scale
        if told.value is not None:
            errors.append(told.value / value - 1.0)
        deviations += _deviation(told, value)
    scales = {nuisance.name: nuisance.scale for nuisance in simulator.nuisances}
    base = [
        (shift.after - truth.base[shift.name] / scales[shift.name]) / shift.sd_after
        for shift in finding.shifts
        if shift.name in truth.base and not shift.run and shift.after is not None and shift.sd_after
    ]
    total = next((gain for gain in finding.gains if gain.channel == "all"), None)
    hidden = _hidden(truth, system, elapsed)
    laws = (one for name in truth.effects for one in alike_laws(simulator.catalogue, name))
    return msgspec.structs.replace(
        hidden,
        near=sorted({*hidden.near, *laws} - set(hidden.hidden)),
        verdict=finding.verdict.value,
        causes=list(finding.names),
        rivals=[rival.effect for rival in finding.ambiguous_with],
        suspects=[suspect.effect for suspect in finding.suspects],
        laws=[law.effect for cause in finding.causes for law in cause.laws],
        errors=errors,
        deviations=deviations,
        base=base,
        fraction=total.fraction if total else None,
        noise_ratio=total.noise_ratio if total else None,
    )


def failed(truth: GroundTruth, why: str, *, system: str, elapsed: float = 0.0) -> Judged:
    """Return the case that came to no finding."""
    return msgspec.structs.replace(_hidden(truth, system, elapsed), failure=why)


def _hidden(truth: GroundTruth, system: str, elapsed: float) -> Judged:
    """Return a case of which nothing has been said yet; the table of the bench does not hold for other systems."""
    sizes = (truth.seen if system == "bench" else truth.lambdas).values()
    weakest = min(sizes, default=0.0)
    return Judged(
        system=system,
        seed=truth.seed,
        kind=truth.kind,
        condition=truth.condition,
        weakest=weakest,
        apart=truth.apart if system == "bench" else weakest,
        hidden=[*truth.effects, *truth.outside],
        verdict="",
        causes=[],
        rivals=[],
        strongest=max(sizes, default=0.0),
        near=sorted(other for name in truth.effects for other in kin(name)),
        elapsed=elapsed,
    )


def covered(deviations: Sequence[float], level: float) -> int:
    """How many of the deviations lie within the interval of a level."""
    half = NormalDist().inv_cdf(0.5 + 0.5 * level)
    return sum(abs(one) <= half for one in deviations)


def _deviation(told: Estimate, value: float) -> list[float]:
    """Return how far a truth is from what was told of it, in units in which its 95 % interval ends at 1.96."""
    if told.value is None or told.low is None or told.high is None:
        return []
    half = told.high - told.value if value > told.value else told.value - told.low
    return [Z95 * (told.value - value) / half] if half > 0.0 else []
