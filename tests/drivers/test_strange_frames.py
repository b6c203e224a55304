"""Frames that differ from the DBC: valid parts are read, dropped ones are reported, and no number is wrong."""

import math
import socket
import struct
import threading
from collections.abc import Callable
from pathlib import Path

import can
import cantools
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_protocol.clock import RealClock, VirtualClock
from bench_protocol.frames import frame, join
from drivers.can_port import has_interface
from drivers.errors import LinkLost, WiringError
from drivers.memory import InMemoryCan
from drivers.stamps import UNCERTAINTY
from drivers.wiring.can.transport import CanTransport

MS = 1_000_000
DBC = """VERSION ""
NS_ :
BS_:
BU_: RIG HOST

BO_ 512 Heights: 8 RIG
 SG_ Left : 0|16@1- (0.01,0) [0|0] "mm" HOST
 SG_ Right : 16|16@1- (0.01,0) [0|0] "mm" HOST
 SG_ Far : 48|16@1- (0.01,0) [0|0] "mm" HOST

BO_ 513 Guarded: 8 RIG
 SG_ Value : 0|16@1- (1,0) [0|0] "" HOST
 SG_ Crc : 56|8@1+ (1,0) [0|0] "" HOST

BO_ 514 Real: 8 RIG
 SG_ Level : 0|32@1- (1,0) [0|0] "mm" HOST
 SG_ Other : 32|16@1- (0.1,0) [0|0] "mm" HOST

SIG_VALTYPE_ 514 Level : 1;
"""
J1939 = """VERSION ""
NS_ :
BS_:
BU_: RIG HOST

BO_ 2566844670 Height: 8 RIG
 SG_ Left : 0|16@1+ (0.0256,0) [0|1645] "mm" HOST
 SG_ Mode : 16|2@1+ (1,0) [0|3] "" HOST
 SG_ Level : 24|8@1+ (0.4,0) [0|100] "%" HOST

BO_ 2566844926 Order: 8 HOST
 SG_ Target : 0|16@1+ (0.0256,0) [0|1645] "mm" RIG

BA_DEF_ "ProtocolType" STRING ;
BA_DEF_DEF_ "ProtocolType" "";
BA_ "ProtocolType" "J1939";
"""
FD = """VERSION ""
NS_ :
BS_:
BU_: RIG HOST

BO_ 600 Wide: 64 RIG
 SG_ First : 0|16@1- (0.01,0) [0|0] "mm" HOST
 SG_ Last : 480|32@1- (0.001,0) [0|0] "mm" HOST

BO_ 601 Order: 20 HOST
 SG_ Target : 128|32@1- (0.001,0) [0|0] "mm" RIG

BO_ 602 Small: 8 RIG
 SG_ One : 0|8@1+ (1,0) [0|0] "" HOST
"""


class Bus:
    """A bus in virtual time on which ``frames`` come every 10 ms, and a transport that hears it."""

    def __init__(self, directory: Path, dbc: str, **keys: object) -> None:
        (directory / "rig.dbc").write_text(dbc)
        self.base = cantools.database.load_string(dbc)
        self.clock, self.frames, self.sent = VirtualClock(), [], []
        self._port, self._time = InMemoryCan(self.sent.append), 0
        table = {"kind": "can", "dbc": "rig.dbc", **keys}
        self.transport = CanTransport("bus", table, directory, port=lambda: self._port)
        self.clock.attach(self._advance)

    def _advance(self, until: int) -> None:
        while self._time + 10 * MS <= until:
            self._time += 10 * MS
            for identifier, extended, data in self.frames:
                self._port.receive(frame(identifier, data, self._time, extended=extended))

    def comes(self, *frames: tuple[int, bytes], extended: bool = False) -> None:
        self.frames = [(identifier, extended, data) for identifier, data in frames]

    def wait(self, seconds: float = 0.1) -> None:
        self.clock.sleep_until(self.clock.now() + round(seconds * 1e9))

    def connect(self) -> "Bus":
        self.transport.connect(self.clock, pytest.fail, within=0.5)
        return self

    def read(self, *names: str) -> list[float]:
        return list(self.transport.read(names).values())


