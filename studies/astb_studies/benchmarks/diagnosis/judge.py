"""The judge compares a finding with the hidden effects, which it reads after the diagnosis."""

from collections.abc import Sequence
from statistics import NormalDist
from typing import Final

import msgspec

from astb_studies.benchmarks.diagnosis.ground_truth import GroundTruth
from astb_studies.benchmarks.diagnosis.next_of_kin import kin
from diagnosis.contracts import Simulator
from diagnosis.engine.equivalence_classes import alike_laws
from diagnosis.estimates import Z95
from diagnosis.finding import Estimate, Finding, Verdict

#: From this λ on, a hidden effect must be detected.
CLEAR: Final = 10.0
#: An error of more standard deviations than this counts as a wrong interval.
FAR: Final = 4.5
#: Levels of the intervals that are checked.
LEVELS: Final = (0.5, 0.8, 0.9, 0.95)


class Judged(msgspec.Struct, frozen=True, kw_only=True):
    """One case: the hidden effects, the finding, and its errors.

    ``weakest`` and ``strongest`` are the least and the largest λ of the hidden effects, on the bench in the noise of
    the case. ``apart`` is the part of the least λ that similar effects cannot imitate. ``laws`` are other laws of the
    phenomenon of a cause, which the finding does not distinguish from it. ``errors`` are errors of the amplitudes of
    correctly named causes, relative to the truth; ``deviations`` are the same errors in reported standard deviations.
    ``base`` has the errors of the parameters of the base model. ``fraction`` and ``noise_ratio`` are the gain on the
    test runs.
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
    failure: str = ""  #: why there is no finding: the case is listed, and counts as neither right nor wrong

    @property
    def detected(self) -> bool:
        """Whether an effect was detected."""
        return self.verdict != Verdict.NO_EFFECT.value

    @property
    def exact(self) -> bool:
        """Whether exactly the hidden effects were named, with no other possible cause."""
        return sorted(self.causes) == sorted(self.hidden) and not self.rivals and not self.laws

    @property
    def in_family(self) -> bool:
        """Whether the finding names a phenomenon that includes the hidden effects, but leaves its law open."""
        named = {*self.causes, *self.rivals, *self.laws}
        open_ = bool(self.rivals or self.laws)
        return open_ and set(self.hidden) <= named <= {*self.hidden, *self.near}

    @property
    def wrong_law(self) -> bool:
        """Whether the finding names a similar effect instead of the hidden one, without naming the hidden one."""
        return bool(set(self.causes) & set(self.near)) and not set(self.hidden) <= {
            *self.causes,
            *self.rivals,
            *self.laws,
        }

    @property
    def reported(self) -> bool:
        """Whether the finding includes all hidden effects: as a cause, an alternative cause, or a suspect."""
        return set(self.hidden) <= {*self.causes, *self.rivals, *self.suspects, *self.laws}

    @property
    def wrong(self) -> list[str]:
        """Named causes that are not hidden, and for which the finding offers no right alternative.

        Effects similar to a hidden one do not count: one relaxation time instead of two is not a wrong cause.
        """
        free = {*self.rivals, *self.laws} & set(self.hidden)
        strange = [c for c in self.causes if c not in self.hidden and c not in self.near]
        return [] if free and len(strange) <= len(free) else strange

    @property
    def amiss(self) -> str:
        """The error of the finding in a few words; "" if there is none."""
        finding = f"{self.verdict}: {', '.join(self.causes)}" if self.causes else self.verdict
        if self.rivals:
            finding += f" or {', '.join(self.rivals)}"
        if self.laws:
            finding += f", as one law of several with {', '.join(self.laws)}"
        if self.suspects:
            finding += f", near: {', '.join(self.suspects)}"
        if self.failure:
            return f"no finding: {self.failure}"
        if self.kind == "null":
            # A detection on a sibling is right, because its form differs from the model.
            wrong = self.causes if self.condition == "sibling" else self.detected
            return f"false alarm: {finding}" if wrong else ""
        if self.wrong:
            return f"wrong cause: {finding}"
        far = [d for d in self.deviations if abs(d) > FAR]
        missed = f"{finding}, off by {far[0]:.3g} standard deviations" if far else ""
        if self.condition == "sibling":
            return missed  # a form that is not that of the model may cost the name
        if self.weakest < CLEAR:
            return ""
        if not self.detected:
            return "not seen"
        if self.kind != "outside" and not self.reported:
            return f"not reported: {finding}"
        return missed


def judge(
    finding: Finding, truth: GroundTruth, simulator: Simulator, *, system: str, elapsed: float = 0.0
) -> Judged:
    """Compare a finding with the truth."""
    right = [cause for cause in finding.causes if cause.effect in truth.effects]
    errors, deviations = [], []
    for cause in right:
        parameter = simulator.catalogue[cause.effect].amplitude
        estimate = next(one for one in cause.parameters if one.name == parameter.name)
        value = truth.effects[cause.effect][parameter.name] / parameter.scale
        if estimate.value is not None:
            errors.append(estimate.value / value - 1.0)
        deviations += _deviation(estimate, value)
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


def failed(truth: GroundTruth, reason: str, *, system: str, elapsed: float = 0.0) -> Judged:
    """Return the case without a finding."""
    return msgspec.structs.replace(_hidden(truth, system, elapsed), failure=reason)


def _hidden(truth: GroundTruth, system: str, elapsed: float) -> Judged:
    """Return a case before its diagnosis; the λ table of the bench is not valid for other systems."""
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
    """Return the number of deviations within the interval of a level."""
    half = NormalDist().inv_cdf(0.5 + 0.5 * level)
    return sum(abs(one) <= half for one in deviations)


def _deviation(estimate: Estimate, value: float) -> list[float]:
    """Return the error of an estimate, scaled so that the end of its 95 % interval is 1.96."""
    if estimate.value is None or estimate.low is None or estimate.high is None:
        return []
    half = estimate.high - estimate.value if value > estimate.value else estimate.value - estimate.low
    return [Z95 * (estimate.value - value) / half] if half > 0.0 else []
