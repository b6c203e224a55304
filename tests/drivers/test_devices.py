"""The verbs of axes, air and generator, on a scripted rig: their actions, waits and refusals."""

import numpy as np
import pytest

from bench_protocol.units import Hz, bar, kN, mbar, mm, mrad, ms, s
from drivers.errors import BenchTimeout, Misuse, RigFault
from tests.refusals import refuses

# -- moving ------------------------------------------------------------------------------------------------------


def test_preload_ramps_in_force_control(world, armed):
    armed.vertical.preload(53.5 * kN, 40 * kN, rate=20 * kN / s, tolerance=20.0)
    assert armed.vertical_left.force == pytest.approx(53.5 * kN, abs=20)
    assert armed.vertical_right.force == pytest.approx(40 * kN, abs=20)
    track = np.array([c.get("vertical_left.force_setpoint", 0.0) for _, _, c in world.peer.tracks])
    steps = np.diff(track[~np.isnan(track)])
    assert steps.max() <= 20 * kN * 0.020 + 10


@pytest.mark.parametrize("mode", ["displacement", "force"])
def test_changing_the_control_mode_makes_no_bump(world, armed, mode):
    other = "force" if mode == "displacement" else "displacement"
    armed.vertical.control = other
    measured = {"vertical_left": 31 * mm, "vertical_right": -22 * mm}
    if mode == "force":
        measured = {"vertical_left": 31 * kN, "vertical_right": 22 * kN}
    for actuator, value in measured.items():
        world.peer.values[f"{actuator}.{mode}"] = value
    applied = []
    apply = world.peer._act

    def watch(name):
        applied.append((len(world.peer.blocks), {k: v for k, v in world.peer.commands.items() if mode in k}))
        apply(name)

    world.peer._act = watch
    before = len(world.peer.blocks)
    armed.vertical.control = mode
    (blocks, commands), *_ = applied
    assert (
        blocks - before > 2 + 10
    )  # averaged over 10 cycles, then streamed for more than two before the change
    for actuator, value in measured.items():
        assert commands[f"{actuator}.{mode}_setpoint"] == pytest.approx(value)
        assert world.peer.values[f"{actuator}.{mode}"] == pytest.approx(value)


def test_holding_the_position(world, armed):
    world.peer.values["vertical_left.displacement"] = 12 * mm
    armed.vertical.hold_position()
    assert armed.vertical.control == "displacement"
    armed.wait(1 * s)
    assert armed.vertical_left.displacement == pytest.approx(12 * mm)


def test_moving_and_pushing_sideways(armed):
    armed.lateral.move_to(20 * mm, 40 * mm / s)
    assert armed.lateral.control == "displacement"
    assert armed.lateral.displacement == pytest.approx(20 * mm, abs=1 * mm)
    assert armed.lateral.displacement_setpoint == 20 * mm  # the ramp is over, not only near its end
    assert not armed.commander.moving()
    armed.lateral.push(-4 * kN, 8 * kN / s)
    assert armed.lateral.control == "force"
    assert armed.lateral.force == pytest.approx(-4 * kN, abs=0.5 * kN)
    armed.lateral.hold_position()
    assert armed.lateral.control == "displacement"


def test_moving_the_platform_leaves_other_axes_where_they_are(armed):
    armed.platform.move_to(vertical=10 * mm, roll=20 * mrad, rate=20 * mm / s, roll_rate=40 * mrad / s)
    armed.platform.move_to(lateral=-5 * mm)
    armed.wait(0.1)
    assert armed.platform.vertical == pytest.approx(10 * mm, abs=0.02 * mm)
    assert armed.platform.lateral == pytest.approx(-5 * mm, abs=0.02 * mm)
    assert armed.platform.roll == pytest.approx(20 * mrad, abs=0.02 * mrad)


def test_an_actuator_that_does_not_follow_is_a_time_out_with_values(world, armed):
    world.peer.sluggish = True
    with refuses(BenchTimeout, "lateral.force 4 kN lateral.force 0 kN"):
        armed.lateral.push(4 * kN, 8 * kN / s)


def test_a_force_beyond_the_wire_is_refused_before_anything_moves(world, armed):
    with refuses(ValueError, "lateral.force_setpoint 70 kN 60 kN"):
        armed.lateral.push(70 * kN)
    assert armed.lateral.force_setpoint == pytest.approx(0)
    with refuses(ValueError, "lateral.control 'speed'"):
        armed.lateral.control = "speed"


# -- air ---------------------------------------------------------------------------------------------------------


def test_filling_holding_and_venting(world, armed):
    armed.air.fill(to=2 * bar, within=5 * s)
    assert armed.left.bellows_pressure == pytest.approx(2 * bar, abs=0.06 * bar)
    assert armed.right.bellows_pressure == pytest.approx(2 * bar, abs=0.06 * bar)
    armed.air.hold()
    assert (armed.air.left_mode, armed.air.right_mode) == ("hold", "hold")
    armed.air.vent(within=5 * s)
    assert armed.left.bellows_pressure < 0.1 * bar
    armed.air.level()
    assert (armed.air.left_mode, armed.air.right_mode) == ("level", "level")


def test_air_orders_for_one_side_leave_the_other(world, armed):
    armed.air.fill(left=1 * bar, within=5 * s)
    assert armed.air.left_mode == "fill"
    assert armed.air.right_mode == "hold"
    assert armed.right.bellows_pressure == 0
    armed.air.vent(left=0.5 * bar, within=5 * s)
    assert armed.left.bellows_pressure == pytest.approx(0.5 * bar, abs=0.06 * bar)