@pytest.fixture
def bus(tmp_path: Path) -> Callable[..., Bus]:
    return lambda dbc=DBC, **keys: Bus(tmp_path, dbc, **keys)


# -- shorter, longer, corrupt, of others -------------------------------------------------------------------------------


def test_what_fits_into_a_short_frame_is_read(bus):
    rig = bus()
    rig.comes((512, struct.pack("<hhh", 1234, -567, 0)))
    rig.connect().wait()
    left, right, far = rig.read("Heights.Left", "Heights.Right", "Heights.Far")
    assert (left, right) == (12.34, -5.67)
    assert math.isnan(far)
    (remark,) = rig.transport.remarks()
    assert "shorter than described: what fits is read" in remark.text


GUARD = {"Guarded": {"checksum": {"signal": "Crc", "scheme": "xor8"}}}


def test_a_checksum_is_where_the_frame_has_it_however_long_it_is(bus):
    rig = bus(messages=GUARD)
    sound = struct.pack("<h5sB", 77, b"", 77)
    rig.comes((513, sound))
    rig.connect().wait()
    assert rig.read("Guarded.Value") == [77.0]
    rig.comes((513, sound[:7]), (512, bytes(8)))
    rig.wait(0.5)
    assert math.isnan(rig.read("Guarded.Value")[0]), "what cannot be checked is not taken"
    assert next(one.text for one in rig.transport.remarks() if one.doubtful).startswith("Guarded: ")


def test_a_new_client_receives_the_replacement(bus):
    rig = bus(messages=GUARD)
    rig.comes((513, bytes([1, 0, 0, 0, 0, 0, 0, 0])), (0x123, b"1"), (0x124, b"2"))
    with pytest.raises(
        LinkLost, match=r"none of its 3 messages came in 0\.5 s; Guarded \(\d+ frames: a wrong"
    ) as told:
        rig.connect()
    assert "0x123 (" in str(told.value)
    assert "frames of no message here)" in str(told.value)
    assert "check that the rig runs" not in str(told.value)


def test_other_identifiers_are_reported_without_doubt(bus):
    rig = bus()
    rig.comes((512, bytes(8)), *((0x300 + k, b"") for k in range(20)))
    rig.connect().wait()
    (remark,) = rig.transport.remarks()
    assert remark.text.startswith("also on the bus: 0x300")
    assert remark.text.endswith("14 other identifiers")
    assert not remark.doubtful


# -- no value ----------------------------------------------------------------------------------------------------------


def test_no_value_is_recognised_as_the_bits_have_it(bus):
    rig = bus(points={"Real.Level": {"null": -999.9}, "Real.Other": {"null": -9999}})
    rig.comes((514, struct.pack("<fhh", -999.9, -9999, 0)))
    rig.connect().wait()
    assert all(math.isnan(value) for value in rig.read("Real.Level", "Real.Other"))
    rig.comes((514, struct.pack("<fhh", 1.5, -999, 0)))
    rig.wait()
    assert rig.read("Real.Level", "Real.Other") == [1.5, pytest.approx(-99.9)]


def test_a_null_that_no_bits_hold_is_refused(bus):
    with pytest.raises(WiringError, match=r"Other: null = -999\.9 does not fit into 16 bits"):
        bus(points={"Real.Other": {"null": -999.9}})


# -- J1939 -------------------------------------------------------------------------------------------------------------


def test_j1939_is_known_by_its_group(bus):
    rig = bus(J1939)
    height = rig.base.get_message_by_name("Height").frame_id
    other = height & ~0x1C0000FF & 0x1FFFFFFF | 3 << 26 | 0x21  # another priority and source address
    rig.comes((other, struct.pack("<HBB4s", 10_000, 1, 100, b"")), extended=True)
    rig.connect().wait()
    assert rig.read("Height.Left", "Height.Mode", "Height.Level") == pytest.approx([256.0, 1.0, 40.0])
    rig.comes((other, struct.pack("<HBB4s", 0xFFFF, 3, 0xFE, b"")), extended=True)
    rig.wait()
    assert all(math.isnan(one) for one in rig.read("Height.Left", "Height.Mode", "Height.Level"))


