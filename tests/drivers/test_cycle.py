"""The compiled cycle: bytes of the codecs in Python, whole on the wire, without the interpreter but not for long."""

import ctypes
import errno
import select
import socket
import struct
import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_protocol.can_codec import Decoder, Encoder
from bench_protocol.clock import RealClock
from bench_protocol.frames import frame, join
from bench_protocol.runtime.mutex import Mutex
from bench_protocol.socketcand import Parser, Sent, send_bytes
from bench_protocol.table import TABLE
from bench_protocol.units import NS, ms
from drivers.commander import CYCLE, Commander
from drivers.cycle import COMPILED, Cycle, frames_to_text, run_cycles
from drivers.errors import LinkLost
from drivers.memory import InMemoryCan
from drivers.modbus_port import InMemoryModbus
from drivers.setpoints import Setpoints
from drivers.wire import Wire
from drivers.wiring.astb.can import AUTONOMY
from drivers.wiring.own import own_wiring

#: Frames that a commander sends each cycle.
STREAM = sum(not message.from_rig and message.rate > 0 for message in TABLE.messages)
FRAMES = st.lists(
    st.builds(
        lambda identifier, data, wide: frame(identifier if wide else identifier & 0x7FF, data, extended=wide),
        st.integers(0, 0x1FFF_FFFF),
        st.binary(max_size=8),
        st.booleans(),
    ),
    min_size=1,
    max_size=4,
).map(join)


@given(FRAMES)
def test_lines_are_those_of_socketcand(block):
    text = np.zeros(44 * block.size, np.uint8)
    assert text[: frames_to_text(block, text, True)].tobytes() == send_bytes(block)


@given(FRAMES)
def test_frames_are_those_of_the_kernel(block):
    text = np.zeros(16 * block.size, np.uint8)
    assert frames_to_text(block, text, False) == text.size
    for record, written in zip(block, text.reshape(-1, 16), strict=True):
        flag = 0x8000_0000 if record["extended"] else 0
        expected = struct.pack("<IB3x8s", record["id"] | flag, record["length"], bytes(record["data"]))
        assert written.tobytes() == expected


class Peer:
    """A commander on a socket, and the far end of it."""

    def __init__(self):
        self.near, self.far = socket.socketpair()
        self.near.setblocking(False)
        self.port = InMemoryCan(lambda block: pytest.fail("Python must not be asked"))
        self.port.wire = self.wire = Wire.on(self.near.fileno(), lines=True)
        silent = InMemoryModbus(lambda request: b"")
        self.commander = Commander(own_wiring(self.port, silent), RealClock())
        self._parser = Parser(sender="a test")

    def waiting(self):
        """Return the frames that have come so far."""
        blocks = []
        while select.select([self.far], [], [], 0)[0] and (data := self.far.recv(1 << 16)):
            blocks += [event.block for event in self._parser.feed(data) if isinstance(event, Sent)]
        return join(blocks)

    def start(self):
        """Begin to stream, and return when the compiled loop is at work."""
        self.commander.start()
        for _ in range(100):
            RealClock().sleep_until(CYCLE)
            if self.waiting().size:
                return
        pytest.fail("no block came within 2 s")

    def fail(self):
        """Begin to stream, and return when that has failed, or 2 s have passed."""
        self.commander.start()
        clock = RealClock()
        for _ in range(100):
            if self.commander.failure:
                break
            clock.sleep_until(clock.now() + CYCLE)

    def close(self):
        self.commander.stop()
        self.near.close()
        self.far.close()


@pytest.fixture
def peer():
    one = Peer()
    yield one
    one.close()


compiled_only = pytest.mark.skipif(
    not COMPILED, reason="NUMBA_DISABLE_JIT: every cycle needs the interpreter"
)


def hold_the_interpreter(seconds):
    """Keep every other thread of Python from running, as a C library can."""
    ctypes.PyDLL(None).usleep(round(seconds * 1e6))


