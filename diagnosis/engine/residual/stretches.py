"""Stretches of a run with a simple motion of an input: swings with one amplitude and period, or holds."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.signal import find_peaks

from diagnosis.contracts import Array, Experiment
from diagnosis.engine.config import LEAST_CYCLES, LEAST_HOLD_S, SAME_CYCLE, SINE_SHARE, STILL_SHARE

Samples = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Swing:
    """Equal cycles of one input: samples ``edges[i]`` to ``edges[i + 1]`` are one cycle, between upward crossings of
    the middle.

    ``amplitude`` is half the peak-to-peak value; ``sine`` is False for other forms, for example a triangle.
    """

    signal: str
    edges: tuple[int, ...]
    frequency: float
    amplitude: float
    mean: float
    sine: bool

    @property
    def start(self) -> int:
        """The first sample."""
        return self.edges[0]

    @property
    def stop(self) -> int:
        """The index after the last sample."""
        return self.edges[-1]


@dataclass(frozen=True, slots=True)
class Hold:
    """Samples ``start`` to ``stop`` in which every input is at rest."""

    start: int
    stop: int


def moving(experiment: Experiment) -> dict[str, Array]:
    """Return the inputs (n,) that move in a run."""
    return {
        name: values
        for name, values in experiment.inputs.items()
        if np.all(np.isfinite(values)) and np.ptp(values) > 1e-9 * max(1.0, float(np.max(np.abs(values))))
    }


def swings(experiment: Experiment, signal: str) -> list[Swing]:
    """Return the stretches of at least three equal cycles in an input.

    A cycle begins where the input rises through the middle of its swing. Cycles belong together while period and swing
    stay within 5 % of those of the first.
    """
    u = experiment.inputs[signal]
    found: list[Swing] = []
    edges = _risings(u)
    if edges.size <= LEAST_CYCLES:
        return found
    lengths = np.diff(edges)
    heights = np.array([np.ptp(u[a:b]) for a, b in pairwise(edges)])
    first = 0
    for i in range(1, lengths.size + 1):
        alike = i < lengths.size and (
            abs(lengths[i] - lengths[first]) <= SAME_CYCLE * lengths[first] + 1
            and abs(heights[i] - heights[first]) <= SAME_CYCLE * heights[first]
        )
        if alike:
            continue
        cycles = edges[first : i + 1]
        # The outermost cycles may begin or end in another motion.
        cycles = cycles[int(i - first > LEAST_CYCLES + 1) : cycles.size - int(i - first > LEAST_CYCLES)]
        if cycles.size > LEAST_CYCLES:
            found.append(_swing(experiment, signal, cycles))
        first = i
    return found


def _risings(u: Array) -> Samples:
    """Return the samples at which the input rises through the middle between a trough and the next crest.

    Crests and troughs with a prominence below 2 % of the range are noise.
    """
    least = 0.02 * float(np.ptp(u))
    crests, troughs = (find_peaks(side, prominence=least)[0] for side in (u, -u))
    edges = []
    for trough, following in pairwise([*troughs, u.size]):
        inside = crests[(crests > trough) & (crests < following)]
        if inside.size:
            crest = inside[0]
            rise = u[trough : crest + 1] > 0.5 * (u[trough] + u[crest])
            edges.append(trough + int(np.argmax(rise)))
    return np.array(edges, dtype=np.int64)


def _swing(experiment: Experiment, signal: str, edges: Samples) -> Swing:
    u = experiment.inputs[signal][edges[0] : edges[-1]]
    frequency = 1.0 / (float(np.polyfit(np.arange(edges.size), edges, 1)[0]) * experiment.step)
    waves = harmonics(u.size, experiment.step, frequency, 1)
    basis = np.column_stack((np.ones(u.size), waves))
    left = u - basis @ np.linalg.lstsq(basis, u, rcond=None)[0]
    return Swing(
        signal=signal,
        edges=tuple(int(edge) for edge in edges),
        frequency=float(frequency),
        amplitude=0.5
        * float(
            np.mean(
                [np.ptp(u[a:b]) for a, b in zip(edges[:-1] - edges[0], edges[1:] - edges[0], strict=True)]
            )
        ),
        mean=float(np.mean(u)),
        sine=bool(np.var(left) <= (1.0 - SINE_SHARE) * np.var(u)),
    )


def harmonics(n: int, step: float, frequency: float, order: int) -> Array:
    """Return cosine and sine (n, 2) of one harmonic of a frequency in Hz."""
    phase = 2.0 * np.pi * order * frequency * step * np.arange(n)
    return np.column_stack((np.cos(phase), np.sin(phase)))


def holds(experiment: Experiment) -> list[Hold]:
    """Return the stretches of at least 5 s in which no input moves by more than 1 % of its range in the run.

    The movement is measured within half a second, so that an input may drift slowly.
    """
    n = experiment.time.size
    still = np.ones(n, dtype=bool)
    window = max(2, round(0.5 / experiment.step))
    for u in moving(experiment).values():
        still &= _local_range(u, window) <= STILL_SHARE * np.ptp(u)
    borders = np.flatnonzero(np.diff(np.concatenate(([0], still.astype(np.int8), [0]))))
    least = round(LEAST_HOLD_S / experiment.step)
    return [Hold(int(a), int(b)) for a, b in borders.reshape(-1, 2) if b - a >= least]


def _local_range(u: Array, window: int) -> Array:
    difference: Array = maximum_filter1d(u, window, mode="nearest") - minimum_filter1d(
        u, window, mode="nearest"
    )
    return difference
