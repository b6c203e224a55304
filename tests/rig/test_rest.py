"""The state after a command: at its end all returns to rest, and arming by the next client causes no motion."""

from collections.abc import Callable

import numpy as np
import pytest

from bench_protocol.rates import PACE
from bench_protocol.table import TABLE
from bench_protocol.units import bar, kN, mm
from bench_protocol.words import AIR_MODES, AXES, CONTROL_MODES, SIDES
from bench_sim.model.layout import Sensor
from tests.rig.conftest import Commander
from tests.rig.left_behind import differences, facts
from tests.rig.way_down import LOSSES, VERTICAL, lose_can

LEVEL, FILL = AIR_MODES.index("level"), AIR_MODES.index("fill")
FORCE, DISPLACEMENT = CONTROL_MODES.index("force"), CONTROL_MODES.index("displacement")


def both(what: str, **values: float) -> dict[str, float]:
    return {f"{what}_{side}_{name}": value for side in SIDES for name, value in values.items()}


def leave_much(commander: Commander) -> None:
    """Change as much as possible from the initial state of a rig."""
    commander.hold_height()
    commander.apply(
        lateral_control=DISPLACEMENT,
        air_dpv=0,
        generator_axis=AXES.index("platform_roll"),
        generator_wave=1,
        generator_roll_amplitude=0.01,
        generator_amplitude=7 * mm,
        generator_force_amplitude=3 * kN,
        generator_frequency=0.5,
        generator_cycles=20,
        **both("air", mode=FILL, target=2.2 * bar),
    )
    commander.apply(air_left_reservoir=0, air_right_reservoir=0)
    assert commander.coil("program_run")[0] == 5
    commander.cycle(40)
    commander.stage(generator_cycles=9)


def power_off(commander: Commander) -> None:
    assert commander.coil("power_off")[0] == 5


def take_mains(commander: Commander) -> None:
    commander.rig.set_mains(there=False)
    commander.wait(100)
    commander.rig.set_mains(there=True)


def return_the_lease(commander: Commander) -> None:
    assert commander.ask(b"\x06\0\0\0\0")[0] == 6


def lose_modbus(commander: Commander) -> None:
    commander.rig.peer_lost(commander.modbus)


def clear_enable(commander: Commander) -> None:
    commander.cycle(2, control_enable=0)


ENDS: dict[str, Callable[[Commander], None]] = {
    **LOSSES,
    **{act.__name__: act for act in (power_off, take_mains, return_the_lease, lose_modbus, clear_enable)},
}


@pytest.mark.parametrize("end", ENDS.values(), ids=ENDS)
def test_after_every_end_the_wires_show_a_fresh_rig(armed, make_rig, end: Callable) -> None:
    leave_much(armed)
    end(armed)
    armed.wait(700)
    for peer in (armed.peer, armed.modbus):
        armed.rig.peer_lost(peer)
    armed.wait(30_000)
    fresh = Commander(make_rig())
    fresh.wait(1_000)
    for commander, number in ((armed, 2), (fresh, 2)):
        successor = Commander(commander.rig, number)
        successor.rig.release_estop()
        successor.cycle(2, control_enable=1)
        if successor.state == "OFF":
            successor.coil("power_on")
            successor.cycle(30)
        elif successor.state != "DISABLED":
            successor.cycle(2, control_reset=1)
            successor.cycle(2, control_reset=0)
        successor.cycle(10)
        assert successor.state == "DISABLED"
    assert differences(facts(armed.rig), facts(fresh.rig)) == []


def heights(commander: Commander) -> np.ndarray:
    return np.array([commander.read(f"{side}.height") for side in SIDES])


def arm_as_a_stranger(commander: Commander) -> Commander:
    """Arm by the bits alone, as another client: to HOLD."""
    successor = Commander(commander.rig, 2)
    successor._rows = successor._encoder.rows(["Control"])
    successor.cycle(2, control_enable=1)
    successor.cycle(2, control_reset=1)
    successor.cycle(2, control_reset=0)
    successor.cycle(2, control_reset=1)
    assert successor.coil("air_high")[0] == 5
    successor.cycle(2, control_hold=1)
    assert successor.state == "HOLD"
    return successor


def test_arming_after_a_killed_leveling_causes_no_motion(armed) -> None:
    """It rose by 91 mm on what the dead one had in force."""
    armed.hold_height()
    armed.apply(**both("air", mode=FILL, target=2.21 * bar))
    armed.cycle(400)
    armed.apply(vertical_control=FORCE, **both("air", mode=LEVEL))
    armed.cycle(50, **{f"{name}_force_setpoint": 20 * kN for name in VERTICAL})
    assert armed.read("left.bellows_pressure") > 1 * bar
    lose_can(armed)
    armed.rig.peer_lost(armed.modbus)
    armed.wait(20_000)
    before = heights(armed)
    successor = arm_as_a_stranger(armed)
    successor.cycle(2, control_active=1)
    assert successor.state == "ACTIVE"
    for _ in range(20):
        successor.cycle(20)
        assert np.abs(heights(successor) - before).max() < 1 * mm
        assert successor.read("left.bellows_pressure") < 20e-3 * bar


