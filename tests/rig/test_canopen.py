"""The rig as a CANopen node, by frames alone: boot-up, heartbeats, NMT, SYNC, emergencies, and who may do what."""

import struct
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_protocol.canopen import NmtState
from bench_protocol.frames import frame, join
from bench_protocol.table import TABLE
from bench_protocol.units import mm
from bench_protocol.words import LimitKind
from bench_sim.rig.limits import Limit, LimitAction
from bench_sim.rig.node_objects import DEFAULTS
from bench_sim.rig.rig import Rig
from bench_sim.rig.tick import FRAMES_PER_TICK_MAX
from tests.rig.conftest import Commander
from tests.rig.master import (
    EMERGENCY,
    HEARTBEAT,
    NMT,
    PERIODIC,
    PRE_OPERATIONAL,
    REQUEST,
    RESET_COMMUNICATION,
    RESET_NODE,
    RESPONSE,
    START,
    STOP,
    SYNC,
    Master,
    number,
)


@pytest.fixture
def master(make_rig: Callable[..., Rig]) -> Master:
    return Master(make_rig())


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
def test_nmt_has_no_effect_while_the_bench_is_held(armed, command: int) -> None:
    """A command without a token: it is counted, with its sender, and a bench that moves goes on moving."""
    stranger = Master(armed.rig, "can:4711")
    before = armed.read("rig.strangers")
    stranger.nmt(command)
    armed.cycle(10)
    assert armed.state == "ACTIVE"
    assert stranger.messages == PERIODIC
    assert number(stranger.upload(0x2000, 1)) == 1
    armed.cycle(5)
    assert armed.read("rig.strangers") == before + 1
    assert (armed.read("rig.stranger"), armed.read("rig.stranger_identifier")) == (4711, NMT)


def test_an_sdo_without_the_holders_token_writes_no_value(armed) -> None:
    stranger, holder = Master(armed.rig, "can:2"), Master(armed.rig, armed.peer)
    token = int(armed.read("rig.lease"))
    for word in (1, token):
        assert stranger.download(0x1017, 0, 200, 2) == 0x08000022
        assert stranger.download(0x2001, 0, word, 2) == 0x08000022, "all can read the token"
    assert number(stranger.upload(0x2000, 2)) == 4
    assert holder.download(0x2001, 0, token ^ 1, 2) == 0x08000022
    assert holder.download(0x2001, 0, token, 2) == 0
    assert holder.download(0x1017, 0, 200, 2) == 0
    assert holder.download(0x1017, 0, 300, 2) == 0x08000022, "a token opens one download"
    assert holder.download(0x2001, 0, token, 2) == 0
    assert stranger.download(0x1017, 0, 300, 2) == 0x08000022, "of the connection that sent it"
    assert number(stranger.upload(0x1017)) == 200
    armed.cycle(5)
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


def test_commands_to_a_stopped_node_are_counted_without_motion(commander) -> None:
    stranger = Master(commander.rig, "stranger")
    commander.wait(500)
    stranger.nmt(STOP)
    commander.set_token(4711)  # an unassigned token: taking the bench starts the node
    commander.cycle(5, control_enable=1)
    stranger.nmt(START)
    assert number(stranger.upload(0x2000, 4)) >= 5


strange_frames = st.lists(
    st.tuples(
        st.sampled_from([NMT, SYNC, EMERGENCY, RESPONSE, REQUEST, HEARTBEAT, 0x77F, 0x7E5]),
        st.binary(max_size=8),
    ),
    min_size=1,
    max_size=20,
)


@pytest.fixture(scope="module")
def moving(parameters) -> Commander:
    """A bench in motion."""
    commander = Commander(Rig(parameters, seed=1))
    commander.arm()
    return commander


@settings(max_examples=60, deadline=None)
@given(strange_frames)
def test_third_party_messages_do_not_disturb_the_holder(
    moving: Commander, said: list[tuple[int, bytes]]
) -> None:
    moving.rig.receive(join([frame(identifier, data) for identifier, data in said]), "can:4711")
    before = dict(moving.rig.node.objects.parameters)
    moving.cycle(3)
    assert moving.state == "ACTIVE"
    assert moving.rig.node.objects.parameters == before == DEFAULTS
    moving.rig.receive(moving.frames(), moving.peer)
    master = Master(moving.rig)
    assert {0x181, 0x282} <= set(master.wait(20)["id"].tolist()), "its PDOs flow"


