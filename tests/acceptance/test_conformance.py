"""The conformance suite: a sound rig passes, each faulty one is found, and two rigs are distinguished."""

import struct

import pytest

from astb.acceptance.conformance.listening import listen
from astb.acceptance.conformance.raw_access import Cable, RawAccess
from astb.acceptance.conformance.report import (
    Observation,
    Outcome,
    Report,
    ReportError,
    common_tests,
    differences,
    read_report,
)
from astb.acceptance.conformance.suite import examine
from astb.rig_in_memory import RigInMemory
from bench_protocol.frames import Block
from bench_protocol.modbus import refuse
from bench_protocol.rest import REST
from bench_protocol.table import TABLE
from bench_protocol.units import kN, mm
from bench_sim.parameters import load
from bench_sim.rig.in_force import InForce
from bench_sim.rig.rig import Rig
from bench_sim.rig.supervisor import Supervisor
from tests.refusals import refuses

IDENTIFIER = {message.name: message.identifier for message in TABLE.messages}


class MemoryRig:
    """A rig in memory as a stranger meets it, whose frames and answers a test may spoil on their way out."""

    def __init__(self, frames=lambda block: block, answers=lambda request, reply: reply):
        rig = Rig(load(), seed=1)
        memory = RigInMemory(rig, run=lambda ticks: frames(rig.run(ticks)))
        peers = iter(range(100))

        def line():
            peer = f"modbus:{next(peers)}"
            return Cable(
                lambda request: answers(request, memory.answer(request, peer)), lambda: rig.peer_lost(peer)
            )

        self.rig, self.memory = rig, memory
        self.access = RawAccess(memory.clock, memory.can, line)

    def examine(self, motion=False) -> dict[str, Observation]:
        found = examine(self.access, motion=motion, say=lambda text: None)
        self.report = Report(rig="test", time="virtual", motion=motion, findings=found)
        return {one.what: one for one in found}

    def wrong(self, motion=False) -> set[str]:
        return {what for what, one in self.examine(motion).items() if one.outcome is Outcome.WRONG}


@pytest.fixture(scope="module")
def sound():
    stand = MemoryRig()
    moved = []
    stand.memory.clock.every(10**8, lambda: moved.append(stand.rig.state))
    at_rest = stand.examine()
    return stand, at_rest, moved


def test_a_sound_rig_is_found_sound_and_stays_where_it_is(sound):
    stand, findings, states = sound
    assert not stand.report.wrong
    assert len(findings) > 70
    assert {state.name for state in states} <= {"OFF", "BOOT", "INIT", "DISABLED"}
    assert stand.rig.lease.token == 0, "the bench is given back"


def test_with_motion_it_is_led_up_and_left_disabled():
    stand = MemoryRig()
    findings = stand.examine(motion=True)
    assert not stand.report.wrong
    assert findings["platform up by 2 mm"].value == pytest.approx(2e-3, abs=3e-4)
    assert findings["time from the last command to hold"].value == pytest.approx(0.1, abs=0.05)
    for when in ("HOLD without set-points", "ACTIVE without set-points"):
        assert findings[f"{when}: heights and displacements"].value < 0.5 * mm
    ends = ("loss of commands", "end of the connection in ACTIVE")
    assert all(findings[f"settings after: {end}"].outcome is Outcome.RIGHT for end in ends)
    assert stand.rig.state.name == "DISABLED"
    assert stand.rig.lease.token == 0