def test_a_held_program_ends_with_its_commander(armed) -> None:
    """HOLD moved the bolster by 34 mm, and ACTIVE by 36 mm more."""
    armed.hold_height()
    up = armed.read("vertical_left.displacement") + 50 * mm
    for _ in range(100):
        armed.cycle(1, **{f"{name}_displacement_setpoint": up for name in VERTICAL})
    armed.apply(
        generator_axis=AXES.index("vertical"),
        generator_amplitude=40 * mm,
        generator_frequency=0.2,
        generator_cycles=20,
    )
    assert armed.coil("program_run")[0] == 5
    armed.cycle(320)
    armed.cycle(5, control_active=0)
    assert armed.state == "HOLD"
    lose_can(armed)
    armed.rig.peer_lost(armed.modbus)
    armed.wait(25_000)
    before = heights(armed)
    successor = arm_as_a_stranger(armed)
    assert np.abs(heights(successor) - before).max() < 1 * mm
    here = {f"{name}_displacement_setpoint": successor.read(f"{name}.displacement") for name in VERTICAL}
    successor._rows = armed._rows
    successor.cycle(50, **here, control_active=1)
    assert successor.state == "ACTIVE"
    assert np.abs(heights(successor) - before).max() < 1 * mm


def seize_aside(commander: Commander, fault: str, **values: str | float) -> float:
    """Command 40 mm to the blocked lateral actuator, by its reading; return its position."""
    commander.apply(lateral_control=DISPLACEMENT)
    commander.cycle(5, lateral_displacement_setpoint=0.0)
    commander.rig.faults.on(fault, values)
    commander.cycle(50, lateral_displacement_setpoint=0.0 if values.get("sensor") else 40 * mm)
    return float(commander.rig.plant.ideal()[Sensor.LATERAL_DISPLACEMENT])


def aside(commander: Commander, cycles: int) -> np.ndarray:
    """Return where the lateral actuator truly is, cycle by cycle."""
    places = []
    for _ in range(cycles):
        commander.cycle(1)
        places.append(commander.rig.plant.ideal()[Sensor.LATERAL_DISPLACEMENT])
    return np.array(places)


def test_a_released_actuator_does_not_jump_after_a_hold(armed) -> None:
    """It moved to its old set-point as fast as its valve allows, also in HOLD."""
    here = seize_aside(armed, "seized_actuator", actuator="lateral")
    armed.cycle(5, control_active=0)
    assert armed.state == "HOLD"
    armed.rig.faults.off("all")
    assert np.abs(aside(armed, 20) - here).max() < 1 * mm, "HOLD holds the present value"
    bits, every = armed._encoder.rows(["Control"]), armed._rows
    armed.values[TABLE.index["control.active"]] = 1.0
    armed._rows = bits
    assert np.abs(aside(armed, 20) - here).max() < 1 * mm
    assert armed.state == "ACTIVE"
    armed._rows = every
    way = np.diff(aside(armed, 20), prepend=here)
    assert way.sum() == pytest.approx(40 * mm, abs=2 * mm), "a new set-point is followed"
    assert way.max() < 1.3 * PACE["m"] * 0.02


@pytest.mark.parametrize("bias", ["40 mm", "-40 mm"])
def test_a_wrong_displacement_reading_causes_no_motion_at_hold_and_resume(armed, bias) -> None:
    here = seize_aside(armed, "bias", sensor="lateral.displacement", value=bias)
    armed._rows = armed._encoder.rows(["Control"])
    for active in (0.0, 1.0):
        armed.values[TABLE.index["control.active"]] = active
        assert np.abs(aside(armed, 20) - here).max() < 1 * mm
    assert armed.state == "ACTIVE"


def test_a_wave_that_is_held_goes_on_from_where_its_actuator_is(armed) -> None:
    armed.hold_height()
    armed.apply(
        lateral_control=DISPLACEMENT,
        generator_axis=AXES.index("lateral"),
        generator_amplitude=40 * mm,
        generator_frequency=0.2,
        generator_cycles=20,
    )
    armed.rig.faults.on("seized_actuator", {"actuator": "lateral"})
    assert armed.coil("program_run")[0] == 5
    armed.cycle(310)  # a quarter of its second turn
    armed.cycle(5, control_active=0)
    armed.rig.faults.off("all")
    here = armed.rig.plant.ideal()[Sensor.LATERAL_DISPLACEMENT]
    armed._rows = armed._encoder.rows(["Control"])
    armed.cycle(5, control_active=1)
    assert armed.coil("program_run")[0] == 5
    way = np.diff(aside(armed, 50), prepend=here)
    assert np.abs(way).max() < 2 * np.pi * 0.2 * 40 * mm * 0.02 + 0.5 * mm, "no faster than the wave"
