"""Step 6, the backward pass: what each accepted effect is worth beside the others; what is worth nothing leaves.

Theory of operation
-------------------
Effects entered one after the other, each for what it explained beside those before it. A later one may have made an
earlier one superfluous. So the model is fitted once without each of them. An effect without which the BIC is no worse
leaves, the least useful first, and the noise is estimated anew; the pass ends when each of the rest is worth its
parameters.

The same fits say how much each effect explains: λ² is the penalised χ² that its absence costs.
"""

from __future__ import annotations

import math
from dataclasses import replace

from diagnosis.engine.search_state import Accepted, Problem, SearchResult, SearchState, Trial
from diagnosis.engine.trials import current_model, fit_physical


def weigh(problem: Problem, state: SearchState) -> SearchResult:
    """Leave out what is not worth its parameters, and say what each of the rest is worth."""
    while True:
        current = state.current
        point = current.model.point
        without = {
            name: fit_physical(problem, name, point.without(name), current) for name in current.effects
        }
        superfluous = [name for name in without if without[name].bic <= current.model.bic]
        if not superfluous:
            return _result(state, without)
        least = min(superfluous, key=lambda name: without[name].bic)
        current = current_model(problem, without[least].point)
        state = replace(state, current=current, rivals={name: state.rivals[name] for name in current.effects})


def _result(state: SearchState, without: dict[str, Trial]) -> SearchResult:
    current = state.current
    lpd = current.prediction.lpd if current.prediction else float("nan")
    scores = _last_scores(state)
    accepted = tuple(
        Accepted(
            name,
            scores[name],
            math.sqrt(max(without[name].penalised_chi2 - current.model.penalised_chi2, 0.0)),
            without[name].bic - current.model.bic,
            lpd - without[name].lpd,
            state.rivals[name],
        )
        for name in current.effects
    )
    return SearchResult(
        state.steps,
        accepted,
        current.model,
        current.prediction,
        current.screening,
        current.footprints,
        state.floors,
    )


def _last_scores(state: SearchState) -> dict[str, float]:
    """Return the score of every effect at the best point of its grid, in the last step that scored it."""
    scores: dict[str, float] = {}
    for step in state.steps:
        screening = step.screening
        for i in sorted(range(len(screening.candidates)), key=lambda i: float(screening.z[i])):
            scores[screening.candidates[i].effect.name] = float(screening.z[i])
    return scores
