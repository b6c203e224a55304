"""The tick in real time: its pace, stalls, the policies for late ticks, and what leaves through the ring."""

import contextlib
import os
import select
import threading
from collections.abc import Iterator

import numpy as np
import pytest

from bench_protocol.clock import RealClock, hurry
from bench_protocol.frames import Block, join
from bench_protocol.runtime.pacing import Late, Pacing
from bench_protocol.runtime.ring import Ring, drain, fill
from bench_protocol.table import TABLE
from bench_protocol.units import NS, ms, s
from bench_protocol.words import BenchState
from bench_sim.model.layout import State
from bench_sim.rig.controls import FAST, TICK_NS
from bench_sim.rig.lateness import count_lateness
from bench_sim.rig.rig import Rig

FAST_ID = TABLE.messages[TABLE.message_index["SpringLeft"]].identifier


class Ticking:
    """A rig that ticks in real time, and its outputs."""

    def __init__(self, rig: Rig, eventfd: int) -> None:
        self.rig, self._eventfd = rig, eventfd
        self._blocks: list[Block] = []

    def wait(self, seconds: float) -> Block:
        """Collect for so long, as the eventfd says; return all frames since the start."""
        clock = RealClock()
        while (left := seconds - clock.now() / NS) > 0:
            if select.select([self._eventfd], [], [], left)[0]:
                os.eventfd_read(self._eventfd)
                self._blocks.append(self.rig.collect())
        return join(self._blocks)


@contextlib.contextmanager
def ticking(rig: Rig, policy: Late = Late.CATCH_UP) -> Iterator[Ticking]:
    eventfd = os.eventfd(0, os.EFD_NONBLOCK)

    def tick() -> None:
        hurry(10)  # as the process does
        rig.keep_time(eventfd, policy)

    thread = threading.Thread(target=tick)
    thread.start()
    try:
        yield Ticking(rig, eventfd)
    finally:
        rig.pacing.stop()
        thread.join(2 * s)
        assert not thread.is_alive()
        os.close(eventfd)


def sampling_times(block: Block) -> np.ndarray:
    return block["time"][block["id"] == FAST_ID]


@pytest.mark.real_time
def test_caught_up_ticks_keep_their_nominal_times(make_rig) -> None:
    rig = make_rig()
    with ticking(rig) as running:
        running.wait(0.1 * s)
        rig.pacing.stall(round(7.5 * ms * NS))
        times = sampling_times(running.wait(0.1 * s))
    assert set(np.diff(times)) == {FAST * TICK_NS}
    assert rig.values[TABLE.index["rig.late_ticks"]] >= 7
    assert 7.5 * ms <= rig.values[TABLE.index["rig.lateness_max"]] < 50 * ms
    assert times.size * FAST >= 190, "nothing is lost in the end"


@pytest.mark.real_time
def test_after_a_stall_the_readers_come_first(parameters) -> None:
    """Commands that arrived while everything stood still must be read before the missed ticks are counted."""
    rig = Rig(parameters, log=400)
    with ticking(rig) as running:
        running.wait(20 * ms)
        rig.pacing.stall(round(100 * ms * NS))
        running.wait(250 * ms)
    late = rig.pacing.log[: int(rig.pacing.record[0]["logged"])] / NS
    stalled = int(np.argmax(late >= 100 * ms))
    assert late[stalled] >= 100 * ms
    assert late[stalled + 1] > late[stalled] + 1.5 * ms, "the tick after it waits for the readers"
    assert late[stalled + 2] < late[stalled + 1], "and then they are caught up, without another pause"
    assert late[stalled + 110 :].min() < 1 * ms


@pytest.mark.real_time
def test_skipping_stops_the_rigs_time(make_rig) -> None:
    rig = make_rig()
    with ticking(rig, Late.SKIP) as running:
        running.wait(50 * ms)
        rig.pacing.stall(round(57.5 * ms * NS))
        times = sampling_times(running.wait(100 * ms))
    assert np.diff(times).max() >= FAST * TICK_NS + 57 * TICK_NS
    assert rig.values[TABLE.index["rig.late_ticks"]] < 40, "the 57 missed ones do not count"


