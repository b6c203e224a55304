"""Many jobs of the bench at once: springs are integrated in lanes, and each only once however many jobs need it.

Theory of operation
-------------------
The sides of the bench meet only in its readings, so a job that differs from another in one spring shares the other's
trajectory, and one that differs in sensors alone, or in forces that follow from motion and pressure, shares both.
What differs is not told by names: two springs are one if everything that their integration depends on is equal bit by
bit (`bench_sim.model.lanes.key_of`).

Where air passes between the sides, both springs of a job are integrated together. A differential pressure valve that is
connected may stay shut, which shows when both have been integrated; once it has opened, no job of that run tries.
"""

from collections import Counter, OrderedDict
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from threading import Lock
from typing import Any, Final, NamedTuple

import numpy as np

from bench_sim.model.lane_layout import LANES
from bench_sim.model.lanes import LaneSpring, integrate_pairs, integrate_springs, key_of
from bench_sim.model.traces import TracedReplay
from diagnosis.contracts import Array

#: Trajectories of an experiment that are kept from one batch to the next: both sides at four points.
_KEPT: Final = 8

#: Springs that are integrated together: one, or both of a job.
Together = tuple[LaneSpring, ...]
Traces = tuple[Array, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Replayed:
    """One replay of a run with one parameter record: its springs, or none where no lane can integrate them.

    Then it is replayed ``alone``, which returns the readings (n, c) of its ``sensors`` (c,); a ``rough`` one is not.
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
        """Return the springs, those together that have to be."""
        if self.kept.opened or self.traced.leaks_between(self.record):
            return [self.springs] if self.springs and not self.rough else []
        return [(spring,) for spring in self.springs]

    def read(self, traces: Sequence[Array]) -> Array:
        """Return the readings (n, c) from the traces of both springs."""
        return self.traced.readings(self.record, traces, self.shift, self.sensors)


class KeptTraces:
    """The trajectories of one experiment that were used last; several threads may ask."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._traces: OrderedDict[Hashable, Traces] = OrderedDict()
        #: Whether the differential pressure valve has been seen to open.
        self.opened = False

    def get(self, key: Hashable) -> Traces | None:
        """Return trajectories that are kept."""
        with self._lock:
            if key in self._traces:
                self._traces.move_to_end(key)
            return self._traces.get(key)

    def keep(self, key: Hashable, traces: Traces) -> None:
        """Keep trajectories, and forget those that were not used for longest."""
        with self._lock:
            self._traces[key] = traces
            self._traces.move_to_end(key)
            while sum(map(len, self._traces.values())) > _KEPT:
                self._traces.popitem(last=False)


class _Missing(NamedTuple):
    """What has to be integrated, and whether it is kept for later batches."""

    springs: Together
    kept: KeptTraces
    keep: bool


def read_all(jobs: Sequence[Replayed], effort: Counter[str]) -> Iterator[Array | None]:
    """Yield the readings (n, c) of each job in order, None of what is rough and lanes cannot do so.

    Equal jobs are one object, and get one array.

    What was done is added to the ``effort``: ``springs`` integrated in ``packs``, ``readings``, and among these replays
    ``alone``.
    """
    parts = {id(job): {key_of(springs): springs for springs in job.parts()} for job in jobs}
    uses = Counter(key for job in jobs for key in parts[id(job)])
    left = Counter(id(job) for job in jobs)
    sole = Counter(id(job.traced) for job in jobs)
    traces: dict[Hashable, Traces] = {}
    missing: dict[Hashable, _Missing] = {}
    for job in jobs:
        for key, springs in parts[id(job)].items():
            if (found := job.kept.get(key)) is not None:
                traces[key] = found
            else:
                missing[key] = _Missing(springs, job.kept, uses[key] > 1 or sole[id(job.traced)] == 1)
    readings: dict[int, Array | None] = {}
    for job in jobs:
        mine = id(job)
        if mine not in readings:
            while any(key in missing for key in parts[mine]):
                traces.update(_integrated(missing, effort))
            ours = [trace for key in parts[mine] for trace in traces[key]]
            readings[mine] = _readings(job, ours, len(parts[mine]) > 1, effort)
        yield readings[mine]
        left[mine] -= 1
        if not left[mine]:
            del readings[mine]
        for key in parts[mine]:
            uses[key] -= 1
            if not uses[key]:
                del traces[key]


def _readings(job: Replayed, traces: Sequence[Array], apart: bool, effort: Counter[str]) -> Array | None:
    """Return what a job reads, from the traces of both springs if they are any good; integrated ``apart``, or not."""
    if traces and all(
        bool(np.isfinite(trace[-1]).all()) for trace in traces
    ):  # NaN would be there until the end
        if apart and not job.traced.stays_shut(job.record, traces):
            job.kept.opened = True
            if job.rough:
                return None
            left, right = job.springs
            (traces,) = integrate_pairs([(left, right)])
            effort.update(packs=1, springs=2)
        effort.update(readings=1)
        return job.read(traces)
    if job.rough:
        return None
    effort.update(readings=1, alone=1)
    return job.alone()


def _integrated(missing: dict[Hashable, _Missing], effort: Counter[str]) -> dict[Hashable, Traces]:
    """Integrate the springs that are needed next, as many as there are lanes, and take them from the ``missing``."""
    first = next(iter(missing.values())).springs
    pack = [
        key
        for key, (springs, _, _) in missing.items()
        if len(springs) == len(first) and springs[0].course.step == first[0].course.step
    ][: LANES // len(first)]
    chosen = [missing.pop(key) for key in pack]
    traces: list[Traces]
    if len(first) == 1:
        traces = [(trace,) for trace in integrate_springs([one.springs[0] for one in chosen])]
    else:
        traces = list(integrate_pairs([(one.springs[0], one.springs[1]) for one in chosen]))
    effort.update(packs=1, springs=len(first) * len(pack))
    for k, (key, (_, kept, keep)) in enumerate(zip(pack, chosen, strict=True)):
        if keep:
            # A copy: the lanes beside it need not live as long.
            traces[k] = tuple(trace.copy() for trace in traces[k])
            kept.keep(key, traces[k])
    return dict(zip(pack, traces, strict=True))
