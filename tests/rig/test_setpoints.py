"""Set-points have ranges and rates at the rig, whatever sent them: by frames and requests, read back from frames."""

import math

import numpy as np
import pytest

from bench_protocol.table import TABLE
from bench_protocol.units import kN, mm, um
from bench_protocol.words import ACTUATORS, AXES, CONTROL_MODES, PLATFORM_AXES, WAVES
from bench_sim.rig.controls import HOLDING

FORCE, DISPLACEMENT = CONTROL_MODES.index("force"), CONTROL_MODES.index("displacement")


def send_raw(commander, identifier: int, *raw: float) -> None:
    """Send one protected frame of three 16-bit fields with any codes, and wait one cycle."""
    row = commander._encoder.rows([next(m.name for m in TABLE.messages if m.identifier == identifier)])
    message = next(m for m in TABLE.messages if m.identifier == identifier)
    kept = {field.signal: commander.values[TABLE.index[field.signal]] for field in message.fields}
    for field, code in zip(message.fields, raw, strict=True):
        commander.values[TABLE.index[field.signal]] = code * TABLE[field.signal].step
    commander.rig.receive(commander._encoder.encode(commander.values, row, 0), commander.peer)
    for name, value in kept.items():
        commander.values[TABLE.index[name]] = value


def refused(commander) -> float:
    commander.cycle(6)  # the count travels ten times a second
    return commander.read("rig.refused_setpoints")


def test_a_set_point_out_of_range_is_refused_counted_and_not_followed(armed) -> None:
    armed.apply(lateral_control=DISPLACEMENT)
    armed.cycle(50, lateral_displacement_setpoint=5 * mm)
    before = armed.read("lateral.displacement")
    assert refused(armed) == 0
    send_raw(armed, 0x203, 0, 0, 32767)  # 327.67 of ±300 mm
    armed.wait(60)
    assert armed.read("lateral.displacement") == pytest.approx(before, abs=0.3 * mm)
    assert refused(armed) == 1
    answer = armed.ask(b"\x04" + (198).to_bytes(2, "big") + b"\0\2")
    assert answer[2:] == np.array([1.0], ">f4").tobytes(), "and on Modbus"


def test_a_frame_is_one_unit(armed) -> None:
    """A side that belongs to the refused one must not move alone."""
    armed.hold_height()
    before = armed.read("vertical_right.displacement")
    send_raw(armed, 0x203, 30001, round(before / (0.01 * mm)) + 500, 0)
    armed.wait(60)
    assert armed.read("vertical_right.displacement") == pytest.approx(before, abs=0.3 * mm)
    assert refused(armed) == 1


