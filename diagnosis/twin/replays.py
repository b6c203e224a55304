"""Effects of causes on a stretch in which they begin: differences of two replays, divided by the size of the cause."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from diagnosis.contracts import Array, Experiment, Hypothesis, Job, MeasuredRun
from diagnosis.systems.air_spring.gas import BEFORE
from diagnosis.systems.air_spring.simulator import AirSpring
from diagnosis.twin.innovations import Bins

#: No size is tried beyond this part of the possible range.
_WITHIN: Final = 0.95
#: A cause that begins later has this part of its largest size before: a delay must exist from the start.
_SMALL: Final = 1e-9
#: A secant of logarithms of sizes that are so near together, or so steep, is not followed.
_SAME: Final = 1e-3
_STEEP: Final = 0.8


class Replays:
    """Computes the effects of causes on a stretch as differences of two replays that begin at the same bin."""

    def __init__(self, run: MeasuredRun, simulator: AirSpring) -> None:
        self._run, self._simulator = run, simulator
        self._bins = Bins(run)
        self._base = next(simulator.run_many([Job(run.experiment, {}, {})]))

    def columns(
        self, sizes: Sequence[tuple[Hypothesis, Mapping[str, float], float]], onset: int
    ) -> Iterator[Array | None]:
        """Yield for each cause its effect (n, c) from bin ``onset`` on, per unit of its size.

        None for a cause of size 0, and for one with which the simulation fails.
        """
        first = onset * self._bins.size
        experiment = self._experiment_from(first)
        jobs = [Job(experiment, {}, {})]
        jobs += [
            Job(experiment, {}, {cause.name: {cause.amplitude.name: size, **shapes}})
            for cause, shapes, size in sizes
        ]
        outputs = self._simulator.run_many(jobs)
        base = next(outputs)
        for (_, _, size), moved in zip(sizes, outputs, strict=True):
            if not size or not np.isfinite(moved).all():
                yield None
                continue
            whole = np.zeros_like(self._base)
            whole[first:] = moved - base
            yield self._bins.mean(whole) / size

    def changing(self, cause: Hypothesis, shapes: Mapping[str, float], sizes: Array) -> Array | None:
        """Return the effect (n, c) of a cause whose size changes from bin to bin (n,); None if the simulation fails."""
        small = _SMALL * np.abs(sizes).max()
        sizes = np.where(np.abs(sizes) > small, sizes, np.copysign(small, sizes.sum()))
        first = np.append(0, np.flatnonzero(np.diff(sizes)) + 1)
        values = [{cause.amplitude.name: float(sizes[k]), **shapes} for k in first]
        moved = self._simulator.run_turning(self._run.experiment, cause.name, values, first * self._bins.size)
        return self._bins.mean(moved - self._base) if np.isfinite(moved).all() else None

    def _experiment_from(self, first: int) -> Experiment:
        """Return the part of the experiment from sample ``first`` on. It starts with the simulated pressures at this
        sample.
        """
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
            settings={**experiment.settings, **there, BEFORE: 1.0, "start": 0.0},  # nothing has drifted yet
        )


class Secant:
    """Secant search for the size at which the fitted size equals the simulated one."""

    def __init__(self) -> None:
        self._trail: list[tuple[float, float]] = []  # logarithms of simulated and of fitted sizes

    def after(self, simulated: float, found: float) -> float:
        """Return the next size to simulate, after size ``found`` was fitted at size ``simulated``."""
        if found * simulated <= 0.0:
            return found
        self._trail.append((float(np.log(abs(simulated))), float(np.log(abs(found)))))
        if len(self._trail) > 1:
            (x0, g0), (x1, g1) = self._trail[-2:]
            slope = (g1 - g0) / (x1 - x0) if abs(x1 - x0) > _SAME else 0.0
            if slope < _STEEP:
                return float(np.copysign(np.exp((g1 - slope * x1) / (1.0 - slope)), found))
        return found


def bounded(cause: Hypothesis, size: float) -> float:
    """Return the size limited to slightly less than its possible range. At the very end, for example with a closed
    orifice, nothing could change further.
    """
    return float(np.clip(size, _WITHIN * cause.amplitude.low, _WITHIN * cause.amplitude.high))


def typical(cause: Hypothesis) -> float:
    """Return the typical size of a fault, with a sign that is possible for the cause."""
    size = cause.amplitude.spread
    return -size if cause.amplitude.high <= 0.0 else size


def can_be(cause: Hypothesis, size: float) -> bool:
    """Return whether a cause that acts may have this size: not 0, within its range, and with a possible sign."""
    amplitude = cause.amplitude
    signed = not cause.one_sided or size * typical(cause) > 0.0
    return size != 0.0 and signed and amplitude.low <= size <= amplitude.high
