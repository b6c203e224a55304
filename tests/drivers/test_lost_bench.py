"""A commander who was away: the messages on its return, and that it keeps its identity."""

import pytest

from astb.rig_in_memory import RigInMemory
from bench_protocol.units import NS, s
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from drivers.errors import NotCommander
from tests.refusals import refuses


@pytest.fixture
def memory():
    return RigInMemory(Rig(load("astb"), seed=1))


def away(memory, bench, seconds):
    """Let nothing of a commander arrive for a while, as if his process was stopped: his connections stand."""
    can, modbus = bench.wiring.carrier.can, bench.wiring.carrier.modbus
    send, answer = can._send, modbus._client._answer
    can._send, modbus._client._answer = (lambda block: None), (lambda request: b"")
    bench.commander.stop()
    bench.wiring.carrier.watchdog.stop()
    memory.clock.sleep_until(memory.clock.now() + round(seconds * NS))
    can._send, modbus._client._answer = send, answer
    bench.commander.start()
    bench.wiring.carrier.watchdog.start(memory.clock)


@pytest.mark.parametrize("taken", [False, True], ids=["nobody's", "somebody else's"])
def test_who_was_away_too_long_learns_what_became_of_the_bench(memory, taken):
    bench = memory.bench()
    bench.connect()
    bench.arm()
    with pytest.raises(NotCommander) as caught:
        away(memory, bench, 3 * s)
    text = str(caught.value)
    assert text.startswith("this commander lost the bench, because it was silent")
    assert "(no client holds the bench now)" in text
    if taken:
        other = memory.bench()
        other.connect()
    with refuses(NotCommander, "silent"):
        bench.rig.nominal_preload = 145e3
    memory.clock.sleep_until(memory.clock.now() + NS)
    assert "this commander has lost its lease" in bench.strangers()
    assert "somebody else" not in bench.describe()
    if taken:
        assert other.rig.state in ("FAULT_DISABLED", "DISABLED")
        assert "another client tries to command the bench" in other.strangers(), "another client to him"
        other.close()
    bench.close()


def test_a_bench_that_was_away_for_a_moment_goes_on(memory):
    with memory.bench() as bench:
        bench.arm()
        away(memory, bench, 0.3 * s)
        assert bench.rig.lease == bench.wiring.given["control.token"]
        bench.arm()
