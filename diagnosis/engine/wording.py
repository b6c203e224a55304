"""Conversion of causes, rivals and scores to the structures of the finding."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from diagnosis.contracts import Array, Hypothesis
from diagnosis.engine.config import DISTINGUISHED, NO_GAIN
from diagnosis.engine.fitting.point import Point, effect_coordinates
from diagnosis.engine.intervals import intervals
from diagnosis.engine.model_error import widened
from diagnosis.engine.remainder import Remainder
from diagnosis.engine.rivals_unseen import Undecided
from diagnosis.engine.screening import Screening
from diagnosis.engine.search_state import Accepted, SearchResult, Trial
from diagnosis.estimates import estimate, in_words, number
from diagnosis.finding import EXPLAINED, NAMED, SUSPECTED, Cause, Estimate, Rival, Score


def estimates(effect: Hypothesis, point: Point, covariance: Array) -> list[Estimate]:
    """Return the fitted amplitude and shapes of an effect, in display units."""
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
    distinguishing_run: str = "",
) -> Cause:
    """Return an accepted effect as a cause of the finding.

    ``laws`` are other laws of the same phenomenon that cannot be distinguished, and ``distinguishing_run`` is a run
    that separates them. A cause is only suspected if it does not improve the prediction of any unseen run.
    """
    gained = left.gained(effect.name)
    confirmed = (left.role != "fit" and gained >= NO_GAIN) or accepted.lpd_gain > 0.5 * DISTINGUISHED
    return Cause(
        effect=effect.name,
        title=effect.title,
        family=effect.family,
        parameters=parameters,
        strength=number(accepted.lambda_),
        score=number(accepted.score),
        bic_gain=number(accepted.bic_gain),
        lpd_gain=number(accepted.lpd_gain),
        gained=number(gained),
        status=NAMED if confirmed else SUSPECTED,
        equation=effect.equation,
        source=effect.source,
        plain=effect.plain,
        phenomenon=effect.phenomenon,
        laws=list(laws),
        separated_by=distinguishing_run,
    )


def laws(
    found: SearchResult, effects: Mapping[str, Hypothesis], instead_of: str, trials: Sequence[Trial]
) -> list[Rival]:
    """Return other laws of one phenomenon as rivals of the finding, from their fits in place of the cause
    ``instead_of``.
    """
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
    """Return the other effects that explain the data, or predict unseen runs, as well as an accepted cause."""
    found_rivals = [
        (a.effect, r.effect, "", estimates(effects[r.effect], r.point, r.covariance), r.bic - found.model.bic)
        for a, r in found.ambiguous(gap)
    ]
    found_rivals += [
        (
            one.instead_of,
            one.effect,
            " alone" if one.both_present else "",
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
        for cause_, effect, alone, parameters, worse in found_rivals
    ]


def scores(found: SearchResult, beside: Screening) -> list[Score]:
    """Return the score of every effect against the base model, and its result in the search.

    ``beside`` are the scores against the final model.
    """
    first = found.steps[0].screening
    gates = {trial.effect: trial.failed for step in reversed(found.steps) for trial in step.trials}
    last = {trial.effect: trial.failed for trial in reversed(found.steps[-1].trials)}
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
            outcome = _still_scores(name, beside, last.get(name, ""))
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
                    f"{in_words(p.name)} = {v / p.scale:.4g} {p.display or p.unit}".removesuffix(" 1")
                    for p, v in zip(candidate.effect.shapes, candidate.shapes, strict=True)
                ),
                outcome=outcome,
            )
        )
    return sorted(rows, key=lambda score: -(score.score or 0.0))


def _still_scores(name: str, beside: Screening, why: str) -> str:
    """Return the outcome of an effect whose score exceeded the threshold against the base model.

    ``why`` is the reason for which the last step rejected the effect; "" if there is none.
    """
    if all(candidate.effect.name != name for candidate in beside.candidates):
        return "an accepted cause explains more"
    score = float(beside.z[beside.best(name)])
    if score <= beside.threshold:
        return EXPLAINED
    present = (
        f"may still be present (score in the final model: {score:.2f}, its threshold: {beside.threshold:.2f})"
    )
    return f"{why}. It {present}" if why else f"it {present}"


def _cosine(found: SearchResult, first: str, second: str) -> float | None:
    screening = found.steps[0].screening
    places = {c.effect.name for c in screening.candidates}
    if not {first, second} <= places:
        return None
    return number(abs(float(screening.projection.cosines[screening.best(first), screening.best(second)])))
