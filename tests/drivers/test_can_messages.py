"""Messages described without a DBC, schemes of checksums, and every description of a bus that cannot be."""

from collections.abc import Callable
from functools import reduce
from operator import xor
from pathlib import Path

import cantools
import e2e.p01
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_protocol.clock import VirtualClock
from bench_protocol.frames import Block, frame, payload
from drivers.errors import WiringError
from drivers.memory import InMemoryCan
from drivers.wiring.can.transport import CanTransport
from drivers.wiring.transports import open_transport
from tests.drivers.can_stand import BUS, write_files
from tests.refusals import refuses


@pytest.fixture(scope="module")
def where(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_files(tmp_path_factory.mktemp("wiring"))


# --- without a DBC ------------------------------------------------------------------------------------------------


@given(
    st.lists(st.tuples(st.integers(1, 20), st.floats(0, 1)), min_size=1, max_size=6),
    st.sampled_from(["little", "big"]),
    st.booleans(),
    st.sampled_from([1.0, 0.5, 0.01, -2.0]),
    st.sampled_from([0.0, -300.0, 7.5]),
    st.integers(0, 0x1FFF_FFFF),
)
def test_own_bits_are_coded_as_cantools_codes_them(
    fields: list[tuple[int, float]],
    order: str,
    signed: bool,
    scale: float,
    offset: float,
    identifier: int,
) -> None:
    """The description gives bits, cantools a DBC of the same bits; frames of either are read by the other."""
    points, lines, raws, start = {}, [], {}, 0
    for k, (length, fraction) in enumerate(fields):
        if start + length > 64:
            break
        place = start if order == "little" else start // 8 * 8 + 7 - start % 8
        points[f"M.s{k}"] = {
            "start": place, "length": length, "byte_order": order, "signed": signed, "scale": scale, "offset": offset,
        }  # fmt: skip
        coded = f"{place}|{length}@{int(order == 'little')}{'-' if signed else '+'} ({scale},{offset})"
        lines.append(f' SG_ s{k} : {coded} [0|0] "" X')
        low = -(1 << length - 1) if signed else 0
        raws[f"M.s{k}"] = low + round(fraction * ((1 << length) - 1))
        start += length
    number = identifier | 0x8000_0000 if identifier > 0x7FF else identifier
    foreign = cantools.database.load_string(
        'VERSION ""\nNS_ :\nBS_:\nBU_: X\n' + f"BO_ {number} M: 8 X\n" + "\n".join(lines) + "\n"
    ).messages[0]
    sent: list[Block] = []
    table = {"kind": "can", "messages": {"M": {"id": identifier}}, "points": points, "answers": False}
    ports: list[InMemoryCan] = []

    def port() -> InMemoryCan:
        ports.append(InMemoryCan(sent.append))
        return ports[-1]

    values = {name: offset + scale * raw for name, raw in raws.items()}
    writer, reader = (CanTransport("bus", table, Path(), port=port) for _ in range(2))
    writer.connect(VirtualClock(), pytest.fail, within=1.0)
    writer.write(values)
    (record,) = sent[0]
    assert (record["id"], record["extended"]) == (identifier, identifier > 0x7FF)
    text = foreign.decode(payload(record), scaling=False)
    assert text == {name[2:]: raw for name, raw in raws.items()}
    reader.connect(VirtualClock(), pytest.fail, within=1.0)
    data_bytes = foreign.encode({name[2:]: raw for name, raw in raws.items()}, scaling=False)
    ports[-1].receive(frame(identifier, data_bytes, extended=identifier > 0x7FF))
    assert reader.read(list(values)) == pytest.approx(values)


@pytest.mark.parametrize(
    ("guard", "expected"),
    [
        ({"scheme": "sum8"}, lambda data: sum(data) % 256),
        ({"scheme": "sum8", "start": 3, "identifier": True}, lambda data: (3 + 1 + 0x23 + sum(data)) % 256),
        ({"scheme": "xor8"}, lambda data: reduce(xor, data, 0)),
        ({"scheme": "function:weighted"}, lambda data: sum(k * byte for k, byte in enumerate(data, 1)) % 251),
        ({"scheme": "e2e_p1", "data_id": 0x4321}, None),
    ],
)
def test_each_scheme(where: Path, guard: dict, expected: Callable | None) -> None:
    sent: list[Block] = []
    table = {
        "kind": "can",
        "answers": False,
        "messages": {"M": {"id": 0x123, "counter": "n", "checksum": {"signal": "c", **guard}}},
        "points": {
            "M.c": {"start": 0, "length": 8},
            "M.n": {"start": 8, "length": 4},
            "M.v": {"start": 16, "length": 48},
        },
    }
    port = InMemoryCan(sent.append)
    transport = CanTransport("bus", table, where, functions=where / "own.py", port=lambda: port)
    transport.connect(VirtualClock(), pytest.fail, within=1.0)
    for k in range(20):
        transport.write({"M.v": k * 0x0123_4567_89})
    for k, block in enumerate(sent):
        data = payload(block[0])
        if expected is None:
            foreign = bytearray(b"\0" + data[1:])
            e2e.p01.e2e_p01_protect(foreign, 0x4321, increment_counter=False)
            assert bytes(foreign) == data
        else:
            assert data[0] == expected(b"\0" + data[1:])
            assert data[1] & 0xF == k % 16


# --- descriptions that cannot be ------------------------------------------------------------------------------------


def messages(**changes: object) -> dict:
    return {"messages": {**BUS["messages"], **changes}}


def own(points: dict, **keys: object) -> dict:
    return {"dbc": None, "messages": {"M": {"id": 0x100, **keys}}, "points": points}


BITS = {"start": 0, "length": 8}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"buss": "x"}, "transports.bus 'buss' 'bus'"),
        ({"dbc": "none.dbc"}, "dbc 'none.dbc'"),
        ({"dbc": "own.py"}, "dbc 'own.py' DBC 2"),
        ({"node": "HOSTS"}, "node 'HOSTS' DBC 'HOST'"),
        ({"burst_begins": "Heights"}, "burst_begins"),
        ({"burst": "5 ms", "burst_begins": "Hights"}, "burst_begins 'Hights' 'Heights'"),
        ({"burst": "5 ms", "burst_begins": "Stream"}, "burst_begins 'Stream'"),
        ({"burst": "5 ms", "burst_begins": "Set", "node": "HOST"}, "burst_begins 'Set'"),
        ({"node": "RIG"}, "messages.Heart RIG HOST"),
        ({"stale": "soon"}, "stale 'soon'"),
        (messages(Height={}), "messages.Height rig.dbc 'Heights'"),
        (messages(Set={"id": 5}), "messages.Set id 0x5 DBC"),
        (messages(Set={"every": "0 ms"}), "messages.Set every '0 ms'"),
        (messages(Set={"counter": "Alife"}), "messages.Set 'Alife' 'Alive'"),
        (messages(Set={"counter": "Alive", "counter_period": 17}), "counter_period 17 16"),
        (messages(Set={"values": {"Mode": 300}}), "messages.Set Mode 300"),
        (messages(Set={"checksum": {"signal": "Crc", "scheme": "crc"}}), "scheme 'crc'"),
        (messages(Set={"checksum": {"signal": "CRC", "scheme": "xor8"}}), "checksum 'CRC'"),
        (messages(Set={"checksum": {"signal": "Alive", "scheme": "xor8"}}), "4 xor8 8"),
        (messages(Set={"checksum": {"signal": "Crc", "scheme": "e2e_p1"}}), "e2e_p1 data_id"),
        (messages(Set={"checksum": {"signal": "Mode", "scheme": "e2e_p1", "data_id": 1}}), "byte 0"),
        (messages(Set={"checksum": {"signal": "Crc", "scheme": "function:wait"}}), "'wait' own.py"),
        (messages(Set={"checksum": {"scheme": "sum8"}}), "checksum"),
        ({"messages": {"*": {"counter": "Alife"}}}, "messages.\"*\" 'Alife' 'Alive'"),
        ({"messages": {"*": {"every": "1 s"}}}, "messages.\"*\" 'every'"),
        ({"points": {"Heights": {"null": 1}}}, "transports.bus.points Message.Signal"),
        ({"points": {"Heights.Lefft": {"null": 1}}}, "'Lefft' 'Left'"),
        ({"points": {"Heights.Left": {"scale": 2.0}}}, "Heights.Left DBC"),
        ({"points": {"Weights.Left": {"null": 1}}}, "'Weights' rig.dbc 'Heights'"),
        ({"dbc": None, "messages": {}, "points": {}}, "messages"),
        ({"dbc": None, "messages": {"M": {}}, "points": {}}, "DBC"),
        (own({}), '"M.Signal"'),
        (own({"M.a": BITS}, id=0x800, extended=False), "id 0x800 11-bit 0 0x7ff"),
        (own({"M.a": BITS}, id=0x2000_0000), "id 0x20000000 29-bit"),
        (own({"M.a": BITS}, length=9), "length 9 bytes CAN 8"),
        (own({"M.a": {"start": 60, "length": 8}}), "messages.M"),
        (own({"M.a": BITS, "M.b": {"start": 7, "length": 2}}), "overlapping"),
        (own({"M.a": {"start": 3}}), "M.a needs"),
        (own({"M.a": {**BITS, "float": True}}), "M.a length 8"),
        (own({"M.a": {**BITS, "page": 2}}), "M.a page 2"),
        (own({"M.a": {**BITS, "scale": 0}}), "M.a scale 0"),
        ({"messages": {"M": {"id": 0x201}}, "points": {"M.a": BITS}}, "identifier 0x201"),
    ],
)
def test_invalid_descriptions_are_refused(changes: dict, words: str, where: Path) -> None:
    def never() -> InMemoryCan:
        raise AssertionError("the bus is not opened")

    with refuses(WiringError, words):
        open_transport("bus", {**BUS, **changes}, where, functions=where / "own.py", port=never)


