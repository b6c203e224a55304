"""The stream of commands: 50 a second, protected, with ramps that are exact to the last cycle."""

import math
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.refusals import refuses

e2e = pytest.importorskip("e2e.p01")

from bench_protocol.can_codec import Decoder  # noqa: E402
from bench_protocol.clock import RealClock, VirtualClock  # noqa: E402
from bench_protocol.frames import join, payload  # noqa: E402
from bench_protocol.table import TABLE  # noqa: E402
from bench_protocol.units import NS, kN, mm, s  # noqa: E402
from drivers.commander import CYCLE, Commander  # noqa: E402
from drivers.errors import LinkLost, Misuse, Refused  # noqa: E402
from drivers.memory import InMemoryCan  # noqa: E402
from drivers.modbus_port import InMemoryModbus  # noqa: E402
from drivers.wiring.own import own_wiring  # noqa: E402


def wiring_on(port):
    """Return our wiring with a silent Modbus, which the stream does not need."""
    return own_wiring(port, InMemoryModbus(lambda request: b""))


class Line:
    """A commander in virtual time and the blocks that it sent."""

    def __init__(self):
        self.clock, self.blocks = VirtualClock(), []
        self.port = InMemoryCan(self.blocks.append)
        self.commander = Commander(wiring_on(self.port), self.clock)

    def cycles(self, count):
        self.clock.sleep_until(self.clock.now() + count * CYCLE)

    def track(self, name):
        decoder = Decoder(TABLE)
        return [v for b in self.blocks for v in _values(decoder.decode(b), name)]


def _values(samples, name):
    return samples.values[samples.signals == TABLE.index[name]].tolist()


def test_fifty_blocks_a_second_of_all_five_messages():
    line = Line()
    line.commander.start()
    line.cycles(50)
    assert len(line.blocks) == 50
    for k, block in enumerate(line.blocks, 1):
        assert block["id"].tolist() == [0x201, 0x202, 0x203, 0x204, 0x206]
        assert (block["time"] == k * CYCLE).all()
    line.commander.stop()
    line.cycles(50)
    assert len(line.blocks) == 50


def test_every_frame_is_accepted_by_the_autosar_oracle():
    line = Line()
    line.commander.set("lateral.force_setpoint", 1234.0)
    line.commander.start()
    line.cycles(40)
    messages = {m.identifier: m for m in TABLE.messages}
    counters = {}
    for record in join(line.blocks):
        data = bytearray(payload(record))
        assert e2e.e2e_p01_check(data, messages[int(record["id"])].data_id)
        counters.setdefault(int(record["id"]), []).append(data[1] & 0x0F)
        data[5] ^= 0x10
        assert not e2e.e2e_p01_check(data, messages[int(record["id"])].data_id)
    assert set(counters) == {0x201, 0x202, 0x203, 0x204, 0x206}
    for sequence in counters.values():
        assert sequence == [k % 15 for k in range(40)]


def test_missing_set_points_are_sent_as_not_available_and_bits_as_zero():
    line = Line()
    line.commander.start()
    line.cycles(1)
    assert math.isnan(line.track("lateral.force_setpoint")[0])
    assert line.track("control.enable") == [0.0]


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(
    start=st.floats(-60 * kN, 60 * kN),
    to=st.floats(-60 * kN, 60 * kN),
    rate=st.floats(500, 1e6),
)
def test_a_ramp_is_a_straight_line_and_ends_exactly(start, to, rate):
    line = Line()
    line.commander.set("lateral.force_setpoint", start)
    line.commander.start()
    duration = line.commander.ramp("lateral.force_setpoint", to, rate)
    assert duration == pytest.approx(max(0.0, abs(to - start) / rate), abs=1.001 * CYCLE / NS)
    cycles = round(duration * NS / CYCLE)
    for k in range(1, cycles + 1):
        line.cycles(1)
        ideal = start + math.copysign(min(k * rate * CYCLE / NS, abs(to - start)), to - start)
        assert line.commander.value("lateral.force_setpoint") == pytest.approx(ideal, rel=1e-12, abs=1e-6)
    if cycles == 0:
        line.cycles(1)
    line.cycles(1)
    assert line.commander.value("lateral.force_setpoint") == to
    assert not line.commander.moving()
    track = np.array(line.track("lateral.force_setpoint"))
    assert np.all(np.diff(track) * math.copysign(1, to - start) >= 0)  # never back, never beyond
    assert track[-1] == pytest.approx(to, abs=1.001)  # half a wire step


