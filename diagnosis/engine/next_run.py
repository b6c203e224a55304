"""What would decide between rivals that explain the data alike: a run of a menu, or a reference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Protocol, runtime_checkable

import numpy as np

from diagnosis.contracts import Array, DiagnosisError, Experiment, MeasuredRun
from diagnosis.engine.config import MOST_REFERENCES, SEPARABLE, WORTH_A_REFERENCE
from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.fitting.linear import Linearisation, solve
from diagnosis.engine.fitting.predict import Prediction, predict
from diagnosis.engine.noise import filters
from diagnosis.finding import NextRun, NextSensor, number


@runtime_checkable
class HasReferences(Protocol):
    """A simulator that knows how to learn some of its nuisances otherwise, such as by a calibration."""

    @property
    def references(self) -> Mapping[str, str]:
        """What to do, by the name of the nuisance that becomes known."""
        ...


def rank(rivals: Sequence[FittedModel], menu: Sequence[Experiment]) -> list[NextRun]:
    """Rank experiments by how far they would part the two rivals that they part least, per minute of the rig.

    Buzzi-Ferraris and Forzatti (1983), after Hunter and Reiner (1965): if one rival is true, the other predicts the
    run worse by so much, in units of BIC, after it has taken up what its parameters can within what the data so far
    say of them.  The smaller of both directions counts.  A gap under `SEPARABLE` may be an upper bound.  Raises
    ``DiagnosisError`` for an experiment without minutes.
    """
    return sorted(
        (_ranked(rivals, experiment) for experiment in menu), key=lambda run: -(run.per_minute or 0.0)
    )


def _ranked(rivals: Sequence[FittedModel], experiment: Experiment) -> NextRun:
    if not experiment.minutes > 0.0:
        raise DiagnosisError(
            f"the experiment {experiment.name} costs {experiment.minutes:g} minutes; a menu needs a positive cost"
        )
    runs = _simulated(rivals, experiment)
    pairs = {f"{_name(a)} / {_name(b)}": (a, b) for a, b in combinations(rivals, 2)}
    gap, pair = min((_distance(a, b, runs), pair) for pair, (a, b) in pairs.items())
    # Parameters that adapt bring rivals nearer together: what is too near already need not wait for them.
    if gap >= SEPARABLE:
        foreseen = _foreseen(runs)
        gap, pair = min((_parted(a, b, foreseen), pair) for pair, (a, b) in pairs.items())
    return NextRun(
        experiment=experiment.name,
        minutes=experiment.minutes,
        bic_gap=number(gap),
        per_minute=number(gap / experiment.minutes),
        pair=pair,
    )


def separation(first: FittedModel, second: FittedModel, experiment: Experiment) -> float:
    """The BIC gap which an experiment adds between two fitted models, whichever of them is true; the smaller one."""
    return _parted(first, second, _foreseen(_simulated((first, second), experiment)))


@dataclass(frozen=True, slots=True, eq=False)
class _Foreseen:
    """An experiment as one model predicts it, and how well that model predicts it then."""

    run: MeasuredRun
    prediction: Prediction


def _simulated(models: Sequence[FittedModel], experiment: Experiment) -> dict[FittedModel, MeasuredRun]:
    """Return the experiment as each model predicts it."""
    shape = (experiment.time.size, len(models[0].replay.simulator.channels))
    always, never = np.ones(shape[0], dtype=bool), np.zeros(shape[0], dtype=bool)
    blank = MeasuredRun(experiment, np.zeros(shape), always, never)
    return {m: replace(blank, outputs=m.replay.of([blank]).predictions(m.point)[0]) for m in models}


def _distance(first: FittedModel, second: FittedModel, runs: Mapping[FittedModel, MeasuredRun]) -> float:
    """χ² between the predictions of two models before any parameter adapts, under the noise of the first."""
    (whiten,) = filters(first.noise, [runs[first]])
    return float(np.sum(whiten(runs[first].outputs - runs[second].outputs) ** 2)) / first.noise.dispersion


def _foreseen(runs: Mapping[FittedModel, MeasuredRun]) -> dict[FittedModel, _Foreseen]:
    """Return how well each model predicts its run. Under one noise they share the columns of their nuisances."""
    foreseen: dict[FittedModel, _Foreseen] = {}
    for model, run in runs.items():
        known = next((foreseen[m].prediction.linearisation for m in foreseen if m.noise is model.noise), None)
        foreseen[model] = _Foreseen(run, predict(model, [run], known))
    return foreseen


def _parted(first: FittedModel, second: FittedModel, foreseen: Mapping[FittedModel, _Foreseen]) -> float:
    return min(_advantage(first, second, foreseen), _advantage(second, first, foreseen))


def _advantage(true: FittedModel, other: FittedModel, foreseen: Mapping[FittedModel, _Foreseen]) -> float:
    """2·(lpd of the true model − lpd of the other one) on the run as the true model predicts it."""
    here, known = foreseen[true], foreseen[other].prediction.linearisation
    return 2.0 * (here.prediction.lpd - predict(other, [here.run], known).lpd)


def _name(model: FittedModel) -> str:
    return " + ".join(model.effects) or "base model"


def sensors(first: FittedModel, second: FittedModel) -> list[NextSensor]:
    """References that would part two rivals on the runs there are, the best first: nuisances to be known otherwise.

    For each nuisance: the BIC gap λ²(1 − cosine²) of the first rival's effects against the second rival, if the
    nuisance could no longer adapt.
    """
    footprint = _footprint(first, second)
    here = second.linearisation
    now = _left(here, footprint, np.ones(len(here.point.numbers), dtype=bool))
    known = second.replay.simulator.references if isinstance(second.replay.simulator, HasReferences) else {}
    found = []
    for name in dict.fromkeys(c.parameter.name for c in here.point.coordinates if not c.owner):
        free = np.array([bool(c.owner) or c.parameter.name != name for c in here.point.coordinates])
        gap = _left(here, footprint, free)
        if gap > WORTH_A_REFERENCE * now:
            how = known.get(name, f"measure {name} against a reference")
            found.append(
                NextSensor(
                    name=name,
                    bic_gap=number(gap),
                    sentence=f"{how}: the gap grows from {now:.3g} to {gap:.3g}",
                )
            )
    return sorted(found, key=lambda sensor: -(sensor.bic_gap or 0.0))[:MOST_REFERENCES]


def _footprint(first: FittedModel, second: FittedModel) -> list[Array]:
    """What the effects of the first model that the second lacks change in the outputs: whitened (n, c) of each run."""
    point = first.point
    numbers = point.numbers.copy()
    own = set(first.effects) - set(second.effects)
    names = [c for c in point.coordinates if c.owner in own]
    # An amplitude is 0 at its nominal value: the first parameter of each effect.
    for owner in own:
        place = point.place(next(c for c in names if c.owner == owner))
        numbers[place] = point.coordinates[place].inside(0.0)
    without = first.replay.predictions(point.at(numbers))
    return [
        f(whole - less)
        for f, whole, less in zip(
            filters(first.noise, first.replay.runs), first.predictions, without, strict=True
        )
    ]


def _left(
    here: Linearisation, footprint: Sequence[Array], free: np.ndarray[tuple[int], np.dtype[np.bool_]]
) -> float:
    """The squared norm of a footprint after the free coordinates have taken up what they can."""
    mixed, own = np.zeros(len(free)), 0.0
    for block, values in zip(here.blocks, footprint, strict=True):
        mixed[block.places] += block.against(values.reshape(1, -1))[:, 0]
        own += float(np.vdot(values, values))
    gram = here.information[np.ix_(free, free)]
    return max(own - float(mixed[free] @ solve(gram, mixed[free])), 0.0)
