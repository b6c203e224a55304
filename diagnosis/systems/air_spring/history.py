"""The history of a bench before a run, expressed by the state of its rubber.

Theory of operation
-------------------
The time before a run is not replayed. But the state of slow rubber depends on it, by a mean over the past with the
weight e^{−s/τ} for s seconds ago:

    M(τ) = ∫ x(s) e^{−(t − s)/τ} ds/τ

A Kelvin element has crept under a force F by q = (r/k) M(τ), where M is that of F. The dash-pot of a Maxwell branch is
at M(τ) of the displacement of the bellows: it is *behind* by x − M(τ), which gives its force. A fractional element has
branches of half a minute and of minutes, which still have a force from the filling of the bellows. So M is computed
from the record for memories from seconds to hours; between them it is smooth in ln τ.

The time before the first sample of a record is unknown. The bench is assumed to have been in the state of the first
sample since it was switched on, and without load before that. The displacement of the bellows is that of the spring
minus the deflection of its emergency spring, ζ_b = ζ + (F − P)/k; shims for another P do not change it. In the lateral
direction the emergency spring takes a twentieth of the shear, which is neglected.
"""

from collections.abc import Callable, Mapping
from functools import cache, lru_cache
from typing import Any, Final

import numpy as np
from scipy.interpolate import PchipInterpolator

from bench_protocol.words import SIDES
from bench_records.record import Record
from bench_sim.model.layout import LATERAL
from bench_sim.model.replay import Before
from bench_sim.parameters import Parameters
from diagnosis.contracts import Array
from diagnosis.systems.air_spring.parity import CELLS, spring_forces
from diagnosis.systems.motion import SENSORS, binned, sheared

#: Time constants τ (s) for which the past is stored, half a decade apart.
MEMORIES: Final = (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0, 10000.0)
#: Averaging time (s) of readings. Every τ is longer.
_MEAN: Final = 1.0
#: Averaging time (s) of the reading at the end of the past. A run begins at rest.
_NOW: Final = 0.1
#: A dash-pot with this time constant (s) has followed its bellows when a run begins. Settings exist only for the slower
#: `MEMORIES`.
_AT_ONCE: Final = 0.3
#: Name of the motion that dash-pots of both sides follow laterally; vertically they follow the bellows of their side.
SHEAR: Final = "shear"


class Past:
    """The part of a record before ``time`` (s), as means over n seconds. The bench was switched on ``on`` s before that
    time.

    ``edges`` (n + 1,) are the borders of the seconds. Means of seconds without samples are interpolated; before the
    first sample they are equal to the first mean.
    """

    def __init__(self, record: Record, time: float, on: float) -> None:
        self._record = record
        self._time = time
        self.edges = np.arange(time - _MEAN * np.ceil(on / _MEAN), time + 0.5 * _MEAN, _MEAN)
        self.means = cache(self._means)

    def __bool__(self) -> bool:
        """Return whether the bench was switched on before the time."""
        return len(self.edges) > 1

    def knows(self, *names: str) -> bool:
        """Return whether all of the signals have samples."""
        return all(name in self._record.signals and self.means(name).size for name in names)

    def until_now(self, name: str) -> Array:
        """Return the means (n + 1,) of a signal; the last element is its present value, at the end of the past."""
        times, values = self._record.series(name)
        now = np.isfinite(values) & (times >= self._time) & (times < self._time + _NOW)
        means = self.means(name)
        return np.append(means, values[now].mean() if now.any() else means[-1])

    def forgotten(self, memory: float) -> tuple[Array, float]:
        """Return the weight of each second (n,) in M(τ), and the weight of all time before; ``memory`` is τ in s."""
        left = np.exp(-np.maximum(self._time - self.edges, 0.0) / memory)
        return np.diff(left), float(left[0])

    def _means(self, name: str) -> Array:
        """Return the means (n,) of a signal; empty without samples."""
        times, values = self._record.series(name)
        known = np.isfinite(values)
        count, total = binned(times[known], values[known], self.edges)
        seen = np.flatnonzero(count)
        if not seen.size:
            return np.empty(0)
        return np.interp(np.arange(len(count)), seen, total[seen] / count[seen])


def load_setting(side: str, memory: float) -> str:
    """Return the name of the setting that holds M(τ) of the load of one spring; ``memory`` is τ in s."""
    return f"{side}.load_over_{memory:g}_s"


