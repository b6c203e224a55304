"""One commander for the bench: the lease, its token on both wires, and what becomes of strangers."""

import itertools
import struct

import e2e.p01
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_protocol.can_codec import Encoder
from bench_protocol.e2e import token_mark
from bench_protocol.frames import Block, frame
from bench_protocol.messages import HIDDEN_TOKEN, Protection
from bench_protocol.table import TABLE
from bench_protocol.units import mm
from bench_sim.rig.controls import CONTROLS
from bench_sim.rig.lease import Lease
from tests.rig.conftest import STREAM


def published(commander, name: str) -> int:
    return int(commander.read(f"rig.{name}"))


def lease_of(commander) -> int:
    return commander.rig.lease.token


def word_of(commander, peer: str) -> int:
    """What this Modbus connection reads in the lease register."""
    return int.from_bytes(commander.ask(b"\x03\0\0\0\x01", peer)[2:], "big")


def request(nonce: int, token: int = 0) -> Block:
    encoder, values = Encoder(TABLE), np.zeros(len(TABLE.signals))
    values[TABLE.index["lease.nonce"]], values[TABLE.index["lease.token"]] = nonce, token
    return encoder.encode(values, encoder.rows(["LeaseRequest"]), 0)


def test_the_rig_draws_the_token_and_tells_both_wires(commander) -> None:
    commander.take_lease()
    commander.wait(100)
    assert commander.token == lease_of(commander) > 0
    assert published(commander, "lease") == HIDDEN_TOKEN, "before the holder has sent it on CAN"
    assert commander.token != word_of(commander, "modbus:9") > 0
    commander.cycle(5)
    assert published(commander, "lease") == commander.token != word_of(commander, "modbus:9")
    assert published(commander, "holder") == 1, "the port of its connection"
    assert commander.ask(b"\x06\0\0\0\0")[0] == 6
    commander.wait(100)
    assert published(commander, "lease") == published(commander, "holder") == lease_of(commander) == 0


def test_same_seed_same_tokens(make_rig, commander) -> None:
    def tokens(seed: int) -> list[int]:
        one, found = type(commander)(make_rig(seed)), []
        for _ in range(5):
            one.take_lease()
            found.append(one.token)
            one.ask(b"\x06\0\0\0\0")
        return found

    assert tokens(1) == tokens(1) != tokens(2)


def test_a_rig_that_is_started_anew_draws_other_tokens(make_rig, commander) -> None:
    """Its old commander may still be on the bus."""
    found = set()
    for _ in range(5):
        one = type(commander)(make_rig(1))
        one.rig.lease.draw_unpredictably()
        one.take_lease()
        found.add(one.token)
    assert len(found) >= 4, "two of five are equal once in 6000 times"


def test_no_token_leaves_the_crc_as_it_was() -> None:
    """257 of the 65536 numbers do not change a CRC of 8 bits when they change the data id."""
    lease = Lease(
        np.zeros(1, CONTROLS)[0], np.zeros(len(TABLE.signals)), 0, on_change=lambda: None, on_end=lambda: None
    )
    drawn = []
    for _ in range(3000):
        lease.write("modbus:1", 1)
        drawn.append(lease.token)
        lease.write("modbus:1", 0)
    marks = [token_mark(token) for token in drawn]
    assert 0 not in marks
    assert all(a != b for a, b in itertools.pairwise(marks)), "nor that of the holder before"
    assert sum(token_mark(token) == 0 for token in range(65536)) == 256
    assert len(set(drawn)) > 2800


@given(st.integers(1, 65535), st.integers(0, 0xFFFF), st.binary(min_size=8, max_size=8))
def test_the_mark_of_a_token_is_what_it_does_to_autosars_crc(token: int, data_id: int, data: bytes) -> None:
    plain, bound = bytearray(data), bytearray(data)
    e2e.p01.e2e_p01_protect(plain, data_id, increment_counter=False)
    e2e.p01.e2e_p01_protect(bound, data_id ^ token, increment_counter=False)
    assert plain[0] ^ bound[0] == token_mark(token)


