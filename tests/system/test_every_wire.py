"""The same tests through bytes on every wire: in memory, on the TCP hub, on SocketCAN."""

import math

import numpy as np
import pytest

from bench_protocol.can_codec import Decoder, Encoder
from bench_protocol.frames import frame, join
from bench_protocol.modbus import NO_AUTHORITY
from bench_protocol.rates import DISABLE_AFTER, HOLD_AFTER
from bench_protocol.registers import BLOCKS, LEASE_ADDRESS
from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.units import Hz, bar, kN, mm, mrad, ms, s
from bench_protocol.words import STATES
from drivers.errors import NotCommander, Refused, RigFault
from tests.refusals import refuses

#: A sample of the rig, which gives its time on the bus; and the delay, on a busy machine, a thread of the rig
#: may take a frame that is on the bus already.
SAMPLE = 5 * ms
READING = 50 * ms
IDENTIFIER = {message.name: message.identifier for message in TABLE.messages}


def test_can_and_modbus_agree_at_one_instant(site, armed):
    """Both publish the sampling instant: the sequence register counts it, and so do the 200 Hz frames, modulo 256."""
    modbus, first_block = site.modbus(), BLOCKS[0]
    readings = [
        r
        for r in TABLE.registers
        if r.space == "input" and r.encoding == "float32" and r.signal in TABLE.index
        if TABLE[r.signal].kind is not Kind.SETTING
        and r.address <= first_block.address(first_block.numbers[-1])
    ]
    first = readings[0].address - 1
    count = readings[-1].address + 3 - first
    with site.listening() as received:
        site.wait(200 * ms)
        for _ in range(2000):
            words = modbus.read_input(first, count)
            if words[0] % 20 == 0:  # an instant at which the messages of all three rates are sent
                break
            site.wait(1 * ms)
        assert words[0] % 20 == 0
        site.wait(100 * ms)
    modbus.close()
    assert words[0] == words[-1], "a block is one snapshot"
    frames = received.frames()
    samples, timings = received.positions("SpringLeft"), received.positions("Timing")
    # By its tick, as the 200 Hz frames restart their numbers every 1.28 s.
    (mine,) = timings[received.series("rig.tick") // 5 % 65536 == words[0]]
    before, following = samples[samples < mine][-1], samples[samples > mine][0]
    assert frames["data"][before, 7] == (words[0] - 1) % 256
    decoder = Decoder(TABLE, from_rig=True)
    decoder.decode(frames[before:following])
    compared = 0
    for register in readings:
        start = register.address - first
        (value,) = np.array(words[start : start + 2], ">u2").view(">f4")
        signal = TABLE[register.signal]
        seen = decoder.latest[TABLE.index[signal.name]]
        if signal.kind is not Kind.MEASUREMENT:
            continue
        step = (
            next(f.step for m in TABLE.messages for f in m.fields if f.signal == signal.name) or signal.step
        )
        assert seen == pytest.approx(float(value), abs=0.501 * step), signal.name
        compared += 1
    assert compared == len(TABLE.of_kind(Kind.MEASUREMENT)), "every measurement travels on both"


def test_both_doors_speak_the_same_table(site, armed):
    assert int(armed.rig.map_hash) == TABLE.map_hash
    modbus = site.modbus()
    high, low = modbus.read_input(1, 2)
    assert (high << 16) | low == TABLE.map_hash
    assert modbus.identification()[0x80] == f"{TABLE.map_hash:08x}".encode()
    modbus.close()


def test_set_points_are_followed(site, armed):
    armed.platform.move_to(vertical=4 * mm, roll=3 * mrad, rate=20 * mm / s)
    armed.lateral.move_to(-3 * mm, rate=20 * mm / s)
    armed.vertical.preload(4 * kN, 6 * kN, rate=40 * kN / s)
    names = [
        "platform.vertical",
        "platform.roll",
        "lateral.displacement",
        "vertical_left.force",
        "vertical_right.force",
    ]
    means = list(armed.averages(*names, over=200 * ms).values())
    assert means[:3] == pytest.approx([4 * mm, 3 * mrad, -3 * mm], abs=0.15 * mm)
    assert means[3:] == pytest.approx([4 * kN, 6 * kN], abs=0.15 * kN)
    load = sum(armed.load_cell[cell] for cell in (1, 2, 3, 4))
    assert load == pytest.approx(10 * kN + 1200 * 9.80665, abs=1.5 * kN), "so do the cells, with the bolster"
    armed.platform.move_to(vertical=0.0, roll=0.0, rate=20 * mm / s)


def test_a_program_runs_to_its_end(site, armed):
    with armed.capture("platform.vertical", "rig.generator_cycle") as capture:
        armed.generator.run(
            "platform_vertical", "unilateral_cosine", amplitude=5 * mm, frequency=4 * Hz, cycles=3
        )
    path = capture.values("platform.vertical")
    # A second-order platform of 30 Hz with 0.7 damping passes 4 Hz with a gain within 1 %.
    assert path.max() == pytest.approx(5 * mm, abs=0.2 * mm)
    assert path.min() > -0.2 * mm
    assert capture.values("rig.generator_cycle").max() == 3
    assert armed.rig.program == "IDLE"


def test_a_program_pauses_goes_on_and_is_stopped(site, armed):
    armed.generator.start("platform_lateral", "sine", amplitude=4 * mm, frequency=2 * Hz, cycles=50)
    armed.generator.hold()
    armed.wait(150 * ms)
    assert armed.rig.program == "HOLD"
    with armed.capture("platform.lateral") as still:
        armed.wait(150 * ms)
    assert np.ptp(still.values("platform.lateral")) < 0.1 * mm
    armed.generator.resume()
    armed.wait(100 * ms)
    assert armed.rig.program == "RUN"
    armed.generator.stop()
    assert armed.rig.program == "STOPPED"


def test_springs_are_filled_and_keep_their_air(site, armed):
    armed.vertical.hold_position()
    # The valves close softly from 0.15 bar below the target: aiming beyond saves the wait.
    armed.air.fill(to=0.5 * bar, tolerance=0.38 * bar)
    armed.air.hold()
    armed.wait(200 * ms)
    before = armed.averages("left.auxiliary_pressure", "right.auxiliary_pressure", over=200 * ms)
    armed.wait(200 * ms)
    after = armed.averages("left.auxiliary_pressure", "right.auxiliary_pressure", over=200 * ms)
    assert min(before.values()) > 0.08 * bar
    for name in before:
        assert after[name] == pytest.approx(before[name], abs=0.03 * bar)
    armed.air.vent(left=0.0, tolerance=0.06 * bar)
    armed.air.hold()
    left, right = armed.averages(
        "left.auxiliary_pressure", "right.auxiliary_pressure", over=200 * ms
    ).values()
    assert left < before["left.auxiliary_pressure"] - 0.1 * bar
    # The gas cools down meanwhile, which costs a tenth of the released air.
    assert right == pytest.approx(before["right.auxiliary_pressure"], abs=0.06 * bar), (
        "the other side is shut"
    )


def test_silence_holds_at_100_ms_and_disables_at_500_ms_and_stays_so(site, armed):
    late = SAMPLE if site.transport == "memory" else READING
    with site.listening() as received:
        site.wait(100 * ms)
        armed.commander.stop()
        site.wait(700 * ms)
    contacts = armed.interlock.fault, armed.interlock.command
    armed.commander.start()
    last, emergency = received.positions("Control")[-1], received.positions("Emergency")
    assert emergency.size == 1
    assert HOLD_AFTER - SAMPLE <= received.rig_time(last, emergency[0]) <= HOLD_AFTER + late
    disabled = received.positions("State")[received.series("rig.state") == STATES.index("FAULT_DISABLED")][0]
    assert DISABLE_AFTER - SAMPLE <= received.rig_time(last, disabled) <= DISABLE_AFTER + 20 * ms + late
    assert received.states() == ["ACTIVE", "FAULT_HOLD", "FAULT_DISABLED"]
    assert received.series("emergency.code")[-1] == 0x8130
    assert contacts == (True, False)
    site.wait(200 * ms)
    state = armed.rig.state, armed.rig.reason
    assert state == ("FAULT_DISABLED", "command late"), "latched, and the first reason stays"
    armed.reset()
    assert armed.rig.state == "DISABLED"


def test_the_emergency_stop_wins_until_it_is_released(site, armed):
    site.press_estop()
    with refuses(RigFault, "ESTOP"):
        armed.wait(2 * s)
    assert armed.interlock.estop
    assert armed.emergency.code == 0xFF02
    with refuses(RigFault, "release"):
        armed.arm()
    with pytest.raises(Refused):
        armed.action.reset()
    assert armed.rig.state == "ESTOP"
    site.release_estop()
    armed.wait(100 * ms)
    assert armed.rig.state == "ESTOP", "releasing the button starts nothing"
    armed.arm()
    assert armed.rig.state == "ACTIVE"


def test_a_second_sender_with_the_next_counter_causes_no_motion(site, armed):
    """With sound CRCs, and in time: what is missing is the token, in a field of one message or in the CRC."""
    encoder, intruder = Encoder(TABLE), site.can()
    values = np.zeros(len(TABLE.signals))
    values[TABLE.index["platform.vertical_setpoint"]] = 50 * mm
    names = ["Control", "PlatformSetpoints"]
    rows = encoder.rows(names)
    rejected, strangers = armed.rig.rejected_commands, armed.rig.strangers
    with site.listening() as received:
        armed.wait_for(lambda: all(received.positions(name).size for name in names), within=2 * s)
        for _ in range(20):
            armed.wait(20 * ms)
            frames = received.frames()
            for name, row in zip(names, rows, strict=True):
                last = frames[frames["id"] == IDENTIFIER[name]][-1]
                encoder.counters[row] = (last["data"][1] + 1) % 15
            intruder.send(encoder.encode(values, rows, 0))
    armed.wait(200 * ms)
    assert armed.rig.state == "ACTIVE"
    assert abs(armed.platform.vertical) < 2 * mm
    assert armed.rig.rejected_commands == rejected, "those of the commander are not repeated"
    assert armed.rig.strangers == strangers + 40
    assert armed.rig.stranger_identifier == 0x204
    assert (armed.rig.stranger != 0) is site.connections
    armed.platform.move_to(vertical=5 * mm, rate=50 * mm / s)
    armed.wait_for(lambda: abs(armed.platform.vertical - 5 * mm) < 1 * mm, within=2 * s)
    intruder.close()
    armed.platform.move_to(vertical=0.0, rate=50 * mm / s)
    assert armed.rig.state == "ACTIVE"


def test_a_burst_reaches_all_clients_in_order(site, armed):
    """2000 third-party frames, corrupt commands among them, while the bench is armed.

    User-mode Linux sends 180 in a second and has no time for the commander meanwhile: there 500 come, 20 at a time.
    """
    count, parts, pause = (500, 25, 60 * ms) if site.slow else (2000, 1, 0.0)
    encoder = Encoder(TABLE)
    spoilt = encoder.encode(np.zeros(len(TABLE.signals)), encoder.rows(["Control"]), 0)
    spoilt["data"][0, 0] ^= 0x55
    numbered = [frame(0x700, k.to_bytes(8, "big")) for k in range(count - 10)]
    burst = join([*numbered, *[spoilt] * 10])
    stranger = site.can()
    with site.listening() as received:
        for part in np.array_split(burst, parts):
            stranger.send(part)
            armed.wait(pause)
        armed.wait_for(
            lambda: (received.frames()["id"] == 0x700).sum() >= len(numbered), within=5 * s, what="the burst"
        )
        armed.wait(200 * ms)
    stranger.close()
    frames = received.frames()
    numbers = [int.from_bytes(bytes(f["data"]), "big") for f in frames[frames["id"] == 0x700]]
    assert numbers == list(range(len(numbered)))
    assert armed.rig.state == "ACTIVE"
    tally = armed.wiring.carrier.tally()
    assert tally["unknown"] >= len(numbered)
    assert tally["lost"] == 0


def test_a_setting_out_of_range_has_no_effect(site, armed):
    """Straight into the registers, past the drivers' own checks."""
    register = next(r for r in TABLE.registers if r.signal == "air.left_target" and r.space == "holding")
    before = armed.wiring.carrier.modbus.read_holding(register.address, 2)
    words = np.array([15 * bar], ">f4").view(">u2").tolist()
    with pytest.raises(Refused) as refused:
        armed.wiring.carrier.modbus.write_registers(register.address, words)
    assert refused.value.code == 3
    with pytest.raises(Refused) as refused:
        armed.wiring.carrier.modbus.write_registers(register.address, words[:1])
    assert refused.value.code == 3, "half of a 32-bit value"
    assert armed.wiring.carrier.modbus.read_holding(register.address, 2) == before
    with refuses(ValueError, "air.left_target 15 bar 0 9 bar"):
        armed.air.left_target = 15 * bar


def test_arming_and_disarming_walk_through_the_states(site, bench):
    with site.listening() as received:
        bench.wait_for(lambda: bench.rig.state == "DISABLED", within=2 * s)
        # Where the rig cannot see one commander leave and another come, it refuses the new one's first frames.
        bench.wait(400 * ms)
        rejected = bench.rig.rejected_commands
        bench.arm()
        assert bench.rig.state == "ACTIVE"
        bench.disarm()
        site.wait(60 * ms)
    up = ["DISABLED", "AIR_LOW", "AIR_HIGH", "HOLD", "ACTIVE"]
    states = received.states()
    assert states[states.index("DISABLED") :] == [*up, "HOLD", "AIR_HIGH", "DISABLED"]
    assert bench.rig.reason == "disabled by the commander"
    assert bench.rig.rejected_commands == rejected
    assert bench.wiring.carrier.tally()["lost"] == bench.wiring.carrier.tally()["repeated"] == 0


def test_a_commander_that_vanishes_leaves_the_bench_in_hold(site, bench):
    """Both connections end without a message, as after a crash: at once where a connection reports it, else 100 ms."""
    bench.arm()
    with site.listening() as received:
        site.wait(100 * ms)
        bench.commander.stop()
        bench.wiring.carrier.can.close()
        bench.wiring.carrier.modbus.close()
        site.wait(300 * ms)
    last, emergency = received.positions("Control")[-1], received.positions("Emergency")
    assert received.states()[:2] == ["ACTIVE", "FAULT_HOLD"]
    assert received.rig_time(last, emergency[0]) <= HOLD_AFTER + READING
    with site.bench() as successor:
        assert successor.rig.state in ("FAULT_HOLD", "FAULT_DISABLED")
        successor.reset()
        assert successor.rig.state in ("HOLD", "DISABLED")


def test_a_closed_modbus_connection_of_the_commander_holds_at_once(site, bench):
    bench.arm()
    with site.listening() as received:
        site.wait(60 * ms)
        bench.wiring.carrier.modbus.close()
        site.wait(60 * ms)
    assert bench.rig.reason == "commander disconnected"
    assert received.states() == ["ACTIVE", "FAULT_HOLD"]


def test_there_is_one_commander(site, bench):
    bench.arm()
    second = site.bench()
    token = bench.wiring.carrier.registers.holder()
    with pytest.raises(NotCommander, match=f"token {token}"):
        second.connect()
    intruder = site.modbus()
    coil = next(r.address for r in TABLE.registers if r.signal == "action.disable")
    for forbidden in (
        lambda: intruder.write_registers(LEASE_ADDRESS, [2]),
        lambda: intruder.write_registers(LEASE_ADDRESS, [0]),
        lambda: intruder.write_coil(coil, True),
    ):
        with pytest.raises(Refused) as refused:
            forbidden()
        assert refused.value.code == NO_AUTHORITY
    (key,) = intruder.read_holding(LEASE_ADDRESS, 1)
    assert key not in (0, token), "reading is for everybody, but the token is the holder's"
    intruder.close()
    bench.wait(150 * ms)
    assert bench.rig.state == "ACTIVE", "that the second one left is no news"
    bench.close()
    with site.bench() as successor:
        assert successor.wiring.carrier.registers.holder() not in (0, token)


def test_only_received_bytes_are_read(site):
    """A reading exists when a frame has brought it, and goes stale when no more come."""
    bench = site.bench()
    assert math.isnan(bench.left.height)
    assert bench.rig.state == "unknown"
    bench.connect()
    assert not math.isnan(bench.left.height)
    bench.wiring.carrier.can.close()
    site.wait(150 * ms)
    assert math.isnan(bench.left.height)
    assert bench.sample("left.height").quality == "stale"
    bench.close()
