"""Naming: which causes enter the model, through which gates, and which others would explain the data as well."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np

from diagnosis.contracts import Array, Hypothesis, MeasuredRun
from diagnosis.engine.config import Config
from diagnosis.engine.fitting.fit import FittedModel, fit
from diagnosis.engine.fitting.point import Point, base_point, effect_coordinates
from diagnosis.engine.fitting.predict import Prediction, predict
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.footprints import Footprints, candidates, footprints
from diagnosis.engine.gates import noise_floors, unfit, unphysical, useless
from diagnosis.engine.noise import quietest, white
from diagnosis.engine.screening import Screening, fit_and_screen

RIVALS: Final = 4  #: so many others are tried in the place of each accepted effect
PAIRED: Final = 4  #: so many causes that are not physical alone are tried two by two
SUBSTITUTE: Final = (
    0.1  #: what passes the gates gains at least this part of what the best that does not would gain
)
COMPARABLE: Final = 0.5  #: a rival gains at least this part of the BIC that the accepted effect gains

Progress = Callable[[str, float], None]


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """What came of fitting a model with ``effect`` in it. ``failed`` is the gate that it did not pass, or ""."""

    effect: str
    point: Point
    covariance: Array  #: of the point's numbers (k, k)
    penalised_chi2: float
    bic: float  #: with what a member of a family that contains others must explain beyond them
    lpd: float  #: of the select runs; NaN where there are none, or where a better trial made it needless
    failed: str = ""
    physical: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """The effects that were in the model, the scores of all others against it, and the trials of what stood out."""

    effects: tuple[str, ...]
    screen: Screening
    trials: tuple[Trial, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Accepted:
    """An accepted effect: its score z, its strength λ, what it gains over the model without it, and its rivals."""

    effect: str
    z: float
    strength: float
    bic_gain: float
    lpd_gain: float  #: NaN where there are no select runs
    rivals: tuple[Trial, ...]  #: physical models with another effect in its place, best first


@dataclass(frozen=True, slots=True, eq=False)
class Naming:
    """All that the search found. ``base`` and ``model`` were fitted under the same noise.

    ``screen`` is the last one, of what is not in the model, seen ``around`` it; ``floors`` (c,) is what noise alone
    leaves.
    """

    steps: tuple[Step, ...]
    accepted: tuple[Accepted, ...]
    base: FittedModel
    model: FittedModel
    prediction: Prediction | None
    screen: Screening
    around: Footprints
    floors: Array

    def confused(self, gap: float) -> list[tuple[Accepted, Trial]]:
        """Return accepted effects with each rival that comes within a BIC gap of them."""
        return [(a, r) for a in self.accepted for r in a.rivals if r.bic - self.model.bic < gap]


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    """A model with its scores, its prediction of the select runs, and the χ² that its effects have explained."""

    model: FittedModel
    screen: Screening
    around: Footprints
    prediction: Prediction | None
    explained: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """A stepwise search over a catalogue: forwards with a swap pass at each step, then backwards.

    A step takes in one cause, or two where neither makes sense alone.
    """

    replay: Replay  #: on the fit runs
    select: tuple[MeasuredRun, ...]
    effects: Mapping[str, Hypothesis]
    config: Config
    progress: Progress

    def run(self) -> Naming:
        """Search; the result is the same for the same seed, however many workers there are."""
        self.progress("fitting the base model", 0.0)
        state = self._stand(self._start())
        floors = noise_floors(
            self.replay.simulator.channels, (*self.replay.runs, *self.select), state.model.noise
        )
        steps: list[Step] = []
        pool: dict[str, list[str]] = {}
        rivals: dict[str, tuple[Trial, ...]] = {}
        starts: dict[str, Point] = {}
        while True:
            done = len(state.model.effects) / self.config.max_effects
            trials: tuple[Trial, ...] = ()
            if done < 1.0:
                self.progress(f"fitting what stands out against {_told(state.model)}", 0.1 + 0.8 * done)
                trials = self._trials(state, floors)
            steps.append(Step(state.model.effects, replace(state.screen, columns=()), trials))
            starts |= {trial.effect: trial.point for trial in trials}
            chosen = self._choose(state, trials, starts, floors) or self._pair(state, trials, floors)
            if chosen is None:
                break
            for gone in set(state.model.effects) - set(chosen.point.owners):
                pool[chosen.effect] = [gone, *pool.pop(gone)]
            others = _comparable(state.model.bic, chosen, trials)
            for new in set(chosen.point.owners) - set(state.model.effects):
                pool[new] = list(dict.fromkeys((*others, *pool.get(new, ()))))
            explained = state.explained + state.model.penalised_chi2 - chosen.penalised_chi2
            state = replace(self._stand(chosen.point), explained=explained)
            state, rivals = self._swap(state, pool, starts)
        return self._settle(steps, state, rivals, floors)

    def _start(self) -> Point:
        """Fit the base model under white noise, to be near before anything is judged."""
        replay = self.replay
        point = base_point(replay.simulator.nuisances, replay.names)
        residuals = replay.residuals(replay.predictions(point))
        deviations = []
        for i, channel in enumerate(replay.simulator.channels):
            errors = np.concatenate(
                [r[run.counted[:, i], i] for r, run in zip(residuals, replay.runs, strict=True)]
            )
            deviations.append(channel.noise or max(float(np.std(errors)), quietest(channel), 1e-150))
        return fit(replay, white(deviations), point, target=0.0).point

    def _stand(self, point: Point) -> _State:
        """Re-estimate the noise around a point, refit, score everything that is not in the model, predict."""
        entries = candidates([e for name, e in self.effects.items() if name not in point.owners])
        around = footprints(self.replay, point, entries)
        sight = fit_and_screen(self.replay, around, alpha=self.config.alpha, seed=self.config.seed)
        return _State(sight.model, sight.screen, around, self._predict(sight.model))

    def _predict(self, model: FittedModel, before: Prediction | None = None) -> Prediction | None:
        if not self.select:
            return None
        return predict(model, self.select, before.linearisation if before else None)

    def _trials(self, state: _State, floors: Array) -> tuple[Trial, ...]:
        """Fit what stands out, and what is easily confused with the best of it or contains it."""
        scores = state.screen
        exceeding = scores.exceeding[: self.config.fits]
        wanted = {scores.candidates[i].effect.name: i for i in exceeding}
        for i in exceeding[:2]:
            effect = scores.candidates[i].effect
            for name in (*effect.richer, *effect.confusers):
                if name in self.effects and name not in state.model.effects:
                    wanted.setdefault(name, scores.best(name))
        fits: dict[str, FittedModel] = {}
        for name, i in wanted.items():
            start = scores.start(state.model.point, i)
            best = min((model.penalised_chi2 for model in fits.values()), default=math.inf)
            fits[name] = self._fit(start, state, best)
        trials: list[Trial] = []
        for name in sorted(fits, key=lambda name: fits[name].bic + self._more(name, fits[name], state)):
            model, prediction = fits[name], None
            failed = unfit(model, name, state.model) or self._rough(state, model)
            if not failed and all(trial.failed for trial in trials):
                prediction = self._predict(model, state.prediction)
                failed = useless(model, prediction, state.model, state.prediction, floors, self.config)
            physical = not unphysical(model, name, state.model)
            trials.append(_trial(name, model, prediction, failed, physical, self._more(name, model, state)))
        return tuple(trials)

    def _fit(self, start: Point, state: _State, target: float = math.inf) -> FittedModel:
        return fit(self.replay, state.model.noise, start, state.model.linearisation, target=target)

    def _attempt(self, effect: str, start: Point, state: _State, target: float = math.inf) -> Trial:
        """Fit and predict a model that must be physical."""
        model = self._fit(start, state, target)
        prediction = self._predict(model, state.prediction)
        failed = unphysical(model, effect, state.model)
        return _trial(effect, model, prediction, failed, more=self._more(effect, model, state))

    def _more(self, name: str, model: FittedModel, state: _State) -> float:
        """Return the χ² that an effect could gain over a poorer member of its family where that is only rough."""
        if not any(name in effect.richer for effect in self.effects.values()):
            return 0.0
        return self.config.rough**2 * max(
            state.explained + state.model.penalised_chi2 - model.penalised_chi2, 0.0
        )

    def _rough(self, state: _State, model: FittedModel) -> str:
        """Return why a further cause may be no more than what the causes found so far are wrong by; "" if it is more.

        No equation is exact: of a cause in plain view, a small part is left that noise would not leave.
        """
        gained = max(state.model.penalised_chi2 - model.penalised_chi2, 0.0)
        roughness = self.config.rough**2 * state.explained
        if not state.explained or gained >= roughness + state.screen.threshold**2:
            return ""
        part = math.sqrt(gained / state.explained)
        return f"leaves {100.0 * part:.2g} % of the trace of what was found before, which may be rough by as much"

    def _choose(
        self, state: _State, trials: Sequence[Trial], starts: Mapping[str, Point], floors: Array
    ) -> Trial | None:
        """Return the best trial through all gates, the first in the order of BIC; None where there is none.

        One that explains next to nothing of what another does, which is not physical, is no substitute for it. Two
        causes must explain clearly more than one richer cause in the place of the first: else that one it is, if it is
        worth its parameters.
        """
        chosen = next((trial for trial in trials if not trial.failed), None)
        if chosen is None:
            return None
        impossible = min((trial.bic for trial in trials if not trial.physical), default=math.inf)
        if state.model.bic - chosen.bic < SUBSTITUTE * (state.model.bic - impossible):
            return None
        inside = state.model.effects
        singles: list[Trial] = []
        for old in inside:
            richer = dict.fromkeys(
                name
                for relative in (old, *self.effects[old].confusers)
                if relative in self.effects
                for name in self.effects[relative].richer
                if name in starts and name not in inside
            )
            for name in richer:
                start = _replaced(state.model.point, old, self.effects[name], starts[name])
                single = self._attempt(name, start, state)
                clearly = chosen.bic < single.bic - self.config.ambiguous and not (
                    chosen.lpd <= single.lpd + self.config.lpd_loss
                )
                if not (single.failed or clearly):
                    singles.append(single)
        if not singles:
            return chosen
        worth = [single for single in singles if single.bic < state.model.bic]
        return min(worth, key=lambda trial: trial.bic, default=None)

    def _pair(self, state: _State, trials: Sequence[Trial], floors: Array) -> Trial | None:
        """Return the best model with two more causes at once, of those of which each alone is not physical.

        A cause that is missing strains what is believed of the base model, and the other one gets the blame.
        """
        strained = [trial for trial in trials if not trial.physical][:PAIRED]
        found: list[Trial] = []
        for first, second in combinations(strained, 2):
            one, two = self.effects[first.effect], self.effects[second.effect]
            if one.family == two.family or len(state.model.effects) + 2 > self.config.max_effects:
                continue
            shapes = [second.point.effects()[two.name][shape.name] for shape in two.shapes]
            start = first.point.extended(effect_coordinates(two), (0.0, *shapes))
            model = self._fit(start, state)
            failed = unfit(model, two.name, state.model) or unphysical(model, one.name, state.model)
            if failed or self._rough(state, model):
                continue
            prediction = self._predict(model, state.prediction)
            if not useless(model, prediction, state.model, state.prediction, floors, self.config):
                more = self._more(one.name, model, state) + self._more(two.name, model, state)
                found.append(_trial(two.name, model, prediction, "", more=more))
        return min(found, key=lambda trial: trial.bic, default=None)

    def _swap(
        self, state: _State, pool: dict[str, list[str]], starts: Mapping[str, Point]
    ) -> tuple[_State, dict[str, tuple[Trial, ...]]]:
        """Try rivals in the place of each effect under the present noise, and let a better one in."""
        seen = {frozenset(state.model.effects)}  # under another noise, what went may look better again
        while True:
            rivals: dict[str, tuple[Trial, ...]] = {}
            for old in state.model.effects:
                fits = [
                    self._attempt(
                        name,
                        _replaced(state.model.point, old, self.effects[name], starts[name]),
                        state,
                        target=state.model.penalised_chi2,
                    )
                    for name in [n for n in pool[old] if n not in state.model.effects][:RIVALS]
                ]
                rivals[old] = tuple(sorted((t for t in fits if not t.failed), key=lambda trial: trial.bic))
            better = [
                (trial.bic, old, trial)
                for old, trials in rivals.items()
                for trial in trials
                if trial.bic < state.model.bic and frozenset(trial.point.owners) not in seen
            ]
            if not better:
                return state, rivals
            _, old, new = min(better, key=lambda swap: swap[0])
            seen.add(frozenset(new.point.owners))
            pool[new.effect] = [old, *(name for name in pool.pop(old) if name != new.effect)]
            state = replace(self._stand(new.point), explained=state.explained)

    def _settle(
        self, steps: list[Step], state: _State, rivals: dict[str, tuple[Trial, ...]], floors: Array
    ) -> Naming:
        """Say what each effect is worth beside the others, and leave out what is not worth its parameters."""
        self.progress("weighing what was found", 0.9)
        model = state.model
        without: dict[str, Trial] = {}
        for name in model.effects:
            without[name] = self._attempt(name, model.point.without(name), state)
        idle = [name for name in without if without[name].bic <= model.bic]
        if idle:
            least = min(idle, key=lambda name: without[name].bic)
            state = self._stand(without[least].point)
            kept = {name: rivals[name] for name in state.model.effects}
            return self._settle(steps, state, kept, floors)
        scores = {
            step.screen.candidates[i].effect.name: float(step.screen.z[i])
            for step in steps
            for i in sorted(range(len(step.screen.candidates)), key=lambda i: float(step.screen.z[i]))
        }
        lpd = state.prediction.lpd if state.prediction else float("nan")
        accepted = tuple(
            Accepted(
                name,
                scores[name],
                float(np.sqrt(max(without[name].penalised_chi2 - model.penalised_chi2, 0.0))),
                without[name].bic - model.bic,
                lpd - without[name].lpd,
                rivals[name],
            )
            for name in model.effects
        )
        base = model
        if accepted:
            start = model.point
            for name in model.effects:
                start = start.without(name)
            base = fit(self.replay, model.noise, start, model.linearisation)
        return Naming(
            tuple(steps), accepted, base, model, state.prediction, state.screen, state.around, floors
        )


def _trial(
    effect: str,
    model: FittedModel,
    prediction: Prediction | None,
    failed: str,
    physical: bool = True,
    more: float = 0.0,
) -> Trial:
    lpd = prediction.lpd if prediction else float("nan")
    return Trial(
        effect, model.point, model.covariance(), model.penalised_chi2, model.bic + more, lpd, failed, physical
    )


def _replaced(point: Point, old: str, effect: Hypothesis, start: Point) -> Point:
    """Return a point with an effect in the place of another, where ``start`` has it."""
    values = start.effects()[effect.name]
    coordinates = effect_coordinates(effect)
    return point.without(old).extended(coordinates, [values[c.parameter.name] for c in coordinates])


def _comparable(bic: float, chosen: Trial, trials: Iterable[Trial]) -> list[str]:
    """Return the other effects whose fits gain at least a good part of what the chosen one gains."""
    least = max(COMPARABLE * (bic - chosen.bic), 0.0)
    return [t.effect for t in trials if t.effect != chosen.effect and bic - t.bic > least]


def _told(model: FittedModel) -> str:
    return " + ".join(("the base model", *model.effects))
