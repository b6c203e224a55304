"""A bench on a third-party wiring: its missing signals, its sequences, its delays."""

import math

import numpy as np
import pytest

from bench_protocol.clock import VirtualClock
from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.units import NS, bar, mm, ms, s
from bench_protocol.words import STATES
from drivers.bench import Bench
from drivers.commander import CYCLE
from drivers.errors import BenchTimeout, LinkLost, NotAvailable, Refused, RigFault, WiringError
from drivers.wiring.contract import Capabilities, Order, Outlet, Sequences, Step
from drivers.wiring.transports import open_transport
from tests.refusals import refuses

ABSENT = {
    "left.auxiliary_temperature": "no thermometer in the chamber",
    "lateral.force": "no transducer in the actuator",
    "lateral.force_setpoint": "the actuator goes to positions only",
    "platform.roll_setpoint": "the platform does not roll",
    "air.dpv": "no differential pressure valve",
    "action.air_high": "one pressure for all",
    "interlock.limits": "not wired",
    "rig.reason": "not told",
    "rig.tripped": "not told",
    "rig.strangers": "not told",
    "rig.map_hash": "not told",
}


class Tiny(Outlet):
    """A rig with two commands, STOP and RUN, and arbitrary measurements; it and its wiring in one."""

    rig, table, given, commanded = "plant T", TABLE, {}, True
    sequences = Sequences(
        up=(
            Step(("DISABLED",), (Order({"key": 1}), Order({"key": 2})), ("HOLD",), within=1 * s),
            Step(("HOLD",), (Order({"key": 3, "air.left_mode": 0}),), ("ACTIVE",), bumpless=True),
        ),
        reset=(Step(("FAULT_HOLD",), (Order({"key": 9}),), ("DISABLED",)),),
        rest=(Order({"key": 0}),),
        at_rest=("DISABLED",),
    )

    def __init__(self, latency=0.0, absent=ABSENT):
        self.absent = absent
        self.clock = VirtualClock()
        self.capabilities = Capabilities(latency=latency)
        self.freshness = np.zeros(len(TABLE.signals), np.int64)
        self.reports = [s.name for s in TABLE.of_kind(Kind.MEASUREMENT, Kind.STATUS) if s.name not in absent]
        self.freshness[[TABLE.index[name] for name in self.reports]] = round(300 * ms * NS)
        self.values = dict.fromkeys(self.reports, 0.0)
        self.settings = {s.name: 0.0 for s in TABLE.of_kind(Kind.SETTING, Kind.INTERLOCK)}
        self.state, self.failure = "DISABLED", None
        self.keys, self.sent, self.deaf, self.opened = [], [], set(), False

    @property
    def outlet(self):
        return self

    def open(self, clock, receive, lost, *, within):
        assert clock is self.clock
        self.opened = True
        rows = np.array([TABLE.index[name] for name in self.reports])

        def publish():
            now = clock.now()
            self.values["rig.state"] = float(STATES.index(self.state))
            receive(np.full(rows.size, now), rows, np.array([self.values[n] for n in self.reports]), now)

        self._telling = clock.every(50_000_000, publish)

    def begin(self):
        pass

    def is_own(self, port, token):
        return False

    def close(self):
        self._telling.cancel()
        self.opened = False

    def send(self, values, time):
        self.sent.append((time, values))

    def write(self, values):
        self.settings |= values

    def read(self, names):
        return {name: self.settings[name] for name in names}

    def act(self, name):
        self.keys.append(name)

    def write_points(self, points):
        self.keys.append(points["key"])
        after = {1: "DISABLED", 2: "HOLD", 3: "ACTIVE", 9: "DISABLED", 0: "DISABLED"}
        if points["key"] not in self.deaf:
            self.state = after[points["key"]]

    def setpoint(self, name, k=-1):
        return self.sent[k][1][TABLE.index[name]]


@pytest.fixture
def tiny():
    return Tiny()


@pytest.fixture
def bench(tiny):
    with Bench(tiny, tiny.clock) as bench:
        yield bench


def test_a_bench_is_led_as_its_wiring_says(tiny, bench):
    tiny.values["vertical_left.displacement"] = 7 * mm
    bench.arm()
    assert bench.state == "ACTIVE"
    assert tiny.keys == [1, 2, 3]
    assert tiny.setpoint("vertical_left.displacement_setpoint") == 7 * mm, "without a bump"
    assert math.isnan(tiny.setpoint("lateral.force_setpoint")), "it is unknown"
    tiny.keys.clear()
    bench.disarm()
    assert (bench.state, tiny.keys) == ("DISABLED", [0])
    tiny.state = "HOLD"
    bench.wait(100 * ms)
    tiny.keys.clear()
    bench.arm()
    assert tiny.keys == [3], "from where it is"


def test_a_fault_is_reset_by_the_wirings_own_orders(tiny, bench):
    tiny.state = "FAULT_HOLD"
    bench.wait(100 * ms)
    bench.arm()
    assert tiny.keys == [9, 1, 2, 3]


def test_an_order_that_the_rig_never_acknowledges_is_named(tiny, bench):
    tiny.deaf = {2}
    before = bench.now
    with pytest.raises(BenchTimeout) as failure:
        bench.arm()
    assert str(failure.value).startswith(
        "HOLD (after key = 1; key = 2): not reached within 1 s; now rig.state = DISABLED; "
    )
    assert bench.now - before <= 1.2 * s, "the step's own time, not that of the whole way"