ODD = """VERSION ""
NS_ :
BS_:
BU_: PLC BENCH
BO_ 256 Heights: 8 PLC
 SG_ Left : 0|16@1- (0.01,0) [0|0] "°C" BENCH
BO_ 512 Faults: 8 PLC
 SG_ Code : 0|8@1+ (1,0) [0|255] "" BENCH
 SG_ Pump : 0|1@1+ (1,0) [0|1] "" BENCH
BO_ 513 One: 8 PLC
 SG_ A : 0|8@1+ (1,0) [0|0] "" BENCH
BO_ 513 Other: 8 PLC
 SG_ B : 0|8@1+ (1,0) [0|0] "" BENCH
BO_ 514 Twice: 8 PLC
 SG_ C : 0|8@1+ (1,0) [0|0] "" BENCH
BO_ 515 Twice: 8 PLC
 SG_ C : 0|8@1+ (1,0) [0|0] "" BENCH
BO_ 516 Wide: 1 PLC
 SG_ In : 0|8@1+ (1,0) [0|0] "" BENCH
 SG_ Out : 0|16@1+ (1,0) [0|0] "" BENCH
BO_ 517 Double: 8 PLC
 SG_ D : 0|8@1+ (1,0) [0|0] "" BENCH
 SG_ E : 8|8@1+ (1,0) [0|0] "" BENCH
 SG_ E : 16|8@1+ (1,0) [0|0] "" BENCH
"""