def slow_frames(block: Block) -> Block:
    """Every other frame of one message is missing."""
    spring = block["id"] == IDENTIFIER["SpringLeft"]
    return block[~(spring & (block["time"] // 5_000_000 % 2 == 0))]


def hasty_codes(request: bytes, reply: bytes) -> bytes:
    """Everything that is refused is refused as a failure of the device."""
    return refuse(request, 4) if reply[7] & 0x80 else reply


def swapped_words(request: bytes, reply: bytes) -> bytes:
    """The two words of every float in the answers come low word first."""
    if request[7] != 4 or reply[7] & 0x80 or reply[8] != 4:
        return reply
    high, low = struct.unpack(">HH", reply[9:13])
    return reply[:9] + struct.pack(">HH", low, high)


def lax(request: bytes, reply: bytes) -> bytes:
    """A rig that accepts wrong writes."""
    return request[:4] + b"\0\6" + request[6:12] if request[7] == 16 and reply[7] & 0x80 else reply


@pytest.mark.parametrize(
    ("spoilt", "found"),
    [
        ({"frames": slow_frames}, {"SpringLeft, rate", "lost frames"}),
        (
            {"answers": hasty_codes},
            {"unknown function code", "one register of a float", "another client requests the lease"},
        ),
        ({"answers": swapped_words}, {"readings that differ between CAN and Modbus"}),
        (
            {"answers": lax},
            {
                "generator.frequency, NaN",
                "air.left_target, one register of the float",
                "another client requests the lease",
            },
        ),
    ],
    ids=["slow frames", "codes", "words", "lax"],
)
def test_a_spoilt_rig_is_found_out(spoilt, found):
    assert found <= MemoryRig(**spoilt).wrong()


def test_a_rig_that_keeps_what_a_command_has_left_is_found_out_and_brought_to_rest(monkeypatch):
    monkeypatch.setattr(InForce, "rest", lambda in_force, vented: None)
    stand = MemoryRig()
    ends = ("return of the lease", "end of the connection")
    findings = stand.examine()
    assert {f"settings after: {end}" for end in ends} == {one.what for one in stand.report.wrong}
    found = findings["settings after: return of the lease"].found
    assert "generator.cycles = 7" in found
    assert "generator.amplitude = 3 mm" in found
    assert {name: stand.rig.registers.active[name] for name in REST} == REST


def test_a_rig_that_moves_when_it_is_armed_and_in_hold_is_found_out(monkeypatch):
    """It holds a force that was never there, and follows set-points in HOLD."""
    handle = Supervisor.handle

    def follow(supervisor, event, tripped=0):
        changed = handle(supervisor, event, tripped)
        supervisor._controls["active"] |= supervisor.state.name == "HOLD"
        return changed

    monkeypatch.setattr(InForce, "_present", lambda in_force, target: 5 * kN)
    monkeypatch.setattr(Supervisor, "handle", follow)
    wrong = MemoryRig().wrong(motion=True)
    assert {
        "motion in HOLD after a new set-point",
        "HOLD without set-points: heights and displacements",
    } <= wrong


def test_a_silent_rig_is_reported_and_the_other_checks_continue():
    findings = MemoryRig(answers=lambda request, reply: b"").examine()
    assert findings["all requests answered"].outcome is Outcome.WRONG
    assert "no answer" in findings["all requests answered"].found
    assert findings["SpringLeft, rate"].outcome is Outcome.RIGHT


class Wall:
    """The virtual clock, as a clock that the rig does not have: time stamps are converted, tick by tick."""

    def __init__(self, clock):
        self._clock, self.now, self.every = clock, clock.now, clock.every

    def sleep_until(self, deadline):
        for instant in range(self.now(), deadline + 1, 10**6):
            self._clock.sleep_until(instant)


@pytest.mark.parametrize("step", [0, -(10**9), 10**9, -31_557_600 * 10**9, 31_557_600 * 10**9])
def test_a_rig_whose_clock_is_set_is_found_out(step):
    def stepped(block: Block) -> Block:
        return with_times(block, block["time"] + 10**18 + step * (block["time"] > 2 * 10**9))

    memory = MemoryRig(frames=stepped).memory
    access = RawAccess(Wall(memory.clock), memory.can, lambda: pytest.fail("nothing is asked"))
    access.wait(0.5)
    times = listen(access)[0].findings
    wrong = {one.what for one in times if one.outcome is Outcome.WRONG}
    assert wrong == ({"jumps of the time stamps"} if step else set())


def with_times(block: Block, times) -> Block:
    block = block.copy()
    block["time"] = times
    return block


def test_two_rigs_are_compared(sound, tmp_path):
    stand, _, _ = sound
    path = tmp_path / "sound.json"
    path.write_bytes(stand.report.to_json())
    again = read_report(path)
    assert again == stand.report
    assert not differences(common_tests(stand.report, again))
    other = MemoryRig(answers=hasty_codes)
    other.examine()
    apart = {one.what: one for one in differences(common_tests(other.report, again))}
    assert apart["one register of a float"].here == "exception 4"
    assert apart["one register of a float"].there == "exception 3"
    assert "SpringLeft, rate" not in apart
    path.write_text("{}")
    with refuses(ReportError, "sound.json"):
        read_report(path)
