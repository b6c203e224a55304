"""The way down: whatever is lost, no limit breaks, and there is a way back over the wires."""

from collections.abc import Callable

import numpy as np
import pytest

from bench_protocol.table import TABLE
from bench_protocol.units import bar, kN, mm
from bench_protocol.words import AIR_MODES, CONTROL_MODES, SIDES
from bench_sim.rig.limit_table import limits_of
from bench_sim.rig.rig import Rig
from tests.rig.way_down import (
    LOSSES,
    VERTICAL,
    disable,
    is_safe,
    lose_can,
    press_estop,
    summary,
    way_back,
    way_down,
)


@pytest.fixture
def held_down(armed):
    """Springs at 1.56 bar, and actuators that hold the bolster down against them."""
    return holding_down(armed)


def holding_down(armed):
    armed.hold_height()
    armed.apply(**{f"air_{side}_{what}": value for side in SIDES for what, value in FILLED.items()})
    armed.cycle(1000)
    return armed


FILLED = {"mode": AIR_MODES.index("fill"), "target": 1.56 * bar}


@pytest.mark.parametrize("lose", LOSSES.values(), ids=LOSSES)
def test_springs_that_were_held_down_do_not_throw_the_bolster_up(held_down, lose: Callable) -> None:
    before = held_down.read("left.height")
    assert held_down.read("vertical_left.force") > 30 * kN, "the case is one in which letting go would throw"
    lose(held_down)
    heights = []
    for _ in range(100):
        samples = held_down.decoder.decode(held_down.rig.run(100))
        heights += samples.values[samples.signals == TABLE.index["left.height"]].tolist()
    assert max(heights) - before < 10 * mm, "it was 172 mm when the actuators released at once"
    assert np.abs(np.diff(heights)).max() / 0.005 < 80 * mm, "mm/s"
    assert is_safe(held_down), summary(held_down)


@pytest.mark.parametrize("lose", LOSSES.values(), ids=LOSSES)
def test_there_is_a_way_back_over_the_wires(held_down, lose: Callable) -> None:
    lose(held_down)
    way_down(held_down)
    way_back(held_down)


def test_a_bolster_that_hangs_on_the_actuators_is_set_down(armed) -> None:
    armed.hold_height()
    up = armed.read("vertical_left.displacement") + 130 * mm
    for _ in range(100):
        armed.cycle(1, **{f"{name}_displacement_setpoint": up for name in VERTICAL})
    armed.cycle(50)
    lose_can(armed)
    armed.wait(600)
    heights = []
    for _ in range(60):
        armed.wait(100)
        heights.append(armed.read("left.height"))
    assert is_safe(armed), summary(armed)
    assert -np.diff(heights).min() / 0.1 < 300 * mm, "mm/s: it sinks, and does not fall"


def test_a_side_without_a_force_reading_is_set_down_with_the_other(armed) -> None:
    """It was released when the other side was down: it fell by 46 mm and threw the bolster 25 mm aside."""
    armed.hold_height()
    up = armed.read("vertical_left.displacement") + 110 * mm
    for _ in range(100):
        armed.cycle(1, **{f"{name}_displacement_setpoint": up for name in VERTICAL})
    armed.cycle(50)
    armed.rig.faults.on("broken_wire", {"sensor": "vertical_right.force", "reads": "nothing"})
    lose_can(armed)
    armed.wait(600)
    heights = []
    for _ in range(60):
        armed.wait(100)
        heights.append([armed.read(f"{side}.height") for side in SIDES])
    assert heights[0][0] > 40 * mm > 0 > heights[-1][0], "it was up, and is down"
    assert np.abs(np.diff(heights, axis=1)).max() < 10 * mm, "it stays level"
    assert -np.diff(heights, axis=0).min() / 0.1 < 300 * mm, "mm/s: it sinks, and does not fall"


