"""Many jobs of the bench at once: springs are integrated in lanes, and each only once however many jobs need it.

Theory of operation
-------------------
The sides of the bench meet only in its readings, so a job that differs from another in one spring shares the other's
trajectory, and one that differs in sensors alone, or in forces that follow from motion and pressure, shares both.
What differs is not told by names: two springs are one if everything that their integration depends on is equal bit by
bit (`bench_sim.model.lanes.LaneSpring.key`).
"""

from collections import Counter, OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from threading import Lock
from typing import Any, Final

import numpy as np

from bench_sim.model.lane_layout import LANES
from bench_sim.model.lanes import LaneSpring, integrate_springs
from bench_sim.model.traces import TracedReplay
from diagnosis.contracts import Array

#: Trajectories of an experiment that are kept from one batch to the next: both sides at four points.
_KEPT: Final = 8

Key = tuple[int, float, bytes]


@dataclass(frozen=True, slots=True, eq=False)
class Replayed:
    """One replay of a run with one parameter record: its springs, or none where no lane can integrate them.

    Then, or if air passes between them, it is replayed ``alone``, which returns the readings (n, c) of its ``sensors``
    (c,) if it can.
    """

    traced: TracedReplay
    kept: "KeptTraces"
    record: Any
    shift: float
    springs: tuple[LaneSpring, ...]
    sensors: Sequence[int]
    alone: Callable[[], Array | None]

    @property
    def keys(self) -> tuple[Key, ...]:
        """Of both springs."""
        return tuple(spring.key for spring in self.springs)

    def read(self, traces: Sequence[Array]) -> Array:
        """Return the readings (n, c) from the traces of both springs."""
        return self.traced.readings(self.record, traces, self.shift, self.sensors)


class KeptTraces:
    """The trajectories of one experiment that were used last; several threads may ask."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._traces: OrderedDict[Key, Array] = OrderedDict()

    def get(self, key: Key) -> Array | None:
        """Return a trajectory that is kept."""
        with self._lock:
            if key in self._traces:
                self._traces.move_to_end(key)
            return self._traces.get(key)

    def keep(self, key: Key, trace: Array) -> None:
        """Keep a trajectory, and forget the one that was not used for longest."""
        with self._lock:
            self._traces[key] = trace
            self._traces.move_to_end(key)
            while len(self._traces) > _KEPT:
                self._traces.popitem(last=False)


def read_all(jobs: Sequence[Replayed], effort: Counter[str]) -> Iterator[Array | None]:
    """Yield the readings (n, c) of each job in order, None of what cannot be replayed alone but would have to be.

    Equal jobs are one object, and get one array.

    What was done is added to the ``effort``: ``springs`` integrated in ``packs``, ``readings``, and among these replays
    ``alone``.
    """
    keys = {id(job): job.keys for job in jobs}
    uses = Counter(key for job in jobs for key in keys[id(job)])
    left = Counter(id(job) for job in jobs)
    sole = Counter(id(job.traced) for job in jobs)
    traces: dict[Key, Array] = {}
    missing: dict[Key, tuple[LaneSpring, KeptTraces, bool]] = {}
    for job in jobs:
        for key, spring in zip(keys[id(job)], job.springs, strict=True):
            if (found := job.kept.get(key)) is not None:
                traces[key] = found
            else:
                missing[key] = spring, job.kept, uses[key] > 1 or sole[id(job.traced)] == 1
    readings: dict[int, Array | None] = {}
    for job in jobs:
        mine = id(job)
        if mine not in readings:
            while any(key in missing for key in keys[mine]):
                pack = _next_pack(missing)
                traces.update(pack)
                effort.update(packs=1, springs=len(pack))
            ours = [traces[key] for key in keys[mine]]
            apart = bool(ours) and _finite(ours) and job.traced.stays_shut(job.record, ours)
            readings[mine] = job.read(ours) if apart else job.alone()
            effort.update(readings=1, alone=int(not apart))
        yield readings[mine]
        left[mine] -= 1
        if not left[mine]:
            del readings[mine]
        for key in keys[mine]:
            uses[key] -= 1
            if not uses[key]:
                del traces[key]


def _finite(traces: Sequence[Array]) -> bool:
    """Whether no trace has become NaN: it would be until its end."""
    return all(bool(np.isfinite(trace[-1]).all()) for trace in traces)


def _next_pack(missing: dict[Key, tuple[LaneSpring, KeptTraces, bool]]) -> dict[Key, Array]:
    """Integrate the springs that are needed next, as many as there are lanes, and take them from the ``missing``."""
    first = next(iter(missing.values()))[0]
    pack = [key for key, (spring, _, _) in missing.items() if spring.course.step == first.course.step][:LANES]
    done = dict(zip(pack, integrate_springs([missing[key][0] for key in pack]), strict=True))
    for key in pack:
        _, kept, keep = missing.pop(key)
        if keep:
            # A copy: the lanes beside it need not live as long.
            done[key] = done[key].copy()
            kept.keep(key, done[key])
    return done
