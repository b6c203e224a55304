"""The socketcand codec: decoding restores the input, for any cut and any sender."""

import struct
from itertools import pairwise

import can
import numpy as np
import pytest
from can.interfaces.socketcand.socketcand import (
    convert_ascii_message_to_can_message,
    convert_can_message_to_ascii_message,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_protocol.frames import FRAME, Block, empty_block, frame, join
from bench_protocol.socketcand import (
    LINE_MAX,
    Command,
    Event,
    Malformed,
    Parser,
    Received,
    Sent,
    beacon_bytes,
    error_bytes,
    frame_bytes,
    iterate,
    open_bytes,
    send_bytes,
)
from tests.refusals import refuses

MICROSECONDS = st.integers(0, 4_000_000_000_000_000)


@st.composite
def frames(draw: st.DrawFn) -> Block:
    extended = draw(st.booleans())
    identifier = draw(st.integers(0, 0x1FFF_FFFF if extended else 0x7FF))
    data = draw(st.binary(max_size=8))
    return frame(identifier, data, 1000 * draw(MICROSECONDS), extended=extended)


blocks = st.lists(frames(), max_size=20).map(join)


def pieces(data: bytes, cuts: list[int]) -> list[bytes]:
    places = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    return [data[a:b] for a, b in pairwise(places)]


def flattened(events: list[Event]) -> list[object]:
    """Events without regard to how frames were gathered into blocks."""
    flat: list[object] = []
    for event in events:
        if isinstance(event, Received | Sent):
            flat += [(type(event).__name__, *each) for each in iterate(event.block)]
        else:
            flat.append(event)
    return flat


def only_block(events: list[Event], kind: type) -> Block:
    assert all(isinstance(event, kind) for event in events), events
    return join(event.block for event in events)


@settings(deadline=None)
@given(blocks, st.lists(st.integers(0), max_size=6))
def test_a_servers_frames_survive_any_splitting(block: Block, cuts: list[int]) -> None:
    parser = Parser()
    events = [event for piece in pieces(frame_bytes(block), cuts) for event in parser.feed(piece)]
    assert only_block(events, Received).tobytes() == block.tobytes()


@settings(deadline=None)
@given(blocks, st.lists(st.integers(0), max_size=6))
def test_a_clients_frames_survive_any_splitting(block: Block, cuts: list[int]) -> None:
    parser = Parser()
    events = [event for piece in pieces(send_bytes(block), cuts) for event in parser.feed(piece)]
    timeless = block.copy()
    timeless["time"] = 0
    assert only_block(events, Sent).tobytes() == timeless.tobytes()


LINES = st.one_of(
    blocks.map(frame_bytes),
    blocks.map(send_bytes),
    st.sampled_from(
        [
            b"< hi >",
            b"<ok>",
            b"  <  open   vcan0  >\r\n",
            b"< send 123 9 1 2 3 4 5 6 7 8 9 >",
            b"< send 20000000 0 >",
            b"< send 3FFFFFFF 1 1 >",
            b"< send 12 2 1 >",
            b"< frame 123 17.5 1 >",
            b"< frame FFFFFFFF 17.5  >",
            b"< frame 7FF 9700000000.0 00 >",
            b"< frame 7FF 9223372035.999999999 00 >",
            b"< send 800 1\t 0 >",
            b"< send 123 2 \t1 2 >",
            b"<>",
            b"< fr< echo >",
            b"> >",
            b"junk",
            b"<" + b"a" * LINE_MAX + b">",
            b"<" + b"a" * LINE_MAX,
            b"< \xff\xfe >",
        ]
    ),
    st.binary(max_size=40),
    st.text("<> sendframe0123fF.\n", max_size=40).map(str.encode),
)


@settings(deadline=None)
@given(st.lists(LINES, max_size=8).map(b"".join), st.lists(st.integers(0), max_size=8))
def test_any_bytes_mean_the_same_however_they_are_cut(data: bytes, cuts: list[int]) -> None:
    whole = Parser().feed(data)
    parser = Parser()
    cut = [event for piece in pieces(data, cuts) for event in parser.feed(piece)]
    # Byte by byte, no line ever meets the fast way together with others.
    slow = Parser()
    single = [event for value in data for event in slow.feed(bytes([value]))]
    assert flattened(whole) == flattened(cut) == flattened(single)


def test_the_memory_of_a_parser_is_bounded() -> None:
    parser = Parser()
    events = []
    for _ in range(100):
        events += parser.feed(b"<" + b"x" * 100_000)
        assert len(parser._rest) <= LINE_MAX
    assert len(events) == 100
    assert all(isinstance(event, Malformed) and str(LINE_MAX) in event.reason for event in events)
    assert parser.feed(b"x> < hi >") == [Command("hi")]


@pytest.mark.parametrize("length", [LINE_MAX - 1, LINE_MAX, LINE_MAX + 1])
def test_the_longest_line_is_socketcands(length: int) -> None:
    line = b"< " + b"a" * (length - 4) + b" >"
    (event,) = Parser().feed(line)
    assert isinstance(event, Command if length <= LINE_MAX else Malformed)


# --- other people's spelling ---------------------------------------------------------------------------------------


def sent(line: bytes) -> tuple[int, int, bool, bytes]:
    ((one,),) = (tuple(iterate(event.block)) for event in Parser().feed(line) if isinstance(event, Sent))
    return one


def test_savvycan_sign_extends_bytes_and_does_not_pad_identifiers() -> None:
    line = b"< send 7 4 fffffff1 a 0 ffffffffffffff80 >"
    assert sent(line) == (0, 7, False, bytes([0xF1, 0x0A, 0x00, 0x80]))


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (b"< send 123 0 >", (0x123, False, b"")),
        (b"<send 123 1 5>", (0x123, False, b"\x05")),
        (b"< send 800 1\t 0 >", (0x800, True, b"\x00")),
        (b"<   send\t1F   2  0a B  >", (0x1F, False, b"\x0a\x0b")),
        (b"< send 00000123 1 ff >", (0x123, True, b"\xff")),
        (b"< send 12345 1 ff >", (0x12345, True, b"\xff")),  # cannot be a standard identifier
        (b"< send 1FFFFFFF 1 007 >", (0x1FFF_FFFF, True, b"\x07")),
        (b"<" + b" " * 500 + b"send 1 1 1>", (0x1, False, b"\x01")),
    ],
)
def test_a_client_may_write_as_it_likes(line: bytes, expected: tuple[int, bool, bytes]) -> None:
    assert sent(line)[1:] == expected


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (b"< frame 123 1700000000.123456 1A220344 >", (1_700_000_000_123_456_000, 0x123, False, "1A220344")),
        (b"< frame 123 1700000000.123456  >", (1_700_000_000_123_456_000, 0x123, False, "")),
        (b"< frame 123 1700000000.123456 >", (1_700_000_000_123_456_000, 0x123, False, "")),
        (b"< frame 123 1.5 11 22 33 >", (1_500_000_000, 0x123, False, "112233")),  # before 2012
        (b"< frame 00000123 1 11 >", (1_000_000_000, 0x123, True, "11")),
        (b"< frame 7 0.000000001 >", (1, 7, False, "")),
    ],
)
def test_a_server_may_be_old(line: bytes, expected: tuple[int, int, bool, str]) -> None:
    (event,) = Parser().feed(line)
    assert isinstance(event, Received)
    ((time, identifier, extended, data),) = iterate(event.block)
    assert (time, identifier, extended, data) == (*expected[:3], bytes.fromhex(expected[3]))


