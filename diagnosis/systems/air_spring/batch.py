"""Many jobs of the bench at once: springs are integrated in parallel lanes, and each different spring only once.

Theory of operation
-------------------
The two sides of the bench are independent except for the readings. So two jobs that differ in one spring share the
trajectory of the other one. Jobs that differ only in sensors, or in forces that follow from motion and pressure, share
both. Two springs count as the same if all inputs of their integration are equal bit by bit
(`bench_sim.model.lanes.springs.key_of`).

If air flows between the sides, both springs of a job are integrated together. Whether a connected differential pressure
valve stays shut is known only after both have been integrated. Once it has opened for one job of a run, the springs of
the other jobs of this run are also integrated together. The result is the same bit by bit if the valve stays shut.
"""

from collections import Counter, OrderedDict
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from threading import Lock
from typing import Any, Final, NamedTuple

import numpy as np

from bench_sim.model.lanes.layout import LANES
from bench_sim.model.lanes.springs import LaneSpring, integrate_pairs, integrate_springs, key_of
from bench_sim.model.lanes.traces import TracedReplay
from diagnosis.contracts import Array

#: Trajectories of an experiment that are kept from one batch to the next: both sides at one point.
_KEPT: Final = 2

#: Springs that are integrated together: one, or both of a job.
Together = tuple[LaneSpring, ...]
Traces = tuple[Array, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Replayed:
    """One replay of a run with one parameter record.

    ``springs`` are its springs; empty if the parallel lanes cannot integrate them. Then ``alone`` replays the run and
    returns the readings (n, c) of its ``sensors`` (c,). A ``rough`` replay cannot run alone.
    """

    traced: TracedReplay
    kept: "KeptTraces"
    record: Any
    shift: float
    springs: Together
    sensors: Sequence[int]
    alone: Callable[[], Array]
    rough: bool

    def parts(self) -> list[Together]:
        """Return the groups of springs to integrate: one group of both if air flows between them, otherwise each spring
        alone.
        """
        joined = self.traced.leaks_between(self.record) or (self.kept.opened and not self.rough)
        if joined and self.springs:
            return [self.springs]
        return [(spring,) for spring in self.springs]

    def opens(self, traces: Sequence[Array]) -> bool:
        """Return whether the differential pressure valve would have opened, judged from the traces of two springs
        integrated separately.
        """
        return not self.traced.stays_shut(self.record, traces)

    def read(self, traces: Sequence[Array]) -> Array:
        """Return the readings (n, c) of the sensors, from the traces of both springs."""
        return self.traced.readings(self.record, traces, self.shift, self.sensors)


class KeptTraces:
    """A cache of the latest trajectories of one experiment. Several threads may use it at once."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._traces: OrderedDict[Hashable, Traces] = OrderedDict()
        #: Whether the differential pressure valve has been seen to open. No output depends on it.
        self.opened = False

    def get(self, key: Hashable) -> Traces | None:
        """Return cached trajectories, or None."""
        with self._lock:
            if key in self._traces:
                self._traces.move_to_end(key)
            return self._traces.get(key)

    def keep(self, key: Hashable, traces: Traces) -> None:
        """Store trajectories, and remove the least recently used ones from a full cache."""
        with self._lock:
            self._traces[key] = traces
            self._traces.move_to_end(key)
            while sum(map(len, self._traces.values())) > _KEPT:
                self._traces.popitem(last=False)


class _Missing(NamedTuple):
    """Springs to integrate and the cache for their traces. ``sole``: no other job of the batch is for the same
    experiment.
    """

    springs: Together
    kept: KeptTraces
    sole: bool


def read_all(jobs: Sequence[Replayed], effort: Counter[str]) -> Iterator[Array | None]:
    """Yield the readings (n, c) of each job in order; None for approximate jobs that lanes cannot compute.

    Equal jobs must be one object; they get one array. The work is added to the counter ``effort``: ``springs``
    integrated in ``packs``, ``readings``, and replays ``alone`` among these.
    """
    batch = _Batch(jobs, effort)
    for job in jobs:
        yield batch.readings(job)
        batch.leave(job)


class _Batch:
    """Jobs that are read in order, and the traces that are still needed."""

    def __init__(self, jobs: Sequence[Replayed], effort: Counter[str]) -> None:
        self._effort = effort
        self._jobs = {id(job): job for job in jobs}
        self._left = Counter(id(job) for job in jobs)
        self._sole = Counter(id(job.traced) for job in jobs)
        self._parts: dict[int, dict[Hashable, Together]] = {}
        self._uses: Counter[Hashable] = Counter()
        self._missing: dict[Hashable, _Missing] = {}
        self._traces: dict[Hashable, Traces] = {}
        self._readings: dict[int, Array | None] = {}
        for job in self._jobs.values():
            self._request_traces(job)

    def readings(self, job: Replayed) -> Array | None:
        """Return the readings of a job; None for an approximate job that lanes cannot compute."""
        if id(job) not in self._readings:
            self._readings[id(job)] = self._read(job)
        return self._readings[id(job)]

    def leave(self, job: Replayed) -> None:
        """Note that a job has been read once, and release data that no other job needs."""
        self._release(job, 1)
        self._left[id(job)] -= 1
        if not self._left[id(job)]:
            del self._readings[id(job)]

    def _request_traces(self, job: Replayed) -> None:
        self._parts[id(job)] = {key_of(springs): springs for springs in job.parts()}
        for key, springs in self._parts[id(job)].items():
            self._uses[key] += self._left[id(job)]
            if key in self._traces or key in self._missing:
                continue
            if (found := job.kept.get(key)) is not None:
                self._traces[key] = found
            else:
                self._missing[key] = _Missing(springs, job.kept, self._sole[id(job.traced)] == 1)

    def _release(self, job: Replayed, times: int) -> None:
        for key in self._parts[id(job)]:
            self._uses[key] -= times
            if not self._uses[key]:
                self._traces.pop(key, None)
                self._missing.pop(key, None)

    def _read(self, job: Replayed) -> Array | None:
        traces = self._traces_of(job)
        if len(self._parts[id(job)]) > 1 and _good(traces) and job.opens(traces):
            job.kept.opened = True
            if job.rough:
                return None
            self._join(job.kept)
            traces = self._traces_of(job)
        if _good(traces):
            self._effort.update(readings=1)
            return job.read(traces)
        if job.rough:
            return None
        self._effort.update(readings=1, alone=1)
        return job.alone()

    def _traces_of(self, job: Replayed) -> list[Array]:
        parts = self._parts[id(job)]
        while any(key in self._missing for key in parts):
            self._integrate()
        return [trace for key in parts for trace in self._traces[key]]

    def _join(self, kept: KeptTraces) -> None:
        """Request both springs together for all unread jobs of a run whose valve has opened. They had requested them
        separately.
        """
        for mine, job in self._jobs.items():
            unread = self._left[mine] and mine not in self._readings
            if unread and job.kept is kept and not job.rough and len(self._parts[mine]) > 1:
                self._release(job, self._left[mine])
                self._request_traces(job)

    def _integrate(self) -> None:
        """Integrate the springs that are needed next, up to the number of lanes, and store their traces."""
        first = next(iter(self._missing.values())).springs
        pack = [
            key
            for key, (springs, _, _) in self._missing.items()
            if len(springs) == len(first) and springs[0].course.step == first[0].course.step
        ][: LANES // len(first)]
        chosen = [self._missing.pop(key) for key in pack]
        traces: list[Traces]
        if len(first) == 1:
            traces = [(trace,) for trace in integrate_springs([one.springs[0] for one in chosen])]
        else:
            traces = list(integrate_pairs([(one.springs[0], one.springs[1]) for one in chosen]))
        self._effort.update(packs=1, springs=len(first) * len(pack))
        for key, (_, kept, sole), found in zip(pack, chosen, traces, strict=True):
            self._traces[key] = found
            if sole or self._uses[key] > 1:
                # A copy: the lanes together with it need not live as long.
                self._traces[key] = tuple(trace.copy() for trace in found)
                kept.keep(key, self._traces[key])


def _good(traces: Sequence[Array]) -> bool:
    """Return whether there are traces and their last values are finite. A NaN in a trace would remain until its end."""
    return bool(traces) and all(bool(np.isfinite(trace[-1]).all()) for trace in traces)