@pytest.mark.parametrize(
    ("keys", "value"), [({}, 256.0), ({"messages": {"Height": {"source": 0x22}}}, 128.0)]
)
def test_only_one_of_two_senders_of_a_group_is_accepted(bus, keys, value):
    rig = bus(J1939, **keys)
    group = rig.base.get_message_by_name("Height").frame_id & ~0xFF
    rig.comes(
        (group | 0x21, struct.pack("<H6s", 10_000, b"")),
        (group | 0x22, struct.pack("<H6s", 5_000, b"")),
        extended=True,
    )
    received = []
    rig.transport.subscribe(lambda time, points: received.append(points["Height.Left"]))
    rig.connect().wait()
    assert set(received) == {value}
    (remark,) = [one for one in rig.transport.remarks() if one.doubtful]
    assert "frames of another source address and not of" in remark.text


def test_j1939_is_sent_from_an_address_of_ours(bus):
    with pytest.raises(WiringError, match=r"Order has the null address 0xFE as its source; .* source = 0x27"):
        bus(J1939).transport.require("Order.Target", writable=True)
    rig = bus(J1939, messages={"Order": {"source": 0x27}}, answers=False)
    rig.connect().transport.write({"Order.Target": 256.0})
    assert int(rig.sent[0]["id"][0]) & 0xFF == 0x27
    assert bytes(rig.sent[0]["data"][0])[:2] == struct.pack("<H", 10_000)
    with pytest.raises(WiringError, match=r"source = 0x27 is for J1939"):
        bus(messages={"Heights": {"source": 0x27}})


# -- CAN FD ------------------------------------------------------------------------------------------------------------


@pytest.mark.real_time
def test_messages_of_can_fd_on_a_bus_of_python_cans(tmp_path):
    (tmp_path / "rig.dbc").write_text(FD)
    base = cantools.database.load_string(FD)
    table = {"kind": "can", "interface": "virtual", "channel": "fd here", "dbc": "rig.dbc"}
    with pytest.raises(
        WiringError, match=r"Wide\.Last: Wide has 64 bytes, but a CAN frame carries 8; set fd = true"
    ):
        CanTransport("bus", table, tmp_path).require("Wide.Last")
    transport = CanTransport("bus", {**table, "fd": True, "bitrate_switch": True}, tmp_path)
    over = threading.Event()
    with can.Bus(interface="virtual", channel="fd here", protocol=can.CanProtocol.CAN_FD) as far:

        def run() -> None:
            while not over.wait(0.01):
                data = base.encode_message("Wide", {"First": -12.34, "Last": 123.456})
                far.send(can.Message(arbitration_id=600, is_extended_id=False, is_fd=True, data=data))
                far.send(can.Message(arbitration_id=602, is_extended_id=False, data=bytes([7] * 8)))

        thread = threading.Thread(target=run)
        thread.start()
        try:
            transport.connect(RealClock(), pytest.fail, within=2.0)
            while math.isnan(transport.read(["Small.One"])["Small.One"]):
                over.wait(0.01)
            assert list(transport.read(["Wide.First", "Wide.Last"]).values()) == pytest.approx(
                [-12.34, 123.456]
            )
            transport.write({"Order.Target": -5.25})
            message = far.recv(2.0)
            assert message.is_fd and message.bitrate_switch
            assert base.decode_message(601, bytes(message.data)) == {"Target": pytest.approx(-5.25)}
        finally:
            over.set()
            thread.join()
            transport.close()


# -- whatever comes ----------------------------------------------------------------------------------------------------

FRAMES = st.lists(
    st.tuples(
        st.sampled_from([512, 513, 514, 515, 0x7FF]), st.booleans(), st.binary(max_size=8), st.booleans()
    ),
    min_size=1,
    max_size=30,
)