@pytest.mark.parametrize(
    ("line", "why"),
    [
        (
            b"< send 123 9 1 2 3 4 5 6 7 8 9 >",
            "length 9 does not fit; a classic CAN frame carries 0 to 8 bytes",
        ),
        (b"< send 123 3 1 2 >", "length 3 announced, but 2 data bytes follow"),
        (
            b"< frame 7FF 9700000000.0 00 >",
            "time stamp of 9700000000 s is too late; use 9223372035 s or less",
        ),
        (b"< send 123 1 1 2 >", "length 1 announced, but 2 data bytes follow"),
        (b"< send 123 1 100 >", "data byte '100' is not a hexadecimal number from 0 to ff"),
        (b"< send 123 1 ffffff7f >", "data byte 'ffffff7f'"),  # sign extension of a positive number
        (b"< send xyz 1 1 >", "identifier 'xyz' is not a hexadecimal number from 0 to 1fffffff"),
        (b"< send 20000000 1 1 >", "identifier '20000000'"),
        (b"< send 123 >", "it needs an identifier, a length and data"),
        (b"< send 123 -1 >", "length '-1'"),
        (b"< frame 123 now 11 >", "time stamp 'now' is not seconds.microseconds"),
        (b"< frame 123 1.0 111 >", "data '111' is not pairs of hexadecimal digits"),
        (b"< frame 123 1.0 112233445566778899 >", "9 data bytes"),
        (b"< frame 123 >", "it needs an identifier, a time stamp and data"),
        (b"< \x00\xff >", "is not a message"),
        (b"< send 12< hi >", "was not closed by '>'"),
    ],
)
def test_an_error_names_the_sender_and_what_would_be_right(line: bytes, why: str) -> None:
    first = Parser(sender="the client").feed(line)[0]
    assert isinstance(first, Malformed)
    assert first.reason.startswith("the client sent a bad line: ")
    assert why in first.reason
    assert first.reason.isprintable()