def test_the_ends_of_the_range_are_in_it(commander) -> None:
    commander.wait(500)
    for raw in (30000, -30000):
        send_raw(commander, 0x203, raw, raw, raw)
        send_raw(commander, 0x202, raw * 2 // 3, raw * 2 // 3, raw)
    assert refused(commander) == 0
    for raw in (30001, -30001):
        send_raw(commander, 0x203, 0, raw, 0)
    assert refused(commander) == 2, "also for a bench without a commander"


def test_not_available_means_as_before_and_is_no_value_out_of_range(armed) -> None:
    send_raw(armed, 0x203, math.nan, math.nan, math.nan)
    assert refused(armed) == 0
    assert armed.state == "ACTIVE"


def course(commander, name: str, ticks: int) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and readings of ``name`` while the bench runs without commands."""
    samples = commander.decoder.decode(commander.rig.run(ticks))
    mine = samples.signals == TABLE.index[name]
    return samples.times[mine] / 1e9, samples.values[mine]


def test_a_jump_is_followed_at_the_greatest_speed(armed) -> None:
    armed.apply(lateral_control=DISPLACEMENT)
    armed.cycle(2)
    start = armed.read("lateral.displacement")
    armed.values[TABLE.index["lateral.displacement_setpoint"]] = start + 15 * mm
    rows = []
    for _ in range(15):
        armed.rig.receive(armed._encoder.encode(armed.values, armed._rows, 0), armed.peer)
        rows.append(course(armed, "lateral.displacement", 20))
    times, places = (np.concatenate(column) for column in zip(*rows, strict=True))
    assert places[-1] == pytest.approx(start + 15 * mm, abs=0.5 * mm)
    speed = (places[4:] - places[:-4]) / (times[4:] - times[:-4])
    assert 0.18 < speed.max() < 0.23, "m/s; one command period would be 0.75"


def test_a_jump_of_a_force_is_followed_at_its_rate(armed) -> None:
    armed.cycle(1, lateral_force_setpoint=10 * kN)
    rows = []
    for _ in range(15):
        armed.rig.receive(armed._encoder.encode(armed.values, armed._rows, 0), armed.peer)
        rows.append(course(armed, "lateral.force", 20))
    times, forces = (np.concatenate(column) for column in zip(*rows, strict=True))
    assert forces[-1] == pytest.approx(10 * kN, abs=0.3 * kN)
    slope, _ = np.polyfit(times[4:30], forces[4:30], 1)
    assert 40 * kN < slope < 60 * kN, "N/s"


WAVES_TOO_FAST = [
    # axis, control of the vertical actuators, wave, amplitudes, frequency: allowed, refused
    ("lateral", "sine", {"generator_amplitude": 4 * mm}, 23.0, 24.5),
    ("lateral", "unilateral_cosine", {"generator_amplitude": 8 * mm}, 23.0, 24.5),
    ("lateral", "triangle", {"generator_amplitude": 10 * mm}, 14.0, 16.0),
    ("vertical", "sine", {"generator_amplitude": 4 * mm}, 23.0, 24.5),
    ("roll", "sine", {"generator_roll_amplitude": 0.004}, 23.0, 24.5),
    ("platform_lateral", "sine", {"generator_amplitude": 4 * mm}, 23.0, 24.5),
    ("platform_roll", "sine", {"generator_roll_amplitude": 0.004}, 23.0, 24.5),
]


@pytest.mark.parametrize(
    ("axis", "wave", "amplitude", "allowed", "too_fast"), WAVES_TOO_FAST, ids=lambda value: str(value)[:20]
)
def test_an_infeasible_waveform_is_not_started(armed, axis, wave, amplitude, allowed, too_fast):
    """2π · 4 mm · 24.5 Hz are 0.62 m/s; the servo-valves give 0.6."""
    armed.apply(
        vertical_control=DISPLACEMENT,
        lateral_control=DISPLACEMENT,
        generator_axis=AXES.index(axis),
        generator_wave=WAVES.index(wave),
        generator_cycles=3,
        generator_frequency=too_fast,
        **amplitude,
    )
    assert armed.coil("program_run") == b"\x85\x04"
    assert armed.read("rig.program") == 0
    armed.apply(generator_frequency=allowed)
    assert armed.coil("program_run")[0] == 5


def test_a_wave_of_force_has_a_rate_too(armed) -> None:
    armed.apply(
        generator_axis=AXES.index("vertical"),
        generator_force_amplitude=10 * kN,
        generator_frequency=2.0,
        vertical_control=FORCE,
        generator_cycles=3,
    )
    assert armed.coil("program_run") == b"\x85\x04", "126 of 50 kN/s"
    armed.apply(generator_frequency=0.75)
    assert armed.coil("program_run")[0] == 5


def test_a_place_is_held_by_the_transducer_there(armed) -> None:
    """A set-point equal to the measured value causes no motion, however often it is sent."""
    rig, places = armed.rig, [int(sensor) for sensor in HOLDING]
    assert np.abs(rig.plant.parameters.sensor_bias[places]).min() > 1 * um, (
        "each of them is wrong by something"
    )
    armed.apply(vertical_control=DISPLACEMENT, lateral_control=DISPLACEMENT)
    armed.cycle(20)
    began = rig.plant.ideal()[places]
    for _ in range(10):
        armed.cycle(
            5,
            **{f"{name}_displacement_setpoint": armed.read(f"{name}.displacement") for name in ACTUATORS},
            **{f"platform_{axis}_setpoint": armed.read(f"platform.{axis}") for axis in PLATFORM_AXES},
        )
    moved = np.abs(rig.plant.ideal()[places] - began)
    assert moved.max() < 100 * um, "readings have noise, and steps of 10 um and urad"
