"""No command is sent before the first one: neither start values nor heartbeats, on any wire."""

import math
import re
import tomllib
from collections.abc import Callable
from pathlib import Path

import cantools
import pytest

from astb.acceptance.checking.examining import WITHIN, examine
from astb.listening import Listening
from bench_protocol.clock import VirtualClock
from bench_protocol.frames import Block, frame, payload
from bench_protocol.table import TABLE
from bench_protocol.units import mm
from drivers.bench import Bench
from drivers.memory import InMemoryCan
from drivers.modbus_port import InMemoryModbus
from drivers.wiring.can.transport import CanTransport
from drivers.wiring.described import DescribedWiring, open_described
from drivers.wiring.description import describe
from drivers.wiring.lines import Description
from tests.foreign.modbus_server import answer

MS = 1_000_000
#: Set-points whose start values are raw zeros, which are -1000 mm.
DBC = """VERSION ""
NS_ :
BS_:
BU_: RIG HOST

BO_ 512 Status: 8 RIG
 SG_ State : 0|8@1+ (1,0) [0|0] "" HOST
 SG_ Left : 8|16@1+ (0.1,-1000) [0|0] "mm" HOST
 SG_ Right : 24|16@1+ (0.1,-1000) [0|0] "mm" HOST

BO_ 769 Set: 8 HOST
 SG_ SetLeft : 0|16@1+ (0.1,-1000) [0|0] "mm" RIG
 SG_ SetRight : 16|16@1+ (0.1,-1000) [0|0] "mm" RIG
 SG_ Spare : 32|8@1+ (1,0) [0|0] "" RIG
 SG_ Enable : 40|8@1+ (1,0) [0|0] "" RIG

BO_ 770 Heart: 1 HOST
 SG_ Alive : 0|8@1+ (1,0) [0|0] "" RIG

BO_ 771 Order: 8 HOST
 SG_ Request : 0|8@1+ (1,0) [0|0] "" RIG

BA_DEF_ SG_ "GenSigStartValue" INT 0 10000;
BA_DEF_DEF_ "GenSigStartValue" 0;
BA_ "GenSigStartValue" SG_ 769 SetLeft 0;
BA_ "GenSigStartValue" SG_ 769 SetRight 0;
BA_ "GenSigStartValue" SG_ 769 Spare 5;
BA_ "GenSigStartValue" SG_ 769 Enable 0;
"""
DATABASE = cantools.database.load_string(DBC)
WIRING = """
[transports.bus]
kind = "can"
dbc = "rig.dbc"
node = "HOST"
messages = { Set = { every = "20 ms" }, Heart = { every = "100 ms", counter = "Alive" } }
points = {}
[transports.plc]
kind = "modbus"
host = "in memory"
stream = "20 ms"
alive = { point = "watchdog", every = "100 ms" }
groups = { image = { every = "50 ms" } }
[transports.plc.points]
place = { table = "input", address = 0, group = "image" }
watchdog = { table = "holding", address = 1 }
enable = { table = "holding", address = 2 }
[signals]
"rig.state" = { from = "bus.Status.State", choices = { DISABLED = 0, HOLD = 1, ACTIVE = 2 } }
"vertical_left.displacement" = { from = "bus.Status.Left", unit = "mm" }
"vertical_right.displacement" = { from = "bus.Status.Right", unit = "mm" }
"vertical_left.displacement_setpoint" = { to = "bus.Set.SetLeft", unit = "mm" }
"vertical_right.displacement_setpoint" = { to = "bus.Set.SetRight", unit = "mm" }
"control.enable" = { to = "plc.enable" }
[[sequences.up]]
start = ["DISABLED"]
orders = [{ "bus.Order.Request" = 1 }]
end = ["HOLD"]
[[sequences.up]]
start = ["HOLD"]
bumpless = true
orders = [{ "bus.Order.Request" = 2 }]
end = ["ACTIVE"]
[sequences]
rest = [{ "bus.Order.Request" = 0 }]
at_rest = ["DISABLED"]
"""


class Stranger:
    """A rig on a bus and a PLC in virtual time: it enters the requested state, and logs its inputs with times."""

    def __init__(self, directory: Path) -> None:
        (directory / "rig.dbc").write_text(DBC)
        self.clock = VirtualClock()
        self.state, self.left, self.right = 0, 12.5, 11.5
        self.frames: list[tuple[str, dict]] = []
        self.words: list[tuple[int, list[int]]] = []
        self._port = InMemoryCan(self._take)
        self.clock.attach(self._advance)
        self._time = 0
        self.description = describe(tomllib.loads(WIRING), directory / "wiring.toml", TABLE)

    def wiring(self, description: Description) -> DescribedWiring:
        ports = {"bus": lambda: self._port, "plc": lambda: InMemoryModbus(self.answer)}
        return open_described("stranger", description, ports)

    def answer(self, adu: bytes) -> bytes:
        return answer(self, adu)

    def bench(self) -> Bench:
        return Bench(self.wiring(self.description), self.clock)

    def _advance(self, until: int) -> None:
        while self._time + 10 * MS <= until:
            self._time += 10 * MS
            values = {"State": self.state, "Left": self.left, "Right": self.right}
            self._port.receive(frame(512, DATABASE.encode_message("Status", values), self._time))

    def _take(self, block: Block) -> None:
        for record in block:
            message = DATABASE.get_message_by_frame_id(int(record["id"]))
            values = message.decode(payload(record))
            self.frames.append((message.name, values))
            if message.name == "Order":
                self.state = values["Request"]

    def read_words(self, holding: bool, address: int, count: int) -> list[int]:
        return [0] * count

    def write_words(self, address: int, words: list[int]) -> None:
        self.words.append((address, words))