@pytest.mark.parametrize("force", [-10 * kN, -20 * kN, -60 * kN])
@pytest.mark.parametrize("cycles", [32, 45, 200])
def test_a_bolster_that_is_lifted_by_force_is_caught_at_its_limit(armed, force, cycles) -> None:
    """Pulled up with hardly a load it is fast: the limit looks ahead, or it would go 14 mm past its 90 mm."""
    armed.cycle(2, **{f"{name}_force_setpoint": force for name in VERTICAL})
    armed.apply(vertical_control=CONTROL_MODES.index("force"))
    for _ in range(cycles):
        armed.cycle(1)
        if armed.state == "FAULT_DISABLED":
            break
    LOSSES["go_silent"](armed)
    heights = []
    for _ in range(40):
        samples = armed.decoder.decode(armed.rig.run(50))
        heights += samples.values[samples.signals == TABLE.index["left.height"]].tolist()
    assert armed.state in ("FAULT_HOLD", "FAULT_DISABLED")
    assert max(heights) < 92 * mm
    way_down(armed)
    way_back(armed)


def test_a_standing_limit_lets_the_bench_come_back(parameters, commander) -> None:
    """Past the height's limit in control of force: the trip holds and vents; reset and arming do not trip again."""
    # One that looks ahead is hardly ever passed.
    late = [{"signal": f"{side}.height", "kind": "upper", "lead": "0 ms"} for side in SIDES]
    held_down = type(commander)(Rig(parameters, seed=1, limits=limits_of(late)))
    held_down.arm()
    holding_down(held_down)
    force = CONTROL_MODES.index("force")
    held_down.cycle(2, vertical_left_force_setpoint=38 * kN, vertical_right_force_setpoint=38 * kN)
    held_down.apply(vertical_control=force)
    letting_go = {f"{name}_force_setpoint": 0.0 for name in VERTICAL}
    assert any(held_down.cycle(1, **letting_go) or held_down.state == "FAULT_DISABLED" for _ in range(100))
    assert TABLE["rig.reason"].choices[int(held_down.read("rig.reason"))] == "limit tripped"
    assert held_down.read("left.height") < 110 * mm, "the actuators caught it"
    held_down.cycle(2, control_enable=1, control_hold=0, control_active=0, control_reset=0)
    held_down.cycle(2, control_reset=1)
    assert held_down.state == "DISABLED"
    held_down.cycle(2, control_reset=0)
    held_down.cycle(2, control_reset=1)
    assert held_down.state == "AIR_LOW"
    assert held_down.read("left.height") > 90 * mm, "the limit is still standing"
    held_down.apply(
        **{f"air_{side}_mode": AIR_MODES.index("vent") for side in SIDES},
        air_left_target=0.0,
        air_right_target=0.0,
    )
    held_down.cycle(1000)
    assert held_down.state == "AIR_LOW", "it vents, and does not trip"
    assert held_down.read("left.height") < 90 * mm
    assert held_down.read("rig.tripped") == 0


def test_the_bench_may_not_be_opened_while_it_holds_the_bolster(held_down) -> None:
    disable(held_down)
    held_down.wait(100)
    answer = held_down.stage(rig_nominal_preload=145 * kN)
    assert answer[0][0] == 0x10
    assert held_down.coil("apply")[0] & 0x80, "shims want free actuators"
    # Staged values stay while its commander commands: it waits, and is not silent.
    assert any(held_down.cycle(25) or is_safe(held_down) for _ in range(120)), summary(held_down)
    assert held_down.state == "DISABLED"
    assert held_down.coil("apply")[0] == 5
    assert (held_down.rig.plant.parameters.nominal_preload == 145 * kN).all()


def test_an_emergency_stop_during_a_fault_is_reported(held_down) -> None:
    held_down.wait(150)
    assert held_down.read("emergency.code") == 0x8130
    press_estop(held_down)
    held_down.wait(10)
    assert held_down.read("emergency.code") == 0xFF02
    assert TABLE["rig.reason"].choices[int(held_down.read("rig.reason"))] == "emergency stop"


def test_a_bolster_that_hangs_on_one_side_is_not_pressed_down_on_the_other(armed) -> None:
    """The one that stood already went down with the other, at 40 mm/s, and pressed its spring with 198 kN."""
    armed.hold_height()
    up = armed.read("vertical_left.displacement") + 110 * mm
    armed.cycle(60, vertical_left_displacement_setpoint=up)
    lose_can(armed)
    pressed = []
    for _ in range(80):
        armed.wait(50)
        pressed.append(armed.read("vertical_right.force"))
    assert is_safe(armed), summary(armed)
    assert max(pressed) < 20 * kN