def behind_setting(place: str, memory: float) -> str:
    """Return the name of the setting that holds the distance of a dash-pot behind its bellows; ``memory`` is τ in s."""
    return f"{place}.behind_over_{memory:g}_s"


def remembered_loads(past: Past, parameters: Parameters) -> dict[str, float]:
    """Return the settings that hold M(τ) of the loads of both springs (N); empty without load cells."""
    if not past or not past.knows(*CELLS):
        return {}
    forces = spring_forces({name: past.means(name) for name in CELLS}, parameters.record)
    return {
        load_setting(side, memory): float(past.forgotten(memory)[0] @ force)
        for side, force in zip(SIDES, forces, strict=True)
        for memory in MEMORIES
    }


def remembered_places(
    past: Past, parameters: Parameters, preload: Callable[[Array], Array]
) -> dict[str, float]:
    """Return the settings that hold x − M(τ) of the displacements of both bellows and of their shear (m).

    ``preload`` returns the shimmed load (N per spring) at given times (n,). Without heights the result is empty.
    Without load cells emergency springs are assumed rigid; other missing signals are assumed constant.
    """
    if not past or not past.knows(*(f"{side}.height" for side in SIDES)):
        return {}
    par = parameters.record
    seen = {name: past.until_now(name) for name in SENSORS if past.knows(name)}
    places = {side: seen[f"{side}.height"].copy() for side in SIDES}
    if par.emergency_spring != 0.0 and past.knows(*CELLS):
        forces = spring_forces({name: past.until_now(name) for name in CELLS}, par)
        for side, force, stiffness in zip(SIDES, forces, par.emergency_stiffness_vertical, strict=True):
            places[side] += (force - preload(past.edges)) / float(stiffness)
    if "lateral.displacement" in seen:
        known = past.knows("lateral.force")
        force = past.until_now("lateral.force") if known else np.zeros(len(past.edges))
        places[SHEAR] = sheared(seen, force / float(par.frame_stiffness[LATERAL]), par)
    distances = {}
    for place, values in places.items():
        for memory in MEMORIES:
            weights, before = past.forgotten(memory)
            mean = weights @ values[:-1] + before * values[0]
            distances[behind_setting(place, memory)] = float(values[-1] - mean)
    return distances


def before(settings: Mapping[str, float], par: Any) -> Before:
    """Return the state of the rubber at the start of a run, from the settings of the run."""
    memory = Before.at_rest()
    for i, side in enumerate(SIDES):
        if par.creep_ratio[i]:
            load = remembered(settings, side, float(par.creep_time[i]))
            memory.crept[i] = par.creep_ratio[i] * load / par.emergency_stiffness_vertical[i]
    for j in np.flatnonzero(par.extra_branch_ratio):
        time = float(par.extra_branch_time[j])
        memory.behind[j] = [behind(settings, place, time) for place in (*SIDES, SHEAR, SHEAR)]
    return memory


def remembered(settings: Mapping[str, float], side: str, memory: float) -> float:
    """Return M(τ) of the load (N) of one spring; ``memory`` is τ in s. 0 if the run has no such settings."""
    if load_setting(side, MEMORIES[0]) not in settings:
        return 0.0
    loads = tuple(settings[load_setting(side, known)] for known in MEMORIES)
    return _between(MEMORIES, loads, memory)


def behind(settings: Mapping[str, float], place: str, memory: float) -> float:
    """Return the distance (m) of a dash-pot behind its ``place`` (the bellows of a side, or `SHEAR`); 0 without
    settings.

    ``memory`` is the time constant of the dash-pot in s. The bench's own dash-pots are fast: they forget the past
    before the first counted sample.
    """
    if behind_setting(place, MEMORIES[0]) not in settings:
        return 0.0
    distances = tuple(settings[behind_setting(place, known)] for known in MEMORIES)
    return _between((_AT_ONCE, *MEMORIES), (0.0, *distances), memory)


@lru_cache(maxsize=4096)
def _between(memories: tuple[float, ...], values: tuple[float, ...], memory: float) -> float:
    """Return the value at ``memory``, interpolated smoothly over the logarithm of ``memories``; constant beyond the
    ends.
    """
    place = np.log(np.clip(memory, memories[0], memories[-1]))
    return float(PchipInterpolator(np.log(memories), values)(place))
