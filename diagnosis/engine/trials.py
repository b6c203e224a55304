"""Step 6, fit and gates: fit models with one more hypothesis under the present noise, and test them by the gates.

Theory of operation
-------------------
A score alone does not identify a cause (step 4), because similar effects score as well. The fit of the effect together
with all base parameters decides. Hypotheses above the threshold are fitted, the highest scores first. For the two
highest, their confusers and richer relatives in the catalogue are fitted too, because a wrong effect often has the
highest score.

A fit starts at the amplitude estimated from the score, with the base parameters adapted to it. All fits of one forward
step share the noise and the columns of the base parameters. So they are fast and comparable by BIC.

Trials are tested in the order of their BIC. A prediction of the validation runs takes as long as a fit. So it is made
only for a trial that has passed all other gates, and only until a better trial has passed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

from diagnosis.engine.config import SUBSTITUTE, WITH_RELATIVES
from diagnosis.engine.family import richer_surcharge
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.point import Point
from diagnosis.engine.fitting.predict import Prediction, predict
from diagnosis.engine.footprints import candidates, confirmed, footprints
from diagnosis.engine.gates import merely_rough, unfit, unphysical, useless
from diagnosis.engine.memory import give_back
from diagnosis.engine.screening import fit_and_screen
from diagnosis.engine.search_state import CurrentModel, Problem, SearchState, Trial
from diagnosis.engine.threads import in_threads

#: Why a fitted model, with its prediction of the validation runs, is rejected; "" if it is not.
Gate = Callable[[FittedModel, Prediction | None], str]


def current_model(problem: Problem, point: Point, explained_chi2: float = 0.0) -> CurrentModel:
    """Return the model of a point with all its results: estimate the noise, fit again, score all other effects, and
    predict the validation runs.
    """
    rest = candidates([e for name, e in problem.hypotheses.items() if name not in point.owners])
    around = footprints(problem.replay, point, rest)
    alpha, seed = problem.config.alpha, problem.config.seed
    screened = fit_and_screen(problem.replay, around, alpha=alpha, seed=seed)
    exceeding, norms = screened.screening.exceeding, screened.screening.projection.norm
    again = confirmed(problem.replay, around, exceeding, norms)
    if again is not around:
        screened, around = fit_and_screen(problem.replay, again, alpha=alpha, seed=seed), again
    prediction = predicted(problem, screened.model)
    return CurrentModel(screened.model, screened.screening, around, prediction, explained_chi2)


def predicted(problem: Problem, model: FittedModel, near: Prediction | None = None) -> Prediction | None:
    """Predict the validation runs; None if there are none. ``near`` is a prediction under the same noise whose columns
    are used again.
    """
    if not problem.select:
        return None
    return predict(model, problem.select, near.linearisation if near else None)


def refit(problem: Problem, start: Point, current: CurrentModel, target: float = math.inf) -> FittedModel:
    """Fit another model under the noise of the current one. The columns of the base parameters are taken from the
    current model.

    The fit stops early if its χ² stays too far above ``target``.
    """
    gap = current.model.penalised_chi2 - target
    ceiling = current.model.penalised_chi2 - SUBSTITUTE * gap if 0.0 < gap < math.inf else math.inf
    model = current.model
    return fit(problem.replay, model.noise, start, model.linearisation, target=target, ceiling=ceiling)


def fit_trials(problem: Problem, state: SearchState) -> tuple[Trial, ...]:
    """Fit and test the effects with the highest scores above the threshold of the current model, and their relatives.
    Return the trials, best BIC first.
    """
    current = state.current
    wanted = _wanted(problem, current)
    starts = {name: current.screening.start(current.model.point, place) for name, place in wanted.items()}
    return tried(problem, state, starts)


def tried(
    problem: Problem, state: SearchState, starts: Mapping[str, Point], gate: Gate = lambda _model, _there: ""
) -> tuple[Trial, ...]:
    """Fit effects from their starts, the most promising first, and test them. Return the trials, best BIC first.

    Predictions are tested in the order of BIC, until one passes. The trials after it have no lpd.

    ``gate`` is a further test: from a fitted model and its prediction of the validation runs it returns why the model
    fails, or "".
    """
    current = state.current
    if not starts:
        return ()
    first, *others = starts.items()
    fitted = [_fitted(problem, current, math.inf, first)]
    best = fitted[0][0].penalised_chi2
    fitted += in_threads(problem.replay.workers, partial(_fitted, problem, current, best), others)
    fitted.sort(key=lambda one: one[0].bic)
    trials = [trial for trial, _ in fitted]
    for i, (trial, passed) in enumerate(fitted):
        if passed is not None:
            prediction = predicted(problem, passed, current.prediction)
            failed = too_useless(problem, state, passed, prediction) or gate(passed, prediction)
            trials[i] = replace(trial, failed=failed, lpd=prediction.lpd if prediction else math.nan)
            if not failed:
                break
    return tuple(trials)


def _fitted(
    problem: Problem, current: CurrentModel, target: float, wanted: tuple[str, Point]
) -> tuple[Trial, FittedModel | None]:
    """Fit a hypothesis from its start, and test the fit. Return the trial and the model. The model of a failed trial is
    None, to save memory.

    ``target`` is the penalised χ² of the most promising trial.
    """
    name, start = wanted
    model = refit(problem, start, current, target)
    wrong = unfit(model, current.model)
    failed = wrong or too_rough(problem, current, model)
    physical = not unphysical(model, current.model)
    surcharge = richer_surcharge(problem, name, model, current)
    give_back()
    trial = trial_of(name, model, None, failed, physical, surcharge)
    return replace(trial, rough=bool(failed) and not wrong), None if failed else model


def _wanted(problem: Problem, current: CurrentModel) -> dict[str, int]:
    """Return the effects to fit, each with the index of its best candidate."""
    screening = current.screening
    exceeding = screening.exceeding[: problem.config.fits]
    wanted = {screening.candidates[i].effect.name: i for i in exceeding}
    for i in exceeding[:WITH_RELATIVES]:
        effect = screening.candidates[i].effect
        for name in (*effect.richer, *effect.confusers):
            if name in problem.hypotheses and name not in current.effects:
                wanted.setdefault(name, screening.best(name))
    return wanted


def fit_physical(
    problem: Problem, effect: str, start: Point, current: CurrentModel, target: float = math.inf
) -> Trial:
    """Fit a model and test only whether it is physical. If it is, predict the validation runs. Return the trial."""
    model = refit(problem, start, current, target)
    failed = unphysical(model, current.model)
    prediction = None if failed else predicted(problem, model, current.prediction)
    surcharge = richer_surcharge(problem, effect, model, current)
    return trial_of(effect, model, prediction, failed, surcharge=surcharge)


def too_rough(problem: Problem, current: CurrentModel, model: FittedModel) -> str:
    """Return why a model with one more effect may only explain errors of the accepted causes; "" if not."""
    gained = current.model.penalised_chi2 - model.penalised_chi2
    return merely_rough(gained, current.explained_chi2, current.screening.threshold, problem.config)


def too_useless(
    problem: Problem, state: SearchState, model: FittedModel, prediction: Prediction | None
) -> str:
    """Return why a model with more effects than the current one does not predict better; "" if it does."""
    current = state.current
    return useless(model, prediction, current.model, current.prediction, state.floors, problem.config)


def trial_of(
    effect: str,
    model: FittedModel,
    prediction: Prediction | None,
    failed: str,
    physical: bool = True,
    surcharge: float = 0.0,
) -> Trial:
    """Return the result of a fit as a trial."""
    lpd = prediction.lpd if prediction else float("nan")
    bic = model.bic + surcharge
    return Trial(effect, model.point, model.covariance(), model.penalised_chi2, bic, lpd, failed, physical)
