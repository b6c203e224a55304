"""The way down: wherever the bench is, whatever is lost, no limit breaks, and there is a way back over the wires."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, note, settings
from hypothesis import strategies as st

from bench_protocol.rates import FAST_RATE
from bench_protocol.table import TABLE
from bench_protocol.units import bar, kN, mm
from bench_protocol.words import AIR_MODES, AXES, CONTROL_MODES, SIDES, LimitKind
from bench_sim.rig.limits import LIMITS

#: What a reading may go past its limit by, or past where it stood when the loss came: what moves needs a way to stop.
ALLOWANCE = {"height": 8 * mm, "displacement": 8 * mm, "pressure": 0.1 * bar, "force": 8 * kN}
WAY_DOWN = 60_000  # ticks
SPANS = [limit for limit in LIMITS if limit.kind in (LimitKind.LOWER, LimitKind.UPPER)]
#: A commander who lets loaded actuators go throws the bolster by himself, past limits that need 20 ms to see it.
CALM = 100 * mm  # per second

VERTICAL = [f"vertical_{side}" for side in SIDES]


@pytest.fixture
def held_down(armed):
    """Springs at 1.56 bar, and actuators that hold the bolster down against them."""
    armed.hold_height()
    armed.apply(**{f"air_{side}_{what}": value for side in SIDES for what, value in FILLED.items()})
    armed.beat(1000)
    return armed


FILLED = {"mode": AIR_MODES.index("fill"), "target": 1.56 * bar}


def go_silent(commander) -> None:
    """The commander is there and says no more."""


def lose_can(commander) -> None:
    commander.rig.peer_lost(commander.peer)


def press_estop(commander) -> None:
    commander.rig.press_estop()


def cut_power(commander) -> None:
    commander.rig.cut_power()


def disable(commander) -> None:
    assert commander.coil("disable")[0] == 5


LOSSES = {act.__name__: act for act in (go_silent, lose_can, press_estop, cut_power, disable)}


def way_down(commander, ticks: int = WAY_DOWN) -> None:
    """Let time pass until the springs are empty and the actuators let go; every limit is kept meanwhile.

    It is broken by what lies outside for as long as the limit itself asks for.
    """
    start = {limit.signal: commander.read(limit.signal) for limit in SPANS}
    course: dict[str, list[float]] = {signal: [] for signal in start}
    for _ in range(ticks // 100):
        samples = commander.decoder.decode(commander.rig.run(100))
        for signal, readings in course.items():
            readings.extend(samples.values[samples.signals == TABLE.index[signal]].tolist())
        for limit in SPANS:
            readings = course[limit.signal]
            slack = ALLOWANCE[limit.signal.split(".")[1].split("_")[-1]]
            if limit.kind is LimitKind.LOWER:
                low = min(limit.at, start[limit.signal]) - slack
                outside = [not value >= low for value in readings]
            else:
                high = max(limit.at, start[limit.signal]) + slack
                outside = [not value <= high for value in readings]
            persistence = round(limit.persistence * FAST_RATE)
            broken = any(all(outside[k : k + persistence]) for k in range(len(outside) - persistence + 1))
            assert not broken, (limit.signal, readings)
        for readings in course.values():
            del readings[:-4]
        if is_safe(commander):
            return
    pytest.fail(f"after {ticks / 1000:g} s the bench is {told(commander)}")


def is_safe(commander) -> bool:
    pressure = [
        commander.read(f"{side}.{part}_pressure") for side in SIDES for part in ("bellows", "auxiliary")
    ]
    force = [commander.read(f"{name}.force") for name in (*VERTICAL, "lateral")]
    return max(pressure) < 0.1 * bar and np.abs(force).max() < 1 * kN


def speed(commander) -> list[float]:
    """How fast the heights and the lateral actuator move (m/s), seen over 5 ms."""
    names = (*(f"{side}.height" for side in SIDES), "lateral.displacement")
    commander.wait(5)
    before = [commander.read(name) for name in names]
    commander.wait(5)
    return [abs(commander.read(name) - old) / 0.005 for name, old in zip(names, before, strict=True)]


def told(commander) -> str:
    pressures = [f"{commander.read(f'{side}.bellows_pressure') / bar:.2f} bar" for side in SIDES]
    heights = [f"{commander.read(f'{side}.height') / mm:.0f} mm" for side in SIDES]
    forces = [f"{commander.read(f'{name}.force') / kN:.1f} kN" for name in VERTICAL]
    return f"{commander.state}, {', '.join((*heights, *pressures, *forces))}"


def way_back(commander) -> None:
    """Return to OFF by commands over the wires alone (and the hand that releases the stop button)."""
    commander.rig.release_estop()
    for _ in range(4):
        commander.beat(2, control_enable=1, control_hold=0, control_active=0, control_reset=0)
        if commander.state == "DISABLED":
            break
        if commander.state == "OFF":
            assert commander.coil("power_on")[0] == 5
            commander.beat(30)
        elif commander.state in ("FAULT_HOLD", "HOLD", "ACTIVE", "AIR_LOW", "AIR_HIGH"):
            commander.coil("disable")
        else:
            commander.beat(2, control_reset=1)
    assert commander.state == "DISABLED", told(commander)
    way_down(commander)
    assert commander.coil("power_off")[0] == 5
    commander.wait(20)
    assert commander.state == "OFF"


@pytest.mark.parametrize("lose", LOSSES.values(), ids=LOSSES)
def test_springs_that_were_held_down_do_not_throw_the_bolster_up(held_down, lose: Callable) -> None:
    before = held_down.read("left.height")
    assert held_down.read("vertical_left.force") > 30 * kN, "the case is one in which letting go would throw"
    lose(held_down)
    heights = []
    for _ in range(100):
        samples = held_down.decoder.decode(held_down.rig.run(100))
        heights += samples.values[samples.signals == TABLE.index["left.height"]].tolist()
    assert max(heights) - before < 10 * mm, "it was 172 mm when the actuators let go at once"
    assert np.abs(np.diff(heights)).max() / 0.005 < 80 * mm, "mm/s"
    assert is_safe(held_down), told(held_down)


@pytest.mark.parametrize("lose", LOSSES.values(), ids=LOSSES)
def test_there_is_a_way_back_over_the_wires(held_down, lose: Callable) -> None:
    lose(held_down)
    way_down(held_down)
    way_back(held_down)


def test_a_bolster_that_hangs_on_the_actuators_is_set_down(armed) -> None:
    armed.hold_height()
    up = armed.read("vertical_left.displacement") + 130 * mm
    for _ in range(100):
        armed.beat(1, **{f"{name}_displacement_setpoint": up for name in VERTICAL})
    armed.beat(50)
    lose_can(armed)
    armed.wait(600)
    heights = []
    for _ in range(60):
        armed.wait(100)
        heights.append(armed.read("left.height"))
    assert is_safe(armed), told(armed)
    assert -np.diff(heights).min() / 0.1 < 300 * mm, "mm/s: it sinks, and does not fall"


def test_a_standing_limit_lets_the_bench_come_back(held_down) -> None:
    """Past the height's limit in control of force: the trip holds and vents; reset and arming do not trip again."""
    force = CONTROL_MODES.index("force")
    held_down.beat(2, vertical_left_force_setpoint=38 * kN, vertical_right_force_setpoint=38 * kN)
    held_down.apply(vertical_control=force)
    letting_go = {f"{name}_force_setpoint": 0.0 for name in VERTICAL}
    assert any(held_down.beat(1, **letting_go) or held_down.state == "FAULT_DISABLED" for _ in range(100))
    assert TABLE["rig.reason"].choices[int(held_down.read("rig.reason"))] == "limit tripped"
    assert held_down.read("left.height") < 110 * mm, "the actuators caught it"
    held_down.beat(2, control_enable=1, control_hold=0, control_active=0, control_reset=0)
    held_down.beat(2, control_reset=1)
    assert held_down.state == "DISABLED"
    held_down.beat(2, control_reset=0)
    held_down.beat(2, control_reset=1)
    assert held_down.state == "AIR_LOW"
    assert held_down.read("left.height") > 90 * mm, "the limit is still standing"
    held_down.apply(
        **{f"air_{side}_mode": AIR_MODES.index("vent") for side in SIDES},
        air_left_target=0.0,
        air_right_target=0.0,
    )
    held_down.beat(1000)
    assert held_down.state == "AIR_LOW", "it vents, and does not trip"
    assert held_down.read("left.height") < 90 * mm
    assert held_down.read("rig.tripped") == 0


