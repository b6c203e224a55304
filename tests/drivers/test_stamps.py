"""Time stamps: read from the ancillary data, and converted from any clock, which may be set meanwhile."""

import itertools
import random
import socket
import struct
from types import SimpleNamespace

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers import can_port
from drivers.can_fd import Fd
from drivers.can_port import PythonCanPort
from drivers.stamps import SO_TIMESTAMPING, SO_TIMESTAMPNS, UNCERTAINTY, StampClock, of_notes

US, S = 1_000, 1_000_000_000
DAY = 1_760_000_000 * S


def timespecs(*times: int) -> bytes:
    return b"".join(struct.pack("@ll", *divmod(time, S)) for time in times)


def test_the_third_of_three_times_is_that_of_the_hardware():
    hardware = of_notes([(1, SO_TIMESTAMPING, timespecs(DAY + 5, 0, 123 * S + 7))])
    assert hardware == (DAY + 5, 123 * S + 7)
    software = of_notes(
        [(1, SO_TIMESTAMPNS, timespecs(DAY + 3)), (1, SO_TIMESTAMPING, timespecs(DAY + 5, 0, 0))]
    )
    assert software == (DAY + 5, 0)
    assert of_notes([(1, SO_TIMESTAMPNS, timespecs(DAY + 3))]) == (DAY + 3, 0)
    assert of_notes([(1, SO_TIMESTAMPING, b"short")]) == (0, 0)


@pytest.mark.parametrize("drift", [-80e-6, 0.0, 80e-6])
def test_times_of_the_hardware_are_as_far_apart_as_on_the_bus(drift):
    """It began 40 days ago, drifts, and the system sees the frames up to 3 ms late."""
    clock, chance = StampClock(drifts=True), random.Random(1)
    found, true = [], []
    for k in range(4000):
        at = k * 2_500 * US
        arrived = DAY + at + 60 * US + round(chance.expovariate(1 / (400 * US)))
        found.append(clock.time(round(at * (1 + drift)) + 3_456_000 * S, arrived))
        true.append(DAY + at)
    late = [a - b for a, b in zip(found, true, strict=True)][400:]
    assert 0 < min(late) < max(late) < 200 * US, "the least lag of the system, not its mean"
    steps = [abs((b - a) - 2_500 * US) for a, b in itertools.pairwise(found[400:])]
    assert sorted(steps)[len(steps) * 95 // 100] < 1 * US


def test_a_clock_that_is_set_anew_is_followed():
    clock = StampClock()
    assert clock.time(5 * S, DAY) == DAY
    assert clock.time(1 * S, DAY + 1000) == DAY + 1000
    assert clock.time(90 * S, DAY + 2000) == DAY + 2000


MS, YEAR = 1_000_000, 31_557_600 * S


@settings(max_examples=40, deadline=None)
@given(
    before=st.integers(-100 * YEAR, 100 * YEAR),
    size=st.sampled_from([1 * MS, 15 * MS, 100 * MS, S, 60 * S, 3600 * S, YEAR]),
    sign=st.sampled_from([1, -1]),
    at=st.integers(1, 1500),
    stall=st.integers(0, 400),
    seed=st.integers(0, 2**32),
    drifts=st.booleans(),
)
def test_a_step_of_the_other_clock_moves_no_reading(before, size, sign, at, stall, seed, drifts):
    """Before, between and during, from 1 ms to 1 a; the reader may also stop, so that frames wait for it."""
    clock, chance, gap = StampClock(drifts=drifts), random.Random(seed), 5 * MS
    for k in range(1900):
        sent = k * gap
        arrived = sent + 50 * US + min(round(chance.expovariate(1 / (100 * US))), 3 * MS)
        if at + 300 <= k < at + 300 + stall:
            arrived = (at + 300 + stall) * gap
        stamp = DAY + before + sent + (sign * size if k >= at else 0)
        error = clock.time(stamp, arrived) - sent
        undetected = sign < 0 and size <= 20 * MS and k >= at  # it is made up for at the pace of a drift
        assert error <= arrived - sent + MS, "no reading is of the future"
        if k != at:
            assert error <= 4 * MS
        assert error >= (-size if undetected else -1 * MS)
    assert clock.steps == (size > 20 * MS)


def test_a_stamp_in_the_future_by_mistake_is_forgotten_with_the_next():
    clock = StampClock()
    clock.time(DAY, 0)
    clock.time(DAY + YEAR, 5 * MS)
    assert clock.time(DAY + 10 * MS, 10 * MS) == 10 * MS


class FakeSocket:
    """What the kernel would hand over: frames with their ancillary data."""

    family = getattr(socket, "AF_CAN", None)

    def __init__(self, *messages: tuple[bytes, list]) -> None:
        self.messages = list(messages)

    def recvmsg(self, *_: int) -> tuple[bytes, list, int, None]:
        if not self.messages:
            raise BlockingIOError
        raw, notes = self.messages.pop(0)
        return raw, notes, 0, None


def receiver(sock: FakeSocket, fd: Fd | None = None) -> can_port._SocketCanReceiver:
    one = object.__new__(can_port._SocketCanReceiver)
    one.overflows, one.stamped_by, one._fd = 0, "system", fd
    one._socket, one._hardware = sock, StampClock(drifts=True)
    one._poll = SimpleNamespace(poll=lambda timeout: True)
    return one


@pytest.mark.parametrize(("interface", "device", "asked"), [("can0", True, True), ("vcan0", False, False)])
def test_only_interfaces_that_have_hardware_are_asked_for_its_stamps(
    monkeypatch, tmp_path, interface, device, asked
):
    (tmp_path / interface / ("device" if device else "statistics")).mkdir(parents=True)
    monkeypatch.setattr(can_port, "_INTERFACES", tmp_path)
    left, right = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    with left, right:
        can_port._SocketCanReceiver(None, left, None, hardware=can_port._is_hardware(interface))
        assert bool(left.getsockopt(socket.SOL_SOCKET, SO_TIMESTAMPING)) is asked
        assert left.getsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS)


