"""The Modbus registers by their bytes: coherent, all or nothing, one commander."""

import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench_protocol.registers import BLOCKS, FLOAT_BLOCK, SCALED_BLOCK, SEQUENCE, twin_address
from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.units import bar

READINGS = sorted(TABLE.of_kind(Kind.MEASUREMENT, Kind.STATUS), key=lambda signal: signal.address)
SETTINGS = TABLE.of_kind(Kind.SETTING)
ADDRESS = {r.signal: r.address for r in TABLE.registers if r.space == "holding"}


def read(commander, space: int, address: int, count: int) -> list[int]:
    answer = commander.ask(struct.pack(">BHH", space, address, count))
    assert answer[0] == space, f"exception {answer[1]}"
    return list(struct.unpack(f">{count}H", answer[2:]))


def test_the_probes_find_byte_and_word_order(commander) -> None:
    words = read(commander, 4, 0, 7)
    assert struct.unpack(">f", struct.pack(">HH", *words[3:5]))[0] == pytest.approx(3.14159)
    assert words[5:7] == [0x1234, 0x5678]
    assert words[1] << 16 | words[2] == TABLE.map_hash


def test_floats_twins_and_can_agree(commander) -> None:
    commander.wait(1000)
    for signal in READINGS:
        (value,) = np.array(read(commander, 4, signal.address, 2), ">u2").view(">f4")
        words = read(commander, 4, twin_address(signal), 1)
        (twin,) = np.array(words, np.uint16).view(np.int16)
        if not np.isnan(value):
            steps = float(value) / signal.step
            assert twin == (pytest.approx(steps, abs=0.51) if abs(steps) < 32767.5 else -32768), signal.name
        can = commander.read(signal.name)
        if signal.kind is Kind.MEASUREMENT:
            step = max(
                f.step or signal.step for m in TABLE.messages for f in m.fields if f.signal == signal.name
            )
            assert value == pytest.approx(can, abs=0.51 * step)


def test_a_block_is_one_snapshot(commander) -> None:
    commander.wait(503)
    sequences = [r.address for r in TABLE.registers if r.space == "input" and r.signal == SEQUENCE]
    spans = [span for one in BLOCKS if (span := one.span(sequences))]
    assert all(any(first < signal.address < end for first, end in spans) for signal in READINGS)
    for first, end in spans:
        block = read(commander, 4, first, end - first + 1)
        assert block[0] == block[-1] == 100
    commander.wait(5)
    assert read(commander, 4, FLOAT_BLOCK - 1, 1) == [101]


def test_before_the_first_sample_readings_are_not_available(commander) -> None:
    words = read(commander, 4, FLOAT_BLOCK, 2)
    assert np.isnan(struct.unpack(">f", struct.pack(">HH", *words))[0])
    assert read(commander, 4, SCALED_BLOCK, 1) == [0x8000]
    assert commander.ask(b"\x02\0\x64\0\x01") == b"\x02\x01\x00", "the quality bit"
    commander.wait(5)
    assert commander.ask(b"\x02\0\x64\0\x01") == b"\x02\x01\x01"


@pytest.mark.parametrize(
    ("address", "count"), [(FLOAT_BLOCK + 1, 2), (FLOAT_BLOCK, 1), (FLOAT_BLOCK, 3), (1, 1)]
)
def test_half_of_a_32_bit_value_is_exception_3(commander, address: int, count: int) -> None:
    assert commander.ask(struct.pack(">BHH", 4, address, count)) == b"\x84\x03"


@pytest.mark.parametrize("address", [7, 50, 250, 5000, 65535])
def test_a_hole_in_the_map_is_exception_2(commander, address: int) -> None:
    assert commander.ask(struct.pack(">BHH", 4, address, 1)) == b"\x84\x02"


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_setting_is_taken_as_written_or_refused(commander, data) -> None:
    signal = data.draw(st.sampled_from(SETTINGS))
    number = data.draw(st.floats(allow_nan=True, allow_infinity=True, width=32))
    before = read(commander, 3, ADDRESS[signal.name], 2)
    (answer,) = commander.stage(**{signal.name.replace(".", "_"): number})
    after = read(commander, 3, ADDRESS[signal.name], 2)
    low, high = np.float32(signal.low), np.float32(signal.high)
    fits = low <= number <= high and not (signal.choices and number != int(number))
    if fits:
        assert answer[0] == 0x10
        assert struct.unpack(">f", struct.pack(">HH", *after))[0] == pytest.approx(number, abs=1e-6)
    else:
        assert answer == b"\x90\x03"
        assert after == before


def test_a_block_with_one_bad_value_stages_no_value(commander) -> None:
    good, bad = struct.pack(">f", 1.0), struct.pack(">f", 99 * bar)
    start = ADDRESS["air.left_mode"]
    before = read(commander, 3, start, 4)
    assert commander.ask(struct.pack(">BHHB", 16, start, 4, 8) + good + bad) == b"\x90\x03"
    assert read(commander, 3, start, 4) == before


def test_settings_act_only_when_applied_and_all_at_once(armed) -> None:
    armed.hold_height()
    armed.stage(air_left_mode=2, air_left_target=2 * bar, air_right_mode=2, air_right_target=1 * bar)
    armed.cycle(50)
    assert abs(armed.read("left.auxiliary_pressure")) < 0.1 * bar
    assert armed.ask(b"\x02\0\0\0\x07")[2] & 0b1000000, "the contact says that something is staged"
    armed.coil("apply")
    armed.cycle(50)
    assert armed.read("left.auxiliary_pressure") > 0.2 * bar
    assert armed.read("right.auxiliary_pressure") > 0.2 * bar
    assert not armed.ask(b"\x02\0\0\0\x07")[2] & 0b1000000


