"""Waits in one compiled call give the same frames, and end at the same tick, as waits of single cycles."""

import numpy as np
import pytest

from astb.rig_in_memory import RigInMemory
from bench_protocol.units import bar, mm, s
from bench_sim.parameters import load
from bench_sim.rig.faults.panel import PlannedFault
from bench_sim.rig.rig import Rig
from drivers.errors import BenchError


class Recorded:
    """A bench on a rig in memory, and all samples that it received; with ``singly`` another port receives them too."""

    def __init__(self, *, singly: bool, faults=(), latency=0.0):
        rig = Rig(load("astb"), seed=5)
        for fault in faults:
            rig.faults.plan(fault)
        self.memory = RigInMemory(rig)
        self.calls, run = 0, rig.run_until_event
        rig.run_until_event = lambda *given: self._counted(run, *given)
        self.bench = self.memory.bench(latency=latency)
        self.bench.connect()
        if singly:
            self.memory.can()
        self.samples = []
        self.bench.receiver.sink = lambda *samples: self.samples.append(samples)

    def _counted(self, run, *given):
        self.calls += 1
        return run(*given)

    def of_plan(self, plan):
        """Return samples, the time at the end, and the text of a fault."""
        text = ""
        try:
            plan(self.bench)
        except BenchError as fault:
            text = str(fault)
        return (
            [np.concatenate(part) for part in zip(*self.samples, strict=True)],
            self.memory.clock.now(),
            text,
        )


def move(bench):
    bench.arm()
    bench.vertical.hold_position()
    bench.air.fill(to=1 * bar, within=60 * s)
    bench.commander.ramp_all({"platform.vertical_setpoint": 5 * mm}, 2 * mm / s)
    bench.wait(3.0013 * s)
    bench.platform.roll_setpoint = 0.001
    bench.wait(2 * s)


def shake(bench):
    bench.arm()
    bench.vertical.hold_position()
    bench.generator.run("platform_vertical", frequency=2.0, amplitude=2 * mm, cycles=5)
    bench.wait(0.37 * s)


def equal(plan, **circumstances):
    """Let a bench alone and one of two ports run ``plan``; assert that all is equal, and return the end (ns)."""
    whole, singly = (Recorded(singly=singly, **circumstances) for singly in (False, True))
    (samples, end, text), (expected, expected_end, expected_text) = (
        one.of_plan(plan) for one in (whole, singly)
    )
    assert (end, text) == (expected_end, expected_text)
    assert whole.calls < singly.calls
    for ours, theirs in zip(samples, expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    return end


@pytest.mark.parametrize("plan", [move, shake])
@pytest.mark.parametrize(
    "faults",
    [
        (),
        [PlannedFault("estop", {}, 6.1234, 1.0)],
        [PlannedFault("drop", {"probability": "100 %"}, 5.507, 0.3)],
        [PlannedFault("delay", {"by": "12 ms", "jitter": "4 ms"}, 4.0, 1.5)],
        [PlannedFault("bus_off", {}, 5.011, 2.0)],
        [PlannedFault("interface_down", {}, 5.011, 2.0)],
    ],
    ids=lambda faults: faults[0].name if faults else "no fault",
)
def test_waits_in_one_call_equal_waits_of_single_cycles(plan, faults):
    equal(plan, faults=faults)


def test_a_wait_without_events_needs_few_calls():
    recorded = Recorded(singly=False)
    recorded.bench.wait(0.5 * s)
    before = recorded.calls
    recorded.bench.wait(10 * s)
    assert recorded.calls - before < 40  # 500 cycles


def test_cycles_between_two_ticks_are_sent_at_the_same_ticks():
    """The latency of Modbus moves the first cycle to any nanosecond."""
    assert equal(shake, latency=0.0012345) % 1_000_000