# -- the commander's heartbeat -----------------------------------------------------------------------------------


def guard(armed, node: int = 0x7F, milliseconds: int = 200) -> Master:
    """Make the rig expect the heartbeat of ``node``, as the holder does on request."""
    master = Master(armed.rig, armed.peer)
    assert master.download(0x2001, 0, int(armed.read("rig.lease")), 2) == 0
    assert master.download(0x1016, 1, node << 16 | milliseconds, 4) == 0
    return master


def test_a_lost_heartbeat_holds_the_bench_and_is_reported(armed) -> None:
    master = guard(armed)
    armed.cycle(30)
    assert armed.state == "ACTIVE", "the first heartbeat starts the guarding"
    for _ in range(5):
        armed.rig.receive(frame(0x77F, b"\x05"), armed.peer)
        armed.cycle(8)
    assert armed.state == "ACTIVE"
    armed.cycle(4)
    assert armed.state == "FAULT_HOLD"
    assert TABLE["rig.reason"].choices[int(armed.read("rig.reason"))] == "heartbeat lost"
    assert (armed.read("emergency.code"), armed.read("emergency.register")) == (0x8130, 0x11)
    assert number(master.upload(0x1001)) == 0x11
    assert number(master.upload(0x1003, 1)) & 0xFFFF == 0x8130
    armed.cycle(2, control_reset=1)
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


def test_a_guard_ends_with_the_lease(armed) -> None:
    master = guard(armed)
    armed.rig.receive(frame(0x77F, b"\x05"), armed.peer)
    armed.cycle(2, control_enable=0, control_hold=0, control_active=0)
    assert armed.ask(b"\x06\0\0\0\0")[0] == 6
    master.wait(1000)
    assert master.of(EMERGENCY) == []
    assert number(master.upload(0x1016, 1)) == 0


def test_a_stopped_node_can_still_be_asked_for_the_bench_on_can(commander) -> None:
    """Else a stranger's NMT command would keep a commander away that has only CAN."""
    master = Master(commander.rig)
    commander.wait(500)
    master.nmt(STOP)
    commander.values[TABLE.index["lease.nonce"]] = 77
    commander.rig.receive(commander.frames("LeaseRequest"), commander.peer)
    commander.wait(200)
    assert commander.read("lease.nonce") == 77 and commander.read("rig.lease") != 0
    assert master.messages == PERIODIC


@pytest.mark.parametrize(("behaviour", "state"), [(0, 127), (1, 5), (2, 4)])
def test_the_node_applies_its_error_behaviour(master: Master, behaviour: int, state: int) -> None:
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
    received = [{identifier for identifier, _ in master.say(SYNC, b"", 5)} for _ in range(4)]
    assert [0x181 in one for one in received] == [True] * 4
    assert [0x186 in one for one in received] == [False, True] * 2
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


def test_of_a_flood_few_frames_are_looked_at_and_all_are_counted(armed) -> None:
    """Each costs some microseconds between two ticks."""
    stranger = Master(armed.rig, "can:4711")
    armed.rig.receive(np.repeat(frame(NMT, b"\x02\x01"), 20_000), stranger.peer)
    armed.cycle(5)
    assert armed.state == "ACTIVE"
    assert [number(stranger.upload(0x2000, sub)) for sub in (1, 3)] == [32, 19_968]


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


def test_every_new_error_is_reported_once_during_a_fault(armed) -> None:
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


def test_two_limits_that_trip_at_once_are_two_errors(parameters) -> None:
    signals = ("platform.vertical", "platform.lateral")
    stop = LimitAction.PROGRAM_STOP
    rig = Rig(parameters, seed=1, limits=tuple(Limit(one, LimitKind.UPPER, 2 * mm, stop) for one in signals))
    commander = Commander(rig)
    commander.arm()
    master = Master(rig)
    commander.cycle(1, platform_vertical_setpoint=5 * mm, platform_lateral_setpoint=5 * mm)
    for _ in range(10):
        commander.rig.receive(commander.frames(), commander.peer)
        master.wait(20)
    told = [struct.unpack("<HBB", data[:4]) for _, data in master.of(EMERGENCY)]
    assert told == [(0xFF01, 0x81, 5)] * 2
    tripped = [number(master.upload(0x1003, k)) >> 24 for k in (2, 1)]
    assert tripped == [TABLE.trip_number(one) for one in signals]