def test_the_valves_between(world, armed):
    armed.air.isolate_dpv()
    armed.air.isolate_reservoirs()
    assert (armed.air.dpv, armed.air.left_reservoir, armed.air.right_reservoir) == ("off", "off", "off")
    armed.air.connect_dpv()
    armed.air.connect_reservoirs()
    assert (armed.air.dpv, armed.air.left_reservoir, armed.air.right_reservoir) == ("on", "on", "on")


def test_a_bellows_that_is_shut_off_is_neither_filled_nor_vented(world, armed):
    """All its air goes through the auxiliary chamber, whose pressure the rig controls."""
    armed.settings.write({"air.left_reservoir": "off"})
    for order in (armed.air.fill, armed.air.vent):
        with refuses(Misuse, "air.connect_reservoirs()"):
            order(to=1 * bar)
    assert armed.air.left_mode == "hold"
    armed.air.fill(right=1 * bar, within=5 * s)
    armed.air.connect_reservoirs()
    armed.air.fill(to=1 * bar, within=5 * s)


def test_filling_needs_one_clear_target(armed):
    with refuses(Misuse, "both"):
        armed.air.fill(to=2 * bar, left=1 * bar)
    with refuses(Misuse, "pressure"):
        armed.air.fill()
    with refuses(ValueError, "20 bar"):
        armed.air.fill(to=20 * bar)
    assert armed.air.left_mode == "hold"


def test_filling_too_slowly_is_a_time_out(armed):
    with refuses(BenchTimeout, "filled 5 1 s left.bellows_pressure 1"):
        armed.air.fill(to=5 * bar, within=1 * s)


@pytest.mark.parametrize(("starts", "within", "told"), [(0.5, 30, True), (8.0, 30, True), (8.0, 20, False)])
def test_a_settled_pressure_differs_from_a_falling_one(world, armed, starts, within, told):
    values, step = world.peer.values, world.peer._step

    def never_below_half_a_bar():
        step()
        for chamber in ("bellows", "auxiliary"):
            values[f"left.{chamber}_pressure"] = max(values["left.bellows_pressure"], 0.5 * bar)

    world.peer._step = never_below_half_a_bar
    values["left.bellows_pressure"] = starts * bar
    armed.wait(100 * ms)
    with refuses(BenchTimeout, "vented 0") as late:
        armed.air.vent(within=within * s)
    since = within - (starts - 0.5)  # it falls by 1 bar/s
    words = f"left.bellows_pressure has not fallen for {since:.0f} s; check the zero of its transducer"
    assert (words in str(late.value)) == told
    assert str(late.value).count("has not fallen") == told


def test_a_large_offset_does_not_disturb_the_estimate_of_the_next_chamber(world, armed):
    values, step = world.peer.values, world.peer._step
    values["left.bellows_pressure"] = 2.0 * bar

    def half_a_bar_too_much():
        values["left.bellows_pressure"] -= 0.5 * bar
        step()
        values["left.auxiliary_pressure"] = values["left.bellows_pressure"]
        values["left.bellows_pressure"] += 0.5 * bar

    world.peer._step = half_a_bar_too_much
    armed.wait(100 * ms)
    start = armed.now
    armed.air.vent(within=40 * s)
    assert values["left.auxiliary_pressure"] < 60 * mbar
    assert armed.now - start > 20 * s, "not before it has long stopped falling"


# -- generator ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("frequency", "cycles"), [(1 * Hz, 5), (30 * Hz, 1), (0.5 * Hz, 1)])
def test_a_run_of_the_generator_waits_for_its_end(world, armed, frequency, cycles):
    armed.vertical.control = "displacement"
    before = armed.now
    armed.generator.run("vertical", amplitude=5 * mm, frequency=frequency, cycles=cycles)
    assert armed.now - before == pytest.approx(max(cycles / frequency, 0.08), abs=0.05)
    assert world.peer.settings["generator.amplitude"] == pytest.approx(5 * mm)
    armed.generator.run("vertical", amplitude=6 * mm, frequency=frequency, cycles=cycles)  # and again
    assert armed.rig.generator_cycle == cycles


def test_a_program_that_ends_early_is_a_fault_of_the_rig(world, armed):
    armed.vertical.control = "displacement"
    armed.generator.start("vertical", amplitude=5 * mm, frequency=1 * Hz, cycles=5)
    armed.wait(1.5 * s)
    armed.generator.stop()
    with refuses(RigFault, "after 1 5"):
        armed.generator.wait_done(within=1 * s)


def test_a_program_that_never_ends_is_a_time_out(world, armed):
    armed.vertical.control = "displacement"
    armed.generator.start("vertical", amplitude=5 * mm, frequency=1 * Hz, cycles=100)
    with refuses(BenchTimeout, "RUN"):
        armed.generator.wait_done(within=2 * s)


@pytest.mark.parametrize(
    ("axis", "control", "amplitudes", "words"),
    [
        ("vertical", "force", {"amplitude": 5 * mm}, "amplitude"),
        ("vertical", "displacement", {}, "needs"),
        ("vertical", "displacement", {"amplitude": 1 * mm, "force_amplitude": 1 * kN}, "given"),
        ("roll", "force", {"roll_amplitude": 1 * mrad}, "roll_amplitude"),
        ("platform_roll", "force", {"amplitude": 1 * mm}, "roll_amplitude"),
        ("vertical", "off", {"amplitude": 1 * mm}, "'off'"),
    ],
)
def test_the_generator_wants_the_amplitude_that_fits_the_axis(world, armed, axis, control, amplitudes, words):
    armed.vertical.control = control
    count = len(world.peer.actions)
    with refuses(Misuse, words):
        armed.generator.run(axis, frequency=1 * Hz, cycles=3, **amplitudes)
    assert len(world.peer.actions) == count
