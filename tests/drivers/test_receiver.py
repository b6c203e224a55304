"""Frames become samples: in order, none lost while a plan computes, and echoed commands are never readings."""

import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_protocol.can_codec import Encoder
from bench_protocol.clock import RealClock, VirtualClock
from bench_protocol.frames import join
from bench_protocol.table import TABLE
from bench_protocol.units import bar, mm
from drivers.errors import Misuse, Stale
from drivers.memory import InMemoryCan
from drivers.modbus_port import InMemoryModbus
from drivers.receiver import Capture, Receiver
from drivers.stamps import StampClock
from drivers.wiring.astb.can import AstbListener
from drivers.wiring.own import own_wiring
from tests.refusals import refuses

HEIGHT, PRESSURE = TABLE.index["left.height"], TABLE.index["left.bellows_pressure"]
MS = 1_000_000


class WiredReceiver(Receiver):
    """A receiver of our wiring, with the listener that hears frames for it."""

    def __init__(self, clock, stamps=None):
        silent = InMemoryModbus(lambda request: b"")
        super().__init__(own_wiring(InMemoryCan(lambda block: None), silent), clock)
        listener = AstbListener(TABLE, clock, stamps, self.receive)
        self.accept, self.tally = listener.receive, listener.tally


def spring(encoder, time, height=0.0, pressure=0.0):
    values = np.full(len(TABLE.signals), np.nan)
    values[HEIGHT], values[PRESSURE] = height, pressure
    return encoder.encode(values, encoder.rows(["SpringLeft"]), time)


def test_every_sample_reaches_the_sink_in_order_while_the_plan_computes():
    receiver, encoder = WiredReceiver(RealClock()), Encoder(TABLE)
    received = []
    receiver.sink = lambda times, rows, values: received.append((times.copy(), rows.copy()))
    frames = [join(spring(encoder, (20 * k + j) * MS) for j in range(20)) for k in range(500)]
    bus = threading.Thread(target=lambda: [receiver.accept(block) for block in frames])
    bus.start()
    rounds = 0
    while bus.is_alive():
        sum(range(20_000))  # a plan that computes and holds the interpreter
        rounds += 1
    bus.join()
    times = np.concatenate([t[r == HEIGHT] for t, r in received])
    assert np.array_equal(times, np.arange(10_000) * MS)
    assert receiver.tally()["accepted"] == 10_000
    assert receiver.tally()["lost"] == receiver.tally()["repeated"] == 0


def test_echoed_commands_are_not_readings():
    receiver, encoder = WiredReceiver(VirtualClock()), Encoder(TABLE)
    values = np.full(len(TABLE.signals), 1.0)
    commands = [message.name for message in TABLE.messages if not message.from_rig and message.rate]
    received = []
    receiver.sink = lambda *arrays: received.append(arrays)
    receiver.accept(encoder.encode(values, encoder.rows(commands), 0))
    assert received == []
    assert receiver.latest(TABLE.index["control.enable"])[1] == -1
    assert receiver.tally()["unknown"] == len(commands)


def test_stamps_of_another_clock_are_converted_and_the_block_stays():
    clock, encoder = VirtualClock(), Encoder(TABLE)
    epoch = 1_700_000_000_000_000_000
    receiver = WiredReceiver(clock, StampClock())
    clock.sleep_until(50 * MS)
    block = join([spring(encoder, epoch + at * MS, 3 * mm) for at in (10, 20)])
    with Capture(receiver, ["left.height"]) as capture:
        receiver.accept(block)
        receiver.accept(spring(encoder, epoch + 20 * MS))
        capture.start = 0
    assert block["time"].tolist() == [epoch + 10 * MS, epoch + 20 * MS]
    assert capture.times("left.height")[-1] == pytest.approx(0.050)
    assert receiver.latest(HEIGHT)[1] == 50 * MS  # the age counts from the arrival


YEAR = 31_557_600_000 * MS
STEPS = st.one_of(
    st.integers(-20, 20).map(lambda steps: steps * MS),
    st.integers(-YEAR, YEAR),
    st.sampled_from([sign * size for sign in (1, -1) for size in (1 * MS, 1000 * MS, 3_600_000 * MS, YEAR)]),
)


@pytest.mark.parametrize("stories", [20, pytest.param(2000, marks=pytest.mark.slow)])
def test_every_capture_has_its_samples_however_the_clock_of_the_rig_is_set(stories):
    @settings(max_examples=stories, deadline=None)
    @given(epoch=st.integers(0, 100 * YEAR), steps=st.dictionaries(st.integers(0, 100), STEPS, max_size=4))
    def follow(epoch, steps):
        clock, encoder = VirtualClock(), Encoder(TABLE)
        receiver = WiredReceiver(clock, StampClock())
        # What looks like stamps out of order: these readings are early by as much.
        undetected = sum(-step for step in steps.values() if -25 * MS <= step < 0)
        for k in range(1, 101):
            if k % 50 == 1:
                capture = Capture(receiver, ["left.height"]).__enter__()
            epoch += steps.get(k, 0)
            block = spring(encoder, epoch + k * 5 * MS)
            clock.sleep_until(k * 5 * MS + 100_000)
            receiver.accept(block)
            assert receiver.latest(HEIGHT)[1] == clock.now()
            if k % 50 == 0:
                times = capture.times("left.height")
                assert 49 - undetected / (5 * MS) <= times.size <= 50
                assert (np.diff(times) >= 0).all()
                assert times[-1] <= 0.251
                capture.__exit__(None, None, None)

    follow()