@settings(max_examples=40, deadline=None)
@given(frames=FRAMES)
def test_every_reading_is_in_the_bits_or_is_none(tmp_path_factory, frames):
    """The bits are looked at without cantools: little-endian words, a checksum by hand."""
    directory = tmp_path_factory.mktemp("any")
    (directory / "rig.dbc").write_text(DBC)
    port, received = InMemoryCan(lambda block: None), []
    table = {"kind": "can", "dbc": "rig.dbc", "answers": False, "messages": GUARD}
    table["points"] = {"Real.Level": {"null": 1.5}}
    transport = CanTransport("bus", table, directory, port=lambda: port)
    transport.subscribe(lambda time, points: received.append(points))
    transport.connect(VirtualClock(), pytest.fail, within=1.0)
    for identifier, extended, drawn, mended in frames:
        guarded = mended and len(drawn) == 8 and identifier == 513
        data = drawn[:7] + bytes([_xor(drawn[:7])]) if guarded else drawn
        received.clear()
        port.receive(join([frame(identifier, data, extended=extended)]))
        content = {name: value for points in received for name, value in points.items()}
        assert content.keys() <= _bits(identifier, extended, data).keys()
        for name, value in content.items():
            right = _bits(identifier, extended, data)[name]
            assert value == pytest.approx(right, nan_ok=True), name


def _xor(data: bytes) -> int:
    found = 0
    for byte in data:
        found ^= byte
    return found


def _bits(identifier: int, extended: bool, data: bytes) -> dict[str, float]:
    """What a frame says, by hand."""
    if extended:
        return {}
    words = {place: int.from_bytes(data[place : place + 2], "little", signed=True) for place in (0, 2, 4, 6)}
    there = {place for place in words if place + 2 <= len(data)}
    if identifier == 512:
        names = {0: "Heights.Left", 2: "Heights.Right", 6: "Heights.Far"}
        return {name: words[place] * 0.01 for place, name in names.items() if place in there}
    if identifier == 513 and len(data) == 8 and _xor(data[:7]) == data[7]:
        return {"Guarded.Value": words[0], "Guarded.Crc": data[7]}
    if identifier == 514:
        level = struct.unpack("<f", data[:4])[0] if len(data) >= 4 else math.nan
        found = {"Real.Level": math.nan if level == 1.5 else level} if len(data) >= 4 else {}
        return found | ({"Real.Other": words[4] * 0.1} if len(data) >= 6 else {})
    return {}


@pytest.mark.vcan
@pytest.mark.skipif(not has_interface("vcan0"), reason="tools/with_vcan.sh runs it where there is a vcan0")
@pytest.mark.real_time
def test_frames_of_can_fd_go_both_ways_on_socketcan(tmp_path):
    """The other end is a plain socket: struct canfd_frame of linux/can.h, and struct can_frame."""
    (tmp_path / "rig.dbc").write_text(FD)
    table = {
        "kind": "can",
        "dbc": "rig.dbc",
        "bus": "vcan0",
        "fd": True,
        "bitrate_switch": True,
        "answers": False,
    }
    transport, received, clock = CanTransport("bus", table, tmp_path), [], RealClock()
    transport.subscribe(lambda time, points: received.append((time, points)))
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as other:
        other.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        other.bind(("vcan0",))
        other.settimeout(5.0)
        transport.connect(clock, pytest.fail, within=5.0)
        wide = struct.pack("<h58xi", -1234, 765432)
        other.send(struct.pack("=IBBxx64s", 600, 64, 1, wide))
        other.send(struct.pack("=IB3x8s", 602, 8, b"\x07"))
        for _ in range(500):
            if len(received) < 2:
                threading.Event().wait(0.01)
        transport.write({"Order.Target": 12.345})
        word, length, flags, data = struct.unpack("=IBBxx64s", other.recv(72))
        stamp = transport.stamp("Wide.First")
        transport.close()
    (time, points), (_, small) = received
    assert points == {"Wide.First": -12.34, "Wide.Last": 765.432}
    assert small == {"Small.One": 7.0}
    assert 0 <= clock.now() - time < 5_000_000_000
    assert (stamp.clock, stamp.within) == ("system", UNCERTAINTY["system"]), "this interface has no clock"
    assert (word, length, flags & 1) == (601, 20, 1), "at the fast rate"
    assert struct.unpack_from("<i", data, 16) == (12345,)
