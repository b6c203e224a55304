"""The pace of the bus against closed forms: lengths of frames, arbitration, response times, error counters."""

import math
import random
import re

import numpy as np
import pytest

from bench_protocol.can_codec import Encoder
from bench_protocol.canopen import SERVICE_RATE_MAX
from bench_protocol.frames import FRAME, Block, frame, join
from bench_protocol.messages import Message
from bench_protocol.table import TABLE
from bench_protocol.units import NS
from bench_sim.rig.can_bus import RIG
from bench_sim.rig.frame_time import frame_bits, worst_bits
from bench_sim.rig.pace import NodeState, Pace
from tests.refusals import refuses

BIT_RATE = 500_000
BIT = NS / BIT_RATE
WORST = worst_bits(8)


def wire_bits(identifier: int, data: bytes, *, extended: bool) -> int:
    """Return the length as a person would count it: bits as text, the CRC by long division, stuffing by search."""
    head = f"{identifier >> 18:011b}11{identifier & 0x3FFFF:018b}000" if extended else f"{identifier:011b}000"
    text = "0" + head + f"{len(data):04b}" + "".join(f"{byte:08b}" for byte in data)
    rest, divisor = int(text + 15 * "0", 2), 0b1100010110011001
    while rest.bit_length() > 15:
        rest ^= divisor << (rest.bit_length() - 16)
    text += f"{rest:015b}"
    stuffed = ""
    while run := re.search("00000|11111", text):
        stuffed += text[: run.end()]
        text = ("1" if run[0][0] == "0" else "0") + text[run.end() :]
    return len(stuffed + text) + 1 + 2 + 7 + 3


def random_block(count: int, seed: int = 1) -> Block:
    chance, frames = random.Random(seed), []
    for _ in range(count):
        extended = chance.random() < 0.5
        # Much of it zeros and ones: that is where stuff bits are.
        data = bytes(chance.choice((0, 255, chance.randrange(256))) for _ in range(chance.randrange(9)))
        frames.append(frame(chance.randrange(1 << (29 if extended else 11)), data, extended=extended))
    return join(frames)


def test_a_frame_is_as_long_as_one_counts_by_hand() -> None:
    block = random_block(400)
    by_hand = [
        wire_bits(int(one["id"]), bytes(one["data"][: one["length"]]), extended=bool(one["extended"]))
        for one in block
    ]
    assert frame_bits(block).tolist() == by_hand


def test_no_frame_is_longer_than_the_worst_case_and_some_reach_it() -> None:
    """47 + 8 n + ⌊(34 + 8 n - 1) / 4⌋ and 67 + 8 n + ⌊(54 + 8 n - 1) / 4⌋ bits (Davis et al. 2007)."""
    assert (worst_bits(8), worst_bits(0)) == (135, 55)
    assert (worst_bits(8, extended=True), worst_bits(0, extended=True)) == (160, 80)
    block = random_block(3000, seed=2)
    worst = [worst_bits(int(one["length"]), extended=bool(one["extended"])) for one in block]
    assert (frame_bits(block) <= worst).all()
    zeros = frame(0, bytes(8))
    # All zeros: 83 bits up to the data, of which the DLC's one breaks one run, and another CRC.
    assert frame_bits(zeros)[0] == wire_bits(0, bytes(8), extended=False)


def ends(pace: Pace, until: float = math.inf) -> list[tuple[int, int, str]]:
    """Return (end, identifier, sender) of everything that has gone over the bus by ``until``."""
    now = 10**15 if until == math.inf else round(until)
    return [(int(one["time"]), int(one["id"]), peer) for block, peer in pace.due(now) for one in block]


def test_what_waits_goes_by_identifier_and_takes_its_time_to_the_bit() -> None:
    pace = Pace(BIT_RATE)
    chance = random.Random(3)
    block = join(frame(identifier, bytes(8), time=1000) for identifier in chance.sample(range(0x800), 40))
    half = block.size // 2
    assert pace.outgoing(block[:half].copy(), 0).size == pace.incoming(block[half:].copy(), "a", 0).size == 0
    found = ends(pace)
    order = np.argsort(block["id"])
    assert [identifier for _, identifier, _ in found] == block["id"][order].tolist()
    sum_of_bits = np.cumsum(frame_bits(block)[order])
    assert [end for end, _, _ in found] == pytest.approx(1000 + (sum_of_bits - 3) * BIT, abs=1)


