"""Watches the limit detectors of a simulated rig: the smallest margin of each, the trips, and the air that was taken
in.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from bench_protocol.frames import Block, join
from bench_protocol.words import SIDES, LimitKind
from bench_sim.model.layout import Input, State
from bench_sim.rig.controls import FAST
from bench_sim.rig.limits import Limit, LimitAction
from bench_sim.rig.rig import Rig

#: Number of samples that are evaluated together.
_BLOCK: Final = 4096
_ENDS: Final = (LimitKind.LOWER, LimitKind.UPPER)


class Closest(NamedTuple):
    """The smallest margin of a limit. ``judged`` is the value that the limit compares with its threshold, in SI."""

    judged: float  #: the value farthest out for the duration that the limit requires; NaN if there is none
    tick: int  #: when, in ticks of the rig
    rest: float  #: first reading; 0 for a quantity without a position


class Trip(NamedTuple):
    """A limit that tripped: its number, the tick, and the judged value."""

    row: int
    tick: int
    judged: float


class LimitWatch:
    """Observes every sample between a rig and its clock, up to the first trip that ends a plan.

    Later samples do not count, because the bench then vents and sinks.
    """

    def __init__(self, rig: Rig, limits: Sequence[Limit]) -> None:
        self._rig, self._limits = rig, limits
        self._tick = self._looked = 0
        self._detectors = rig.detectors
        self._sense = rig.detectors["sense"].copy()
        self._samples = rig.detectors["samples"].copy()
        self._tail = max(1, int(self._samples.max()))
        self._judged = np.full((_BLOCK + self._tail, len(limits)), -np.inf)
        self._count = self._tail  # the first rows are from the block before
        self._worst = np.full(len(limits), -np.inf)
        self._worst_tick = np.zeros(len(limits), np.int64)
        self._rest = np.full(len(limits), np.nan)
        self._known = np.zeros(len(limits), np.bool_)
        self._masses = self._air()
        self.air = 0.0  #: kg that both springs took in from the supply
        self.trips: list[Trip] = []
        self.over: Trip | None = None  #: the trip that ends the plan

    def run(self, ticks: int) -> Block:
        """Run the rig for ``ticks`` ticks, like `Rig.run`, and observe its limits."""
        blocks = []
        while ticks > 0:
            part = min(ticks, FAST - self._tick % FAST)
            blocks.append(self._rig.run(part))
            self._tick += part
            ticks -= part
            if self._tick % FAST == 0 and self.over is None:
                self._sample_detectors()
        return blocks[0] if len(blocks) == 1 else join(blocks)

    def closest(self) -> list[Closest]:
        """Return the smallest margin of every limit."""
        self._sum_up()
        place = np.isin([limit.kind for limit in self._limits], _ENDS)
        rest = np.where(place, self._rest, 0.0)
        return [
            Closest(
                float(sense * worst) if np.isfinite(worst) else np.nan, int(tick), float(sense * start) + 0.0
            )
            for sense, worst, tick, start in zip(
                self._sense, self._worst, self._worst_tick, rest, strict=True
            )
        ]

    def _sample_detectors(self) -> None:
        self._looked = self._tick
        judged, tripped = self._detectors["judged"], self._detectors["tripped"] != 0
        self._judged[self._count] = judged
        self._count += 1
        if np.isnan(self._rest).any():
            self._rest = np.where(np.isnan(self._rest), judged, self._rest)
        masses = self._air()
        if self._rig.plant.inputs[Input.SUPPLY] > 0.0:  # air that enters a vented spring does not count
            self.air += float(np.maximum(masses - self._masses, 0.0).sum())
        self._masses = masses
        if (tripped & ~self._known).any():
            self._trip(np.flatnonzero(tripped & ~self._known))
        self._known = tripped
        if self._count == len(self._judged):
            self._sum_up()

    def _trip(self, rows: npt.NDArray[np.intp]) -> None:
        for row in rows.tolist():
            judged = float(self._sense[row] * self._detectors["judged"][row])
            self.trips.append(Trip(row, self._tick, judged))
            if self.over is None and self._limits[row].action >= LimitAction.PROGRAM_HOLD:
                self.over = self.trips[-1]

    def _air(self) -> npt.NDArray[np.float64]:
        """Return the mass of air in each spring (kg), including its auxiliary chamber, so that internal flow does not
        count.
        """
        state, both = self._rig.plant.state, len(SIDES)
        bellows = state[State.BELLOWS_MASS : State.BELLOWS_MASS + both]
        return bellows + state[State.AUXILIARY_MASS : State.AUXILIARY_MASS + both]

    def _sum_up(self) -> None:
        """Store for each limit the largest value that lasted for the required number of samples."""
        rows = self._judged[: self._count]
        new = self._count - self._tail
        if new == 0:
            return
        rows = np.where(np.isnan(rows), -np.inf, rows)
        for samples in np.unique(self._samples[self._samples > 0]).tolist():
            of = np.flatnonzero(self._samples == samples)
            windows = np.lib.stride_tricks.sliding_window_view(
                rows[self._tail - samples + 1 :, of], samples, axis=0
            )
            stood = windows.min(axis=-1)
            place = stood.argmax(axis=0)
            farthest = stood[place, np.arange(of.size)]
            farther = farthest > self._worst[of]
            self._worst[of[farther]] = farthest[farther]
            self._worst_tick[of[farther]] = self._looked - FAST * (new - 1 - place[farther])
        self._judged[: self._tail] = self._judged[self._count - self._tail : self._count]
        self._count = self._tail
