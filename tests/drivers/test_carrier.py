"""A transport that carries the signals themselves, with and without others: a line redirects a signal."""

import numpy as np
import pytest

from astb.rig_in_memory import RigInMemory
from bench_protocol.clock import VirtualClock
from bench_protocol.input_limits import read_toml
from bench_protocol.named_files import named_files
from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.units import bar, mm, s
from bench_protocol.words import AIR_BY_STATE
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from drivers.bench import Bench
from drivers.errors import LinkLost, NotAvailable, Refused, WiringError
from drivers.wiring.astb.transport import AstbTransport
from drivers.wiring.described import DescribedWiring, open_described
from drivers.wiring.description import describe, read_description
from drivers.wiring.own import own_description
from tests.drivers.strange_rig import PointsInMemory
from tests.refusals import refuses

FILE = named_files("wirings")["local"]
RIG = {"kind": "astb"}
#: A laser that is read by another device, a valve that it sets, and a spring that has no thermometer.
LINES = {
    "left.height": {"from": "box.laser", "unit": "mm"},
    "air.right_target": {"to": "box.target", "read": "box.target_is", "unit": "bar", "within": "100 ms"},
    "left.bellows_temperature": {"absent": "no thermometer"},
}


def described(lines, *, generator=True, **transports):
    """Return the description of our rig with ``lines`` and further transports."""
    keys = read_toml(FILE) | {"signals": lines, "capabilities": {"generator": generator}}
    keys["transports"] = keys["transports"] | transports
    return describe(keys, FILE, TABLE)


class RigWithBox:
    """Our rig with an additional box, whose laser is constant and whose valve may refuse."""

    def __init__(self) -> None:
        self.memory = RigInMemory(Rig(load(), seed=1))
        self.box = PointsInMemory({"laser": 12.5, "target": 2.0, "target_is": 2.0})
        self.box.react = self.apply
        self.refuses = False
        can, modbus = self.memory.can(), self.memory.modbus()
        carrier = AstbTransport("rig", RIG, TABLE, lambda: (can, modbus))
        told = described(LINES, box={"kind": "box.py:make"})
        self.wiring = DescribedWiring("the rig", told, {"box": self.box}, carrier)

    def apply(self, point: str, number: float) -> None:
        if point == "target" and not self.refuses:
            self.box.points["target_is"] = number


def test_signals_with_a_line_go_their_way_and_all_others_that_of_the_table():
    beside = RigWithBox()
    with Bench(beside.wiring, beside.memory.clock) as bench:
        bench.arm()
        with bench.capture("left.height", "right.height") as capture:
            bench.wait(1 * s)
        assert set(capture.values("left.height")) == {12.5 * mm}
        assert capture.values("left.height").size == pytest.approx(20, abs=2)
        assert capture.values("right.height").size == pytest.approx(200, abs=5)
        with refuses(NotAvailable, "thermometer"):
            bench.settings.reading("left.bellows_temperature")
        bench.settings.write({"air.right_target": 4 * bar, "air.left_target": 3 * bar})
        assert beside.box.points["target"] == 4.0
        assert bench.settings.read("air.left_target") == 3 * bar
        assert bench.wiring.source("left.height") == "box.laser"
        assert bench.wiring.source("right.height").startswith("CAN 0x")
        bench.disarm()
    assert beside.memory.rig.lease.token == 0
    assert beside.box.connections == 0


def test_settings_of_both_ways_are_taken_over_together_or_not_at_all():
    beside = RigWithBox()
    with Bench(beside.wiring, beside.memory.clock) as bench:
        before = bench.settings.readings("air.right_target", "air.left_target")
        beside.refuses = True
        with refuses(Refused, "air.right_target"):
            bench.settings.write({"air.right_target": 4 * bar, "air.left_target": 3 * bar})
        assert bench.settings.readings("air.right_target", "air.left_target") == before
        beside.refuses = False
        bench.arm()
        with refuses(Refused, "changed"):
            bench.settings.write({"air.right_target": 4 * bar, "rig.nominal_preload": 50_000.0})
        assert beside.box.points["target"] == 2.0


def test_waves_are_played_for_a_rig_whose_generator_is_not_to_be_used():
    memory = RigInMemory(Rig(load(), seed=1))
    told = described({}, generator=False)
    wiring = open_described("the rig", told, {"rig": lambda: (memory.can(), memory.modbus())})
    with Bench(wiring, memory.clock) as bench:
        bench.arm()
        bench.vertical.hold_position()
        with bench.capture("vertical_left.displacement") as capture:
            bench.generator.run("vertical", amplitude=3 * mm, frequency=1.0, cycles=3)
        assert np.ptp(capture.values("vertical_left.displacement")) == pytest.approx(6 * mm, abs=0.5 * mm)
        assert "generator.amplitude" in wiring.played


def test_who_only_listens_is_nobodys_commander():
    memory = RigInMemory(Rig(load(), seed=1))
    with memory.bench() as bench:
        bench.arm()
        token = memory.rig.lease.token
        told = described({}, rig={"kind": "astb", "commands": False})
        received = []
        wiring = open_described("the rig", told, {"rig": lambda: (memory.can(), memory.modbus())})
        wiring.open(
            memory.clock, lambda times, rows, values, fresh: received.extend(rows), print, within=1 * s
        )
        bench.wait(0.5 * s)
        assert (memory.rig.lease.token, wiring.commanded, wiring.given) == (token, False, {})
        wiring.close()
        bench.wait(0.5 * s)
        assert bench.rig.strangers == 0
        assert TABLE.index["left.height"] in received


def test_the_supplied_file_has_all_signals_and_states_of_our_rig():
    told = own_description()
    assert told.sequences.air == AIR_BY_STATE
    further = {signal.name for signal in TABLE.of_kind(Kind.FURTHER)}
    assert told.carried == set(TABLE.index) - further
    assert told.absent.keys() == further
    assert read_description(FILE, TABLE).digest == told.digest


@pytest.mark.parametrize(
    ("lines", "transports", "words"),
    [
        ({}, {"second": RIG}, "second"),
        ({"left.height": {"from": "rig.left.height", "unit": "m"}}, {}, "carries"),
    ],
)
def test_keys_that_exclude_a_table_are_reported(lines, transports, words):
    with refuses(WiringError, words):
        described(lines, **transports)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"can": {"port": 70_000}}, "transports.rig"),
        ({"kan": {}}, "transports.rig"),
        ({"modbus": {"unit": 300}}, "transports.rig"),
    ],
)
def test_keys_of_the_transport_that_cannot_be(keys, words):
    with refuses(WiringError, words):
        open_described("the rig", described({}, rig=RIG | keys))


@pytest.mark.parametrize(
    ("air", "words"),
    [
        ({"ACTIVE": "let of"}, "sequences.air.ACTIVE 'let of'"),
        ({"AKTIVE": "let off"}, "sequences.air 'AKTIVE'"),
    ],
)
def test_invalid_states_of_the_air_are_refused(air, words):
    keys = read_toml(FILE)
    with refuses(WiringError, words):
        describe(keys | {"sequences": {"air": air}}, FILE, TABLE)


def test_a_missing_rig_is_reported_and_connections_are_closed():
    wiring = open_described("the rig", described({}, rig=RIG | {"modbus": {"port": 1}}))
    with pytest.raises(LinkLost, match=r"127\.0\.0\.1:1\b"):
        wiring.open(VirtualClock(), lambda *received: None, print, within=1 * s)
    wiring.close()
    assert wiring.failure is None
