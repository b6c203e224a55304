"""Step 6, the backward pass: the gain of each accepted effect over the others; effects that fail a gate leave.

Theory of operation
-------------------
Effects entered one after the other, each through all gates together with those before it. A later one may have made an
earlier one superfluous, or pushed it out of its range. So the model is fitted once without each of them, and each
passes the gates again together with *all* others: BIC, range and beliefs, the select runs, the part of the error that
it explains (`gates.py`). Only roughness is not tested, because it has a meaning in the order of entering alone. Of
those that fail, the one whose absence costs the least BIC is looked at. It may be the victim: a friction that comes out
negative, or predicts nothing, together with a damping that has taken its place. So where it passes without a lesser
effect, that one leaves, else it leaves itself. Noise and rivals are those of another model then, so both are estimated
again (`rivals.py`), and the pass begins again; it ends when all that is left passes.

The same fits state how much each effect explains: λ² is the penalised χ² that its absence costs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.fitting.point import Point
from diagnosis.engine.fitting.predict import Prediction
from diagnosis.engine.gates import unfit, useless
from diagnosis.engine.rivals import swap
from diagnosis.engine.search_state import Accepted, Problem, SearchResult, SearchState
from diagnosis.engine.trials import current_model, predicted, refit


@dataclass(frozen=True, slots=True, eq=False)
class _Weighed:
    """A model, mostly the current one without an effect, and what it predicts of the select runs."""

    model: FittedModel
    prediction: Prediction | None


def weigh(problem: Problem, state: SearchState) -> SearchResult:
    """Leave out what does not pass the gates together with the others, and state what each of the rest is worth."""
    while True:
        without = _without_each(problem, state)
        failed = _failed(problem, state, without)
        if not failed:
            return _result(state, without)
        first = min(failed, key=lambda name: without[name].model.bic)
        state = dismissed(problem, state, {_one_too_many(problem, state, without, first): failed[first]})


def dismissed(problem: Problem, state: SearchState, why: Mapping[str, str]) -> SearchState:
    """Return the state without some effects, each with the reason, under new noise and with new rivals."""
    point = state.current.model.point
    for name in why:
        point = point.without(name)
    alternatives = {
        kept: tuple(name for name in others if name not in why)
        for kept, others in state.alternatives.items()
        if kept not in why
    }
    others = tuple(name for name in state.current.effects if name not in why)
    state = replace(
        state,
        current=current_model(problem, point),
        alternatives=alternatives,
        rivals={},
        left={**state.left, **why},
        beside={**state.beside, **dict.fromkeys(why, others)},
    )
    return swap(problem, state)


def _without_each(problem: Problem, state: SearchState) -> dict[str, _Weighed]:
    current = state.current
    return {name: _fitted(problem, state, current.model.point.without(name)) for name in current.effects}


def _fitted(problem: Problem, state: SearchState, point: Point) -> _Weighed:
    model = refit(problem, point, state.current)
    return _Weighed(model, predicted(problem, model, state.current.prediction))


def _failed(problem: Problem, state: SearchState, without: Mapping[str, _Weighed]) -> dict[str, str]:
    """Return the accepted effects that do not pass a gate together with the others, each with the gate."""
    beside = _Weighed(state.current.model, state.current.prediction)
    failed = {name: _gate(problem, state, beside, other) for name, other in without.items()}
    return {name: why for name, why in failed.items() if why}


def _gate(problem: Problem, state: SearchState, beside: _Weighed, absent: _Weighed) -> str:
    """Return the gate that an effect does not pass, from the models with and without it; "" if it passes all."""
    return unfit(beside.model, absent.model) or useless(
        beside.model, beside.prediction, absent.model, absent.prediction, state.floors, problem.config
    )


def _one_too_many(problem: Problem, state: SearchState, without: Mapping[str, _Weighed], failed: str) -> str:
    """Return which effect leaves where one failed: a lesser one without which that passes, else that one itself."""
    lesser = [name for name in without if without[name].model.bic < without[failed].model.bic]
    for name in sorted(lesser, key=lambda name: without[name].model.bic):
        beside = without[name]
        neither = _fitted(problem, state, beside.model.point.without(failed))
        if not _gate(problem, state, beside, neither):
            return name
    return failed


def _result(state: SearchState, without: Mapping[str, _Weighed]) -> SearchResult:
    current = state.current
    scores = _last_scores(state)
    accepted = tuple(
        Accepted(
            name,
            scores[name],
            math.sqrt(max(without[name].model.penalised_chi2 - current.model.penalised_chi2, 0.0)),
            without[name].model.bic - current.model.bic,
            _lpd(current.prediction) - _lpd(without[name].prediction),
            state.rivals[name],
        )
        for name in current.effects
    )
    # Anyone who goes on from here has a model of his own, and predicts with that.
    state = replace(state, current=replace(current, prediction=None))
    return SearchResult(state, accepted, {name: one.model for name, one in without.items()})


def _lpd(prediction: Prediction | None) -> float:
    return prediction.lpd if prediction else float("nan")


def _last_scores(state: SearchState) -> dict[str, float]:
    """Return the score of every effect at the best point of its grid, in the last step that scored it."""
    scores: dict[str, float] = {}
    for step in state.steps:
        screening = step.screening
        for i in sorted(range(len(screening.candidates)), key=lambda i: float(screening.z[i])):
            scores[screening.candidates[i].effect.name] = float(screening.z[i])
    return scores