@pytest.mark.real_time
@pytest.mark.parametrize(
    ("stall", "policy", "fault"),
    [(130, Late.FAULT, True), (130, Late.CATCH_UP, False), (40, Late.FAULT, False)],
)
def test_a_lost_tick_is_a_fault_only_if_asked_for(armed, stall: int, policy: Late, fault: bool) -> None:
    rig = armed.rig
    with ticking(rig, policy) as running:
        rig.pacing.stall(round(stall * ms * NS))
        running.wait((stall + 30) * ms)
    reason = TABLE["rig.reason"].choices[int(rig.values[TABLE.index["rig.reason"]])]
    assert (reason == "tick lost") is fault


@pytest.mark.real_time
def test_python_acts_between_two_ticks(make_rig) -> None:
    """An emergency stop is reported at once, with the time of day, though the tick never needs the interpreter."""
    rig = make_rig()
    with ticking(rig) as running:
        running.wait(0.5 * s)
        rig.press_estop()
        assert rig.state is BenchState.ESTOP
        block = running.wait(20 * ms)
    emergency = block[block["id"] == 0x081]
    assert emergency.size == 1
    assert abs(int(emergency["time"][0]) - int(sampling_times(block)[-1])) < 0.1 * NS


@pytest.mark.real_time
def test_a_pipe_that_is_fitted_meanwhile_is_computed_from_the_next_tick_on(make_rig) -> None:
    """How a step is divided, and which states it has, depends on the pipes."""
    rig = make_rig()
    with ticking(rig) as running:
        running.wait(20 * ms)
        assert rig.apply(rig.registers.active | {"rig.pipe": 1.0})
        with rig.lock:
            rig.plant.state[State.AUXILIARY_MASS] *= 1.01
        running.wait(50 * ms)
        with rig.lock:
            assert rig.plant.state[State.PIPE_FLOW] != 0.0


@pytest.mark.real_time
def test_a_thread_that_computes_does_not_hold_up_the_tick(make_rig) -> None:
    """What took the interpreter for 5 ms at a time used to make most ticks late."""
    rig = make_rig()
    stop = threading.Event()

    def compute() -> None:
        while not stop.is_set():
            sum(range(100_000))

    threads = [threading.Thread(target=compute) for _ in range(2)]
    with ticking(rig) as running:
        for thread in threads:
            thread.start()
        running.wait(0.5 * s)
        stop.set()
    for thread in threads:
        thread.join()
    ticks = sum(rig.values[row] for row in range(*_bins()))
    assert ticks >= 400
    assert rig.values[TABLE.index["rig.late_ticks"]] < 0.1 * ticks


def _bins() -> tuple[int, int]:
    first = TABLE.index["rig.lateness_50us"]
    return first, first + 6


def test_lateness_is_counted_where_it_belongs() -> None:
    values, pacing = np.zeros(len(TABLE.signals)), Pacing.virtual()
    for lateness in (10e-6, 60e-6, 99e-6, 0.2e-3, 0.4e-3, 0.9e-3, 1.5e-3, 20e-3):
        count_lateness(values, round(lateness * NS), pacing)
    assert values[slice(*_bins())].tolist() == [1, 2, 1, 1, 1, 2]
    assert values[TABLE.index["rig.late_ticks"]] == 2
    assert values[TABLE.index["rig.lateness_max"]] == pytest.approx(20e-3)


def test_a_full_ring_loses_the_oldest_and_counts(make_rig) -> None:
    rig, ring = make_rig(), Ring.of(32)
    block = rig.run(100)[:40]
    fill(ring, rig.lock.address, block, 7)
    out, senders = block.copy(), np.zeros(40, np.int64)
    assert drain(ring, rig.lock.address, out, senders) == 32
    assert (out[:32] == block[8:]).all()
    assert (senders[:32] == 7).all()
    assert ring.lost == 8
    assert drain(ring, rig.lock.address, out, senders) == 0


def test_virtual_time_does_not_wait() -> None:
    assert not Pacing.virtual().real
