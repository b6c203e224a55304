"""Step 6, fit and gates: models with one more hypothesis, fitted under the present noise and judged by the gates.

Theory of operation
-------------------
A score is no name (step 4): whatever resembles the true cause scores as well. What decides is the fit, of the effect
together with all base parameters. Fitted are the hypotheses that exceed the threshold, the highest scores first, and
with the two highest whatever their catalogue calls their confusers or their richer relatives: an impostor often scores
first, and the true cause may stand behind it.

A fit starts at the amplitude that the score estimates, with the base parameters that make room for it. All fits of one
forward step share the noise and the columns of the base parameters, which makes them cheap, and comparable by BIC.

Trials are judged in the order of their BIC. Predicting the select runs costs as much as a fit, so only a trial that has
passed all other gates, and that no better one has already passed before, is requested it.
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

#: Why a fitted model, with what it predicts of the select runs, is not to be taken; "" if it may be.
Gate = Callable[[FittedModel, Prediction | None], str]


def current_model(problem: Problem, point: Point, explained_chi2: float = 0.0) -> CurrentModel:
    """Re-estimate the noise around a point, refit, score everything that is not in the model, predict."""
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
    """Predict the select runs, with the columns of a prediction under the same noise; None where there are none."""
    if not problem.select:
        return None
    return predict(model, problem.select, near.linearisation if near else None)


def refit(problem: Problem, start: Point, current: CurrentModel, target: float = math.inf) -> FittedModel:
    """Fit another model under the noise of the current one, with its columns of the base parameters.

    Below a ``target``, what gains less than a substitute must gain of that is not worth much.
    """
    gap = current.model.penalised_chi2 - target
    ceiling = current.model.penalised_chi2 - SUBSTITUTE * gap if 0.0 < gap < math.inf else math.inf
    model = current.model
    return fit(problem.replay, model.noise, start, model.linearisation, target=target, ceiling=ceiling)


def fit_trials(problem: Problem, state: SearchState) -> tuple[Trial, ...]:
    """Fit and judge the effects that stand out against the current model, and their relatives; best BIC first."""
    current = state.current
    wanted = _wanted(problem, current)
    starts = {name: current.screening.start(current.model.point, place) for name, place in wanted.items()}
    return tried(problem, state, starts)


def tried(
    problem: Problem, state: SearchState, starts: Mapping[str, Point], gate: Gate = lambda _model, _there: ""
) -> tuple[Trial, ...]:
    """Fit effects, each from its start, the most promising first, and judge them; best BIC first.

    A further ``gate`` returns why a fitted model with its prediction of the select runs does not pass, or "".
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
    """Fit a hypothesis from its start, and judge it; a model is large, and one that has failed is not kept.

    ``target`` is the penalised χ² of the most promising one, in whose light the others are fitted.
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
    """Return the effects to be fitted, each with its best point of the grid."""
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
    """Fit a model that only has to be physical; if it is, compute its predictions."""
    model = refit(problem, start, current, target)
    failed = unphysical(model, current.model)
    prediction = None if failed else predicted(problem, model, current.prediction)
    surcharge = richer_surcharge(problem, effect, model, current)
    return trial_of(effect, model, prediction, failed, surcharge=surcharge)


def too_rough(problem: Problem, current: CurrentModel, model: FittedModel) -> str:
    """Return why a model with one more effect may only take up what the causes found before are wrong by."""
    gained = current.model.penalised_chi2 - model.penalised_chi2
    return merely_rough(gained, current.explained_chi2, current.screening.threshold, problem.config)


def too_useless(
    problem: Problem, state: SearchState, model: FittedModel, prediction: Prediction | None
) -> str:
    """Return why a model with more effects than the current one predicts nothing better."""
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
    """Return the trial of a fitted model."""
    lpd = prediction.lpd if prediction else float("nan")
    bic = model.bic + surcharge
    return Trial(effect, model.point, model.covariance(), model.penalised_chi2, bic, lpd, failed, physical)
