"""Step 8, the verdict: one of six statements, from the named causes and the surfaces of step 7.

Theory of operation
-------------------
The search has named causes. The simulator's surfaces now represent everything that the catalogue lacks. The noise is
estimated once more without the part that they explain. The surfaces are tested (`omnibus.py`) on the fit runs and the
validation runs together, because an unknown term is often clearest on runs that were not fitted. Causes that the
clearest surface makes superfluous leave the model (`cause_removal.py`), and so do those outside of their range in the
last fit, those with 0 in their interval, and those that may only compensate an error of the equations (`constancy.py`).
Such a cause helps little on runs that it was not fitted to. A cause that removes most of the error of the validation
runs, as fitted, is therefore kept, however rough its own equation. The remaining causes pass all gates again
(`backward.py`), and the test is repeated without the removed ones. Then the surface is fitted. If a removed cause may
compensate such an error, and no surface was clear together with it, then a surface that appears in its absence is not
reported, because a known cause explains the same error.

The verdict follows from the remaining causes and scores, and no cause is forced:

* no cause: `unknown` if a surface predicts better, `unresolved` if anything else is significant, otherwise `no effect`;
* causes with a rival that explains the data nearly as well: `ambiguous`;
* causes, and a surface or a score that is more than a small part of the χ² that they explain: `named + unexplained
  remainder`;
* otherwise `named`.

The residual on unseen runs may still change the verdict (`final`, from `remainder.py`). `no effect` and a plain `named`
require that the residual reaches the noise. Doubts about the data, or misfits, change `no effect` to another verdict
(`diagnose.verdict_on`). A cause that leaves most of the error in every channel is not named at all. Between these
limits, the unseen runs select among rivals (`rivals_unseen.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from diagnosis.contracts import MeasuredRun
from diagnosis.engine.backward import dismissed, weigh
from diagnosis.engine.cause_removal import doubtful, no_clearer, vague
from diagnosis.engine.config import REMAINDER, REPORTED_FIT_STEPS, UNKEPT_SURFACE_P, Config
from diagnosis.engine.constancy import owed_to_form
from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.footprints import Footprints, footprints, joined, with_surfaces
from diagnosis.engine.gates import out_of_range
from diagnosis.engine.intervals import below_resolution
from diagnosis.engine.omnibus import Omnibus
from diagnosis.engine.prediction_share import is_predicted, residual_bound
from diagnosis.engine.remainder import Remainder
from diagnosis.engine.screening import ScreenedModel, Screening, fit_and_screen
from diagnosis.engine.search_state import Problem, SearchResult
from diagnosis.engine.suspects import Dismissed
from diagnosis.engine.unknown import clear_surfaces, dropped, explain
from diagnosis.finding import Unknown, Verdict

#: Why a cause leaves that the form of the model may have made.
OWED: Final = "an error in the equations of the model can explain the same misfit"


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """The verdict with the fitted surfaces.

    ``found`` is the search result without doubtful effects. ``screened`` is the model with the remaining effects, and
    the scores against it. ``model`` also contains the surfaces that were kept. ``dismissed`` are the doubtful effects.
    """

    verdict: Verdict
    found: SearchResult
    screened: ScreenedModel
    model: FittedModel
    unknowns: tuple[Unknown, ...]
    dismissed: tuple[Dismissed, ...] = ()


def judge(problem: Problem, found: SearchResult) -> Judgement:
    """Test the result of the search with the surfaces of the simulator, and remove doubtful effects. Return the
    remaining result with its verdict.
    """
    imitable, left = False, list[Dismissed]()
    while True:
        screened, clear = _beyond(problem, found)
        gone = _leaving(problem, found, screened, clear)
        if not gone:
            break
        imitable = imitable or (not clear and OWED in gone.values())
        left += [
            Dismissed(one, found.model, gone[one.effect]) for one in found.accepted if one.effect in gone
        ]
        found = weigh(problem, dismissed(problem, found.state, gone))
    if imitable and not found.accepted:
        clear = []
    model = screened.model
    unknowns: tuple[Unknown, ...] = ()
    if clear:
        model, unknown = explain(model, clear[0], screened.screening, problem.select)
        unknowns = (unknown,) if unknown.kept or clear[0].p < UNKEPT_SURFACE_P else ()
    verdict = _verdict(found, screened.screening, unknowns, problem.config)
    return Judgement(verdict, found.without_footprints(), screened, model, unknowns, tuple(left))


def without_surfaces(judgement: Judgement, config: Config) -> Judgement:
    """Return a judgement without surfaces in the model, because they do not improve predictions. Clear surfaces are
    still reported.
    """
    unknowns = tuple(dropped(one) for one in judgement.unknowns if (one.p or 0.0) < UNKEPT_SURFACE_P)
    verdict = _verdict(judgement.found, judgement.screened.screening, unknowns, config)
    return replace(judgement, verdict=verdict, model=judgement.screened.model, unknowns=unknowns)


def _beyond(problem: Problem, found: SearchResult) -> tuple[ScreenedModel, list[Omnibus]]:
    """Return the model with the accepted effects, its scores and surface tests, and the tests of the clear surfaces."""
    replay, select, config = problem.replay, problem.select, problem.config
    current = found.state.current
    if not replay.simulator.surfaces:
        return ScreenedModel(current.model, current.screening, ()), []
    around = with_surfaces(replay, current.footprints)
    screened = fit_and_screen(replay, around, alpha=config.alpha, seed=config.seed, steps=REPORTED_FIT_STEPS)
    together = _with_select(around, replay, select, config) if select else screened
    return screened, clear_surfaces(found.accepted, screened, together, config)


def _leaving(
    problem: Problem, found: SearchResult, screened: ScreenedModel, clear: Sequence[Omnibus]
) -> dict[str, str]:
    """Return the accepted effects that must leave the final model, each with the reason."""
    model = screened.model
    if not found.accepted:
        return {}
    if unseen := _below_samples(problem, found, model):
        return unseen
    if impossible := out_of_range(model):
        least = min(found.accepted, key=lambda one: one.bic_gain)
        return {least.effect: next(iter(impossible.values()))}
    if clear and (similarities := doubtful(model, clear[0], found.accepted, problem.select, problem.config)):
        return dict.fromkeys(
            similarities, f"a fitted surface ({clear[0].surface.title}) explains the same error"
        )
    left = residual_bound(problem.select, found.floors)
    if unsure := vague(model, screened.tests, found.accepted, left, found.state.finite):
        beside = f" with a fitted surface ({clear[0].surface.title})" if clear else ""
        why = f"the 95 % interval of its size{beside} contains zero, if errors of the model are included"
        return {unsure[0]: why}
    owed = owed_to_form(model, found.accepted)
    if owed and clear:  # an unknown term may be the whole form error
        explained, _ = explain(model, clear[0], screened.screening, problem.select)
        owed = owed_to_form(explained, found.accepted)
    owed = (*owed, *no_clearer(model, clear, found.accepted))
    owed = tuple(name for name in owed if not is_predicted(model, name, problem.select, found.floors))
    return dict.fromkeys(owed, OWED)


def _below_samples(problem: Problem, found: SearchResult, model: FittedModel) -> dict[str, str]:
    """Return the accepted effects whose amplitude is below the resolution of the samples, each with the reason."""
    amplitudes = {one.effect: problem.hypotheses[one.effect].amplitude.name for one in found.accepted}
    return {
        effect: "it is smaller than the samples can resolve"
        for effect, name in amplitudes.items()
        if name in below_resolution(model, problem.hypotheses[effect])
    }


def _with_select(
    around: Footprints, replay: Replay, select: Sequence[MeasuredRun], config: Config
) -> ScreenedModel:
    """Fit and screen the model on the fit runs and the validation runs together, and return the result."""
    there = replay.of(select)
    point = around.point.with_records(there.records)
    further = with_surfaces(there, footprints(there, point, around.candidates))
    both = replay.of((*replay.runs, *select))
    return fit_and_screen(both, joined(around, further), alpha=config.alpha, seed=config.seed, last=True)


def final(verdict: Verdict, left: Remainder, rivals: int = 0) -> Verdict:
    """Return the verdict after the error on unseen runs is considered. ``rivals`` is the number of rivals that predict
    these runs equally well.
    """
    if verdict is Verdict.NO_EFFECT and left.large:
        return Verdict.UNRESOLVED
    if verdict not in {Verdict.NAMED, Verdict.REMAINDER}:
        return verdict
    if left.relative:
        return Verdict.UNRESOLVED
    if rivals:
        return Verdict.AMBIGUOUS
    return Verdict.REMAINDER if verdict is Verdict.NAMED and left.large else verdict


def _verdict(
    found: SearchResult, screening: Screening, unknowns: Sequence[Unknown], config: Config
) -> Verdict:
    explained = sum(accepted.lambda_**2 for accepted in found.accepted)
    rest = [i for i in screening.exceeding if screening.z[i] ** 2 > REMAINDER * explained]
    if not found.accepted:
        if any(unknown.kept for unknown in unknowns):
            return Verdict.UNKNOWN
        return Verdict.UNRESOLVED if unknowns or rest else Verdict.NO_EFFECT
    if found.ambiguous(config.ambiguous):
        return Verdict.AMBIGUOUS
    return Verdict.REMAINDER if unknowns or rest else Verdict.NAMED