@compiled_only
@pytest.mark.real_time
def test_the_stream_goes_on_while_a_library_holds_the_interpreter(peer):
    peer.commander.set("lateral.force_setpoint", 0.0)
    peer.start()
    peer.commander.ramp("lateral.force_setpoint", 5000.0, 10_000.0)
    hold_the_interpreter(300 * ms)
    frames = peer.waiting()
    assert frames.size >= 10 * STREAM, "ten cycles, while no Python ran"
    decoder = Decoder(TABLE)
    samples = decoder.decode(frames)
    assert decoder.tally[3] == 0, "the counters are in sequence"
    forces = samples.values[samples.signals == TABLE.index["lateral.force_setpoint"]]
    assert np.diff(forces[1:]) == pytest.approx(10_000.0 * CYCLE / NS, abs=1.01), "and so is the ramp"
    assert peer.commander.failure is None


@compiled_only
@pytest.mark.real_time
def test_a_waveform_arrives_cycle_by_cycle_while_a_library_holds_the_interpreter(peer):
    peer.commander.set("lateral.force_setpoint", 0.0)
    peer.start()
    cycles = 1000.0 * np.sin(np.pi * np.arange(26) / 25) ** 2
    peer.commander.play({"lateral.force_setpoint": cycles})
    hold_the_interpreter(300 * ms)
    clock = RealClock()
    clock.sleep_until(clock.now() + 20 * CYCLE)
    decoder = Decoder(TABLE)
    samples = decoder.decode(peer.waiting())
    assert decoder.tally[3] == 0, "no cycle is lost"
    forces = samples.values[samples.signals == TABLE.index["lateral.force_setpoint"]]
    first = int(np.argmax(forces > 0.0)) - 1  # the first cycle of it is still at rest
    assert forces[first : first + 26] == pytest.approx(cycles, abs=1.01), "none twice, none changed"
    assert (forces[first + 26 :] == 0.0).all()


@compiled_only
@pytest.mark.real_time
def test_a_plan_that_is_stuck_is_not_alive(peer):
    """What the stream does without Python is bounded; afterwards it goes on."""
    peer.start()
    hold_the_interpreter(AUTONOMY / NS + 400 * ms)
    granted = AUTONOMY // CYCLE
    assert granted - 6 <= peer.waiting().size // STREAM <= granted + 1
    clock = RealClock()
    clock.sleep_until(clock.now() + 10 * CYCLE)
    assert peer.waiting().size >= 3 * STREAM
    assert peer.commander.failure is None


@compiled_only
def test_no_write_to_a_disconnected_wire(peer):
    peer.wire.cut()
    peer.fail()
    assert isinstance(peer.commander.failure, LinkLost)
    assert peer.waiting().size == 0


@compiled_only
def test_a_far_end_that_has_gone_ends_the_stream(peer):
    peer.far.close()
    peer.fail()
    assert "frames could not be sent: Broken pipe" in str(peer.commander.failure)
    assert not peer.wire.usable, "half a line may be out"
    peer.far = socket.socket()


def _sending(wire, blocks):
    """Return a thread that sends every millisecond, and where it puts its end."""
    encoder = Encoder(TABLE)
    cycle = Cycle.of(encoder, encoder.rows(["Control", "ForceSetpoints"]), Setpoints.of(len(TABLE.signals)))
    cycle.counts["granted"] = blocks
    mutex, clock, end = Mutex(), RealClock(), []

    def run():
        start, period = clock.monotonic(clock.now()), round(1 * ms * NS)
        end.append(run_cycles(cycle, mutex.address, wire.descriptor, wire.mutex.address, True, start, period))

    return threading.Thread(target=run), cycle, end


@compiled_only
def test_a_full_socket_is_waited_for_and_every_line_arrives_whole(peer):
    peer.near.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
    thread, cycle, end = _sending(peer.wire, 300)
    thread.start()
    clock, frames = RealClock(), []
    for _ in range(400):
        frames.append(peer.waiting())
        if sum(part.size for part in frames) >= 600:
            break
        clock.sleep_until(clock.now() + round(15 * ms * NS))
    cycle.counts["stop"] = 1
    thread.join()
    assert end == [0]
    identifiers = join(frames)["id"].tolist()
    assert identifiers == [identifiers[0], identifiers[1]] * 300


@compiled_only
def test_a_socket_that_stays_full_is_an_error(peer):
    peer.near.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
    thread, _, end = _sending(peer.wire, 10_000)
    thread.start()
    thread.join(20)
    assert end == [errno.ETIMEDOUT]