def test_commands_need_a_lease(commander) -> None:
    commander.wait(500)
    commander.set_token(0)
    commander.cycle(5, control_enable=1)
    commander.cycle(5, control_reset=1)
    commander.wait(100)
    assert commander.state == "DISABLED"
    assert published(commander, "strangers") == 10 * len(STREAM)
    assert published(commander, "stranger") == 1
    assert published(commander, "rejected_commands") == 0


@pytest.mark.parametrize("peer", ["can:2", "vcan0"])
def test_a_third_party_with_the_next_counter_causes_no_motion(commander, peer: str) -> None:
    """On a bus without connections (vcan0) all frames come from one place: only the token distinguishes them."""
    armed = commander
    armed.peer = "can:1" if peer == "can:2" else peer
    armed.arm()
    stranger = type(armed)(armed.rig, 2)
    stranger.set_token(0)
    before = armed.read("rig.rejected_commands")
    for _ in range(10):
        stranger._encoder.counters[:] = armed._encoder.counters
        stranger.values[TABLE.index["platform.vertical_setpoint"]] = 30 * mm
        armed.rig.receive(stranger.frames(), peer)
        armed.cycle(1)
    armed.cycle(10)
    assert armed.state == "ACTIVE"
    assert abs(armed.read("platform.vertical")) < 1 * mm
    assert armed.read("rig.rejected_commands") == before, "the true commander's frames still count"
    assert published(armed, "strangers") == 10 * len(STREAM)
    assert published(armed, "stranger") == (2 if peer == "can:2" else 0)
    assert published(armed, "stranger_identifier") == STREAM[-1].identifier


def test_the_token_of_somebody_before_is_a_strangers(armed) -> None:
    old = armed.token
    armed.cycle(2, control_enable=0)
    armed.ask(b"\x06\0\0\0\0")
    successor = type(armed)(armed.rig, 2)
    successor.cycle(10)
    assert successor.token != old
    armed.rig.receive(armed.frames("Control"), armed.peer)
    successor.cycle(10)
    assert published(successor, "strangers") == 1
    assert published(successor, "stranger") == 1
    assert successor.read("rig.rejected_commands") == 0, "counters restart with the lease"


@pytest.mark.parametrize("message", [m for m in TABLE.messages if m.protection is Protection.E2E and m.rate])
def test_a_frame_that_is_neither_ours_nor_sound_is_corrupt(armed, message) -> None:
    spoilt = armed.frames(message.name)
    spoilt["data"][:, 0] ^= 0x5A if token_mark(armed.token) != 0x5A else 0x5B
    armed.rig.receive(spoilt, "can:2")
    armed.wait(100)
    assert published(armed, "strangers") == 0
    assert published(armed, "rejected_commands") == 1


def test_requests_of_strangers_are_counted_too(armed) -> None:
    assert armed.coil("disable", "modbus:127.0.0.1:4711") == b"\x85\x06"
    armed.wait(100)
    assert published(armed, "strangers") == 1
    assert published(armed, "stranger") == 4711
    assert published(armed, "stranger_identifier") == 0


def test_a_lease_that_is_returned_holds_at_once(armed) -> None:
    armed.ask(b"\x06\0\0\0\0")
    armed.wait(20)
    assert armed.state == "FAULT_HOLD"
    assert TABLE["rig.reason"].choices[published(armed, "reason")] == "commander disconnected"


# -- on CAN alone ------------------------------------------------------------------------------------------------


def test_a_lease_can_be_taken_and_returned_on_can(commander) -> None:
    commander.rig.receive(request(0xBEEF), commander.peer)
    commander.wait(5)
    assert commander.read("lease.nonce") == 0xBEEF
    token = published(commander, "lease")
    assert token == lease_of(commander) > 0
    commander.rig.receive(request(0xCAFE), "can:2")
    commander.wait(5)
    assert published(commander, "lease") == token
    assert commander.read("lease.nonce") == 0xBEEF, "the answer is not for the second one"
    commander.set_token(token)
    commander.wait(300)
    commander.cycle(5, control_enable=1)
    commander.cycle(2, control_reset=1)
    assert commander.state == "AIR_LOW"
    commander.cycle(2, control_enable=0, control_reset=0)
    commander.rig.receive(request(1, token), commander.peer)
    commander.wait(5)
    assert published(commander, "lease") == 0


