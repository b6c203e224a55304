"""Steps 6 to 8 again: test a removed cause without the causes that replaced it.

Theory of operation
-------------------
Causes that imitate each other can remove each other. For example, a friction explains nearly everything. A lag and a
viscous friction enter in addition, and the friction becomes superfluous and is removed. Then the lag and the viscous
friction fail a gate themselves. The result is worse than the friction alone, which a diagnosis with fewer candidates
would find. More candidates must not give a poorer model.

So each cause that was removed while others were in the model is fitted alone, as when it was a candidate. If one
predicts the validation runs clearly better than the final model, the search is repeated without the effects that were
in the model at its removal, and without all other removed effects. The final model is compared without its surfaces,
because a named cause has priority over a surface.

One cause may also replace two: a clock error replaces delays of all signals that it times. The delays are removed, and
one of them still scores at the end. Then the search is repeated without the cause in the final model which is most
similar to the removed one.

The result of the second search is tested with the whole catalogue. It is kept if it still predicts the validation runs
clearly better and its error on the fit runs is not larger. If two causes replace one, no other effect may score,
because with a large residual any model with more parameters fits a little better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from diagnosis.contracts import Array, MeasuredRun
from diagnosis.engine.backward import weigh
from diagnosis.engine.base_model import without_effects
from diagnosis.engine.best_base import noise_ratio
from diagnosis.engine.config import PREDICTS_AS_WELL
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.point import effect_coordinates
from diagnosis.engine.fitting.predict import predict
from diagnosis.engine.search import search
from diagnosis.engine.search_state import Problem, SearchResult
from diagnosis.engine.trials import current_model
from diagnosis.engine.verdict import Judgement, judge

INSTEAD: Final = "the model without it predicts the validation runs better"


def without_substitutes(problem: Problem, first: Judgement) -> Judgement:
    """Return a judgement in which a removed cause is restored in place of its substitutes, if this is better; otherwise
    ``first``.
    """
    if not problem.select:
        return first
    out = _substitutes(problem, first)
    one_for_two = set() if out else _in_the_place_of(first)
    out = out or one_for_two
    if not out:
        return first
    narrower = replace(problem, hypotheses={k: v for k, v in problem.hypotheses.items() if k not in out})
    found = search(narrower)
    if not found.accepted:
        return first
    second = judge(problem, _restored(problem, first, found, out))
    before, after = ((one.screened.model, one.found.floors) for one in (first, second))
    better = PREDICTS_AS_WELL * _error(*after, problem.select) < _error(*before, problem.select)
    if first.found.accepted:  # an effect that predicts better by chance explains less
        better = better and _error(*after, problem.replay.runs) <= _error(*before, problem.replay.runs)
    if one_for_two:
        better = better and not second.screened.screening.exceeding
    return second if better and second.found.accepted else first


def _substitutes(problem: Problem, first: Judgement) -> set[str]:
    """Return the effects to remove from the search, if one removed cause alone predicts better than the judgement;
    usually none.
    """
    cause = _best_single_cause(problem, first)
    state = first.found.state
    return {*state.left, *state.beside[cause], *first.found.model.effects} - {cause} if cause else set()


def _in_the_place_of(first: Judgement) -> set[str]:
    """Return the accepted effect that may have displaced a removed one, or none. The removed effect scores above the
    threshold at the end, and the accepted one was in the model when it was removed. Of several such pairs the one with
    the most similar footprints is used.
    """
    state, screening = first.found.state, first.screened.screening
    scoring = [screening.candidates[i].effect.name for i in screening.exceeding]
    initial = first.found.steps[0].screening
    similarity = {
        (stayed, gone): abs(float(initial.projection.cosines[initial.best(stayed), initial.best(gone)]))
        for gone in scoring
        for stayed in state.beside.get(gone, ())
        if stayed in first.found.model.effects
    }
    return {max(similarity, key=similarity.__getitem__)[0]} if similarity else set()


def _best_single_cause(problem: Problem, first: Judgement) -> str:
    """Return the removed cause that alone predicts the validation runs best; "" if the judgement is better."""
    state, model, floors = first.found.state, first.screened.model, first.found.floors
    errors = {}
    left = (one for one, others in state.beside.items() if others and one not in model.effects)
    for name in (one for one in left if one in state.last_fit):
        fitted, coordinates = (
            state.last_fit[name].effects()[name],
            effect_coordinates(problem.hypotheses[name]),
        )
        start = without_effects(model.point).extended(
            coordinates, [fitted[c.parameter.name] for c in coordinates]
        )
        alone = fit(model.replay, model.noise, start, model.linearisation)
        errors[name] = _error(alone, floors, problem.select)
    best = min(errors, key=errors.__getitem__, default="")
    return best if best and PREDICTS_AS_WELL * errors[best] < _error(model, floors, problem.select) else ""


def _error(model: FittedModel, floors: Array, runs: Sequence[MeasuredRun]) -> float:
    """Return the ratio of error to noise of a fitted model on ``runs``."""
    return noise_ratio(predict(model, runs, fixed=True), floors)


def _restored(problem: Problem, first: Judgement, found: SearchResult, out: set[str]) -> SearchResult:
    """Return the result of a search without the effects ``out``, after scores and gates are computed again with all
    effects.
    """
    left = {name: first.found.state.left.get(name, INSTEAD) for name in out}
    state = replace(
        found.state,
        current=current_model(problem, found.model.point, found.state.current.explained_chi2),
        steps=(*first.found.steps[:1], *found.steps),
        left={**left, **found.state.left},
    )
    return weigh(problem, state)
