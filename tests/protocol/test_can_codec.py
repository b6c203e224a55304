"""The compiled CAN codec against cantools and the AUTOSAR E2E library, and against itself."""

import cantools
import e2e.p01
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_protocol.can_codec import Decoder, Encoder, Tally
from bench_protocol.frames import Block, frame, join, payload
from bench_protocol.messages import Protection
from bench_protocol.table import TABLE
from bench_protocol.units import in_unit
from tools.generate.files import ROOT

DATABASE = cantools.database.load_file(ROOT / "bench_protocol" / "generated" / "astb.dbc")
ALL_ROWS = np.arange(len(TABLE.messages))


def values_at(fraction: float) -> np.ndarray:
    """Return a value for every signal, at ``fraction`` of its range."""
    return np.array([s.low + fraction * (s.high - s.low) for s in TABLE.signals])


@settings(max_examples=50, deadline=None)
@given(st.floats(0, 1))
def test_cantools_reads_what_we_send(fraction: float) -> None:
    values = values_at(fraction)
    for record in Encoder(TABLE).encode(values, ALL_ROWS, 0):
        message = DATABASE.get_message_by_frame_id(int(record["id"]))
        decoded = message.decode(payload(record), decode_choices=False)
        row = TABLE.messages[TABLE.message_index[message.name]]
        for field in row.fields:
            signal = TABLE[field.signal]
            step = in_unit(field.step or signal.step, signal.unit)
            expected = in_unit(values[TABLE.index[field.signal]], signal.unit)
            assert decoded[field.signal.replace(".", "_")] == pytest.approx(expected, abs=0.5001 * step)


@settings(max_examples=50, deadline=None)
@given(st.floats(0, 1))
def test_what_cantools_sends_we_read(fraction: float) -> None:
    values = values_at(fraction)
    for row in TABLE.messages:
        if row.protection is Protection.E2E:
            continue  # cantools knows no CRC
        message = DATABASE.get_message_by_name(row.name)
        known = {f.signal.replace(".", "_"): values[TABLE.index[f.signal]] for f in row.fields}
        data = {n: in_unit(v, TABLE.signals[TABLE.index[_name(row, n)]].unit) for n, v in known.items()}
        if row.protection is Protection.COUNTER:
            data["sample_counter"] = 7
        raw = message.encode(data, strict=False)
        samples = Decoder(TABLE).decode(frame(row.identifier, raw))
        for index, value in zip(samples.signals, samples.values, strict=True):
            signal = TABLE.signals[index]
            step = max(f.step or signal.step for f in row.fields if f.signal == signal.name)
            assert value == pytest.approx(values[index], abs=0.5001 * step)


def _name(row: object, flat: str) -> str:
    return next(f.signal for f in row.fields if f.signal.replace(".", "_") == flat)


def test_our_protection_is_autosar_profile_1() -> None:
    encoder = Encoder(TABLE)
    for message in TABLE.messages:
        if message.protection is not Protection.E2E:
            continue
        rows = encoder.rows([message.name])
        for _ in range(40):
            (record,) = encoder.encode(values_at(0.7), rows, 0)
            ours = payload(record)
            theirs = bytearray(ours)
            e2e.p01.e2e_p01_protect(theirs, message.data_id, increment_counter=False)
            assert ours == bytes(theirs)
            assert e2e.p01.e2e_p01_check(bytearray(ours), message.data_id)


def test_counters_run_as_the_profiles_say() -> None:
    encoder = Encoder(TABLE)
    rows = encoder.rows(["Control"])
    seen = [encoder.encode(values_at(0.0), rows, 0)["data"][0, 1] & 0x0F for _ in range(31)]
    assert seen == [k % 15 for k in range(31)]


def test_not_available_travels_as_not_available() -> None:
    values = np.full(len(TABLE.signals), np.nan)
    samples = Decoder(TABLE).decode(Encoder(TABLE).encode(values, ALL_ROWS, 0))
    nullable = {f.signal for m in TABLE.messages for f in m.fields if f.nullable}
    for index, value in zip(samples.signals, samples.values, strict=True):
        assert np.isnan(value) == (TABLE.signals[index].name in nullable)