def test_a_lease_on_can_ends_with_the_silence_of_its_holder(commander) -> None:
    commander.rig.receive(request(1), "vcan0")
    commander.wait(499)
    assert lease_of(commander) > 0
    commander.wait(1)
    assert lease_of(commander) == 0
    commander.rig.receive(request(2), "vcan0")
    commander.wait(5)
    commander.set_token(lease_of(commander))
    commander.peer = "vcan0"
    commander.cycle(50)
    assert lease_of(commander) == commander.token
    commander.wait(500)
    assert lease_of(commander) == 0


def test_a_modbus_connection_joins_a_lease_on_can_by_its_key(commander) -> None:
    commander.wait(500)
    commander.rig.receive(request(1), commander.peer)
    commander.wait(5)
    commander.set_token(token := lease_of(commander))
    commander.cycle(5, control_enable=1)
    commander.cycle(2, control_reset=1)
    assert commander.coil("air_high") == b"\x85\x06"
    key, other = word_of(commander, commander.modbus), word_of(commander, "modbus:2")
    assert len({key, other, token, 0}) == 4
    for word in (token, key, other):
        assert commander.ask(struct.pack(">BHH", 6, 0, word), "modbus:2") == b"\x86\x06", "all can read these"
    commander.cycle(5)
    before = published(commander, "strangers")
    commander.rig.receive(request(2, other), "can:2")
    commander.cycle(5)
    assert published(commander, "strangers") == before + 1, "a third party names no user"
    assert commander.coil("air_high") == b"\x85\x06"
    commander.rig.receive(request(3, key), commander.peer)
    commander.cycle(1)
    assert word_of(commander, commander.modbus) == token
    assert commander.coil("air_high")[0] == 5
    assert commander.coil("air_low", "modbus:2") == b"\x85\x06"
    commander.rig.receive(request(4, other), commander.peer)
    commander.cycle(1)
    assert commander.ask(struct.pack(">BHH", 6, 0, token), "modbus:2") == b"\x86\x06", "once"


def test_the_holders_request_is_answered_among_third_party_requests(commander) -> None:
    commander.rig.receive(request(1), commander.peer)
    commander.wait(5)
    for peer in ("can:2", commander.peer, "can:3"):
        commander.rig.receive(request(2, lease_of(commander)), peer)
    commander.wait(1)
    assert lease_of(commander) == 0


def test_who_asks_twice_need_not_count(commander) -> None:
    """Every program begins its counter at 0: a request is no stream."""
    for nonce in (1, 2, 3):
        commander.rig.receive(request(nonce), commander.peer)
        commander.wait(5)
        token = lease_of(commander)
        commander.rig.receive(request(nonce, token), commander.peer)
        commander.wait(5)
        assert lease_of(commander) == 0 < token
    spoilt = frame(0x205, bytes(8))
    commander.rig.receive(spoilt, commander.peer)
    assert lease_of(commander) == 0


# -- the watchdog of the holder's writes -------------------------------------------------------------------------


def watchdog(commander, milliseconds: int) -> bytes:
    return commander.ask(struct.pack(">BHH", 6, 1, milliseconds))


def test_only_its_own_write_arms_the_watchdog(armed) -> None:
    armed.cycle(2, control_active=0)
    assert watchdog(armed, 200)[0] == 6
    armed.cycle(20)
    assert armed.state == "FAULT_HOLD"
    assert TABLE["rig.reason"].choices[published(armed, "reason")] == "commander disconnected"


def test_a_refused_write_feeds_no_watchdog(armed) -> None:
    watchdog(armed, 200)
    for _ in range(9):
        assert armed.stage(air_left_target=99e5) == [b"\x90\x03"]
        assert armed.coil("air_high") == b"\x85\x04"
        assert armed.ask(struct.pack(">BHH", 6, 9999, 1)) == b"\x86\x02"
        armed.stage("modbus:2", air_left_target=1e5)
        armed.ask(b"\x03\0\0\0\x02")
        armed.cycle(1)
    assert armed.state == "ACTIVE"
    armed.cycle(2)
    assert armed.state == "FAULT_HOLD"


