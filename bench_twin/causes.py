"""What may have made a rig part from its model: each cause of the catalogue by what it explains of a stretch.

A cause may have been there from the start of the stretch, or since about when rig and model parted. What it does since
then is the difference of two replays that begin there, with the cause and without: they begin in motion, which is not
known well, but that is the same in both.

A quick look, linear in the size of the cause and of all parameters: a diagnosis (`astb diagnose`) is slower, and knows
more. A cause explains a stretch if the twin that has it does not part from the rig (`bench_twin.detector`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from bench_twin.detector import Detector
from bench_twin.innovations import BIN, BINS, BLOCK, Belief, Bins, Columns, judge, rough
from diagnosis.contracts import Array, Experiment, Hypothesis, Job, MeasuredRun
from diagnosis.systems.air_spring.simulator import AirSpring

#: So many of the causes that explain most are looked at closely, at the size that they were found to have.
_CLOSELY: Final = 9
#: Simulations at a size that was found before.
_ROUNDS: Final = 2
#: A cause that began so many s after the start of a stretch is told from one that was there before.
_LATE: Final = 2.0
#: Causes that explain as much as the best but for so much of χ² are told beside it.
_ALIKE: Final = 9.0


#: Blocks before and after the parting at which a cause may have begun.
_NEAR: Final = (-30, -24, -16, -12, -8, -6, -4, -3, -2, -1, 0, 1, 2)
#: χ² by which a beginning may fit worse than the best and still be possible (k = 2).
_POSSIBLE: Final = 4.0


class Suspect(NamedTuple):
    """A cause with its size in SI, and the interval of that (k = 2) over all beginnings that are possible."""

    name: str
    size: float
    low: float
    high: float
    since: float  #: s of the stretch from which on it acts, 0 from before its start
    left: float  #: χ² that it leaves
    explains: bool  #: whether the twin with it goes along with the rig


def suspects(
    run: MeasuredRun, columns: Columns, belief: Belief, simulator: AirSpring, since: float
) -> list[Suspect]:
    """Return the causes that explain a stretch that parted ``since`` s of it, the best first; none if none does."""
    look = _Look(run, columns, belief, simulator)
    onsets = (0,) if since < _LATE else (0, round(since / BIN))
    tried = [one for onset in onsets for one in look.each(onset) if one.fit.size != 0.0]
    chosen: dict[tuple[str, int], _Tried] = {}
    for one in sorted(tried, key=lambda one: one.fit.left):
        if len(chosen) < _CLOSELY:
            chosen.setdefault((one.cause.name, one.onset), one)
    looked = look.closely(list(chosen.values()))
    ranked = sorted((one for one in looked if one.explains), key=lambda one: one.left)
    best = {one.name: one for one in reversed(ranked) if one.left < ranked[0].left + _ALIKE}
    return sorted(best.values(), key=lambda one: one.left)


class _Fitted(NamedTuple):
    """What least squares say of a column: its size, the standard deviation of that, and the χ² that is left."""

    size: float
    deviation: float
    left: float


class _Tried(NamedTuple):
    """A cause as it was tried: at one point of its grid, and since which bin (0: before the stretch)."""

    cause: Hypothesis
    shapes: Mapping[str, float]
    onset: int
    fit: _Fitted


class _Near(NamedTuple):
    """A cause that begins near where it was tried: the χ² that it leaves, its bin, what it adds (n, c), and its fit."""

    left: float
    onset: int
    column: Array
    fit: _Fitted


class _Look:
    """One look at a stretch."""

    def __init__(self, run: MeasuredRun, columns: Columns, belief: Belief, simulator: AirSpring) -> None:
        self._columns, self._belief, self._simulator = columns, belief, simulator
        self._fit = _Fit(columns, belief)
        self._replays = Replays(run, simulator)

    def each(self, onset: int) -> Iterator[_Tried]:
        """Yield every cause at every point of its grid, at its typical size, since a bin."""
        points = [
            (cause, dict(zip((shape.name for shape in cause.shapes), point, strict=True)))
            for cause in self._simulator.catalogue.values()
            for point in cause.grid
        ]
        sizes = [(cause, shapes, _typical(cause)) for cause, shapes in points]
        for (cause, shapes), column in zip(points, self._replays.columns(sizes, onset), strict=True):
            if column is not None:
                fit = self._fit.with_(column, _typical(cause))
                if not cause.one_sided or fit.size * _typical(cause) > 0.0:
                    yield _Tried(cause, shapes, onset, fit)

    def closely(self, chosen: Sequence[_Tried]) -> list[Suspect]:
        """Return causes at the size and with the beginning that simulations at that size tell.

        All that may have begun with a bin are simulated together.
        """
        sizes = [one.fit.size for one in chosen]
        near = [self._near(one.onset) for one in chosen]
        found: list[list[_Near]] = [[] for _ in chosen]
        for _ in range(_ROUNDS):
            sizes = [
                float(np.clip(size, one.cause.amplitude.low, one.cause.amplitude.high))
                for size, one in zip(sizes, chosen, strict=True)
            ]
            fitted: list[list[_Near]] = [[] for _ in chosen]
            for onset in sorted(set().union(*near)):
                some = [k for k, onsets in enumerate(near) if onset in onsets and sizes[k]]
                asked = [(chosen[k].cause, chosen[k].shapes, sizes[k]) for k in some]
                for k, column in zip(some, self._replays.columns(asked, onset), strict=True):
                    if column is not None:
                        fit = self._fit.with_(column, _typical(chosen[k].cause))
                        fitted[k].append(_Near(fit.left, onset, column, fit))
            found = [new or old for new, old in zip(fitted, found, strict=True)]
            sizes = [min(one, key=lambda near: near.left).fit.size if one else 0.0 for one in fitted]
        return [self._suspect(one.cause, tried) for one, tried in zip(chosen, found, strict=True) if tried]

    def _near(self, onset: int) -> set[int]:
        """Return the bins with which a cause may have begun that was tried with one."""
        last = len(self._columns.measured) - 2 * BINS
        return (
            {one for one in (onset + BINS * blocks for blocks in _NEAR) if 0 < one <= last} if onset else {0}
        )

    def _suspect(self, cause: Hypothesis, tried: Sequence[_Near]) -> Suspect:
        best = min(tried, key=lambda one: one.left)
        possible = [one.fit for one in tried if one.left <= best.left + _POSSIBLE]
        low = min(one.size - 2.0 * one.deviation for one in possible)
        high = max(one.size + 2.0 * one.deviation for one in possible)
        explained = self._columns._replace(simulated=self._columns.simulated + best.fit.size * best.column)
        white = judge(explained, self._belief, rough(self._columns)).white
        along = Detector(white.shape[1], BLOCK).look(white) is None
        return Suspect(cause.name, best.fit.size, low, high, best.onset * BIN, best.left, along)


class Replays:
    """What causes do to a stretch that began with a bin of it: differences of two replays that begin there."""

    def __init__(self, run: MeasuredRun, simulator: AirSpring) -> None:
        self._run, self._simulator = run, simulator
        self._bins = Bins(run)
        self._base = next(simulator.run_many([Job(run.experiment, {}, {})]))

    def columns(
        self, sizes: Sequence[tuple[Hypothesis, Mapping[str, float], float]], onset: int
    ) -> Iterator[Array | None]:
        """Yield what causes (with shapes) add since a bin, per unit of their sizes (n, c); None of impossible ones."""
        first = onset * self._bins.size
        experiment = self._from(first)
        jobs = [Job(experiment, {}, {})]
        jobs += [
            Job(experiment, {}, {cause.name: {cause.amplitude.name: size, **shapes}})
            for cause, shapes, size in sizes
        ]
        outputs = self._simulator.run_many(jobs)
        base = next(outputs)
        for (_, _, size), moved in zip(sizes, outputs, strict=True):
            if not np.isfinite(moved).all():
                yield None
                continue
            whole = np.zeros_like(self._base)
            whole[first:] = moved - base
            yield self._bins.mean(whole) / size

    def _from(self, first: int) -> Experiment:
        """Return the experiment from a sample on, with the pressures that the model has there."""
        experiment = self._run.experiment
        if first == 0:
            return experiment
        there = {
            channel.name: float(self._base[first, k])
            for k, channel in enumerate(self._simulator.channels)
            if channel.name in experiment.settings
        }
        return replace(
            experiment,
            time=experiment.time[first:] - experiment.time[first],
            inputs={name: values[first:] for name, values in experiment.inputs.items()},
            settings={**experiment.settings, **there, "start": 0.0},  # what drifts has not drifted yet
        )


def _typical(cause: Hypothesis) -> float:
    """The size of an ordinary fault, of the sign that is possible."""
    size = cause.amplitude.spread
    return -size if cause.amplitude.high <= 0.0 else size


class _Fit:
    """Least squares of the errors of a stretch by all parameters with their priors, and by one column more."""

    def __init__(self, columns: Columns, belief: Belief) -> None:
        variance = columns.noise / np.maximum(columns.samples, 1) + BINS * rough(columns) ** 2
        weight = np.where(columns.samples > 0, 1.0 / variance, 0.0)
        errors = columns.measured - columns.simulated
        H = columns.parameters.reshape(-1, columns.parameters.shape[-1])
        w = weight.reshape(-1)
        self._w, self._weighted = w, np.ascontiguousarray((H * w[:, None]).T)
        information = np.linalg.inv(belief.covariance)
        self._inverse = np.linalg.inv(information + self._weighted @ H)
        e = np.where(columns.samples > 0, errors, 0.0).reshape(-1) - H @ belief.mean
        self._pull = w * (e - H @ (self._inverse @ (self._weighted @ e)))  # of a column on what is left
        self._chi2 = float(e @ self._pull)

    def with_(self, column: Array, typical: float) -> _Fitted:
        """Return what a ``column`` (n, c) explains; nothing of what would not even be seen at its typical size."""
        x = column.reshape(-1)
        imitated = self._weighted @ x
        strength = float(x @ (self._w * x) - imitated @ self._inverse @ imitated)
        if strength * typical**2 < 1.0:
            return _Fitted(0.0, np.inf, self._chi2)
        size = float(x @ self._pull) / strength
        return _Fitted(size, strength**-0.5, self._chi2 - size**2 * strength)