def test_a_frame_on_its_way_is_not_interrupted_and_a_standard_frame_wins_over_its_extension() -> None:
    pace = Pace(BIT_RATE)
    first, later = frame(0x700, bytes(8), time=0), frame(0x001, b"", time=10)
    pace.outgoing(
        join([first, frame(0x123 << 18, b"", time=20, extended=True), frame(0x123, b"", time=20), later]), 0
    )
    assert [identifier for _, identifier, _ in ends(pace)] == [0x700, 0x001, 0x123, 0x123 << 18]


def test_a_result_is_reported_only_after_the_end() -> None:
    pace = Pace(BIT_RATE)
    pace.outgoing(frame(1, bytes(8), time=0), 0)
    end = (frame_bits(frame(1, bytes(8)))[0] - 3) * BIT
    assert ends(pace, end - 1) == []
    assert ends(pace, end) == [(round(end), 1, RIG)]


def response_time(message: Message, jitter: dict[str, float], messages: list[Message]) -> float:
    """Return the worst-case response time (s) by Davis, Burns, Bril and Lukkien, Real-Time Systems 35 (2007).

    For the first instance in the busy period, which is the worst one where it ends within the period; asserted.
    """
    length, bit = WORST / BIT_RATE, 1 / BIT_RATE
    higher = [one for one in messages if one.identifier < message.identifier]
    lower = [one for one in messages if one.identifier > message.identifier]
    blocking = length if lower else 0.0
    wait = blocking
    while True:
        more = blocking + sum(
            math.ceil((wait + jitter[one.name] + bit) * one.rate - 1e-9) * length for one in higher
        )
        if more == wait:
            break
        wait = more
    assert jitter[message.name] + wait + length <= 1 / message.rate
    return jitter[message.name] + wait + length


def test_no_message_of_the_table_waits_longer_than_the_analysis_of_response_times_allows() -> None:
    """All messages at their rates with contents of chance, the commander's at any phase and with 1 ms of jitter."""
    messages = [message for message in TABLE.messages if message.rate]
    jitter = {message.name: 0.0 if message.from_rig else 1e-3 for message in messages}
    allowed = {m.identifier: response_time(m, jitter, messages) for m in messages}
    names = {m.identifier: m.name for m in messages}
    chance, pace, released = random.Random(4), Pace(BIT_RATE), {}
    seconds = 4
    for message in messages:
        phase = 0 if message.from_rig else chance.randrange(20_000_000)
        frames, period = [], NS / message.rate
        for k in range(int(seconds * message.rate)):
            nominal = round(phase + k * period)
            late = 0 if message.from_rig else chance.randrange(1_000_000)
            data = chance.choice((bytes(8), b"\xff" * 8, chance.randbytes(8)))
            frames.append(frame(message.identifier, data, time=nominal + late))
            released.setdefault(message.identifier, []).append(nominal)
        pace.incoming(join(frames[:1000]), message.name, 0)
    worst = dict.fromkeys(allowed, 0.0)
    for end, identifier, _ in ends(pace):
        worst[identifier] = max(worst[identifier], (end - released[identifier].pop(0)) / NS)
    assert not any(released.values()), "every frame arrived"
    for identifier, time in worst.items():
        assert 0 < time <= allowed[identifier], names[identifier]
    lowest = max(worst)
    assert worst[lowest] > 0.5 * allowed[lowest], "the analysis is not far from what happens"


def test_the_load_is_what_the_table_says() -> None:
    """With every stuff bit, the frames of the table take the fraction of 500 kbit/s that the table promises."""
    pace = Pace(BIT_RATE, stuffing="worst")
    rates = {message.identifier: message.rate for message in TABLE.messages if message.rate}
    for identifier, rate in {**rates, 0x7FF: SERVICE_RATE_MAX}.items():
        block = np.zeros(int(2.5 * rate), FRAME)
        block["id"], block["length"] = identifier, 8
        block["time"] = np.arange(block.size) * NS / rate
        pace.incoming(block, f"{identifier:x}", 0)
    for now in range(0, 2_400_000_000, 1_000_000):
        list(pace.due(now))
    assert pace.load == pytest.approx(TABLE.bus_load, rel=0.005)