def test_ramps_of_one_call_start_on_the_same_cycle_and_another_call_takes_over():
    line = Line()
    names = ("vertical_left.force_setpoint", "vertical_right.force_setpoint")
    line.commander.set_all(dict.fromkeys(names, 0.0))
    line.commander.start()
    assert line.commander.ramp_all(dict(zip(names, (10 * kN, 20 * kN), strict=True)), 10 * kN / s) == 2.0
    line.cycles(50)
    assert [line.commander.value(name) for name in names] == [10 * kN, 10 * kN]
    assert not line.commander.moving(names[0])
    assert line.commander.moving(names[1])
    line.commander.ramp(names[1], 0.0, 10 * kN / s)  # turns round where it is
    line.cycles(1)
    assert line.commander.value(names[1]) == pytest.approx(9.8 * kN)
    line.commander.freeze()
    line.cycles(10)
    assert line.commander.value(names[1]) == pytest.approx(9.8 * kN)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda c: c.set("lateral.force_setpoint", 61 * kN), ValueError, "61 kN does not fit.*-60 to 60 kN"),
        (lambda c: c.set("lateral.force_setpoint", math.nan), ValueError, "does not fit"),
        (lambda c: c.set("left.height", 1 * mm), Misuse, "left.height is a measurement"),
        (lambda c: c.set("left.hieght", 1 * mm), KeyError, "no signal"),
        (lambda c: c.ramp("lateral.force_setpoint", 0.0, 0.0), ValueError, "rate = 0"),
        (lambda c: c.ramp("lateral.force_setpoint", 0.0, -1.0), ValueError, "rate = -1"),
        (lambda c: c.ramp("lateral.force_setpoint", 0.0, math.inf), ValueError, "rate = inf"),
        (lambda c: c.ramp("lateral.displacement_setpoint", 0.0, 1.0), Misuse, "no value yet"),
        (
            lambda c: c.ramp_all({"lateral.force_setpoint": 1.0, "platform.roll_setpoint": 9.0}, 1.0),
            ValueError,
            "fit",
        ),
    ],
)
def test_unsuitable_values_are_refused_without_effect(call, error, words):
    line = Line()
    line.commander.set("lateral.force_setpoint", 5 * kN)
    with pytest.raises(error, match=words):
        call(line.commander)
    line.commander.start()
    line.cycles(3)
    assert line.track("lateral.force_setpoint") == [5 * kN] * 3


def test_values_set_together_travel_together():
    line = Line()
    with refuses(ValueError, "platform"):
        line.commander.set_all({"lateral.force_setpoint": 1 * kN, "platform.vertical_setpoint": 1.0})
    assert math.isnan(line.commander.value("lateral.force_setpoint"))


def test_a_lost_bus_ends_the_stream_and_is_remembered():
    line = Line()
    line.commander.start()
    line.cycles(2)
    line.port.lose("the server has gone")
    line.cycles(5)
    assert len(line.blocks) == 2
    assert isinstance(line.commander.failure, LinkLost)


@pytest.mark.real_time
def test_a_stall_makes_no_set_point_jump():
    """A bus that takes 250 ms for one block: the ramp goes on from where it was, a cycle at a time."""
    clock, blocks = RealClock(), []

    def send(block):
        blocks.append(block)
        if len(blocks) == 10:
            clock.sleep_until(clock.now() + NS // 4)

    commander = Commander(wiring_on(InMemoryCan(send)), clock)
    name = "lateral.displacement_setpoint"
    commander.set(name, 0.0)
    commander.start()
    commander.ramp(name, 30 * mm, 40 * mm / s)
    clock.sleep_until(clock.now() + 3 * NS // 4)
    commander.stop()
    decoder = Decoder(TABLE)
    track = [value for block in blocks for value in _values(decoder.decode(block), name)]
    assert len(track) > 15
    assert np.diff(track).max() <= 40 * mm / s * CYCLE / NS + 0.01 * mm
    assert np.diff([block["time"][0] for block in blocks]).min() >= CYCLE // 2  # not all at once
    assert track[-1] < 30 * mm


@pytest.mark.real_time
def test_in_real_time_many_threads_may_command_while_the_cycles_keep_time():
    clock, stamps = RealClock(), []
    port = InMemoryCan(lambda block: stamps.append((int(block["time"][0]), clock.now())))
    commander = Commander(wiring_on(port), clock)
    commander.start()

    def pester(name):
        for k in range(300):
            commander.set(name, k * 10.0)

    threads = [
        threading.Thread(target=pester, args=(name,))
        for name in (
            "lateral.force_setpoint",
            "vertical_left.force_setpoint",
            "vertical_right.force_setpoint",
        )
    ]
    for thread in threads:
        thread.start()
    clock.sleep_until(commander.origin + 25 * CYCLE + CYCLE // 2)
    commander.stop()
    for thread in threads:
        thread.join()
    assert len(stamps) in (24, 25)
    assert commander.value("lateral.force_setpoint") == 2990


def test_set_points_wait_for_a_cycle_that_holds_the_mutex():
    """A waiting client has released the interpreter already, and must not do so twice."""
    line, given = Line(), threading.Event()
    line.commander.set("lateral.force_setpoint", 0.0)

    def give():
        line.commander.set("lateral.force_setpoint", 1 * kN)
        line.commander.ramp("lateral.force_setpoint", 2 * kN, 1 * kN)
        line.commander.freeze()
        given.set()

    thread = threading.Thread(target=give)
    with line.commander._mutex:
        thread.start()
        assert not given.wait(0.05)
    thread.join(5)
    assert given.is_set()
    assert line.commander.value("lateral.force_setpoint") == 1 * kN


@pytest.mark.parametrize("error", [Refused("not in this state", 4), KeyError("Set.Left")])
def test_every_end_of_the_stream_is_reported(monkeypatch, error):
    """A user's transport may raise any error; in a thread it would be lost."""
    clock, port = VirtualClock(), InMemoryCan(lambda block: None)
    wiring = wiring_on(port)
    commander = Commander(wiring, clock)

    def fail(values, time):
        raise error

    monkeypatch.setattr(wiring.outlet, "send", fail)
    commander.start()
    clock.sleep_until(3 * CYCLE)
    assert isinstance(commander.failure, LinkLost)
    assert type(error).__name__ in str(commander.failure)
    commander.stop()
