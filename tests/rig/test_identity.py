"""A client at another address whose TCP ports are those of the holder: it may do what it likes, and nothing changes."""

import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench_protocol.can_codec import Encoder
from bench_protocol.frames import Block, frame
from bench_protocol.table import TABLE
from bench_protocol.units import mm
from bench_protocol.words import STATES
from bench_sim.rig.controls import SUSPECTS_MAX, TRIES_MAX
from bench_sim.rig.peers import peer_name
from tests.rig.conftest import STREAM, Commander
from tests.rig.test_lease import published, request, word_of

_CAN, _MODBUS = 4711, 4712  # TCP ports of both clients
words = st.sampled_from(["published", "own", "none"])
_COILS = ("power_off", "disable", "air_low", "air_high", "reset", "apply")
attacks = st.one_of(
    st.tuples(st.just("close"), st.sampled_from(["can", "modbus"])),
    st.tuples(st.just("command"), words, st.sampled_from([message.name for message in STREAM])),
    st.tuples(st.just("request"), words),
    st.tuples(st.just("write"), words, st.sampled_from([0, 1])),
    st.tuples(st.just("coil"), st.sampled_from(_COILS)),
    st.tuples(st.just("stage")),
    st.tuples(st.just("download"), words),
)


#: Signals about third-party clients, and about frames without a valid CRC, differ.
_COUNTS = {"rig.strangers", "rig.rejected_commands"}
_UNCOUNTED = [
    message.identifier
    for message in TABLE.messages
    if message.from_rig and not _COUNTS & {place.signal for place in message.fields}
]


class Namesake:
    """A client at another address whose ports are those of the holder, and who uses every number that it can read."""

    def __init__(self, holder) -> None:
        self.holder = holder
        self.peer = peer_name("can", "127.0.0.2", _CAN, 3)
        self.modbus = peer_name("modbus", "127.0.0.2", _MODBUS, 4)

    def word(self, which: str) -> int:
        match which:
            case "published":
                return int(self.holder.rig.values[TABLE.index["rig.lease"]])
            case "own":
                return word_of(self.holder, self.modbus)
        return 0

    def close(self, wire: str) -> None:
        self.holder.rig.peer_lost(self.peer if wire == "can" else self.modbus)

    def command(self, which: str, message: str) -> None:
        """Send what would move the bench, with the counter that is expected next."""
        encoder, values, word = Encoder(TABLE), np.zeros(len(TABLE.signals)), self.word(which)
        encoder.counters[:] = self.holder._encoder.counters
        encoder.bind(word)
        values[TABLE.index["control.token"]] = word
        values[TABLE.index["platform.vertical_setpoint"]] = 30 * mm
        self.holder.rig.receive(encoder.encode(values, encoder.rows([message]), 0), self.peer)

    def request(self, which: str) -> None:
        self.holder.rig.receive(request(1, self.word(which)), self.peer)

    def write(self, which: str, address: int) -> None:
        answer = self.holder.ask(struct.pack(">BHH", 6, address, self.word(which)), self.modbus)
        assert answer[0] == 0x86

    def coil(self, name: str) -> None:
        assert self.holder.coil(name, self.modbus) == b"\x85\x06"

    def stage(self) -> None:
        assert self.holder.stage(self.modbus, generator_amplitude=3 * mm) == [b"\x90\x06"]

    def download(self, which: str) -> None:
        """Make the node send none of its readings, by the token."""
        for data in (
            struct.pack("<BHBI", 0x2B, 0x2001, 0, self.word(which)),
            struct.pack("<BHBI", 0x23, 0x1800, 1, 0xC0000181),
        ):
            self.holder.rig.receive(frame(0x601, data), self.peer)