def test_thirty_two_failures_in_a_row_take_a_node_off_the_bus_and_1408_recessive_bits_bring_it_back() -> None:
    pace = Pace(BIT_RATE)
    pace.spoil("a", 32)
    states = []
    pace.incoming(frame(5, b"x", time=0), "a", 0)
    now = 0
    while pace.nodes["a"].state is not NodeState.OFF:
        now += 10_000
        list(pace.due(now))
        states.append((pace.nodes["a"].transmit_errors, pace.nodes["a"].state))
    passive = [errors for errors, state in states if state is NodeState.PASSIVE]
    assert min(passive) == 128
    assert pace.nodes["a"].transmit_errors == 256
    assert pace.nodes[RIG].receive_errors == 32
    assert not pace.receives("a")
    assert pace.receives(RIG)
    pace.incoming(frame(5, b"y", time=now), "a", 0)
    assert pace.nodes["a"].lost == 2, "the frame that failed, and the one that came meanwhile"
    off = pace.nodes["a"].off_since
    list(pace.due(off + math.floor(1408 * BIT) - 1))
    assert pace.nodes["a"].state is NodeState.OFF
    list(pace.due(off + math.ceil(1408 * BIT)))
    assert (pace.nodes["a"].state, pace.nodes["a"].transmit_errors) == (NodeState.ACTIVE, 0)
    assert ends(pace) == []


def test_on_a_busy_bus_each_frame_is_one_run_of_recessive_bits_and_a_restart_can_wait() -> None:
    for restart, first in ((0.0, 128), (0.01, 128 + 37)):
        pace = Pace(BIT_RATE, restart=restart)
        pace.spoil("a", 32)
        pace.incoming(frame(5, b"", time=0), "a", 0)
        now = 0
        while pace.receives("a"):
            now += 1000
            list(pace.due(now))
        off = pace.nodes["a"].off_since
        block = join([frame(1, bytes(8), time=off)] * 300)
        pace.outgoing(block, 0)
        count = 0
        while not pace.receives("a"):
            now += 10_000
            count += sum(part.size for part, _ in pace.due(now))
        assert abs(count - first) <= 13, "the wait, and 128 frames of about 270 µs"


def test_a_frame_that_fails_is_repeated_until_it_arrives_and_costs_its_time() -> None:
    clean, noisy = Pace(BIT_RATE), Pace(BIT_RATE, error_rate=0.02, seed=1)
    block = join(frame(k % 0x800, k.to_bytes(4, "big"), time=1000 * k) for k in range(1000))
    for pace in (clean, noisy):
        pace.outgoing(block.copy(), 0)
    one, other = ends(clean), ends(noisy)
    assert sorted(identifier for _, identifier, _ in one) == sorted(identifier for _, identifier, _ in other)
    repeated = (other[-1][0] - one[-1][0]) / BIT
    assert 23 * 10 < repeated < (135 + 23) * 35, "about twenty broken frames"
    assert noisy.nodes[RIG].transmit_errors <= 8


def test_a_full_queue_loses_what_comes_then_and_counts_it() -> None:
    pace = Pace(BIT_RATE)
    pace.outgoing(join([frame(1, b"", time=0)] * 1500), 0)
    assert (pace.nodes[RIG].lost, pace.waiting) == (1500 - 1024, 1024)


@pytest.mark.parametrize(("wrong", "why"), [
    ({"bit_rate": 5}, "CAN"),
    ({"bit_rate": math.nan}, "CAN"),
    ({"bit_rate": 5e5, "error_rate": 1.0}, "fraction"),
    ({"bit_rate": 5e5, "restart": -1.0}, "negative"),
])  # fmt: skip
def test_invalid_settings_are_refused_with_a_reason(wrong, why) -> None:
    with refuses(ValueError, why):
        Pace(**wrong)


def test_encoded_commands_travel_unchanged() -> None:
    encoder = Encoder(TABLE)
    rows = encoder.rows([m.name for m in TABLE.messages if not m.from_rig and m.rate])
    block = encoder.encode(np.zeros(len(TABLE.signals)), rows, 77)
    pace = Pace(BIT_RATE)
    pace.incoming(block.copy(), "a", 0)
    ((out, peer),) = pace.due(10**9)
    assert peer == "a"
    for name in ("id", "extended", "length", "data"):
        assert (out[name] == np.sort(block, order="id")[name]).all()
