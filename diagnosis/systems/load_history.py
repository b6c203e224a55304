"""What a bench stood under before a run began, as rubber that creeps remembers it.

Theory of operation
-------------------
A Kelvin element under a force F(t) has crept by q = (r/k) L, where

    L(τ) = ∫ F(s) e^{−(t − s)/τ} ds/τ

is the load that a memory of τ keeps. What happened before a run is not replayed, so its record is asked for L, at
memories from seconds to hours; between them it is smooth in ln τ. Before the bench was switched on nothing is known,
and no load is assumed.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np

from bench_protocol.words import SIDES
from bench_records.record import Record
from bench_sim.parameters import Parameters
from diagnosis.contracts import Array
from diagnosis.systems.air_spring_parity import CELLS, spring_forces

#: Memories in s at which the load is told, half a decade apart.
MEMORIES: Final = (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0, 10000.0)
#: Forces are averaged over so many seconds: no memory is shorter.
_MEAN: Final = 1.0


def setting(side: str, memory: float) -> str:
    """Return the name of the setting that tells L of one spring for a memory of so many seconds."""
    return f"{side}.load_over_{memory:g}_s"


def remembered_loads(record: Record, time: float, on: float, parameters: Parameters) -> dict[str, float]:
    """Return the settings that tell L(τ) of both springs (N) at a ``time`` of a record; none without load cells.

    The bench had been switched on for ``on`` s. Before the first sample the load was that of the first one, before the
    bench was on there was none.
    """
    edges = np.arange(time - _MEAN * np.ceil(on / _MEAN), time + 0.5 * _MEAN, _MEAN)
    if len(edges) < 2 or not set(CELLS) <= set(record.signals):
        return {}
    means = {name: _means(*record.series(name), edges) for name in CELLS}
    if not all(values.size for values in means.values()):
        return {}
    forces = spring_forces(means, parameters.record)
    ages = time - edges
    kept = {memory: np.diff(np.exp(-np.maximum(ages, 0.0) / memory)) for memory in MEMORIES}
    return {
        setting(side, memory): float(weights @ force)
        for side, force in zip(SIDES, forces, strict=True)
        for memory, weights in kept.items()
    }


def remembered(settings: Mapping[str, float], side: str, memory: float) -> float:
    """Return L of a spring (N) for a memory of so many seconds; 0 where no setting tells it."""
    if setting(side, MEMORIES[0]) not in settings:
        return 0.0
    from scipy.interpolate import PchipInterpolator

    loads = [settings[setting(side, known)] for known in MEMORIES]
    place = np.log(np.clip(memory, MEMORIES[0], MEMORIES[-1]))
    return float(PchipInterpolator(np.log(MEMORIES), loads)(place))


def _means(times: Array, values: Array, edges: Array) -> Array:
    """Return the means (n − 1,) of a signal between ``edges`` (n,), held where there is no sample; () without any."""
    known = np.isfinite(values)
    count, _ = np.histogram(times[known], edges)
    total, _ = np.histogram(times[known], edges, weights=values[known])
    seen = np.flatnonzero(count)
    if not seen.size:
        return np.empty(0)
    return np.interp(np.arange(len(count)), seen, total[seen] / count[seen])