@pytest.mark.parametrize("charset", ["utf-8", "utf-8-sig", "cp1252"])
def test_of_a_dbc_only_what_is_used_is_judged(tmp_path: Path, charset: str) -> None:
    (tmp_path / "rig.dbc").write_text(ODD, encoding=charset)
    table = {"kind": "can", "dbc": "rig.dbc", "answers": False}
    transport = CanTransport("bus", table, tmp_path)
    for point in ("Heights.Left", "Twice_0x202.C", "Twice_0x203.C", "Faults.Pump", "Wide.In", "Double.D"):
        transport.require(point)
    for point, words in (
        ("Wide.Out", "Wide.Out cannot be read: the signal does not fit into the 1 bytes of Wide"),
        ("Double.E", "Double.E cannot be read: Double has two signals of this name"),
        ("One.A", "One.A cannot be used: One and Other have the same identifier, 0x201"),
        ("Other.B", "One and Other have the same identifier, 0x201"),
        ("Twice.C", r"no message for 'Twice.C'"),
    ):
        with pytest.raises(WiringError, match=words):
            transport.require(point)
    with refuses(WiringError, "Faults.Pump"):
        transport.require("Faults.Pump", writable=True)
    with refuses(WiringError, "messages.Faults"):
        CanTransport("bus", {**table, "messages": {"Faults": {"every": "10 ms"}}}, tmp_path)
    CanTransport("bus", {**table, "messages": {"Faults": {"stale": "1 s"}}}, tmp_path)


def test_signals_that_share_bits_are_read_each_as_it_is_described(tmp_path: Path) -> None:
    (tmp_path / "rig.dbc").write_text(ODD)
    port = InMemoryCan(lambda block: None)
    transport = CanTransport(
        "bus", {"kind": "can", "dbc": "rig.dbc", "answers": False}, tmp_path, port=lambda: port
    )
    clock = VirtualClock()
    transport.connect(clock, pytest.fail, within=1.0)
    port.receive(frame(512, b"\x03" + bytes(7), clock.now()))
    port.receive(frame(516, b"\x07", clock.now()))
    names = ["Faults.Code", "Faults.Pump", "Wide.In"]
    assert transport.read(names) == dict(zip(names, (3.0, 1.0, 7.0), strict=True))


def test_the_charset_of_a_dbc_is_a_key(tmp_path: Path) -> None:
    (tmp_path / "rig.dbc").write_text(ODD.replace("°C", "č"), encoding="cp1250")
    table = {"kind": "can", "dbc": "rig.dbc", "answers": False, "charset": "cp1250"}
    CanTransport("bus", table, tmp_path).require("Heights.Left")
    with refuses(WiringError, 'charset "klingon" "utf-8"'):
        CanTransport("bus", {**table, "charset": "klingon"}, tmp_path)