def test_frames_have_the_stamps_of_the_hardware_where_there_are_some():
    classic = struct.pack("=IB3x8s", 0x123, 2, b"\1\2")
    wide = struct.pack("=IBB2x64s", 0x80000456, 12, 0, bytes(range(12)))
    notes = [
        [(1, SO_TIMESTAMPING, timespecs(DAY + late, 0, 7 * S + at))]
        for at, late in ((0, 100 * US), (1000 * US, 3000 * US))
    ]
    one = receiver(FakeSocket((classic, notes[0]), (wide, notes[1])), Fd())
    block = one.receive(0.0)
    assert one.stamped_by == "hardware"
    assert int(block["time"][1]) - int(block["time"][0]) == pytest.approx(1000 * US, abs=200)
    assert block["id"].tolist() == [0x123, 0x456]
    assert block["length"].tolist() == [2, 12]
    assert block["fd"].tolist() == [0, 1]
    plain = receiver(FakeSocket((classic, [(1, SO_TIMESTAMPNS, timespecs(DAY))]), (wide, [])))
    block = plain.receive(0.0)
    assert plain.stamped_by == "system"
    assert block["time"].tolist() == [DAY], "frames of CAN FD are for who asks for them"


def test_an_adapter_with_a_clock_of_its_own_is_brought_to_the_time_of_the_day():
    with can.Bus(interface="virtual", channel="stamps") as far:
        bus = can.Bus(interface="virtual", channel="stamps", preserve_timestamps=True)
        port = PythonCanPort(bus, stamped_by="hardware")
        blocks: list = []
        port.subscribe(blocks.append)
        for k in range(5):
            far.send(can.Message(timestamp=12.0 + 0.001 * k, arbitration_id=k, data=b""))
        for _ in range(200):
            if sum(len(block) for block in blocks) == 5:
                break
            port._thread.join(0.01)
        port.close()
    times = [int(time) for block in blocks for time in block["time"]]
    assert min(times) > DAY - 10**18
    assert port.stamped_by == "hardware"
    assert UNCERTAINTY[port.stamped_by] < UNCERTAINTY["system"]