def test_a_foreign_clock_neither_ages_nor_refreshes_a_reading():
    clock, encoder = VirtualClock(), Encoder(TABLE)
    for offset in (-(3600 * 1000) * MS, 3600 * 1000 * MS):  # the other machine's clock is an hour off
        receiver = WiredReceiver(clock, StampClock())
        receiver.accept(spring(encoder, 10**18 + offset))
        assert receiver.latest(HEIGHT)[1] == clock.now()


def test_a_sink_that_fails_does_not_stop_the_receiver():
    receiver, encoder = WiredReceiver(VirtualClock()), Encoder(TABLE)

    def full(*arrays):
        raise OSError("no space left on device")

    receiver.sink = full
    receiver.accept(spring(encoder, 0, 1 * mm))
    receiver.accept(spring(encoder, 5 * MS, 2 * mm))
    assert receiver.latest(HEIGHT)[0] == pytest.approx(2 * mm)
    assert "no space left" in str(receiver.failure)


def fill(capture, receiver, times, values):
    encoder = Encoder(TABLE)
    with capture:
        for time, value in zip(times, values, strict=True):
            receiver.accept(spring(encoder, time, value, value * 1e6))


def test_a_capture_that_is_full_says_so(monkeypatch):
    monkeypatch.setattr("drivers.receiver.CAPTURE_SAMPLES_MAX", 5)
    receiver = WiredReceiver(VirtualClock())
    capture = Capture(receiver, ["left.height"])
    fill(capture, receiver, [5 * MS * k for k in range(3)], [1.0 * mm] * 3)
    with refuses(Misuse, "limit 5"):
        capture.values("left.height")


def test_a_capture_holds_exactly_what_came_meanwhile():
    clock = VirtualClock()
    receiver, encoder = WiredReceiver(clock), Encoder(TABLE)
    receiver.accept(spring(encoder, 0, 1 * mm))
    clock.sleep_until(10 * MS)
    with Capture(receiver, ["left.height", "left.bellows_pressure"]) as capture:
        receiver.accept(spring(encoder, 5 * MS, 1.5 * mm))  # was on its way when the capture began
        receiver.accept(spring(encoder, 10 * MS, 2 * mm, 1 * bar))
        receiver.accept(spring(encoder, 15 * MS, 3 * mm, 2 * bar))
    receiver.accept(spring(encoder, 20 * MS, 4 * mm))
    assert capture.times("left.height") == pytest.approx([0, 0.005])
    assert capture.values("left.height") == pytest.approx([2 * mm, 3 * mm])
    assert capture.values("left.bellows_pressure") == pytest.approx([1 * bar, 2 * bar])


@pytest.mark.parametrize(("name", "words"), [("rig.lateness_50us", "itself"), ("left.hieght", "signal")])
def test_a_capture_refuses_what_it_could_never_fill(name, words):
    with refuses((Misuse, KeyError), words):
        Capture(WiredReceiver(VirtualClock()), [name])


def test_a_capture_answers_only_for_its_own_signals():
    capture = Capture(WiredReceiver(VirtualClock()), ["left.height"])
    with refuses(Misuse, "right.height left.height"):
        capture.values("right.height")
    with refuses(Misuse, "samples"):
        capture.aligned()


def test_a_missing_signal_is_not_a_failure_of_the_plan():
    receiver = WiredReceiver(VirtualClock())
    capture = Capture(receiver, ["left.height", "load_cell.1"])
    fill(capture, receiver, [5 * MS * k for k in range(10)], [0.0] * 10)
    with refuses(Stale, "load_cell.1"):
        capture.aligned()


def test_aligned_on_the_samples_own_grid_returns_the_samples():
    receiver = WiredReceiver(VirtualClock())
    capture = Capture(receiver, ["left.height", "left.bellows_pressure"])
    values = np.round(10 * np.sin(np.arange(100)), 2) * mm
    fill(capture, receiver, [5 * MS * k for k in range(100)], values)
    times, columns = capture.aligned(rate=200)
    assert times == pytest.approx(np.arange(100) * 0.005)
    assert columns["left.height"] == pytest.approx(values, abs=1e-12)
    assert np.array_equal(columns["left.bellows_pressure"], capture.values("left.bellows_pressure"))


@settings(max_examples=30, deadline=None)
@given(
    jitter=st.lists(st.integers(0, 4 * MS), min_size=10, max_size=60),
    rate=st.floats(20, 900),
    slope=st.floats(-50, 50),
)
def test_aligned_interpolates_a_straight_line_exactly_whatever_the_jitter(jitter, rate, slope):
    receiver = WiredReceiver(VirtualClock())
    capture = Capture(receiver, ["left.height"])
    at = [5 * MS * k + wobble for k, wobble in enumerate(jitter)]
    fill(capture, receiver, at, [slope * mm * t / 1e9 for t in at])
    times, columns = capture.aligned(rate)
    assert columns["left.height"] == pytest.approx(slope * mm * times, abs=0.006 * mm)  # half a wire step
    assert times[-1] <= at[-1] / 1e9 + 1e-9


def test_aligned_says_nan_in_a_gap_instead_of_drawing_a_line():
    receiver = WiredReceiver(VirtualClock())
    capture = Capture(receiver, ["left.height"])
    at = [5 * MS * k for k in range(100) if not 40 <= k < 70]  # 150 ms without frames
    fill(capture, receiver, at, [0.0] * len(at))
    times, columns = capture.aligned()
    gap = np.isnan(columns["left.height"])
    assert gap.any()
    assert (times[gap] > 0.195).all()
    assert (times[gap] < 0.350).all()
    assert gap.sum() == 30
