"""Step 6, admission: choose the trial that enters the model, alone, as a replacement, or together with another trial.

Theory of operation
-------------------
The trials are sorted by BIC, and the first one that passes all gates is chosen. It does not enter if

* an unphysical trial explains far more. The data then need a pair, or a term that is in no catalogue;
* a richer member of the family of an accepted cause explains as much in place of that cause (`family.py`). Then the
  richer member enters if its parameters improve the BIC; otherwise nothing enters.

A further cause may be much smaller than the accepted causes, and no larger than the error of their equations. It enters
if the model is sufficient with it and insufficient without it: no other score exceeds the threshold, no surface test
rejects the model, and the validation runs are predicted clearly better. An inexact equation cannot cause this, because
no single candidate explains all of its residual.

If nothing enters and the residual is far above the noise, two causes may be missing. A fit with only one of them moves
the base parameters far from their priors: a lag seems to need a wrong mass because the rubber is missing too. A large
leak also hides the scores of other causes. So the best of the unphysical trials is added to the model, all candidates
are scored again, and the highest ones are fitted with it (`choose_with_strained`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from diagnosis.engine.config import COMPARABLE, DISTINGUISHED, PAIRED, SUBSTITUTE
from diagnosis.engine.family import richer_members, richer_surcharge
from diagnosis.engine.fitting.point import Point
from diagnosis.engine.footprints import with_surfaces
from diagnosis.engine.gates import unfit
from diagnosis.engine.p_values import bonferroni
from diagnosis.engine.screening import fit_and_screen
from diagnosis.engine.search_state import CurrentModel, Problem, SearchState, Trial
from diagnosis.engine.trials import (
    current_model,
    fit_physical,
    predicted,
    refit,
    too_rough,
    too_useless,
    trial_of,
)


def choose(problem: Problem, state: SearchState, trials: Sequence[Trial]) -> Trial | None:
    """Return the trial that enters the model; None if no trial enters."""
    chosen = next((trial for trial in trials if not trial.failed), None)
    if chosen is None:
        return None
    bic = state.current.model.bic
    impossible = min((trial.bic for trial in trials if not trial.physical), default=math.inf)
    if bic - chosen.bic < SUBSTITUTE * (bic - impossible):
        return None
    singles = _richer_instead(problem, state, chosen)
    if not singles:
        return chosen
    return min((single for single in singles if single.bic < bic), key=lambda trial: trial.bic, default=None)


def _richer_instead(problem: Problem, state: SearchState, chosen: Trial) -> list[Trial]:
    """Return trials in which a more general effect (`richer_members`) replaces an accepted one.

    ``chosen`` is the trial that keeps the accepted effect and adds another one. Trials that are clearly worse than
    ``chosen`` are not returned.
    """
    current, config = state.current, problem.config
    singles: list[Trial] = []
    for old in current.effects:
        for name in richer_members(problem, old, current.effects):
            if name not in state.last_fit:
                continue
            start = current.model.point.replaced(old, problem.hypotheses[name], state.last_fit[name])
            single = fit_physical(problem, name, start, current)
            by_bic = chosen.bic < single.bic - config.ambiguous
            by_lpd = not chosen.lpd <= single.lpd + config.lpd_loss  # also for NaN: no validation runs
            if not (single.failed or (by_bic and by_lpd)):
                singles.append(single)
    return singles


def choose_sufficient(problem: Problem, state: SearchState, trials: Sequence[Trial]) -> Trial | None:
    """Return the best trial that failed only because it is small, if the model with this trial explains the data
    sufficiently; else None.
    """
    current = state.current
    trial = next((one for one in trials if one.rough), None)
    if trial is None or current.prediction is None:
        return None
    model = refit(problem, trial.point, current)
    there = predicted(problem, model, current.prediction)
    if there is None or there.lpd - current.prediction.lpd < 0.5 * DISTINGUISHED:
        return None
    if too_useless(problem, state, model, there):
        return None
    beside = current_model(problem, trial.point)
    left = beside.screening.exceeding or _surfaces_see(problem, beside)
    return None if left else replace(trial, failed="", lpd=there.lpd)


def _surfaces_see(problem: Problem, beside: CurrentModel) -> bool:
    """Return whether the test of any surface rejects the model ``beside``."""
    replay, config = problem.replay, problem.config
    if not replay.simulator.surfaces:
        return False
    around = with_surfaces(replay, beside.footprints)
    tests = fit_and_screen(replay, around, alpha=config.alpha, seed=config.seed).tests
    return any(bonferroni(test.p, len(tests)) < config.alpha_unknown for test in tests)


def choose_with_strained(problem: Problem, state: SearchState, trials: Sequence[Trial]) -> Trial | None:
    """Return the best model with two further causes: the strongest trial that is unphysical alone, and another
    candidate. None if there is no such model.
    """
    current = state.current
    strained = next((trial for trial in trials if not trial.physical and trial.bic < current.model.bic), None)
    if strained is None or len(current.effects) + 2 > problem.config.max_effects:
        return None
    beside = current_model(problem, strained.point)
    family = problem.hypotheses[strained.effect].family
    screening = beside.screening
    places = [i for i in screening.exceeding if screening.candidates[i].effect.family != family][:PAIRED]
    found: list[Trial] = []
    for i in places:
        names = strained.effect, screening.candidates[i].effect.name
        found += _with_two(problem, state, names, screening.start(beside.model.point, i))
    return min(found, key=lambda trial: trial.bic, default=None)


def _with_two(problem: Problem, state: SearchState, names: tuple[str, str], start: Point) -> list[Trial]:
    """Fit two further causes together from ``start``, and return the trial of the second one; empty if a gate rejects
    the model.
    """
    current = state.current
    model = refit(problem, start, current)
    if unfit(model, current.model) or too_rough(problem, current, model):
        return []
    prediction = predicted(problem, model, current.prediction)
    if too_useless(problem, state, model, prediction):
        return []
    surcharge = sum(richer_surcharge(problem, name, model, current) for name in names)
    return [trial_of(names[1], model, prediction, "", surcharge=surcharge)]


def admit(problem: Problem, state: SearchState, chosen: Trial, trials: tuple[Trial, ...]) -> SearchState:
    """Return the state with the chosen trial as the current model, and with the alternatives to the new effects."""
    current = state.current
    alternatives = dict(state.alternatives)
    for gone in set(current.effects) - set(chosen.point.owners):
        alternatives[chosen.effect] = (gone, *alternatives.pop(gone))
    others = _comparable(current.model.bic, chosen, trials, problem.config.ambiguous)
    for new in set(chosen.point.owners) - set(current.effects):
        alternatives[new] = tuple(dict.fromkeys((*others, *alternatives.get(new, ()))))
    explained = current.explained_chi2 + current.model.penalised_chi2 - chosen.penalised_chi2
    return replace(
        state, current=current_model(problem, chosen.point, explained), alternatives=alternatives, rivals={}
    )


def _comparable(bic: float, chosen: Trial, trials: Sequence[Trial], ambiguous: float) -> list[str]:
    """Return the other effects whose fit improves ``bic`` by more than the part `COMPARABLE` of the improvement by the
    chosen effect.

    An effect that improves ``bic`` is also included if its BIC exceeds that of the chosen one by less than
    ``ambiguous``.
    """
    gain = bic - chosen.bic
    least = max(min(COMPARABLE * gain, gain - ambiguous), 0.0)
    return [t.effect for t in trials if t.effect != chosen.effect and bic - t.bic > least]
