"""Step 6, the swap pass: test rivals in place of each accepted effect; a better one replaces it.

Theory of operation
-------------------
The first effect was the best one alone. Together with a second cause, or under the noise estimated with it, another may
be better. So after each entry the alternatives of every accepted effect are fitted in its place: effects that explained
a large part when it entered, other laws of the same phenomenon (`equivalence_classes.py`), and effects that it
replaced. The best swap that lowers the BIC is made, and the pass begins again under the noise of the new model.

Under another noise a removed effect may look better again. Then the two sets of effects are compared, each under its
own noise, by the likelihood of the measured samples with all constants (`_criterion`), because χ² alone cannot compare
two noises. The better set stays, so the pass ends. The other one becomes its rival; their BIC gap is the difference in
`_criterion`.

The remaining alternatives, when no swap is better, are the rivals of the verdict: physical models, each with its BIC
(step 8).
"""

from __future__ import annotations

import math
from dataclasses import replace

from diagnosis.engine.config import RIVALS
from diagnosis.engine.equivalence_classes import alike_laws
from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.search_state import Problem, SearchState, Trial
from diagnosis.engine.trials import current_model, fit_physical


def swap(problem: Problem, state: SearchState) -> SearchState:
    """Replace accepted effects by better rivals. Return the state with the remaining rivals of each effect."""
    visited: dict[frozenset[str], SearchState] = {}
    while True:
        current = state.current
        rivals = {old: _rivals(problem, state, old) for old in current.effects}
        state = replace(state, rivals=rivals)
        visited[frozenset(current.effects)] = state
        better = [
            (trial.bic, old, trial)
            for old, trials in rivals.items()
            for trial in trials
            if trial.bic < current.model.bic and frozenset(trial.point.owners) not in visited
        ]
        if not better:
            return _settled(visited, state)
        _, old, new = min(better, key=lambda swap: swap[0])
        alternatives = dict(state.alternatives)
        rest = (name for name in alternatives.pop(old) if name != new.effect)
        alternatives[new.effect] = (old, *rest)
        state = replace(
            state,
            current=current_model(problem, new.point, current.explained_chi2),
            alternatives=alternatives,
        )


def _settled(visited: dict[frozenset[str], SearchState], last: SearchState) -> SearchState:
    """Return the best of the visited states.

    The noise of each state is its own. So if a rival of the best state was visited and seems better, its BIC is
    replaced: it differs from that of the best state by the difference in `_criterion`.
    """
    criteria = {effects: _criterion(state.current.model) for effects, state in visited.items()}
    best = min(
        visited.values(), key=lambda state: (criteria[frozenset(state.current.effects)], state is not last)
    )
    own = criteria[frozenset(best.current.effects)]

    def compared(trial: Trial) -> Trial:
        effects = frozenset(trial.point.owners)
        if effects not in criteria or trial.bic >= best.current.model.bic:
            return trial
        return replace(trial, bic=best.current.model.bic + criteria[effects] - own)

    rivals = {
        old: tuple(sorted(map(compared, trials), key=lambda trial: trial.bic))
        for old, trials in best.rivals.items()
    }
    return replace(best, rivals=rivals)


def _criterion(model: FittedModel) -> float:
    """Return the BIC of a model plus the constants of its noise: ln of the innovation variance of every sample."""
    constant = sum(
        float(run.counted[:, i].sum()) * math.log(model.noise.dispersion * channel.innovation**2)
        for run in model.replay.runs
        for i, channel in enumerate(model.noise.channels)
    )
    return model.bic + constant


def _rivals(problem: Problem, state: SearchState, old: str) -> tuple[Trial, ...]:
    """Return physical models in which an alternative replaces the accepted effect ``old``, best first."""
    current = state.current
    outside = [name for name in state.alternatives[old] if name not in current.effects][:RIVALS]
    laws = (name for name in alike_laws(problem.hypotheses, old) if name in state.last_fit)
    outside += [name for name in laws if name not in (*outside, *current.effects)]
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
