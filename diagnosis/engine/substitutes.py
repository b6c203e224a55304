"""Steps 6 to 8, once more: a cause that left for others is tried without those others.

Theory of operation
-------------------
Causes that can replace each other are thrown out by each other: a friction explains nearly all, a lag and a viscous
friction enter together with it and take its place, it leaves as superfluous, and then they fail a gate themselves. The
result is worse than the friction alone, which a diagnosis with a shorter list would have found. A longer list of
candidates must not give a poorer model.

So each cause that left while others were in the model is fitted alone, as it was fitted when it was a candidate. Where
one predicts the select runs clearly better than all that was named in the end, the search is repeated without those
that were in the model when it left, and without all others that left. A name comes before a surface: predictions of the
surface do not count.

One cause may also represent two: a clock that is behind for delays of all that it times. These then leave together with
it, and one of them still scores in the end. Then the search is repeated without that cause in the final model which is
most like the one that left together with it.

The result of the second search is weighed and judged with the whole catalogue, and stays if it still predicts the
select runs clearly better and leaves no more of the error in the runs that it was fitted to. Two instead of one must
leave nothing that scores: where much remains, whatever has more parameters imitates a little more of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from diagnosis.contracts import Array, MeasuredRun
from diagnosis.engine.backward import weigh
from diagnosis.engine.base_model import without_effects
from diagnosis.engine.before import noise_ratio
from diagnosis.engine.config import PREDICTS_AS_WELL
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.point import effect_coordinates
from diagnosis.engine.fitting.predict import predict
from diagnosis.engine.search import search
from diagnosis.engine.search_state import Problem, SearchResult
from diagnosis.engine.trials import current_model
from diagnosis.engine.verdict import Judgement, judge

INSTEAD: Final = "the model without it predicts the select runs better"


def without_substitutes(problem: Problem, first: Judgement) -> Judgement:
    """Return a judgement, or a better one of what left for others."""
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
    if first.found.accepted:  # what predicts better by chance explains less
        better = better and _error(*after, problem.replay.runs) <= _error(*before, problem.replay.runs)
    if one_for_two:
        better = better and not second.screened.screening.exceeding
    return second if better and second.found.accepted else first


def _substitutes(problem: Problem, first: Judgement) -> set[str]:
    """Return the effects present when a cause left that alone predicts better than the judgement; mostly none."""
    cause = _best_single_cause(problem, first)
    state = first.found.state
    return {*state.left, *state.beside[cause], *first.found.model.effects} - {cause} if cause else set()


def _in_the_place_of(first: Judgement) -> set[str]:
    """Return the accepted effect most similar to one which left with it and still scores; mostly none."""
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
    """Return the removed cause that alone predicts the select runs best, if better than the judgement."""
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
    """Return the error over the noise of a model, as it was fitted, on some runs."""
    return noise_ratio(predict(model, runs, fixed=True), floors)


def _restored(problem: Problem, first: Judgement, found: SearchResult, out: set[str]) -> SearchResult:
    """Return the result without some candidates, weighed with them among the scores again."""
    left = {name: first.found.state.left.get(name, INSTEAD) for name in out}
    state = replace(
        found.state,
        current=current_model(problem, found.model.point, found.state.current.explained_chi2),
        steps=(*first.found.steps[:1], *found.steps),
        left={**left, **found.state.left},
    )
    return weigh(problem, state)
