"""The same bench over real sockets, in real time: nothing lost while a plan computes, a dead server noticed at once."""

import threading

import numpy as np
import pytest

from bench_protocol.clock import RealClock, wall_time_ns
from bench_protocol.table import TABLE
from bench_protocol.units import NS, kN, mm, s
from bench_sim.rig.can_hub import CanHub
from bench_sim.rig.modbus_server import ModbusTcpServer
from bench_sim.rig.servers import serve_in_thread
from drivers.bench import Bench
from drivers.can_port import open_can
from drivers.errors import LinkLost
from drivers.modbus_port import open_modbus
from drivers.wiring.own import own_wiring

pytestmark = pytest.mark.real_time
HEIGHT = TABLE.index["left.height"]


@pytest.fixture
def live(make_world):
    """A scripted peer on its own sockets in real time, and a connected bench."""
    peer, lock, clock = make_world().peer, threading.RLock(), RealClock()
    peer.epoch = wall_time_ns()

    def receive(block, name):
        with lock:
            peer.receive(block)

    def answer(request, name):
        with lock:
            return peer.answer(request)

    hub = CanHub(receive)
    with serve_in_thread(hub, ModbusTcpServer(answer)) as servers:

        def tick():
            with lock:
                peer.values["left.height"] = (clock.now() // 5_000_000 % 100) * mm
                block = peer.advance(clock.now())
            block["time"] += peer.epoch
            hub.publish(block)

        ticking = clock.every(5_000_000, tick)
        can = open_can("tcp", host="127.0.0.1", port=servers.can_port)
        bench = Bench(own_wiring(can, open_modbus("127.0.0.1", servers.modbus_port)), clock)
        bench.connect()
        yield peer, servers, bench
        bench.close()
        ticking.cancel()


@pytest.mark.slow
def test_no_frame_is_lost_while_the_plan_computes(live):
    peer, _, bench = live
    received = []
    bench.arm()
    bench.wait(0.5 * s)  # until the offset of the stamps is known
    bench.receiver.sink = lambda times, rows, values: received.append((times, rows))
    with bench.capture("left.height") as capture:
        end = bench.now + 0.8
        while bench.now < end:
            sum(range(50_000))  # holds the interpreter
        assert bench.left.height >= 0  # and later readings are fresh
        bench.wait(0.2 * s)  # a busy machine still holds a part in its sockets
    assert capture.times("left.height").size >= 0.8 * 200
    times = np.concatenate([t[r == HEIGHT] for t, r in received])
    steps = np.diff(times)
    # On a busy machine, a frame that arrives sooner than all before corrects the offset of the stamps once.
    assert steps.max() == 5_000_000 and (steps < 5_000_000).sum() <= 1
    assert bench.wiring.carrier.tally()["lost"] == 0
    bench.vertical.preload(1 * kN, 2 * kN, rate=20 * kN)
    assert bench.vertical_right.force == pytest.approx(2 * kN, abs=0.5 * kN)
    assert peer.state == "ACTIVE"


def test_a_dead_server_is_noticed(live):
    _, servers, bench = live
    bench.arm()
    servers.stop()
    stopped = bench.clock.now()
    with pytest.raises(LinkLost):
        bench.wait(5 * s)
    assert (bench.clock.now() - stopped) / NS < 0.1


def test_closing_leaves_no_thread_behind(live):
    _, _, bench = live
    before = bench.now
    bench.close()
    assert bench.now - before < 1
    names = [thread.name for thread in threading.enumerate()]
    assert not [name for name in names if name.startswith(("receiver", "every 20"))]


@pytest.mark.slow
@pytest.mark.parametrize("before", [0.001, -3600.0, 31_557_600.0])
def test_a_plan_measures_on_while_the_clock_of_the_rig_is_set(live, before):
    """The clock of one side is set before the measurement, between two and during one."""
    peer, _, bench = live
    for step in (before, 1.0, -1.0, 0.001, -0.001, 3600.0, -31_557_600.0):
        peer.epoch += round(step * NS)
        mean = bench.averages("left.height", over=0.3 * s)
        assert mean["left.height"] == pytest.approx(50 * mm, abs=50 * mm)
        with bench.capture("left.height") as capture:
            bench.wait(0.1 * s)
            peer.epoch += round(step * NS)
            bench.wait(0.1 * s)
        assert capture.times("left.height").size > 30
