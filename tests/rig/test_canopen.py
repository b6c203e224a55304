"""The rig as a CANopen node, by frames alone: boot-up, heartbeats, NMT, SYNC, SDO, and who may do what."""

import struct
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_protocol.canopen import NmtState
from bench_protocol.frames import Block, frame, join, payload
from bench_protocol.object_dictionary import OBJECT_DICTIONARY
from bench_protocol.table import TABLE
from bench_sim.rig.rig import Rig
from bench_sim.rig.tick import FRAMES_PER_TICK_MAX

NMT, SYNC, EMERGENCY, RESPONSE, REQUEST, HEARTBEAT = 0x000, 0x080, 0x081, 0x581, 0x601, 0x701
START, STOP, PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION = 1, 2, 128, 129, 130
IDENTIFIERS = {message.name: message.identifier for message in TABLE.messages}
PERIODIC = {message.name for message in TABLE.messages if message.from_rig and message.rate}


class Master:
    """Speaks CANopen to a rig by bytes; keeps everything that it has heard."""

    def __init__(self, rig: Rig, peer: str = "master") -> None:
        self.rig, self.peer = rig, peer
        self.heard: list[tuple[int, int, bytes]] = []

    def wait(self, ticks: int) -> Block:
        block = self.rig.run(ticks)
        self.heard += [(int(one["time"]) // 10**6, int(one["id"]), payload(one)) for one in block]
        return block

    def say(self, identifier: int, data: bytes, ticks: int = 1) -> list[tuple[int, bytes]]:
        """Send a frame; return what was heard in the ticks after it, without the times."""
        before = len(self.heard)
        self.rig.receive(frame(identifier, data), self.peer)
        self.wait(ticks)
        return [(identifier, data) for _, identifier, data in self.heard[before:]]

    def nmt(self, command: int, node: int = 1) -> None:
        self.say(NMT, bytes((command, node)))

    def of(self, identifier: int) -> list[tuple[int, bytes]]:
        return [(time, data) for time, one, data in self.heard if one == identifier]

    def ask(self, request: bytes) -> bytes:
        (response,) = [data for identifier, data in self.say(REQUEST, request) if identifier == RESPONSE]
        return response

    def upload(self, index: int, sub: int = 0) -> bytes:
        head = self.ask(struct.pack("<BHB4x", 0x40, index, sub))
        assert head[0] >> 5 == 2, f"abort {head[4:][::-1].hex()}"
        if head[0] & 2:
            return head[4 : 8 - (head[0] >> 2 & 3)]
        data, toggle = b"", 0
        while True:
            segment = self.ask(bytes((0x60 | toggle,)) + bytes(7))
            assert segment[0] & 0x10 == toggle
            data += segment[1 : 8 - (segment[0] >> 1 & 7)]
            toggle ^= 0x10
            if segment[0] & 1:
                return data

    def download(self, index: int, sub: int, value: int, size: int) -> int:
        """Write by an expedited transfer; return the abort code, 0 for success."""
        command = 0x23 | (4 - size) << 2
        data = value.to_bytes(size, "little").ljust(4, b"\0")
        answer = self.ask(struct.pack("<BHB", command, index, sub) + data)
        return 0 if answer[0] == 0x60 else int.from_bytes(answer[4:], "little")

    def abort_code(self, index: int, sub: int = 0) -> int:
        answer = self.ask(struct.pack("<BHB4x", 0x40, index, sub))
        assert answer[0] == 0x80
        return int.from_bytes(answer[4:], "little")

    @property
    def messages(self) -> set[str]:
        """The periodic messages that come within 100 ms."""
        heard = set(self.wait(100)["id"].tolist())
        return {name for name in PERIODIC if IDENTIFIERS[name] in heard}


@pytest.fixture
def master(make_rig: Callable[..., Rig]) -> Master:
    return Master(make_rig())


def number(data: bytes) -> int:
    return int.from_bytes(data, "little")


# -- boot-up, heartbeat, NMT -------------------------------------------------------------------------------------


def test_the_node_boots_once_starts_by_itself_and_beats_every_second(master: Master) -> None:
    master.wait(3500)
    assert master.heard[0][1:] == (HEARTBEAT, b"\x00"), "before anything else"
    beats = master.of(HEARTBEAT)[1:]
    assert [time for time, _ in beats] == [1000, 2000, 3000]
    assert {data for _, data in beats} == {bytes((NmtState.OPERATIONAL,))}


def test_no_tick_sends_more_than_there_is_room_for(master: Master) -> None:
    assert master.download(0x1017, 0, 100, 2) == 0
    counts = [master.wait(1).size for _ in range(400)]
    assert max(counts) == FRAMES_PER_TICK_MAX, "all messages and the heartbeat at once"


@pytest.mark.parametrize(
    ("command", "state", "sends", "answers"),
    [
        (STOP, NmtState.STOPPED, set(), False),
        (PRE_OPERATIONAL, NmtState.PRE_OPERATIONAL, set(), True),
        (START, NmtState.OPERATIONAL, PERIODIC, True),
    ],
)
@pytest.mark.parametrize("node", [0, 1])
def test_nmt_decides_what_the_node_sends_and_answers(
    master: Master, command: int, state: int, sends: set[str], answers: bool, node: int
) -> None:
    master.wait(1)
    master.nmt(command, node)
    assert master.messages == sends
    master.wait(1000)
    assert master.of(HEARTBEAT)[-1][1] == bytes((state,))
    answered = master.say(REQUEST, struct.pack("<BHB4x", 0x40, 0x1000, 0))
    assert bool([one for one in answered if one[0] == RESPONSE]) is answers
    master.nmt(START)
    assert master.messages == PERIODIC


def test_commands_to_other_nodes_and_unknown_ones_are_none(master: Master) -> None:
    for data in (b"\x02\x02", b"\x02", b"", b"\x02\x01\x00", b"\x07\x01"):
        master.say(NMT, data)
    assert master.messages == PERIODIC


@pytest.mark.parametrize("command", [RESET_NODE, RESET_COMMUNICATION])
def test_a_reset_boots_the_communication_and_leaves_the_bench(master: Master, command: int) -> None:
    master.wait(500)
    assert master.download(0x1017, 0, 200, 2) == master.download(0x1800, 2, 1, 1) == 0
    state = master.upload(0x3000 + TABLE["rig.state"].address)
    master.rig.press_estop()
    master.wait(1)
    said = master.say(NMT, bytes((command, 1)))
    assert (HEARTBEAT, b"\x00") in said
    assert number(master.upload(0x1017)) == 1000
    assert number(master.upload(0x1800, 2)) == 255
    assert master.upload(0x3000 + TABLE["rig.state"].address) != state, "still the emergency stop's"
    assert number(master.upload(0x1003)) == (0 if command == RESET_NODE else 1)
    assert master.messages == PERIODIC


# -- the bench and its holder ------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", [STOP, PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION])
def test_nmt_changes_nothing_while_somebody_holds_the_bench(armed, command: int) -> None:
    """A command without a token: it is counted, with its sender, and a bench that moves goes on moving."""
    stranger = Master(armed.rig, "can:4711")
    before = armed.read("rig.strangers")
    stranger.nmt(command)
    armed.beat(10)
    assert armed.state == "ACTIVE"
    assert stranger.messages == PERIODIC
    assert number(stranger.upload(0x2000, 1)) == 1
    armed.beat(5)
    assert armed.read("rig.strangers") == before + 1
    assert (armed.read("rig.stranger"), armed.read("rig.stranger_identifier")) == (4711, NMT)


def test_an_sdo_writes_nothing_without_the_holders_token(armed) -> None:
    stranger = Master(armed.rig, "stranger")
    assert stranger.download(0x1017, 0, 200, 2) == 0x08000022
    assert stranger.download(0x2001, 0, 1, 2) == 0x08000022
    assert number(stranger.upload(0x2000, 2)) == 2
    token = int(armed.read("rig.lease"))
    assert stranger.download(0x2001, 0, token, 2) == 0
    assert stranger.download(0x1017, 0, 200, 2) == 0
    assert stranger.download(0x1017, 0, 300, 2) == 0x08000022, "a token opens one download"
    assert number(stranger.upload(0x1017)) == 200
    armed.beat(5)
    assert armed.state == "ACTIVE"


def test_whoever_takes_the_bench_finds_the_node_as_it_booted(commander) -> None:
    stranger = Master(commander.rig, "stranger")
    commander.wait(500)
    assert stranger.download(0x1800, 2, 240, 1) == stranger.download(0x1016, 1, 0x7F_0064, 4) == 0
    stranger.nmt(STOP)
    assert stranger.messages == set()
    commander.arm()
    assert stranger.messages == PERIODIC
    assert number(stranger.upload(0x1016, 1)) == 0


def test_commands_to_a_stopped_node_are_counted_and_move_nothing(commander) -> None:
    stranger = Master(commander.rig, "stranger")
    commander.wait(500)
    stranger.nmt(STOP)
    commander.bear(4711)  # nobody gave it this token: who takes the bench starts the node
    commander.beat(5, control_enable=1)
    stranger.nmt(START)
    assert number(stranger.upload(0x2000, 4)) >= 5


# -- the commander's heartbeat -----------------------------------------------------------------------------------


def guard(armed, node: int = 0x7F, milliseconds: int = 200) -> Master:
    """Let the rig expect the heartbeat of ``node``, as the holder does who wants it."""
    master = Master(armed.rig, armed.peer)
    assert master.download(0x2001, 0, int(armed.read("rig.lease")), 2) == 0
    assert master.download(0x1016, 1, node << 16 | milliseconds, 4) == 0
    return master


def test_a_lost_heartbeat_holds_the_bench_and_is_told(armed) -> None:
    master = guard(armed)
    armed.beat(30)
    assert armed.state == "ACTIVE", "the first heartbeat starts the guarding"
    for _ in range(5):
        armed.rig.receive(frame(0x77F, b"\x05"), armed.peer)
        armed.beat(8)
    assert armed.state == "ACTIVE"
    armed.beat(4)
    assert armed.state == "FAULT_HOLD"
    assert TABLE["rig.reason"].choices[int(armed.read("rig.reason"))] == "heartbeat lost"
    assert (armed.read("emergency.code"), armed.read("emergency.register")) == (0x8130, 0x11)
    assert number(master.upload(0x1001)) == 0x11
    assert number(master.upload(0x1003, 1)) & 0xFFFF == 0x8130
    armed.beat(2, control_reset=1)
    assert armed.state == "HOLD"
    assert armed.read("emergency.code") == 0


def test_a_heartbeat_is_lost_to_the_tick(armed) -> None:
    guard(armed, milliseconds=50)
    armed.rig.receive(frame(0x77F, b"\x05"), armed.peer)
    start, states = int(armed.rig._controls["tick"]), {}
    for _ in range(60):
        armed.rig.tick()
        states.setdefault(armed.rig.state.name, int(armed.rig._controls["tick"]) - start)
    assert (states["FAULT_REACTION"], states["FAULT_HOLD"]) == (50, 51)


@pytest.mark.parametrize(("behaviour", "state"), [(0, 127), (1, 5), (2, 4)])
def test_what_becomes_of_the_node_is_its_error_behaviour(master: Master, behaviour: int, state: int) -> None:
    """Without a commander no fault of the bench: an emergency message, and its end with the next heartbeat."""
    master.wait(500)
    assert master.download(0x1029, 1, behaviour, 1) == 0
    assert master.download(0x1016, 1, 0x30 << 16 | 100, 4) == 0
    master.say(0x730, b"\x00")
    master.wait(1200)
    assert master.of(HEARTBEAT)[-1][1] == bytes((state,))
    ((_, told),) = master.of(EMERGENCY)
    assert told[:3] == b"\x30\x81\x11"
    master.say(0x730, b"\x05")
    assert master.of(EMERGENCY)[-1][1][:3] == b"\0\0\0"


# -- SYNC --------------------------------------------------------------------------------------------------------


def test_a_synchronous_pdo_waits_for_its_sync(master: Master) -> None:
    assert master.download(0x1800, 2, 1, 1) == master.download(0x1805, 2, 2, 1) == 0
    assert master.messages == PERIODIC - {"SpringLeft", "Lateral"}
    heard = [{identifier for identifier, _ in master.say(SYNC, b"", 5)} for _ in range(4)]
    assert [0x181 in one for one in heard] == [True] * 4
    assert [0x186 in one for one in heard] == [False, True] * 2
    assert master.download(0x1800, 2, 255, 1) == 0
    assert "SpringLeft" in master.messages


def test_a_pdo_can_be_switched_off(master: Master) -> None:
    assert master.download(0x1800, 1, 0xC000_0181, 4) == 0
    assert master.messages == PERIODIC - {"SpringLeft"}
    master.say(SYNC, b"", 5)
    assert master.download(0x1800, 1, 0x4000_0181, 4) == 0
    assert master.messages == PERIODIC


def test_a_flood_of_syncs_sends_every_sample_once(master: Master) -> None:
    assert master.download(0x1800, 2, 1, 1) == 0
    master.wait(4)
    master.rig.receive(join([frame(SYNC, b"")] * 3000), "flood")
    assert (master.wait(5)["id"] == 0x181).sum() == 1


def test_the_rig_can_be_the_one_that_sends_sync(master: Master) -> None:
    assert master.download(0x1800, 2, 1, 1) == master.download(0x1006, 0, 50_000, 4) == 0
    assert master.download(0x1005, 0, 0x4000_0080, 4) == 0
    master.heard.clear()
    master.wait(1000)
    syncs = [time for time, _ in master.of(SYNC)]
    assert len(syncs) == 20 and set(np.diff(syncs)) == {50}
    assert [time for time, _ in master.of(0x181)] == syncs
    assert master.download(0x1005, 0, 0x80, 4) == 0
    master.heard.clear()
    master.wait(200)
    assert master.of(SYNC) == []


# -- emergencies -------------------------------------------------------------------------------------------------


def test_every_new_error_is_told_once_also_during_a_fault(armed) -> None:
    master = Master(armed.rig)
    master.wait(600)  # the commander is late, then lost: one error
    armed.rig.press_estop()
    master.wait(10)
    told = [struct.unpack("<HBB", data[:4]) for _, data in master.of(EMERGENCY)]
    assert told == [(0x8130, 0x11, 1), (0xFF02, 0x91, 4)]
    assert number(master.upload(0x1001)) == 0x91
    assert [number(master.upload(0x1003, k)) & 0xFFFF for k in (1, 2)] == [0xFF02, 0x8130]
    assert master.abort_code(0x1003, 3) == 0x08000024
    armed.rig.release_estop()
    assert armed.coil("reset")[0] == 5
    armed.wait(1)
    assert armed.read("emergency.code") == 0
    assert number(master.upload(0x1001)) == 0
    assert number(master.upload(0x1003)) == 2, "the history stays"


# -- SDO ---------------------------------------------------------------------------------------------------------


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
    row = TABLE["supply.pressure"]
    commander.wait(5000)
    value = struct.unpack("<f", master.upload(0x3000 + row.address))[0]
    code = int.from_bytes(master.upload(0x2384, 1), "little", signed=True)
    assert value == pytest.approx(commander.read("supply.pressure"), rel=0.01)
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
