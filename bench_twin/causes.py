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
#: Simulations at a size that was found before: over all beginnings that are possible, and, of so many causes that
#: explain most, closely around the best.
_ROUNDS: Final = 2
_FINE_ROUNDS: Final = 2
_FINELY: Final = 3
#: A secant of logarithms of sizes that are so near together, or so steep, is not followed.
_SAME: Final = 1e-3
_STEEP: Final = 0.8
#: No size is tried beyond so much of what is possible.
_WITHIN: Final = 0.95
#: Sizes, in ordinary ones, at which causes are tried: large ones only where no small one explains the stretch.
_SIZES: Final = (1.0, 5.0)
#: A cause that began so many s after the start of a stretch is told from one that was there before.
_LATE: Final = 2.0
#: Causes that explain as much as the best but for so much of χ² are told beside it.
_ALIKE: Final = 9.0


#: Bins before and after the parting at which a cause may have begun: whole blocks.
_NEAR: Final = tuple(BINS * block for block in (-30, -24, -16, -12, -8, -6, -4, -3, -2, -1, 0, 1, 2))
#: The same where it is looked for closely.
_NEARER: Final = (-8, -5, -3, -2, -1, 0, 1, 2, 3, 5, 8)
#: χ² by which a beginning may fit worse than the best and still be possible (k = 2).
_POSSIBLE: Final = 4.0


class Suspect(NamedTuple):
    """A cause with its size in SI, and the interval of that (k = 2) over all beginnings that are possible."""

    name: str
    size: float
    low: float
    high: float
    since: float  #: s of the stretch from which on it acts, 0 from before its start
    since_low: float  #: interval of that (k = 2)
    since_high: float
    left: float  #: χ² that it leaves
    explains: bool  #: whether the twin with it goes along with the rig


def suspects(
    run: MeasuredRun, columns: Columns, belief: Belief, simulator: AirSpring, since: float
) -> list[Suspect]:
    """Return the causes that explain a stretch that parted ``since`` s of it, the best first; none if none does."""
    look = _Look(run, columns, belief, simulator)
    onsets = (0,) if since < _LATE else (0, round(since / BIN))
    ranked: list[Suspect] = []
    for times in _SIZES:
        tried = [one for onset in onsets for one in look.each(onset, times) if one.fit.size != 0.0]
        chosen: dict[tuple[str, int], _Tried] = {}
        for one in sorted(tried, key=lambda one: one.fit.left):
            if len(chosen) < _CLOSELY:
                chosen.setdefault((one.cause.name, one.onset), one)
        ranked = sorted(look.closely(list(chosen.values())), key=lambda one: one.left)
        ranked = [one for one in ranked if one.explains]
        if ranked:
            break
    alike = [one for one in ranked if one.left < ranked[0].left + _ALIKE]
    return [
        _over([one for one in alike if one.name == name]) for name in dict.fromkeys(one.name for one in alike)
    ]


def _over(ranked: Sequence[Suspect]) -> Suspect:
    """Return the first of the suspects of one name, with the intervals of all that explain as much."""
    best = ranked[0]
    possible = [one for one in ranked if one.left <= best.left + _POSSIBLE]
    return best._replace(
        low=min(one.low for one in possible),
        high=max(one.high for one in possible),
        since_low=min(one.since_low for one in possible),
        since_high=max(one.since_high for one in possible),
    )


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


_NOTHING: Final[Array] = np.empty((0, 0))


class _Closely:
    """A cause that is looked at closely: its present ``size``, where it may begin, what its last round ``found``."""

    def __init__(self, tried: _Tried, near: set[int]) -> None:
        self.tried, self.near = tried, near
        self.size = _possible(tried.cause, tried.fit.size)
        self.found: list[_Near] = []
        self._all: list[_Near] = []
        self._trail: list[tuple[float, float]] = []  # logarithms of sizes, and of what they were found to be

    @property
    def best(self) -> _Near:
        """The beginning that explains most."""
        return min(self.found, key=lambda one: one.left)

    @property
    def possible(self) -> list[_Near]:
        """All beginnings of all rounds that explain as much as the best one does."""
        return [one for one in self._all if one.left <= self.best.left + _POSSIBLE]

    def learn(self, near: list[_Near]) -> None:
        """Take over a round: the next size is where what is found would be what was simulated, by the secant."""
        if not near:
            self.size = 0.0
            return
        self.found = near
        self._all += [one._replace(column=_NOTHING) for one in near]
        found = self.best.fit.size
        if found * self.size > 0.0:
            self._trail.append((float(np.log(abs(self.size))), float(np.log(abs(found)))))
            if len(self._trail) > 1:
                (x0, g0), (x1, g1) = self._trail[-2:]
                slope = (g1 - g0) / (x1 - x0) if abs(x1 - x0) > _SAME else 0.0
                if slope < _STEEP:
                    found = float(np.copysign(np.exp((g1 - slope * x1) / (1.0 - slope)), found))
        self.size = _possible(self.tried.cause, found)


