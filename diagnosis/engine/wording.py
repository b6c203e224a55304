"""Causes, rivals and scores as the finding has them, and the sentence on top of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain, repeat
from typing import Final

import numpy as np

from diagnosis.contracts import Array, Hypothesis
from diagnosis.engine.config import GAINS_LITTLE, GAINS_NOTHING
from diagnosis.engine.fitting.point import Point, effect_coordinates
from diagnosis.engine.intervals import intervals
from diagnosis.engine.model_error import widened
from diagnosis.engine.remainder import Remainder
from diagnosis.engine.screening import Screening
from diagnosis.engine.search_state import Accepted, SearchResult, Trial
from diagnosis.engine.undecided import Undecided
from diagnosis.finding import (
    Cause,
    Estimate,
    Rival,
    Score,
    Suspect,
    Unknown,
    Verdict,
    decimals,
    estimate,
    number,
)

SENTENCES: Final = {
    Verdict.NO_EFFECT: "Nothing was found in these runs that contradicts the simulation.",
    Verdict.DOUBTFUL: "These data do not show whether the simulation is right: they are in doubt. In what is left of "
    "them, no contradiction was found.",
    Verdict.NAMED: "{causes}, which the model did not have.",
    Verdict.AMBIGUOUS: "{causes}, which the model did not have; {rivals} would explain these runs as well.",
    Verdict.UNRESOLVED: "The simulation is wrong somewhere, but no cause passes every test. {near}",
    Verdict.UNKNOWN: "The simulation is wrong in a way that no known cause explains. {unknown}",
    Verdict.REMAINDER: "{causes}, which the model did not have; something else is wrong as well and was not "
    "identified. {unknown}",
}

#: The amplitude of what arrives late by a time.
DELAY: Final = "delay"


def estimates(effect: Hypothesis, point: Point, covariance: Array) -> list[Estimate]:
    """Return amplitude and shapes of an effect where a fit ended, in the units that people read."""
    values = point.values()
    found = []
    for coordinate in effect_coordinates(effect):
        i = point.place(coordinate)
        deviation = float(np.sqrt(max(covariance[i, i], 0.0))) * coordinate.scale
        found.append(estimate(coordinate.parameter, float(values[i]), deviation))
    return found


def cause(
    accepted: Accepted,
    effect: Hypothesis,
    parameters: list[Estimate],
    left: Remainder,
    laws: Sequence[Rival] = (),
    would_tell: str = "",
) -> Cause:
    """Return an accepted effect as the finding has it.

    ``laws`` are others of its phenomenon that it is not told from, ``would_tell`` the run that would.
    """
    return Cause(
        effect=effect.name,
        title=effect.title,
        family=effect.family,
        parameters=parameters,
        strength=number(accepted.lambda_),
        score=number(accepted.score),
        bic_gain=number(accepted.bic_gain),
        lpd_gain=number(accepted.lpd_gain),
        gained=number(left.gained(effect.name)),
        equation=effect.equation,
        source=effect.source,
        plain=effect.plain,
        phenomenon=effect.phenomenon,
        laws=list(laws),
        separated_by=would_tell,
    )


def laws(
    found: SearchResult, effects: Mapping[str, Hypothesis], instead_of: str, trials: Sequence[Trial]
) -> list[Rival]:
    """Return laws of one phenomenon as the finding has them, from their fits in the place of a cause."""
    return [
        Rival(
            effect=trial.effect,
            title=effects[trial.effect].title,
            family=effects[trial.effect].family,
            instead_of=instead_of,
            parameters=estimates(effects[trial.effect], trial.point, trial.covariance),
            bic_gap=number(trial.bic - found.model.bic),
            cosine=_cosine(found, instead_of, trial.effect),
        )
        for trial in trials
    ]


def rivals(
    found: SearchResult, effects: Mapping[str, Hypothesis], gap: float, alike: Sequence[Undecided] = ()
) -> list[Rival]:
    """Return which other effects explain the data, or predict unseen runs, as well as a cause does."""
    told = [
        (a.effect, r.effect, "", estimates(effects[r.effect], r.point, r.covariance), r.bic - found.model.bic)
        for a, r in found.ambiguous(gap)
    ]
    told += [
        (
            one.instead_of,
            one.effect,
            " alone" if one.alone else "",
            intervals(effects[one.effect], one.model, widened(one.model, ())),
            one.bic_gap,
        )
        for one in alike
    ]
    return [
        Rival(
            effect=effect,
            title=f"{effects[effect].title}{alone}",
            family=effects[effect].family,
            instead_of=cause_,
            parameters=parameters,
            bic_gap=number(worse),
            cosine=_cosine(found, cause_, effect),
        )
        for cause_, effect, alone, parameters, worse in told
    ]


def scores(found: SearchResult) -> list[Score]:
    """Return the score of every effect against the base model, and what became of it."""
    first = found.steps[0].screening
    gates = {trial.effect: trial.failed for step in reversed(found.steps) for trial in step.trials}
    accepted = [a.effect for a in found.accepted]
    rows = []
    for name in dict.fromkeys(c.effect.name for c in first.candidates):
        i = first.best(name)
        candidate = first.candidates[i]
        if name in accepted:
            outcome = "accepted"
        elif reason := found.state.left.get(name) or gates.get(name):
            outcome = reason
        elif first.z[i] > first.threshold:
            outcome = "another candidate explains it better"
        else:
            outcome = "below the threshold"
        rows.append(
            Score(
                effect=name,
                title=candidate.effect.title,
                family=candidate.effect.family,
                score=number(float(first.z[i])),
                strength=number(float(abs(first.projection.z[i]))),
                shape=", ".join(
                    f"{p.name} = {v / p.scale:.4g} {p.display or p.unit}"
                    for p, v in zip(candidate.effect.shapes, candidate.shapes, strict=True)
                ),
                outcome=outcome,
            )
        )
    return sorted(rows, key=lambda score: -(score.score or 0.0))


def sentence(
    verdict: Verdict,
    causes: Sequence[Cause],
    others: Sequence[Rival],
    suspects: Sequence[Suspect],
    unknowns: Sequence[Unknown],
    left: Remainder,
    also: str = "",
) -> str:
    """Say the verdict in a few sentences, for whoever reads nothing else: what it is, what it gains, what is left.

    ``also`` is what may be there beside the named causes.
    """
    titles = {c.effect: c.title for c in causes}
    others = [r for r in others if r.effect not in _laws_of(causes, r.instead_of)]
    if verdict is Verdict.AMBIGUOUS and causes and not others:
        verdict = Verdict.NAMED  # The phenomenon is, and of its laws the next sentence tells.
    said = SENTENCES[verdict].format(
        causes=_begun(" and ".join(map(_claimed, causes))),
        rivals=" or ".join(
            f"{_with_size(r)} instead of {titles.get(r.instead_of, r.instead_of)}" for r in others
        ),
        unknown=" ".join(u.sentence for u in unknowns),
        near=_nearest(causes, suspects),
    )
    parts = [said.strip()]
    if verdict is not Verdict.UNRESOLVED:
        parts += [_which_law(one, alone=len(causes) == 1) for one in causes]
        parts.append(_late_together(causes))
    if causes or unknowns or left.large:
        parts.append(_gained(left))
    if verdict is not Verdict.UNRESOLVED:
        parts += [_worth(one) for one in causes]
        parts += [also] if causes else []
    return " ".join(part for part in parts if part)


def _laws_of(causes: Sequence[Cause], name: str) -> set[str]:
    return {law.effect for one in causes if one.effect == name for law in one.laws}


def _claimed(one: Cause) -> str:
    """Say what is claimed: the cause with its size, or the phenomenon alone where its law is not told."""
    return f"there is {one.phenomenon}" if one.laws else f"{_plain(one)} ({_size(one.parameters)})"


def _which_law(one: Cause, *, alone: bool) -> str:
    """Say between which laws these runs do not tell, and what would; "" where one law is told."""
    if not one.laws:
        return ""
    told = " or ".join([_with_size(one), *map(_with_size, one.laws)])
    of = "it" if alone else one.phenomenon
    would = f" What would tell: {one.separated_by}." if one.separated_by else ""
    return f"Which law {of} follows these runs do not tell: {told}.{would}"


def _late_together(causes: Sequence[Cause]) -> str:
    """Say of several delays that they are one; "" where their intervals have nothing in common."""
    delays = [one.parameters[0] for one in causes if one.parameters[0].name == DELAY]
    low, high = (
        [end for end in ends if end is not None]
        for ends in ([one.low for one in delays], [one.high for one in delays])
    )
    if len(delays) < 2 or len(low) < len(delays) or len(high) < len(delays) or max(low) > min(high):
        return ""
    late = f"{0.5 * (max(low) + min(high)):.{decimals(max(low), min(high))}f} {delays[0].unit}"
    return (
        f"All of these are late by the same {late}: what they have in common may be late, such as their device or its "
        "clock, or what drives the simulation may be ahead of them."
    )


def _with_size(one: Cause | Rival) -> str:
    return f"{one.title} ({_size(one.parameters)})"


def _plain(one: Cause) -> str:
    """Say what is so: a part of a sentence."""
    return one.plain or f"there is {one.title}"


def _begun(text: str) -> str:
    return text[:1].upper() + text[1:]


def _nearest(causes: Sequence[Cause], suspects: Sequence[Suspect]) -> str:
    """Say which candidates are best where nothing is named: one similar to the cause, or what does not pass a test."""
    if causes:
        names = " and ".join(f"{c.title} ({_size(c.parameters)})" for c in causes)
        many = len(causes) > 1
        return (
            f"The best {'candidates are' if many else 'candidate is'} {names}, but most of the error remains: the "
            f"cause may be an effect similar to {'these' if many else 'it'} that was not looked for."
        )
    told = []
    for place, one in zip(chain(["best"], repeat("next")), suspects, strict=False):
        title = _begun(one.title)
        told.append(f"{title} ({_size(one.parameters)}) is the {place} candidate, but {one.why}.")
    return " ".join(told)


def _gained(left: Remainder) -> str:
    """Say how large the error was and is, in words, where that is worth a sentence."""
    if not left.after > 0.0:
        return ""
    what = {
        "report": "On unseen runs",
        "select": "On the runs used for selection",
        "fit": "On the runs used for fitting",
    }[left.role]
    change = f"the error falls from {left.before:.3g} to {left.after:.3g} times the noise"
    if left.after > 0.995 * left.before:
        change = f"the error stays at {left.after:.3g} times the noise"
    return f"{what}, {change}{': not every cause of it was found' if left.large else ''}."


def further(screening: Screening) -> str:
    """Say what else still has a score above the threshold; "" if nothing has."""
    first, *others = [*screening.exceeding, None]
    if first is None:
        return ""
    more = f", and {len(others) - 1} more" if len(others) > 1 else ""
    return (
        f"{_begun(screening.candidates[first].effect.title)}{more} may be there as well: its score of "
        f"{screening.z[first]:.1f} is above the threshold of {screening.threshold:.1f}."
    )


def _worth(one: Cause) -> str:
    """Say of a cause that it explains nothing, or little, of the error on unseen runs; "" if it does."""
    if one.gained is None or one.gained >= GAINS_LITTLE:
        return ""
    title = _begun(one.title)
    if one.gained < GAINS_NOTHING:
        return f"{title} does not reduce it noticeably."
    return f"{title} explains only {100.0 * one.gained:.2g} % of it."


def _size(parameters: Sequence[Estimate]) -> str:
    first = parameters[0]
    unit = "" if first.unit == "1" else f" {first.unit}"
    if first.below is not None:
        return f"below {first.below:.2g}{unit}"
    if first.value is None:
        return f"{first.name} unknown"
    if first.low is None or first.high is None:
        return f"{first.value:.4g}{unit}"
    half = 0.5 * (first.high - first.low)
    if abs(first.value - first.low - half) > 0.1 * half:  # a valley that bends, or a range that ends
        return f"{first.value:.4g}{unit}, 95 %: {first.low:.3g} to {first.high:.3g}"
    places = decimals(first.low, first.high)
    return f"{first.value:.{places}f} ± {half:.{places}f}{unit}"


def _cosine(found: SearchResult, first: str, second: str) -> float | None:
    screening = found.steps[0].screening
    places = {c.effect.name for c in screening.candidates}
    if not {first, second} <= places:
        return None
    return number(abs(float(screening.projection.cosines[screening.best(first), screening.best(second)])))
