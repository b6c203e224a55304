"""The rig's SDO server, only by frames: its answers, its refusals with reasons, and its robustness."""

import struct
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_protocol.frames import frame, join
from bench_protocol.object_dictionary import OBJECT_DICTIONARY
from bench_protocol.table import TABLE
from bench_sim.rig.rig import Rig
from tests.rig.master import (
    REQUEST,
    RESET_COMMUNICATION,
    RESPONSE,
    Master,
    number,
)


@pytest.fixture
def master(make_rig: Callable[..., Rig]) -> Master:
    return Master(make_rig())


def test_the_device_says_who_it_is(master: Master) -> None:
    assert master.upload(0x1008) == b"ASTB virtual air spring test bench"
    assert master.upload(0x100A) == f"map {TABLE.map_hash:08x}".encode()
    assert number(master.upload(0x1018, 3)) == TABLE.map_hash


def test_every_object_can_be_read_and_readings_are_those_of_the_frames(commander) -> None:
    master = Master(commander.rig)
    for one in OBJECT_DICTIONARY:
        for entry in one.entries:
            if entry.readable and not (one.index == 0x1003 and entry.sub):
                data = master.upload(one.index, entry.sub)
                assert len(data) == entry.type.size or entry.type.size == 0
    row = TABLE["left.bellows_temperature"]
    commander.wait(5000)
    value = struct.unpack("<f", master.upload(0x3000 + row.address))[0]
    code = int.from_bytes(master.upload(0x2382, 1), "little", signed=True)
    assert value == pytest.approx(commander.read("left.bellows_temperature"), rel=0.01)
    assert code * row.step == pytest.approx(value, rel=0.01)
    half = TABLE["rig.nominal_preload"]
    assert struct.unpack("<f", master.upload(0x4000 + half.address))[0] == half.default
    nothing = TABLE["left.height"].address
    commander.rig.values[TABLE.index["left.height"]] = np.nan
    assert np.isnan(struct.unpack("<f", commander.rig.node.objects.read(0x3000 + nothing, 0))[0])
    assert commander.rig.node.objects.read(0x2181, 1) == b"\x00\x80"


@pytest.mark.parametrize(
    ("index", "sub", "value", "size", "code"),
    [
        (0x1234, 0, 0, 1, 0x06020000),
        (0x1018, 9, 0, 1, 0x06090011),
        (0x1018, 1, 0, 4, 0x06010002),
        (0x3064, 0, 0, 4, 0x06010002),
        (0x2201, 1, 1, 1, 0x08000021),
        (0x1017, 0, 200, 4, 0x06070012),
        (0x1017, 0, 200, 1, 0x06070013),
        (0x1017, 0, 99, 2, 0x06090032),
        (0x1006, 0, 9_000, 4, 0x06090032),
        (0x1006, 0, 10_500, 4, 0x06090030),
        (0x1005, 0, 0x81, 4, 0x06090030),
        (0x1016, 1, 0x1_0064, 4, 0x06040043),
        (0x1016, 1, 0x80_0064, 4, 0x06090030),
        (0x1029, 1, 3, 1, 0x06090031),
        (0x1800, 2, 0, 1, 0x06090030),
        (0x1800, 2, 241, 1, 0x06090030),
        (0x1800, 1, 0x182, 4, 0x06090030),
        (0x1400, 1, 0x202, 4, 0x06010002),
        (0x1A00, 0, 0, 1, 0x06010002),
        (0x1003, 0, 1, 1, 0x06090030),
    ],
)
def test_a_download_that_cannot_be_is_aborted_for_its_reason(
    master: Master, index: int, sub: int, value: int, size: int, code: int
) -> None:
    assert master.download(index, sub, value, size) == code


def test_an_upload_that_cannot_be_is_aborted_for_its_reason(master: Master) -> None:
    assert master.abort_code(0x2001) == 0x06010001
    assert master.abort_code(0x22FF) == 0x06020000
    assert master.abort_code(0x1000, 1) == 0x06090011
    assert master.ask(b"\x60" + bytes(7))[4:] == (0x05040001).to_bytes(4, "little"), "no transfer under way"
    assert master.ask(b"\xa0" + bytes(7))[4:] == (0x05040001).to_bytes(4, "little"), "block transfer"
    assert master.ask(b"\x40\x08\x10" + bytes(5))[0] == 0x41
    assert master.ask(b"\x70" + bytes(7))[4:] == (0x05030000).to_bytes(4, "little"), "toggle bit"


def test_a_download_may_come_in_segments_and_without_its_size(master: Master) -> None:
    assert master.ask(b"\x21\x17\x10\x00\x02\0\0\0")[0] == 0x60
    assert master.ask(b"\x0b\xc8\x00" + bytes(5))[0] == 0x20
    assert number(master.upload(0x1017)) == 200
    assert master.ask(b"\x22\x17\x10\x00\x2c\x01\0\0")[0] == 0x60
    assert number(master.upload(0x1017)) == 300


def test_a_client_that_does_not_wait_gets_few_answers_and_the_rest_is_counted(master: Master) -> None:
    request = frame(REQUEST, struct.pack("<BHB4x", 0x40, 0x1000, 0))
    master.rig.receive(join([request] * 1000), "flood")
    assert (master.wait(1)["id"] == RESPONSE).sum() == 8
    assert number(master.upload(0x2000, 3)) == 992


requests = st.one_of(
    st.binary(max_size=8),
    st.builds(
        lambda head, place, rest: bytes((head,)) + struct.pack("<HB", *place) + rest,
        st.integers(0, 255),
        st.sampled_from([(one.index, entry.sub) for one in OBJECT_DICTIONARY for entry in one.entries]),
        st.binary(min_size=4, max_size=4),
    ),
)


@pytest.fixture(scope="module")
def fuzzed(parameters) -> Master:
    return Master(Rig(parameters, seed=1))


@settings(max_examples=150, deadline=None)
@given(st.lists(requests, min_size=1, max_size=12))
def test_whatever_is_asked_is_answered_by_eight_bytes_or_not_at_all(
    fuzzed: Master, asked: list[bytes]
) -> None:
    for request in asked:
        answers = [data for identifier, data in fuzzed.say(REQUEST, request) if identifier == RESPONSE]
        silent = len(request) != 8 or request[0] >> 5 == 4
        assert len(answers) == (0 if silent else 1)
        for answer in answers:
            assert len(answer) == 8
            if answer[0] >> 5 == 4:
                assert answer[0] == 0x80 and number(answer[4:]) >= 0x05030000
    fuzzed.nmt(RESET_COMMUNICATION)
    assert fuzzed.upload(0x1008).startswith(b"ASTB")
