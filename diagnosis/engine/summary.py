"""The first screen of a finding: the error, its certainty, the evidence, and the next steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, repeat
from types import MappingProxyType
from typing import Final

from msgspec.structs import replace

from diagnosis.contracts import Hypothesis, Role
from diagnosis.engine.config import GAINS_LITTLE
from diagnosis.engine.remainder import Remainder
from diagnosis.engine.screening import Screening
from diagnosis.estimates import Z95, decimals, in_words, percent, with_unit
from diagnosis.finding import (
    NAMED,
    SUSPECTED,
    Cause,
    Estimate,
    Finding,
    Imitation,
    Rival,
    Summary,
    Suspect,
    Verdict,
)

_CAUSES: Final = "{causes}. The model does not contain {this}.{imitated}"
WRONG: Final = MappingProxyType(
    {
        Verdict.NO_EFFECT: "These runs do not contradict the model.",
        Verdict.DOUBTFUL: "Some data are doubtful. The other data do not contradict the model.",
        Verdict.NAMED: _CAUSES,
        Verdict.AMBIGUOUS: f"Possible cause: {_CAUSES}",
        Verdict.UNRESOLVED: "The model has an error, but no candidate passes every test.",
        Verdict.UNKNOWN: "The model has an error that no known effect explains. {unknown}",
        Verdict.REMAINDER: f"{_CAUSES} The model also has another error. Its cause is not known. {{unknown}}",
    }
)
#: Certainty of a verdict without causes.
CAUSELESS: Final = MappingProxyType(
    {
        Verdict.NO_EFFECT: "An effect that is too small for these runs may still exist.",
        Verdict.DOUBTFUL: "Faults of the data may hide an effect.",
        Verdict.UNKNOWN: "The fitted function describes the error only in the stated range. It does not name a cause.",
    }
)
#: The part to inspect for a cause, by its family.
WHERE: Final = MappingProxyType(
    {
        "rubber": "the rubber parts (type, age, mounting)",
        "gas": "chambers, bellows and their connections (tightness, volume, temperature)",
        "flow": "orifice, pipes and valves (dirt, wear, adjustment)",
        "friction": "seals and guides (preload, lubrication, wear)",
        "sensor": "the sensors (zero, calibration, mounting)",
        "acquisition": "converters, gateways and clocks of the data acquisition",
        "rig": "frame, supports and actuators (mounting, alignment)",
        "leak": "the chamber, its seals and fittings (tightness)",
        "heat": "the gas and the walls (temperatures, waiting time after filling)",
        "lubrication": "seals and guides (lubrication)",
        "geometry": "the bore (shape), and hoses and cables that can pull (stiffness)",
        "drive": "spindle and bearings of the drive (alignment)",
    }
)
ROLES: Final[Mapping[Role, str]] = MappingProxyType(
    {
        "report": "On the test runs (not used for the fit)",
        "select": "On the validation runs (used to select the causes)",
        "fit": "On the fit runs",
    }
)
#: Names of the runs of each role.
TESTING: Final[Mapping[Role, str]] = MappingProxyType(
    {"report": "test runs", "select": "validation runs", "fit": "fit runs"}
)
#: Load cases, with the explanation that follows them in a text.
LOADS: Final = MappingProxyType({"AW0": "AW0 (empty car)", "AW3": "AW3 (full car)"})
#: The name of an amplitude that is a delay.
DELAY: Final = "delay"


@dataclass(frozen=True, slots=True)
class Conclusions:
    """Results for the summary that are not in the finding.

    ``accepted`` holds all accepted effects, even if no cause is named and they are only candidates. ``also`` describes
    further effects that may be present. ``misfit`` is the clearest error above the noise if no candidate fits.
    ``differing`` describes how the verdict by the test runs differs from that by the validation runs.
    """

    accepted: Sequence[Cause]
    left: Remainder
    hypotheses: Mapping[str, Hypothesis] = field(default_factory=dict)
    also: str = ""
    misfit: str = ""
    differing: str = ""


def summarised(finding: Finding, beside: Conclusions) -> Finding:
    """Return the finding with its summary, and with a short sentence that has neither figures of channels nor
    advice.
    """
    wrong, sure, error = _wrong(finding), _sentences(_sure(finding, beside)), _error(beside.left, finding)
    return replace(
        finding,
        sentence=_sentences(
            [wrong, sure, error if finding.causes or finding.unknowns or beside.left.large else ""]
        ),
        summary=Summary(
            wrong=wrong,
            sure=sure,
            evidence=_sentences([error, _shown_by(finding), _in_checks(finding)]),
            next=_next_step(finding, beside),
        ),
    )


def further(screening: Screening) -> str:
    """Return a sentence on other effects with a score above the threshold; "" if there are none."""
    first, *others = [*screening.exceeding, None]
    if first is None:
        return ""
    title, count = _begun(screening.candidates[first].effect.title), len(others) - 1
    more = f" and {count} other effect{'s' if count > 1 else ''}" if count else ""
    return f"{title}{more} may also be present (see Open points in the report)."


def _sentences(parts: Sequence[str]) -> str:
    return " ".join(part.strip() for part in parts if part)


def _wrong(found: Finding) -> str:
    text = WRONG[found.verdict].format(
        causes=_claims(found.causes),
        this="these effects" if len(found.causes) > 1 else "this effect",
        imitated=_imitated(found.imitations, many=len(found.causes) > 1) if found.causes else "",
        unknown=" ".join(u.sentence for u in found.unknowns if u.kept),
    )
    return text.strip()


def _claims(causes: Sequence[Cause]) -> str:
    """Return the named causes as text, then the suspected ones."""
    named, suspected = (
        " and ".join(_claimed(one) for one in causes if one.status == status) for status in (NAMED, SUSPECTED)
    )
    return _begun("; ".join(part for part in (named, suspected and f"suspected: {suspected}") if part))


def _claimed(one: Cause) -> str:
    """Return a cause with its size as text; only the name of the phenomenon if its law is not known."""
    return f"there is {one.phenomenon}" if one.laws else f"{_plain(one)} ({_size(one.parameters)})"


def _imitated(imitations: Sequence[Imitation], *, many: bool) -> str:
    """Return sentences on a base parameter: the value that it would need without the causes, and its expected value. ""
    without any.
    """
    if not imitations:
        return ""
    one = imitations[0]
    return (
        f" Without {'these causes' if many else 'this cause'}, the model needs an improbable value to fit the data: "
        f"{in_words(one.name)} = {with_unit(one.before, one.unit, 4)}. The expected value is {_prior(one)}."
    )


def _prior(one: Imitation) -> str:
    return f"{one.expected:.4g} ± {with_unit(Z95 * one.sd, one.unit, 2)} (95 % interval)"


def _sure(found: Finding, beside: Conclusions) -> list[str]:
    if found.verdict is Verdict.UNRESOLVED:
        return [_nearest(beside.accepted, found.suspects), beside.misfit, beside.differing]
    causes = found.causes
    if not causes:
        return [CAUSELESS[found.verdict]]
    return [
        *map(_which_law, causes),
        _suspected(found, beside.left),
        _alternatives(found),
        _late_together(causes),
        *(_worth(one) for one in causes if one.status == NAMED),
        beside.also,
        beside.differing,
    ]


def _alternatives(found: Finding) -> str:
    titles = {c.effect: c.title for c in found.causes}
    laws = {(c.effect, law.effect) for c in found.causes for law in c.laws}
    rivals = [r for r in found.ambiguous_with if (r.instead_of, r.effect) not in laws]
    if not rivals:
        return "" if laws else "No other tested cause explains these runs equally well."
    instead: dict[str, list[str]] = {}
    for one in rivals:
        instead.setdefault(titles.get(one.instead_of, one.instead_of), []).append(one.title)
    return _sentences(
        [
            f"Instead of {title}, {len(names)} other effects explain the data equally well: {'; '.join(names)}."
            if names[1:]
            else f"Instead of {title}, {names[0]} explains the data equally well."
            for title, names in instead.items()
        ]
    )


def _suspected(found: Finding, left: Remainder) -> str:
    """Return why causes are suspected and not named; "" if all are named."""
    some = [one for one in found.causes if one.status == SUSPECTED]
    if not some:
        return ""
    names = " and ".join(one.title for one in some)
    what = "The cause is" if len(found.causes) == 1 else f"{_begun(names)} {'are' if some[1:] else 'is'}"
    if left.role == "fit":
        return f"{what} only suspected, because no run was reserved for a test."
    text = (
        f"{what} only suspected, because the prediction of the {TESTING[left.role]} does not clearly improve."
    )
    if found.imitations:
        name = in_words(found.imitations[0].name)
        text += f" Another value of {name} has the same effect as this cause. Only its expected value contradicts this."
    return text


def _which_law(one: Cause) -> str:
    """Return the laws that these runs cannot distinguish, and a run that can; "" if the law is known."""
    if not one.laws:
        return ""
    laws = " or ".join([_with_size(one), *map(_with_size, one.laws)])
    would = f" {_run('This run distinguishes them', one.separated_by)}" if one.separated_by else ""
    return f"These runs cannot distinguish several laws of {one.phenomenon}: {laws}.{would}"


def _run(label: str, text: str) -> str:
    """Return sentences that describe a run and what to look for in it. ``text`` is `Cause.separated_by`."""
    run, _, sign = text.partition(": ")
    return f"{label}: {run}.{f' Look for: {sign}.' if sign else ''}"


def _late_together(causes: Sequence[Cause]) -> str:
    """Return a sentence that several delays may have one common reason; "" if their intervals do not overlap."""
    delays = [one.parameters[0] for one in causes if one.parameters[0].name == DELAY]
    low, high = (
        [end for end in ends if end is not None]
        for ends in ([one.low for one in delays], [one.high for one in delays])
    )
    if len(delays) < 2 or len(low) < len(delays) or len(high) < len(delays) or max(low) > min(high):
        return ""
    late = f"{0.5 * (max(low) + min(high)):.{decimals(max(low), min(high))}f} {delays[0].unit}"
    return (
        f"All of these are late by the same {late}. The reason may be a common part, such as their device or its "
        "clock, or inputs of the simulation that are early."
    )


def _nearest(causes: Sequence[Cause], suspects: Sequence[Suspect]) -> str:
    """Return sentences on the best candidates, for a finding without a named cause."""
    if causes:
        names = " and ".join(_with_size(c) for c in causes)
        many = len(causes) > 1
        return (
            f"The best {'candidates are' if many else 'candidate is'} {names}, but most of the error remains. "
            "The cause may be a similar effect that was not tested."
        )
    places = chain(["best"], repeat("next"))
    return _sentences(
        [
            f"{_begun(_with_size(one))} is the {place} candidate, but {one.why}."
            for place, one in zip(places, suspects, strict=False)
        ]
    )


def _worth(one: Cause) -> str:
    """Return a sentence on a cause that explains little of the error on unseen runs; otherwise ""."""
    if one.gained is None or one.gained >= GAINS_LITTLE:
        return ""
    if one.gained <= 0.0:
        return f"{_begun(one.title)} does not improve the prediction of the test runs."
    return f"{_begun(one.title)} explains only {percent(one.gained)} of the error on the test runs."


def _error(left: Remainder, found: Finding) -> str:
    """Return a sentence on the ratio of error to noise, before and after the causes are added; "" if it is not
    known.
    """
    if not left.after > 0.0:
        return ""
    change = f"the error falls from {left.before:.3g} to {left.after:.3g} times the noise"
    if left.after > 1.005 * left.before and (found.causes or found.unknowns):
        change = f"the error rises from {left.before:.3g} to {left.after:.3g} times the noise"
    elif left.after > 0.995 * left.before:
        verb = "stays at" if found.causes or found.unknowns else "is"
        change = f"the error {verb} {left.after:.3g} times the noise"
    return f"{ROLES[left.role]}, {change}.{' The model does not explain all of the error.' if left.large else ''}"


def _shown_by(found: Finding) -> str:
    """Return a sentence with the number that shows the causes best: the error of the worst channel, or a parameter
    that imitates them.
    """
    if not found.causes and not found.unknowns:
        return ""
    without, _ = _models(found)
    having = f"with {'them' if len(found.models.effects) > 1 else 'it'}"
    seen = [one for one in found.gains[1:] if one.fraction is not None]
    if seen and not found.suspected:
        one = max(seen, key=lambda gain: gain.noise_ratio_before or 0.0)
        before, after, floor = (
            with_unit(value or 0.0, one.unit, 3) for value in (one.rmse_before, one.rmse_after, one.floor)
        )
        error = f"{before} {without}, {after} {having} (noise: {floor})"
        return f"The clearest error is that of {one.channel}: {error}."
    if not found.imitations:
        return ""
    number = found.imitations[0]
    before, after = (with_unit(value, number.unit, 4) for value in (number.before, number.after))
    name = in_words(number.name)
    return (
        f"{_begun(without)}, the fitted {name} is {before}, {having} {after}. Expected is {_prior(number)}."
    )


def _in_checks(found: Finding) -> str:
    """Return sentences on the figure of a plan in which tuned and extended model differ most; "" if none differs
    clearly.
    """
    differing = [one for one in found.checks if one.differs]
    if not differing or not found.models.effects:
        return ""
    measured = [one for one in differing if one.measured is not None]
    one = max(measured or differing, key=lambda each: abs((each.extended or 0.0) / (each.tuned or 1.0) - 1.0))
    numbers = [value or 0.0 for value in (one.extended, one.uncertainty, one.tuned, one.stock, one.measured)]
    places = decimals(-numbers[1], numbers[1])
    extended, half, tuned, stock, read = (f"{value:.{places}f}" for value in numbers)
    kind = {"kN/m": "stiffness ", "kN*s/m": "damping "}.get(one.unit, "")
    seen = f" The measured value in {one.run} is {read}." if one.measured is not None else ""
    without, having = _models(found)
    name = one.name
    for load, car in LOADS.items():
        name = name.replace(load, car)
    return (
        f"The model {having} predicts {extended} ± {half} {one.unit} (95 % interval) for the {kind}{name}. "
        f"The model {without} predicts {tuned} after its fit to the data, and {stock} before.{seen}"
    )


def _models(found: Finding) -> tuple[str, str]:
    """Return the texts for the model without the causes of a finding, and for the model with them."""
    what = "the causes" if len(found.models.effects) > 1 else "the cause"
    return f"without {what}", f"with {what}"


def _next_step(found: Finding, beside: Conclusions) -> str:
    if found.verdict is Verdict.DOUBTFUL:
        return "Correct the doubtful data, and repeat the diagnosis."
    if found.verdict is Verdict.NO_EFFECT:
        return "No inspection is necessary. The report lists the smallest detectable size of each effect."
    names = [
        *(one.effect for one in beside.accepted),
        *(one.effect for one in found.ambiguous_with),
        *(one.effect for one in found.suspects),
    ] or [unknown.nearest[0].effect for unknown in found.unknowns if unknown.nearest]
    effects = [beside.hypotheses[name] for name in names if name in beside.hypotheses]
    if not effects:
        return "Add the effect that you expect to the catalogue, and repeat the diagnosis."
    places = dict.fromkeys(WHERE[one.family] for one in effects if one.family in WHERE)
    others = dict.fromkeys(one.title for one in effects if one.family not in WHERE)
    parts = [f"General advice for such causes: inspect {'; '.join(places)}."] if places else []
    parts += [f"Search for: {'; '.join(others)}."] if others else []
    tests = [one.separated_by for one in effects if one.separated_by]
    if found.next_runs:
        parts.append(_run("Make this run next", found.next_runs[0].experiment))
    elif found.next_sensors:
        parts.append(f"{_begun(found.next_sensors[0].sentence.rstrip('.'))}.")
    elif tests:
        parts.append(_run(_why_this_run(found), tests[0]))
    return _sentences(parts)


def _why_this_run(found: Finding) -> str:
    """Return the beginning of the sentence on a run that distinguishes the first cause from similar effects."""
    clear = found.causes and found.verdict is not Verdict.AMBIGUOUS and not found.suspected
    if not clear or any(one.laws for one in found.causes):
        return "Make this run next"
    what = f'"{found.causes[0].title}"' if found.causes[1:] else "the cause"
    return f"To confirm {what}, measure (if the data do not contain such a run)"


def _with_size(one: Cause | Rival | Suspect) -> str:
    return f"{one.title} ({_size(one.parameters)})"


def _plain(one: Cause) -> str:
    """Return the consequence of a cause as a clause."""
    return one.plain or f"there is {one.title}"


def _begun(text: str) -> str:
    return text[:1].upper() + text[1:]


def _size(parameters: Sequence[Estimate]) -> str:
    first = parameters[0]
    name, unit = in_words(first.name), "" if first.unit == "1" else f" {first.unit}"
    if first.below is not None:
        return f"{name} below {first.below:.2g}{unit}"
    if first.value is None:
        return f"{name} unknown"
    if first.low is None or first.high is None:
        return f"{name}: {first.value:.4g}{unit}"
    half, places = 0.5 * (first.high - first.low), decimals(first.low, first.high)
    if abs(first.value - first.low - half) > 0.1 * half:  # a valley that bends, or a range that ends
        ends = f"{first.low:.{places}f} to {first.high:.{places}f}"
        return f"{name}: {first.value:.{places}f}{unit}, 95 % interval: {ends}{unit}"
    return f"{name}: {first.value:.{places}f} ± {half:.{places}f}{unit}, 95 % interval"