def test_a_fault_without_a_reason_is_reported_while_arming(tiny, bench):
    tiny.deaf = {3}
    tiny.clock.every(round(0.6 * NS), lambda: setattr(tiny, "state", "FAULT_HOLD"))
    with refuses(RigFault, "ACTIVE FAULT_HOLD"):
        bench.arm()


ASKED = {
    "left.auxiliary_temperature": lambda bench: bench.left.auxiliary_temperature,
    "lateral.force": lambda bench: bench.averages("lateral.displacement", "lateral.force"),
    "lateral.force_setpoint": lambda bench: bench.lateral.push(1000.0),
    "platform.roll_setpoint": lambda bench: bench.platform.roll_setpoint,
    "air.dpv": lambda bench: bench.air.isolate_dpv(),
    "action.air_high": lambda bench: bench.action.air_high(),
    "interlock.limits": lambda bench: bench.interlock.limits,
    "rig.reason": lambda bench: bench.rig.reason,
    "rig.tripped": lambda bench: bench.sample("rig.tripped"),
}


@pytest.mark.parametrize("name", ASKED)
def test_absent_signals_are_refused_with_the_reason(tiny, bench, name):
    tiny.settings["lateral.control"] = 1.0
    said = dict(tiny.settings)
    with pytest.raises(NotAvailable) as refusal:
        ASKED[name](bench)
    assert str(refusal.value) == f"plant T has no {name}: {ABSENT[name]}"
    assert tiny.settings == said, "nothing was sent"


def test_what_is_there_is_as_ever(tiny, bench):
    tiny.values["left.bellows_pressure"] = 3 * bar
    assert bench.averages("left.bellows_pressure", over=500 * ms) == {"left.bellows_pressure": 3 * bar}
    assert bench.interlock.estop is False
    assert "interlock.limits" not in bench.settings.contacts()
    assert "air.dpv" not in bench.settings.in_force()
    assert bench.describe() == "state DISABLED"
    assert bench.strangers() == ""
    assert bench.has("left.height")
    assert not bench.has("left.height", "air.dpv")
    assert bench.lacks("rig.reason", "air.dpv", "rig.tripped", "left.height") == (
        "plant T has no rig.reason, rig.tripped: not told; plant T has no air.dpv: no differential pressure valve"
    )
    with refuses(KeyError, "signal"):
        bench.has("left.hieght")


def test_a_silent_rig_is_noticed_by_its_own_limits(tiny, bench):
    bench.arm()
    tiny._telling.cancel()
    with refuses(LinkLost, "silent after 0.3 s"):
        bench.wait(5 * s)


def test_what_fails_in_the_background_is_raised_as_it_is(tiny, bench):
    tiny.failure = Refused("plc.valve did not follow", 4)
    with refuses(Refused, "follow"):
        bench.wait(1 * s)
    with bench.despite_faults():
        bench.wait(1 * s)
    tiny.failure = None


@pytest.mark.parametrize("latency", [0.0, 120 * ms])
def test_cycles_are_waited_for_until_they_show(latency):
    tiny = Tiny(latency)
    with Bench(tiny, tiny.clock) as bench:
        before = bench.clock.now()
        bench.wait_cycles(3)
        assert bench.clock.now() - before == 4 * CYCLE + round(latency * NS)


def test_a_wiring_is_closed_though_the_plan_failed(tiny):
    with pytest.raises(ZeroDivisionError), Bench(tiny, tiny.clock) as bench:
        bench.arm()
        1 / 0  # noqa: B018
    assert (tiny.opened, tiny.state) == (False, "DISABLED")


def test_a_refused_order_does_not_block_the_others(tiny):
    """On the way to rest the following orders may still be sent."""
    tiny.sequences = Sequences(tiny.sequences.up, (), (Order({"key": 7}), Order({"key": 0})), ("DISABLED",))
    write_points = tiny.write_points

    def refuse(points):
        if points["key"] == 7:
            raise Refused("key = 7 was refused", 4)
        write_points(points)

    tiny.write_points = refuse
    with Bench(tiny, tiny.clock) as bench:
        bench.arm()
        bench.disarm()
        assert tiny.state == "DISABLED"
        bench.arm()
        tiny.deaf = {0}
        with refuses(BenchTimeout, "key 7"):
            bench.disarm(within=1 * s)
        tiny.deaf = set()


def test_an_unknown_state_is_not_reported_as_silence(tiny, bench):
    bench.arm()
    tiny.clock.sleep_until(tiny.clock.now() + 60_000_000)
    tiny._telling.cancel()
    row = np.array([TABLE.index["rig.state"]])

    def publish():
        tiny.receiver.receive(np.array([tiny.clock.now()]), row, np.array([math.nan]), tiny.clock.now())

    tiny.receiver = bench.receiver
    tiny._telling = tiny.clock.every(50_000_000, publish)
    with refuses(LinkLost, "reports"):
        bench.wait(5 * s)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("def make(name, table, where):\n    return table['hots']\n", "KeyError('hots')"),
        ("def make(:\n", "imported"),
    ],
)
def test_a_transport_of_somebodys_own_that_is_written_wrongly(tmp_path, text, words):
    (tmp_path / "mine.py").write_text(text)
    with refuses(WiringError, words):
        open_transport("mine", {"kind": "mine.py:make", "host": "x"}, tmp_path)
