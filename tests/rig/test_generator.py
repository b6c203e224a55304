"""Waves of a program at once, over the wires: one start, one end, and what stops one of them stops all."""

import numpy as np
import pytest

from bench_protocol.table import TABLE
from bench_protocol.units import mm, mrad
from bench_protocol.words import AXES, CONTROL_MODES, REASONS, WAVES, WAVES_AT_ONCE, Program
from bench_sim.rig.controls import Target
from bench_sim.rig.limit_table import limits_of
from bench_sim.rig.rig import Rig

WAVE = {
    "wave": 0,
    "amplitude": 0.0,
    "roll_amplitude": 0.0,
    "force_amplitude": 0.0,
    "frequency": 1.0,
    "cycles": 5,
}
THREE = (
    {"axis": "vertical", "amplitude": 6 * mm},
    {"axis": "lateral", "amplitude": 8 * mm, "wave": WAVES.index("unilateral_cosine")},
    {"axis": "platform_roll", "roll_amplitude": 5 * mrad, "frequency": 2.0, "cycles": 8, "delay": 0.5},
)
MOVED = [Target.VERTICAL_LEFT, Target.VERTICAL_RIGHT, Target.LATERAL, Target.PLATFORM_ROLL]


@pytest.fixture
def placed(armed):
    """A commander of a rig whose actuators hold their places."""
    armed.hold_height()
    armed.apply(lateral_control=CONTROL_MODES.index("displacement"))
    return armed


def add(commander, axis: str, **wave: float) -> int:
    """Set a wave and keep it; return the function of the answer: 5, or 0x85 for a refusal."""
    values = WAVE | {"delay": 0.0} | wave | {"axis": AXES.index(axis)}
    commander.apply(**{f"generator_{name}": float(value) for name, value in values.items()})
    return commander.coil("program_add")[0]


def program(commander) -> Program:
    return Program(int(commander.rig._controls["program"]))


def run(commander, cycles: int) -> np.ndarray:
    """Return what the generator adds to each set-point, cycle by cycle."""
    offsets = []
    for _ in range(cycles):
        commander.cycle(1)
        offsets.append(commander.rig._controls["offset"].copy())
    return np.array(offsets)


@pytest.fixture
def moving(placed):
    """A commander of a rig that moves three axes at once, for a while."""
    for wave in THREE:
        assert add(placed, **wave) == 5
    assert placed.coil("program_run")[0] == 5
    run(placed, 100)
    assert (abs(run(placed, 50)[:, MOVED]).max(axis=0) > 3 * mm).all()
    return placed


def test_they_start_on_one_tick_and_end_together(placed):
    for wave in THREE:
        assert add(placed, **wave) == 5
    assert not run(placed, 5).any(), "an added offset causes no motion"
    assert placed.coil("program_run")[0] == 5
    offsets = run(placed, 260)
    times = 0.02 * np.arange(1, 261)
    inside = (times > 1.0) & (times < 3.4)
    phase = 2 * np.pi * times[inside]
    assert offsets[inside, Target.LATERAL] == pytest.approx(4 * mm * (1 - np.cos(phase)), abs=0.04 * mm)
    assert offsets[inside, Target.VERTICAL_LEFT] == pytest.approx(6 * mm * np.sin(phase), abs=0.04 * mm)
    late = (times > 1.0) & (times < 4.0)
    roll = 5 * mrad * np.sin(2 * np.pi * 2.0 * (times[late] - 0.5))
    assert offsets[late, Target.PLATFORM_ROLL] == pytest.approx(roll, abs=0.07 * mrad)
    assert not offsets[times < 0.5, Target.PLATFORM_ROLL].any()
    assert not offsets[:, [Target.PLATFORM_VERTICAL, Target.PLATFORM_LATERAL]].any()
    assert not offsets[-3:].any()
    assert program(placed) is Program.IDLE
    assert placed.read("rig.generator_cycle") == 8, "of the wave that was added last"


def test_the_actuators_do_it_together(moving):
    seen = []
    for _ in range(50):
        moving.cycle(1)
        seen.append([moving.read(f"{one}.displacement") for one in ("vertical_left", "lateral")])
    assert (np.ptp(seen, axis=0) > 5 * mm).all()


def stop(commander) -> None:
    assert commander.coil("program_stop")[0] == 5


def hold(commander) -> None:
    assert commander.coil("program_hold")[0] == 5


def estop(commander) -> None:
    commander.rig.press_estop()


def leave(commander) -> None:
    commander.rig.peer_lost(commander.modbus)