def test_a_bad_line_costs_only_itself() -> None:
    good = send_bytes(frame(0x10, b"\x01")), send_bytes(frame(0x11, b"\x02"))
    events = Parser().feed(good[0] + b"< send 10 1 xx >" + good[1] + b"< echo >")
    assert [type(event) for event in events] == [Sent, Malformed, Sent, Command]


# --- against the client that comes with python-can ---------------------------------------------------------------


@settings(deadline=None)
@given(frames())
def test_python_can_understands_our_frames(block: Block) -> None:
    message = convert_ascii_message_to_can_message(frame_bytes(block).decode())
    ((time, identifier, extended, data),) = iterate(block)
    assert (message.arbitration_id, message.is_extended_id, bytes(message.data)) == (
        identifier,
        extended,
        data,
    )
    assert message.timestamp == pytest.approx(time * 1e-9, abs=1e-6)


@settings(deadline=None)
@given(frames())
def test_we_understand_python_cans_frames(block: Block) -> None:
    ((_, identifier, extended, data),) = iterate(block)
    message = can.Message(arbitration_id=identifier, is_extended_id=extended, data=data)
    assert sent(convert_can_message_to_ascii_message(message).encode()) == (0, identifier, extended, data)


# --- the rest --------------------------------------------------------------------------------------------------------


def test_spelling_is_that_of_the_protocol() -> None:
    block = join(
        [
            frame(0x123, bytes.fromhex("1A220344"), 1_700_000_000_123_456_789),
            frame(0x7, b"", 1_700_000_000_000_001_000, extended=True),
        ]
    )
    assert frame_bytes(block) == (
        b"< frame 123 1700000000.123456 1A220344 >< frame 00000007 1700000000.000001  >"
    )
    assert send_bytes(block) == b"< send 123 4 1a 22 03 44 >< send 00000007 0 >"
    assert open_bytes("vcan0") == b"< open vcan0 >"
    assert frame_bytes(empty_block()) == send_bytes(empty_block()) == b""


@pytest.mark.parametrize("bus", ["", "vcan 0", "a>b", "x" * 16, "vcanä"])
def test_only_an_interface_name_can_be_opened(bus: str) -> None:
    with refuses(ValueError, "CAN"):
        open_bytes(bus)


def test_other_arrays_are_refused() -> None:
    with refuses(TypeError, "frame"):
        frame_bytes(np.zeros(3, np.int64))


@settings(deadline=None)
@given(st.text(max_size=300))
def test_a_refusal_stays_one_line(reason: str) -> None:
    (event,) = Parser().feed(error_bytes(reason))
    assert isinstance(event, Command)
    assert event.word == "error"


def test_the_beacon_is_the_xml_python_can_looks_for() -> None:
    import xml.etree.ElementTree as ET

    root = ET.fromstring(beacon_bytes("a&b", "127.0.0.1", 29536, ("vcan0",), "test"))
    assert (root.tag, root.attrib["name"], root.attrib["type"]) == ("CANBeacon", "a&b", "SocketCAN")
    assert root.findtext("URL") == "can://127.0.0.1:29536"
    assert [bus.attrib["name"] for bus in root.iter("Bus")] == ["vcan0"]


def test_the_packed_record_is_the_frame_type() -> None:
    """The codec moves frames as bytes of this layout; if ``FRAME`` changes, it must too."""
    block = frame(0x1234567, b"\x01\x02", 42, extended=True)
    assert FRAME.itemsize == struct.calcsize("<qIBB8s")
    assert struct.unpack("<qIBB8s", block.tobytes()) == (42, 0x1234567, 1, 2, b"\x01\x02\0\0\0\0\0\0")