def test_every_accepted_write_feeds_the_watchdog(armed) -> None:
    watchdog(armed, 200)
    for _ in range(5):
        assert armed.stage(air_left_target=1e5)[0][0] == 0x10
        armed.cycle(8)
        assert armed.coil("apply")[0] == 5
        armed.cycle(8)
    assert armed.state == "ACTIVE"


def test_zero_switches_the_watchdog_off_and_so_does_the_end_of_the_lease(armed) -> None:
    watchdog(armed, 200)
    assert armed.ask(b"\x03\0\x01\0\x01") == b"\x03\x02\0\xc8"
    watchdog(armed, 0)
    armed.cycle(30)
    assert armed.state == "ACTIVE"
    watchdog(armed, 200)
    armed.cycle(2, control_enable=0)
    armed.ask(b"\x06\0\0\0\0")
    armed.wait(20)
    assert armed.ask(b"\x03\0\x01\0\x01") == b"\x03\x02\0\0"
    assert watchdog(armed, 200) == b"\x86\x06", "it is the holder's"
    assert watchdog(armed, 10_001) == b"\x86\x03"


def test_after_the_watchdog_can_goes_on_and_a_connection_may_join_again(armed) -> None:
    watchdog(armed, 200)
    armed.cycle(12)
    assert armed.state == "FAULT_HOLD"
    armed.cycle(100)
    assert armed.state == "FAULT_HOLD", "commands arrive: the air stays shut in"
    assert armed.coil("air_low") == b"\x85\x06"
    assert armed.ask(struct.pack(">BHH", 6, 0, armed.token))[0] == 6
    armed.cycle(2, control_active=0)
    armed.cycle(2, control_reset=1)
    armed.cycle(2, control_reset=0)
    armed.cycle(2, control_active=1)
    assert armed.state == "ACTIVE"


def test_after_the_watchdog_and_silence_the_bench_is_free(armed) -> None:
    watchdog(armed, 200)
    armed.wait(520)
    assert lease_of(armed) == 0
    assert armed.state == "FAULT_DISABLED"
    assert armed.ask(b"\x06\0\0\0\x01", "modbus:2")[0] == 6


# -- a commander with open connections and no process --------------------------------------------------------------


def test_a_commander_who_is_silent_on_both_wires_loses_the_bench_once_it_is_safe(armed) -> None:
    armed.wait(1900)
    assert armed.state == "FAULT_DISABLED"
    assert lease_of(armed) == armed.token, "not before the grace period is over"
    armed.wait(110)
    assert lease_of(armed) == 0
    assert armed.ask(b"\x06\0\0\0\x01", "modbus:2")[0] == 6, (
        "the next one need not wait for a connection to close"
    )


def test_a_returning_holder_is_refused_on_both_buses(armed) -> None:
    old = armed.token
    armed.wait(2100)
    assert armed.stage(air_left_target=1e5) == [b"\x90\x06"], (
        "without a holder: the old one assumes that it holds it"
    )
    assert armed.coil("power_off") == b"\x85\x06"
    assert watchdog(armed, 200) == b"\x86\x06"
    armed.cycle(1)
    armed.wait(100)
    assert published(armed, "strangers") == 4, "three requests, and the Control message with the old token"
    assert published(armed, "stranger") == 1
    assert armed.stage("modbus:2", air_left_target=1e5)[0][0] == 0x10, (
        "a hand with a command-line client still may"
    )
    armed.take_lease()
    assert armed.token != old
    assert armed.stage(air_left_target=1e5)[0][0] == 0x10, "who asks again is anybody"


@pytest.mark.parametrize("wire", ["modbus", "can"])
def test_a_commander_received_on_one_wire_keeps_the_lease(armed, wire) -> None:
    """A plan that computes for long still feeds; a client that streams need not write."""
    for _ in range(4):
        if wire == "can":
            armed.cycle(95)
        else:
            armed.wait(1900)
            assert armed.stage(air_left_target=1e5)[0][0] == 0x10
    assert lease_of(armed) == armed.token


def test_a_holder_who_never_commands_on_can_is_not_expected_there(commander) -> None:
    commander.take_lease()
    commander.wait(30_000)
    assert lease_of(commander) == commander.token