@pytest.mark.parametrize("value", [1e30, -1e30, np.inf, -np.inf])
def test_values_beyond_the_range_travel_as_the_limit(value: float) -> None:
    values = np.full(len(TABLE.signals), value)
    encoder = Encoder(TABLE)
    samples = Decoder(TABLE).decode(encoder.encode(values, encoder.rows(["SpringLeft"]), 0))
    assert samples.values[0] == pytest.approx(np.sign(value) * 0.32767)


def stream(count: int, name: str = "Control", period: int = 20_000_000) -> Block:
    encoder = Encoder(TABLE)
    rows = encoder.rows([name])
    return join(encoder.encode(values_at(0.4), rows, k * period) for k in range(count))


def test_gaps_in_the_sample_counter_are_counted() -> None:
    decoder = Decoder(TABLE)
    block = stream(300, "SpringLeft", 5_000_000)
    decoder.decode(np.delete(block, [10, 11, 12, 200]))
    assert decoder.tally[Tally.LOST] == 4
    assert decoder.tally[Tally.ACCEPTED] == 296


def test_a_late_reading_is_not_taken_for_the_newest() -> None:
    block = stream(300, "SpringLeft", 5_000_000)
    late = np.concatenate([block[:50], block[51:60], block[50:51], block[60:]])
    decoder = Decoder(TABLE)
    decoder.decode(late)
    assert decoder.tally[Tally.OUT_OF_SEQUENCE] == 1
    assert decoder.tally[Tally.LOST] == 1
    assert decoder.tally[Tally.ACCEPTED] == 299


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 63), st.integers(1, 40))
def test_a_corrupt_command_is_refused_without_motion(bit: int, at: int) -> None:
    block = stream(42)
    spoilt = block.copy()
    spoilt["data"][at, bit // 8] ^= 1 << bit % 8
    decoder = Decoder(TABLE)
    decoder.decode(spoilt[: at + 1])
    assert decoder.tally[Tally.CORRUPT] == 1
    assert decoder.tally[Tally.ACCEPTED] == at
    # The frame that should have come is still the next one: the rejected one has not moved the counter.
    decoder.decode(block[at : at + 1])
    assert decoder.tally[Tally.ACCEPTED] == at + 1


def test_a_repeated_command_is_refused() -> None:
    decoder = Decoder(TABLE)
    block = stream(3)
    decoder.decode(np.repeat(block, 2))
    assert decoder.tally[Tally.ACCEPTED] == 3
    assert decoder.tally[Tally.REPEATED] == 3


def test_a_command_from_far_ahead_is_refused_until_silence_explains_it() -> None:
    decoder = Decoder(TABLE)
    block = stream(12)
    decoder.decode(block[:1])
    early = block[9:10].copy()
    early["time"] = 20_000_000
    decoder.decode(early)
    assert decoder.tally[Tally.OUT_OF_SEQUENCE] == 1
    decoder.decode(block[9:10])  # the same frame when 180 ms have passed: nine cycles were lost
    assert decoder.tally[Tally.ACCEPTED] == 2
    assert decoder.tally[Tally.LOST] == 8


def test_a_command_for_another_message_is_refused() -> None:
    block = stream(1)
    block["id"] = 0x202  # the data id in the CRC gives it away
    decoder = Decoder(TABLE)
    assert decoder.decode(block).values.size == 0
    assert decoder.tally[Tally.CORRUPT] == 1


def test_foreign_short_and_extended_frames_are_counted_and_ignored() -> None:
    decoder = Decoder(TABLE)
    decoder.decode(join([frame(0x7FF, b""), frame(0x181, b"\1\2"), frame(0x181, bytes(8), extended=True)]))
    assert decoder.tally[Tally.UNKNOWN] == 2
    assert decoder.tally[Tally.MALFORMED] == 1
    assert decoder.tally[Tally.ACCEPTED] == 0


def test_an_echo_of_feedback_is_no_command() -> None:
    decoder = Decoder(TABLE, from_rig=False)
    assert decoder.decode(stream(5, "SpringLeft")).values.size == 0