def test_the_bench_may_not_be_opened_while_it_holds_the_bolster(held_down) -> None:
    disable(held_down)
    held_down.wait(100)
    answer = held_down.stage(rig_nominal_preload=145 * kN)
    assert answer[0][0] == 0x10
    assert held_down.coil("apply")[0] & 0x80, "shims want free actuators"
    way_down(held_down)
    assert held_down.coil("apply")[0] == 5


def test_an_emergency_stop_during_a_fault_is_told(held_down) -> None:
    held_down.wait(150)
    assert held_down.read("emergency.code") == 0x8130
    press_estop(held_down)
    held_down.wait(10)
    assert held_down.read("emergency.code") == 0xFF02
    assert TABLE["rig.reason"].choices[int(held_down.read("rig.reason"))] == "emergency stop"


# --- stories: any commands, any loss --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Deed:
    """One thing that a commander does; its ``repr`` is a line of the story."""

    what: str
    values: tuple[tuple[str, float], ...] = ()
    beats: int = 1

    def __repr__(self) -> str:
        shown = ", ".join(f"{name} = {value:g}" for name, value in self.values)
        return f"{self.what} {shown} ({self.beats * 20} ms)".replace("  ", " ")

    def do(self, commander) -> None:
        match self.what:
            case "apply":
                for answer in commander.stage(**dict(self.values)):
                    assert answer[0] == 0x10
                commander.coil("apply")  # may be refused
            case "coil":
                commander.coil(self.values[0][0])
            case "steer":
                for name, value in self.values:
                    commander.values[ROWS[name]] = value
            case "pause":
                commander.wait(20 * self.beats)
                return
        commander.beat(self.beats)