class _Look:
    """One look at a stretch."""

    def __init__(self, run: MeasuredRun, columns: Columns, belief: Belief, simulator: AirSpring) -> None:
        self._columns, self._belief, self._simulator = columns, belief, simulator
        self._fit = _Fit(columns, belief)
        self._replays = Replays(run, simulator)

    def each(self, onset: int, times: float) -> Iterator[_Tried]:
        """Yield every cause at every point of its grid, at so many times its typical size, since a bin."""
        points = [
            (cause, dict(zip((shape.name for shape in cause.shapes), point, strict=True)))
            for cause in self._simulator.catalogue.values()
            for point in cause.grid
        ]
        sizes = [(cause, shapes, _possible(cause, times * _typical(cause))) for cause, shapes in points]
        for (cause, shapes), column in zip(points, self._replays.columns(sizes, onset), strict=True):
            if column is not None:
                fit = self._fit.with_(column, _typical(cause))
                if not cause.one_sided or fit.size * _typical(cause) > 0.0:
                    yield _Tried(cause, shapes, onset, fit)

    def closely(self, chosen: Sequence[_Tried]) -> list[Suspect]:
        """Return causes at the size and with the beginning that simulations at that size tell.

        All that may have begun with a bin are simulated together.
        """
        looks = [_Closely(one, self._around(one.onset, _NEAR)) for one in chosen]
        for _ in range(_ROUNDS):
            self._simulate(looks)
        looks = [one for one in looks if one.found]
        best = sorted(looks, key=lambda one: one.best.left)[:_FINELY]
        for _ in range(_FINE_ROUNDS):
            for one in best:
                one.near = self._around(one.best.onset, _NEARER)
            self._simulate(best)
        return [self._suspect(one) for one in looks]

    def _simulate(self, looks: Sequence[_Closely]) -> None:
        """Simulate causes at their present sizes with all beginnings near theirs, and take over what that tells."""
        fitted: list[list[_Near]] = [[] for _ in looks]
        for onset in sorted(set[int]().union(*(one.near for one in looks))):
            some = [k for k, one in enumerate(looks) if onset in one.near and one.size]
            asked = [(looks[k].tried.cause, looks[k].tried.shapes, looks[k].size) for k in some]
            for k, column in zip(some, self._replays.columns(asked, onset), strict=True):
                if column is not None:
                    fit = self._fit.with_(column, _typical(looks[k].tried.cause))
                    fitted[k].append(_Near(fit.left, onset, column, fit))
        for one, near in zip(looks, fitted, strict=True):
            one.learn(near)

    def _around(self, onset: int, bins: Sequence[int]) -> set[int]:
        """Return the bins with which a cause may have begun that was tried with one; 0 is before the stretch."""
        last = len(self._columns.measured) - 2 * BINS
        return {one for one in (onset + off for off in bins) if 0 < one <= last} if onset else {0}

    def _suspect(self, look: _Closely) -> Suspect:
        best = look.best
        possible = look.possible
        low = min(one.fit.size - 2.0 * one.fit.deviation for one in possible)
        high = max(one.fit.size + 2.0 * one.fit.deviation for one in possible)
        explained = self._columns._replace(simulated=self._columns.simulated + best.fit.size * best.column)
        white = judge(explained, self._belief, rough(self._columns)).white
        along = Detector(white.shape[1], BLOCK).look(white) is None
        since = (
            best.onset * BIN,
            min(one.onset for one in possible) * BIN,
            max(one.onset for one in possible) * BIN,
        )
        return Suspect(look.tried.cause.name, best.fit.size, low, high, *since, best.left, along)


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


def _possible(cause: Hypothesis, size: float) -> float:
    """The nearest size that is possible, not quite all of it: where nothing flows any more, more is the same."""
    return float(np.clip(size, _WITHIN * cause.amplitude.low, _WITHIN * cause.amplitude.high))


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