ACTIVE = {r.signal: r.address for r in TABLE.registers if r.space == "input" and r.signal in ADDRESS}


def value(commander, space: int, name: str) -> float:
    """Return a setting as it is staged (3) or in force (4)."""
    words = read(commander, space, {3: ADDRESS, 4: ACTIVE}[space][name], 2)
    return float(np.array(words, ">u2").view(">f4")[0])


def staged(commander) -> bool:
    return bool(commander.ask(b"\x02\0\0\0\x07")[2] & 0b1000000)


def test_what_is_staged_and_what_is_in_force_are_two_tables(commander) -> None:
    assert ACTIVE.keys() == {signal.name for signal in SETTINGS}
    commander.stage(generator_amplitude=0.020)
    assert value(commander, 3, "generator.amplitude") == pytest.approx(0.020)
    assert value(commander, 4, "generator.amplitude") == 0.0
    assert staged(commander)
    commander.coil("apply")
    assert value(commander, 4, "generator.amplitude") == pytest.approx(0.020)
    assert not staged(commander)
    commander.stage(generator_amplitude=0.030)
    commander.stage(generator_amplitude=0.020)
    assert not staged(commander), "staged values equal the values in force"


def test_what_the_bench_refuses_is_not_in_force(armed) -> None:
    armed.stage(rig_nominal_preload=145_000.0)
    assert armed.coil("apply") == b"\x85\x04"
    assert value(armed, 4, "rig.nominal_preload") == 53_500
    assert value(armed, 3, "rig.nominal_preload") == 145_000, "until it may, or is replaced"
    assert staged(armed)


def test_a_program_runs_with_what_is_in_force(armed) -> None:
    armed.apply(generator_axis=3, generator_amplitude=0.010, generator_frequency=1.0, generator_cycles=5)
    armed.stage(generator_amplitude=0.060)
    assert armed.coil("program_run")[0] == 5
    heights = []
    for _ in range(150):
        armed.cycle(1)
        heights.append(armed.read("platform.vertical"))
    assert max(heights) == pytest.approx(0.010, abs=0.001)


def leave(commander) -> None:
    commander.rig.peer_lost(commander.modbus)


def another_writes(commander) -> None:
    assert commander.stage("modbus:2", generator_frequency=2.0)[0][0] == 0x10


def the_lease_is_taken(commander) -> None:
    commander.take_lease()


def the_lease_is_returned(commander) -> None:
    commander.take_lease()
    commander.stage(generator_amplitude=0.020)
    commander.ask(b"\x06\0\0\0\0")


@pytest.mark.parametrize("event", [leave, another_writes, the_lease_is_taken, the_lease_is_returned])
def test_a_client_cannot_apply_set_points_of_another(commander, event) -> None:
    commander.stage(generator_amplitude=0.020)
    event(commander)
    assert value(commander, 3, "generator.amplitude") == 0.0
    assert staged(commander) is (event is another_writes)
    commander.coil("apply", "modbus:2" if event is another_writes else None)
    assert value(commander, 4, "generator.amplitude") == 0.0
    assert value(commander, 4, "generator.frequency") == (2.0 if event is another_writes else 1.0)


def test_applying_for_another_client_has_no_effect(commander) -> None:
    commander.stage(generator_amplitude=0.020)
    assert commander.coil("apply", "modbus:2")[0] == 5
    assert value(commander, 4, "generator.amplitude") == 0.0
    assert not staged(commander)


def test_coils_fall_back_at_once_and_only_one_acts(commander) -> None:
    assert commander.ask(b"\x01\0\0\0\x0a") == b"\x01\x02\x00\x00"
    assert commander.ask(b"\x0f\0\0\0\x02\x01\x03") == b"\x8f\x03"


def test_the_lease_makes_one_commander(commander) -> None:
    take = struct.pack(">BHH", 6, 0, 1)
    assert commander.ask(take, "modbus:first") == take

    def lease(peer: str) -> int:
        return int.from_bytes(commander.ask(b"\x03\0\0\0\x01", peer)[2:], "big")

    token = lease("modbus:first")
    assert token not in (0, 1), "the rig draws it"
    assert commander.ask(struct.pack(">BHH", 6, 0, 1), "modbus:second") == b"\x86\x06"
    assert commander.stage("modbus:second", generator_amplitude=0.001) == [b"\x90\x06"]
    assert commander.coil("disable", "modbus:second") == b"\x85\x06"
    assert lease("modbus:first") == token
    assert lease("modbus:second") not in (0, token), "the token is the holder's own"
    assert commander.rig.values[TABLE.index["rig.lease"]] not in (0, token)
    commander.rig.peer_lost("modbus:first")
    assert commander.stage("modbus:second", generator_amplitude=0.001)[0][0] == 0x10


def test_the_commanders_modbus_connection_counts_too(armed) -> None:
    armed.rig.peer_lost(armed.modbus)
    armed.rig.run(2)
    assert armed.rig.state.name == "FAULT_HOLD"


def test_a_modbus_watchdog_that_is_not_fed_holds(armed) -> None:
    armed.ask(struct.pack(">BHH", 6, 1, 200))
    armed.cycle(8)
    armed.ask(struct.pack(">BHH", 6, 1, 200))
    armed.cycle(8)
    assert armed.state == "ACTIVE"
    armed.cycle(4)
    assert armed.state == "FAULT_HOLD"


def test_identification_carries_the_map_hash(commander) -> None:
    answer = commander.ask(b"\x2b\x0e\x04\x80")
    assert f"{TABLE.map_hash:08x}".encode() in answer