@pytest.fixture
def stranger(tmp_path: Path) -> Stranger:
    return Stranger(tmp_path)


def test_no_command_frames_before_the_first_command(stranger):
    with stranger.bench() as bench:
        bench.wait(5.0)
        assert bench.vertical_left.displacement == pytest.approx(12.5 * mm)
    assert stranger.frames == []
    assert stranger.words == []


def test_signs_of_life_come_before_the_first_order_and_set_points_once_they_are_given(stranger):
    with stranger.bench() as bench:
        bench.arm()
        orders = [k for k, (name, _) in enumerate(stranger.frames) if name == "Order"]
        before = [name for name, _ in stranger.frames[: orders[0]]]
        assert set(before) == {"Heart"}
        assert len(before) >= 3, "a rig that wants to see its commander alive has seen it"
        assert len([one for one in stranger.words if one[0] == 1]) >= 3
        bench.vertical_left.displacement_setpoint = 13.5 * mm
        bench.wait(0.1)
    sent = [values for name, values in stranger.frames if name == "Set"]
    assert {values["SetLeft"] for values in sent} == {12.5, 13.5}, "first the measured value, never -1000 mm"
    assert {values["SetRight"] for values in sent} == {11.5}
    assert {values["Spare"] for values in sent} == {5}, "a start value of an unwritten signal"


def test_one_of_two_set_points_in_a_frame_takes_no_start_value_along(stranger):
    with stranger.bench() as bench:
        bench.commander.set("vertical_left.displacement_setpoint", 3 * mm)
        bench.wait(0.5)
        assert {name for name, _ in stranger.frames} == {"Heart"}
        bench.commander.set("vertical_right.displacement_setpoint", 4 * mm)
        bench.wait(0.5)
    sent = [(values["SetLeft"], values["SetRight"]) for name, values in stranger.frames if name == "Set"]
    assert set(sent) == {(3.0, 4.0)}


def test_a_read_only_client_does_not_affect_a_live_rig(stranger):
    stranger.state = 2
    with stranger.bench() as bench:
        assert bench.state == "ACTIVE"
    assert stranger.state == 2
    assert stranger.frames == []


@pytest.mark.parametrize("first", [lambda one: one.write({"Order.Request": 1}), lambda one: one.begin()])
def test_no_transport_sends_before_the_first_command(tmp_path: Path, first: Callable) -> None:
    (tmp_path / "rig.dbc").write_text(DBC)
    clock, sent = VirtualClock(), []
    table = {
        "kind": "can",
        "dbc": "rig.dbc",
        "answers": False,
        "messages": {"Set": {"every": "20 ms"}, "Heart": {"every": "100 ms", "counter": "Alive"}},
    }
    transport = CanTransport(
        "bus",
        table,
        tmp_path,
        port=lambda: InMemoryCan(sent.append),
        streamed=["Set.SetLeft", "Set.SetRight"],
    )
    transport.connect(clock, pytest.fail, within=1.0)
    clock.sleep_until(clock.now() + 2000 * MS)
    assert sent == []
    first(transport)
    clock.sleep_until(clock.now() + 1000 * MS)
    assert {int(one) for block in sent for one in block["id"]} <= {770, 771}
    transport.stream({"Set.SetLeft": 1.0, "Set.SetRight": math.nan}, clock.now())
    clock.sleep_until(clock.now() + 100 * MS)
    assert {int(one) for block in sent for one in block["id"]} <= {770, 771}
    transport.stream({"Set.SetRight": 2.0}, clock.now())
    clock.sleep_until(clock.now() + 100 * MS)
    assert 769 in {int(one) for block in sent for one in block["id"]}
    transport.close()


def test_a_check_doubts_a_connection_that_loses_polls_though_readings_come(stranger):
    count = iter(range(10**6))
    stranger.answer = lambda adu: b"" if next(count) % 8 == 5 else answer(stranger, adu)
    with Listening(stranger.wiring(stranger.description), stranger.clock, WITHIN) as one:
        report = examine(one)
    (noticed,) = report.connections
    assert report.doubtful == ["transport plc"]
    assert re.fullmatch(r"\d+ of \d+ requests got no answer", noticed.remark)
    assert stranger.words == []
