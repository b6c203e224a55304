"""The tick loop in real time, on a clock that stalls when the test says so."""

import threading

import numpy as np
import pytest

from bench_protocol.frames import FRAME
from bench_sim.rig.controls import TICK_NS
from bench_sim.rig.process import Late, keep_time


class StallingClock:
    """Time that passes in sleep alone, and stands still for others for ``stalls[k]`` ns at the k-th tick."""

    def __init__(self, stalls: dict[int, int]) -> None:
        self.time, self.stalls, self.sleeps = 0, stalls, 0
        self.pauses: list[int] = []

    def now(self) -> int:
        return self.time

    def sleep_until(self, deadline: int) -> None:
        if deadline % TICK_NS == 0 and self.time <= deadline:
            self.sleeps += 1
            self.time = deadline + self.stalls.get(self.sleeps, 0)
        elif deadline > self.time:  # the pause after a stall: not on the tick's own grid
            self.pauses.append(self.time)
            self.time = deadline


class CountingRig:
    """Counts ticks and lateness and ends the loop."""

    def __init__(self, ticks: int, stop: threading.Event) -> None:
        self.ticks, self.stop, self.lateness, self.lost = ticks, stop, [], []

    def report_lateness(self, lateness: float, *, lost: bool) -> None:
        self.lateness.append(lateness)
        self.lost.append(lost)

    def tick(self) -> np.ndarray:
        if len(self.lateness) == self.ticks:
            self.stop.set()
        block = np.zeros(1, FRAME)
        block["time"] = len(self.lateness) * TICK_NS
        return block


def run(stalls: dict[int, int], ticks: int = 400, policy: Late = Late.CATCH_UP):
    stop, clock, times = threading.Event(), StallingClock(stalls), []
    rig = CountingRig(ticks, stop)
    keep_time(rig, lambda block: times.append(int(block["time"][0])), stop, clock, policy)
    return rig, clock, np.array(times)


def test_caught_up_ticks_keep_their_nominal_times() -> None:
    rig, clock, times = run({100: 7_500_000})
    assert set(np.diff(times)) == {TICK_NS}
    assert sum(lateness >= 1e-3 for lateness in rig.lateness) == 7
    assert clock.time == pytest.approx(400 * TICK_NS, abs=TICK_NS), "nothing is lost in the end"


def test_after_a_stall_the_readers_come_first() -> None:
    """Commands that arrived while everything stood still must be read before the missed ticks are counted."""
    _, clock, _ = run({100: 127_300_000})
    assert clock.pauses == [100 * TICK_NS + 127_300_000], "once, not for every tick that is caught up"
    _, clock, _ = run({100: 5_300_000})
    assert clock.pauses == [], "a late tick is no stall"


def test_skipping_lets_the_rigs_time_stand_still() -> None:
    rig, _, times = run({100: 7_500_000}, policy=Late.SKIP)
    assert sum(lateness >= 1e-3 for lateness in rig.lateness) == 1
    assert sorted(set(np.diff(times))) == [TICK_NS, 8 * TICK_NS]


def test_a_lost_tick_is_a_fault_only_if_asked_for() -> None:
    assert not any(run({100: 127_300_000})[0].lost)
    assert any(run({100: 127_300_000}, policy=Late.FAULT)[0].lost)
    assert not any(run({100: 50_300_000}, policy=Late.FAULT)[0].lost)