def bring(commander, state: str) -> None:
    """Bring a bench that was just switched on to ``state``; the holder has the lease, and commands where he must."""
    commander.take_lease()
    match state:
        case "BOOT":
            commander.wait(50)
        case "INIT":
            commander.wait(250)
        case "DISABLED" | "OFF":
            commander.wait(500)
            if state == "OFF":
                assert commander.coil("power_off")[0] == 5
            commander.wait(20)
        case "AIR_LOW" | "AIR_HIGH" | "HOLD":
            commander.wait(500)
            commander.cycle(2, control_enable=1)
            commander.cycle(2, control_reset=1)
            if state != "AIR_LOW":
                assert commander.coil("air_high")[0] == 5
                commander.cycle(2, control_reset=0)
            if state == "HOLD":
                commander.cycle(2, control_hold=1)
        case _:
            commander.arm()
            if state == "ESTOP":
                commander.rig.press_estop()
            if state != "ACTIVE":
                while STATES[int(commander.rig.values[TABLE.index["rig.state"]])] != state:
                    commander.rig.run(1)
    assert STATES[int(commander.rig.values[TABLE.index["rig.state"]])] == state


def course(make_rig, state: str, deeds) -> tuple[Block, bool]:
    """Return what the rig sends after it was brought to ``state``, and whether the holder still writes."""
    holder = Commander(make_rig())
    holder.peer = peer_name("can", "127.0.0.1", _CAN, 1)
    holder.modbus = peer_name("modbus", "127.0.0.1", _MODBUS, 2)
    bring(holder, state)
    namesake, blocks = Namesake(holder), []
    for name, *arguments in deeds:
        getattr(namesake, name)(*arguments)
        holder.rig.receive(holder.frames(), holder.peer)
        blocks.append(holder.rig.run(20))
    for _ in range(20 - len(deeds)):
        holder.rig.receive(holder.frames(), holder.peer)
        blocks.append(holder.rig.run(20))
    block = np.concatenate(blocks)
    known = np.isin(block["id"], _UNCOUNTED)
    return block[known], holder.stage(generator_amplitude=1 * mm)[0][0] == 0x10


def check_namesake(make_rig, state: str, deeds) -> None:
    alone, writes = course(make_rig, state, ())
    beside, still = course(make_rig, state, deeds)
    assert writes
    assert still
    assert alone.tobytes() == beside.tobytes(), "every reading, state and counter is as without other clients"


@pytest.mark.parametrize("state", STATES)
@settings(max_examples=3, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(deeds=st.lists(attacks, min_size=4, max_size=12))
def test_a_client_with_the_holders_ports_has_no_effect(make_rig, state: str, deeds) -> None:
    check_namesake(make_rig, state, deeds)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@settings(max_examples=500, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(state=st.sampled_from(STATES), deeds=st.lists(attacks, max_size=15))
def test_a_client_with_the_holders_ports_has_no_effect_in_500_sequences(make_rig, state: str, deeds) -> None:
    check_namesake(make_rig, state, deeds)


def test_who_guesses_tokens_cannot_command_even_with_the_right_one(commander) -> None:
    """Before the holder has commanded: ten wrong ones shut a connection out, and eight such connections all others."""
    commander.wait(500)
    commander.take_lease()
    right = commander.token

    def guess(peer: str, token: int) -> bool:
        commander.set_token(token)
        commander.rig.receive(commander.frames("Control"), peer)
        commander.wait(1)
        return int(commander.rig._controls["commander"]) >= 0

    wrong = [token for token in range(1, 200) if token != right]
    for k in range(SUSPECTS_MAX):
        peer = peer_name("can", "127.0.0.2", _CAN, 10 + k)
        assert not any(guess(peer, 0) for _ in range(30)), "no token is no guess"
        assert not any(guess(peer, token) for token in wrong[:TRIES_MAX])
        assert not guess(peer, right)
    assert not guess(commander.peer, right), "the bench stays still; the holder requests a new one"
    commander.ask(b"\x06\0\0\0\0")
    commander.take_lease()
    assert guess(commander.peer, commander.token)


def test_when_the_commanders_connection_is_closed_another_token_is_drawn(armed) -> None:
    old = armed.token
    armed.rig.peer_lost(armed.peer)
    armed.wait(20)
    assert armed.state == "FAULT_HOLD"
    again = Commander(armed.rig)
    again.peer, again.decoder = "can:5", armed.decoder
    again.set_token(old)
    strangers = published(armed, "strangers")
    again.cycle(5, control_enable=1)
    again.wait(100)
    assert published(again, "strangers") == strangers + 5, "all have read it on the bus"
    again.set_token(word_of(again, again.modbus))
    assert again.token != old
    again.cycle(10)
    again.wait(100)
    assert published(again, "strangers") == strangers + 5
    assert published(again, "lease") == again.token
