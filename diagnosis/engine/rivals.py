"""Step 6, the swap pass: rivals are tried in the place of each accepted effect, and a better one takes it.

Theory of operation
-------------------
What entered first was the best alone. Beside a second cause, or under the noise that is estimated with it in the model,
another may be better. So after each entry the alternatives of every accepted effect are fitted in its place: those
which explained a good part when it entered, and those which it replaced itself. The best swap that lowers the BIC is
made and the pass begins anew, under the noise of the new model. No set of effects is visited twice: under another
noise, what went might look better again.

What remains when no swap is better are the rivals of the verdict: physical models, each with its BIC (step 8).
"""

from __future__ import annotations

from dataclasses import replace

from diagnosis.engine.config import RIVALS
from diagnosis.engine.search_state import Problem, SearchState, Trial
from diagnosis.engine.trials import current_model, fit_physical


def swap(problem: Problem, state: SearchState) -> SearchState:
    """Let better rivals in, and return the state with the rivals that remain of each accepted effect."""
    visited = {frozenset(state.current.effects)}
    while True:
        current = state.current
        rivals = {old: _rivals(problem, state, old) for old in current.effects}
        better = [
            (trial.bic, old, trial)
            for old, trials in rivals.items()
            for trial in trials
            if trial.bic < current.model.bic and frozenset(trial.point.owners) not in visited
        ]
        if not better:
            return replace(state, rivals=rivals)
        _, old, new = min(better, key=lambda swap: swap[0])
        visited.add(frozenset(new.point.owners))
        alternatives = dict(state.alternatives)
        rest = (name for name in alternatives.pop(old) if name != new.effect)
        alternatives[new.effect] = (old, *rest)
        state = replace(
            state,
            current=current_model(problem, new.point, current.explained_chi2),
            alternatives=alternatives,
        )


def _rivals(problem: Problem, state: SearchState, old: str) -> tuple[Trial, ...]:
    """Return physical models with an alternative in the place of an accepted effect, best first."""
    current = state.current
    outside = [name for name in state.alternatives[old] if name not in current.effects][:RIVALS]
    fits = [
        fit_physical(
            problem,
            name,
            current.model.point.replaced(old, problem.hypotheses[name], state.last_fit[name]),
            current,
            target=current.model.penalised_chi2,
        )
        for name in outside
    ]
    return tuple(sorted((trial for trial in fits if not trial.failed), key=lambda trial: trial.bic))
