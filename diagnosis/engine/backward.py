"""Step 6, the backward pass: test each accepted effect again, and remove effects that fail a gate.

Theory of operation
-------------------
Effects enter one after the other. Each was tested together with the effects before it. A later effect can make an
earlier one superfluous, or push it out of its range. So the model is fitted once without each effect, and each effect
must pass the gates again together with *all* others: BIC, range and priors, the validation runs, the explained part of
the error (`gates.py`). Roughness is not tested, because it depends on the order of entering. Of the effects that fail,
the one with the smallest loss of BIC is examined. It may be correct, and another effect wrong: for example, a friction
becomes negative because a wrong damping has replaced it. So if it passes without a weaker effect, the weaker effect is
removed; otherwise it is removed itself. Then noise and rivals are estimated again (`rivals.py`), and the pass begins
again. It ends when all remaining effects pass.

The same fits show how much each effect explains: λ² is the increase of the penalised χ² without the effect.
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
    """A model and its prediction of the validation runs. The model is usually the current one without one effect."""

    model: FittedModel
    prediction: Prediction | None


def weigh(problem: Problem, state: SearchState) -> SearchResult:
    """Remove the effects that fail a gate in the model with all accepted effects. Return the result of the search, with
    the part that each remaining effect explains.
    """
    while True:
        without = _without_each(problem, state)
        failed = _failed(problem, state, without)
        if not failed:
            return _result(state, without)
        first = min(failed, key=lambda name: without[name].model.bic)
        state = dismissed(problem, state, {_one_too_many(problem, state, without, first): failed[first]})


def dismissed(problem: Problem, state: SearchState, why: Mapping[str, str]) -> SearchState:
    """Return the state without the effects in ``why``, which gives the reason for each. Estimate noise and rivals
    again.
    """
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
    """Return each accepted effect that fails a gate, with the reason. The model with all effects is compared with the
    model ``without`` this one.
    """
    beside = _Weighed(state.current.model, state.current.prediction)
    failed = {name: _gate(problem, state, beside, other) for name, other in without.items()}
    return {name: why for name, why in failed.items() if why}


def _gate(problem: Problem, state: SearchState, beside: _Weighed, absent: _Weighed) -> str:
    """Return why an effect fails a gate, from the models with and without it; "" if it passes all."""
    return unfit(beside.model, absent.model) or useless(
        beside.model, beside.prediction, absent.model, absent.prediction, state.floors, problem.config
    )


def _one_too_many(problem: Problem, state: SearchState, without: Mapping[str, _Weighed], failed: str) -> str:
    """Return the effect to remove: a weaker effect without which ``failed`` passes, otherwise ``failed`` itself."""
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
    # The caller continues with another model, and predicts with that.
    state = replace(state, current=replace(current, prediction=None))
    return SearchResult(state, accepted, {name: one.model for name, one in without.items()})


def _lpd(prediction: Prediction | None) -> float:
    return prediction.lpd if prediction else float("nan")


def _last_scores(state: SearchState) -> dict[str, float]:
    """Return the score of every effect at the best point of its grid, from the last step that scored it."""
    scores: dict[str, float] = {}
    for step in state.steps:
        screening = step.screening
        for i in sorted(range(len(screening.candidates)), key=lambda i: float(screening.z[i])):
            scores[screening.candidates[i].effect.name] = float(screening.z[i])
    return scores