@pytest.mark.parametrize("end", [stop, hold, estop, leave])
def test_what_stops_one_stops_all(moving, end):
    end(moving)
    after = run(moving, 60)
    assert program(moving) is not Program.RUN
    assert (np.ptp(after[1:], axis=0) == 0.0).all(), "no axis goes on by itself"
    assert after[-1].any() == (program(moving) is Program.HOLD)
    assert (np.ptp([moving.rig._controls["setpoint"] for _ in range(2)], axis=0) == 0.0).all()


#: What becomes of bench and program when a limit on one axis trips, by the limit's action.
ENDS = {
    "program hold": ("HOLD", Program.HOLD),
    "program stop": ("FAULT_HOLD", Program.STOPPED),
    "interlock": ("FAULT_DISABLED", Program.IDLE),
}


@pytest.mark.parametrize("action", ENDS)
@pytest.mark.parametrize(
    ("signal", "beyond"),
    [
        ("lateral.displacement", 6 * mm),
        ("platform.roll", 3 * mrad),
        ("vertical_left.displacement", 4 * mm),
    ],
)
def test_a_limit_on_one_axis_stops_all_on_one_tick(armed, parameters, action, signal, beyond):
    """On whichever axis, all stop together; state, reason and the limit's axis are reported."""
    at = f"{armed.read(signal) + beyond:.6f} {'rad' if signal.endswith('roll') else 'm'}"
    row = {"signal": signal, "kind": "upper", "at": at, "action": action}
    commander = type(armed)(Rig(parameters, seed=1, limits=limits_of([row])))
    commander.arm()
    commander.hold_height()
    commander.apply(lateral_control=CONTROL_MODES.index("displacement"))
    for wave in THREE:
        assert add(commander, **wave) == 5
    assert commander.coil("program_run")[0] == 5
    seen = []
    while program(commander) is Program.RUN:
        seen.append(run(commander, 1)[-1])
        assert len(seen) < 300
    assert (seen[-2] != 0.0).sum() >= 3, "several axes were on their way"
    state, ended = ENDS[action]
    after = run(commander, 40)
    assert (np.ptp(after[1:], axis=0) == 0.0).all(), "no axis goes on by itself"
    assert program(commander) is ended
    assert commander.state == state
    assert TABLE.tripped(commander.read("rig.tripped")).name == signal
    if state.startswith("FAULT"):
        assert REASONS[int(commander.read("rig.reason"))] == "limit tripped"


def test_after_a_stop_all_are_back_where_they_were(moving):
    stop(moving)
    run(moving, 60)
    assert moving.rig._controls["setpoint"][MOVED] == pytest.approx(moving.rig._controls["goal"][MOVED])
    assert not moving.rig._controls["slew"].any()


def test_a_held_program_goes_on_where_all_were(moving):
    before = run(moving, 1)[0]
    hold(moving)
    assert np.ptp(run(moving, 20), axis=0) == pytest.approx(0.0, abs=1e-12)
    assert moving.coil("program_run")[0] == 5
    step = abs(run(moving, 1)[0] - before)
    assert 0.0 < step.max() < 3 * mm


def test_each_is_bounded_and_so_is_what_they_make_together(placed):
    fast = {"amplitude": 60 * mm, "frequency": 1.5}  # 0.57 m/s at the peak; the rig follows 0.6
    assert add(placed, "vertical", **fast) == 5
    assert add(placed, "roll", roll_amplitude=50 * mrad, frequency=1.0) == 0x85
    assert add(placed, "lateral", amplitude=70 * mm, frequency=1.5) == 0x85
    assert add(placed, "lateral", **fast) == 5
    for _ in range(WAVES_AT_ONCE - 2):
        assert add(placed, "platform_vertical", amplitude=1 * mm) == 5
    assert add(placed, "platform_vertical", amplitude=1 * mm) == 0x85, "more than a program has"


@pytest.mark.parametrize("end", [stop, estop])
def test_what_was_added_is_forgotten(placed, end):
    add(placed, "lateral", amplitude=8 * mm)
    end(placed)
    if end is estop:
        assert not placed.rig.generator._added
        return
    add(placed, "platform_vertical", amplitude=3 * mm)
    placed.coil("program_run")
    offsets = run(placed, 120)
    assert not offsets[:, Target.LATERAL].any()
    assert abs(offsets[:, Target.PLATFORM_VERTICAL]).max() > 2 * mm


def test_a_roll_by_forces_is_up_on_one_side_and_down_on_the_other(armed):
    armed.apply(vertical_control=1.0)
    assert add(armed, "roll", force_amplitude=500.0, wave=WAVES.index("plateau")) == 5
    assert armed.coil("program_run")[0] == 5
    offsets = run(armed, 150)[-20:]
    assert offsets[:, Target.VERTICAL_LEFT] == pytest.approx(500.0)
    assert offsets[:, Target.VERTICAL_RIGHT] == pytest.approx(-500.0)