ROWS = {signal.name.replace(".", "_"): row for row, signal in enumerate(TABLE.signals)}
BEATS = st.integers(1, 60)
PRESSURES = st.sampled_from([0.3 * bar, 1.56 * bar, 3.5 * bar, 5.5 * bar])
HEIGHTS = st.sampled_from([-60 * mm, -20 * mm, 0.0, 30 * mm, 60 * mm])
FORCES = st.sampled_from([0.0, 53.5 * kN, 145 * kN])
COILS = st.sampled_from(["program_run", "program_stop", "air_low", "air_high"])


def order(what: str, values: st.SearchStrategy[dict[str, float]], longer: int = 1) -> st.SearchStrategy[Deed]:
    return st.builds(lambda given, beats: Deed(what, tuple(given.items()), longer * beats), values, BEATS)


def deed(what: str, **values: st.SearchStrategy) -> st.SearchStrategy[Deed]:
    return order(what, st.fixed_dictionaries(values))


def both(what: str, **values: float) -> dict[str, float]:
    return {f"{what}_{side}_{name}": value for side in SIDES for name, value in values.items()}


def bits_of(given: dict[str, bool]) -> dict[str, float]:
    return {f"control_{bit}": float(on) for bit, on in given.items()}


DEEDS = st.one_of(
    *(
        deed("apply", **{f"air_{side}_mode": st.integers(0, 3), f"air_{side}_target": PRESSURES})
        for side in SIDES
    ),
    order(
        "apply", PRESSURES.map(lambda target: both("air", mode=AIR_MODES.index("fill"), target=target)), 10
    ),
    deed("apply", air_left_reservoir=st.integers(0, 1), air_right_reservoir=st.integers(0, 1)),
    deed("apply", air_dpv=st.integers(0, 1)),
    deed("apply", vertical_control=st.integers(0, 2)),
    deed("apply", lateral_control=st.integers(0, 2)),
    order("steer", HEIGHTS.map(lambda height: both("vertical", displacement_setpoint=height))),
    order("steer", FORCES.map(lambda force: both("vertical", force_setpoint=force))),
    deed("steer", lateral_displacement_setpoint=HEIGHTS),
    deed("steer", lateral_force_setpoint=st.sampled_from([-20 * kN, 0.0, 20 * kN])),
    deed("steer", vertical_left_force_setpoint=FORCES),
    deed("apply", generator_axis=st.integers(0, len(AXES) - 1), generator_amplitude=st.floats(0.0, 0.02)),
    order("coil", COILS.map(lambda name: {name: 1.0})),
    order("steer", st.fixed_dictionaries({"hold": st.booleans(), "active": st.booleans()}).map(bits_of)),
    st.integers(1, 12).map(lambda beats: Deed("pause", (), beats)),
)
STORIES = st.lists(DEEDS, max_size=8)


def live_through(make_rig, commander_of, story: list[Deed], loss: str) -> None:
    commander = commander_of(make_rig())
    commander.arm()
    commander.hold_height()
    for one in story:
        one.do(commander)
    assume(max(speed(commander)) < CALM)
    note(f"then {loss}, when the bench is {told(commander)}")
    LOSSES[loss](commander) if loss != "disable" else commander.coil("disable")
    way_down(commander)
    way_back(commander)


@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
@given(STORIES, st.sampled_from(sorted(LOSSES)))
def test_every_story_ends_well(make_rig, commander, story: list[Deed], loss: str) -> None:
    live_through(make_rig, type(commander), story, loss)


@pytest.mark.slow
@pytest.mark.timeout(900)
@settings(max_examples=1500, deadline=None, suppress_health_check=list(HealthCheck))
@given(STORIES, st.sampled_from(sorted(LOSSES)))
def test_many_stories_end_well(make_rig, commander, story: list[Deed], loss: str) -> None:
    live_through(make_rig, type(commander), story, loss)
