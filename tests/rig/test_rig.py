"""The rig by its bytes: arming, air, actuators, generator, limits, stop button, determinism."""

import numpy as np
import pytest

from bench_protocol.table import TABLE
from bench_protocol.table_signals import MEASUREMENTS
from bench_protocol.units import Hz, bar, kN, mm
from bench_protocol.words import AIR_MODES, AXES, WAVES
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.layout import State as PlantState
from bench_sim.parameters.effects import with_effects
from bench_sim.rig.rig import Rig

VENT, FILL, LEVEL = AIR_MODES.index("vent"), AIR_MODES.index("fill"), AIR_MODES.index("level")


def test_no_step_of_arming_can_be_skipped(commander) -> None:
    commander.wait(500)
    assert commander.state == "DISABLED"
    assert commander.coil("air_high") == b"\x85\x04"
    assert commander.coil("reset") == b"\x85\x04", "without a commander the air stays shut"
    commander.cycle(2, control_enable=1, control_hold=1, control_active=1)
    assert commander.state == "DISABLED", "H and M without reset and air"
    commander.cycle(2, control_reset=1)
    assert commander.state == "AIR_LOW"
    commander.cycle(5)
    assert commander.state == "AIR_LOW", "levels are no edges"


def test_clearing_the_bits_steps_down(armed) -> None:
    armed.cycle(2, control_active=0)
    assert armed.state == "HOLD"
    armed.cycle(2, control_hold=0)
    assert armed.state == "AIR_HIGH"
    armed.cycle(2, control_enable=0)
    assert armed.state == "DISABLED"


def test_filling_stops_at_the_target_and_venting_empties(armed) -> None:
    armed.hold_height()
    armed.apply(air_left_mode=FILL, air_left_target=2 * bar, air_right_mode=FILL, air_right_target=2 * bar)
    armed.cycle(600)
    assert armed.read("left.auxiliary_pressure") == pytest.approx(2 * bar, abs=0.05 * bar)
    armed.apply(air_left_mode=VENT, air_right_mode=VENT, air_left_target=0, air_right_target=0)
    armed.cycle(3000)
    assert armed.read("left.auxiliary_pressure") < 0.15 * bar


def test_leveling_lifts_the_empty_bolster_to_its_dead_band(armed) -> None:
    armed.apply(air_left_mode=LEVEL, air_right_mode=LEVEL)
    armed.cycle(1250)
    for side in ("left", "right"):
        assert abs(armed.read(f"{side}.height")) < 14 * mm


def test_air_low_restricts_and_disabled_shuts(commander) -> None:
    commander.wait(500)
    commander.cycle(2, control_enable=1)
    commander.cycle(2, control_reset=1)
    commander.apply(
        air_left_mode=FILL, air_left_target=5 * bar, air_right_mode=FILL, air_right_target=5 * bar
    )
    start = commander.read("left.auxiliary_pressure")
    commander.cycle(5)
    slow = commander.read("left.auxiliary_pressure") - start
    commander.coil("air_high")
    before = commander.read("left.auxiliary_pressure")
    commander.cycle(5)
    fast = commander.read("left.auxiliary_pressure") - before
    assert fast > 3 * slow > 0
    commander.coil("disable")
    commander.cycle(500)  # the bolster comes to rest on what air there is
    shut = commander.read("left.auxiliary_pressure")
    commander.cycle(50)
    assert commander.read("left.auxiliary_pressure") == pytest.approx(shut, abs=0.05 * bar)


def test_force_set_points_are_followed(armed) -> None:
    armed.cycle(1, lateral_force_setpoint=2 * kN)
    armed.cycle(50)
    assert armed.read("lateral.force") == pytest.approx(2 * kN, abs=0.1 * kN)


def test_a_change_of_control_mode_makes_no_bump(armed) -> None:
    armed.cycle(100, lateral_force_setpoint=1 * kN)
    before = armed.read("lateral.displacement")
    armed.apply(lateral_control=2)
    armed.wait(20)
    # The commander still streams 0 mm and 1 kN; without a new set-point nothing may have moved.
    assert armed.read("lateral.displacement") == pytest.approx(before, abs=0.5 * mm)
    assert armed.read("lateral.force") == pytest.approx(1 * kN, abs=0.3 * kN)


def run_program(commander, **settings: float) -> np.ndarray:
    commander.apply(**settings)
    assert commander.coil("program_run")[0] == 5
    trace = []
    for _ in range(5000):
        commander.cycle(1)
        trace.append(commander.read("platform.vertical"))
        if commander.read("rig.program") == 0 and len(trace) > 3:
            break
    return np.array(trace)


def test_unilateral_cosine_rises_to_its_amplitude_and_comes_back(armed) -> None:
    trace = run_program(
        armed,
        generator_axis=AXES.index("platform_vertical"),
        generator_wave=WAVES.index("unilateral_cosine"),
        generator_amplitude=5 * mm,
        generator_frequency=1.2 * Hz,
        generator_cycles=3,
    )
    assert trace.max() == pytest.approx(5 * mm, abs=0.2 * mm)
    assert trace.min() > -0.3 * mm
    armed.cycle(20)
    assert armed.read("platform.vertical") == pytest.approx(0, abs=0.2 * mm)
    assert armed.read("rig.generator_cycle") == 3


def test_a_program_needs_active_and_a_control_mode(commander, armed) -> None:
    armed.apply(lateral_control=0, generator_axis=AXES.index("lateral"))
    assert armed.coil("program_run") == b"\x85\x04", "the actuator is off"
    armed.apply(generator_axis=AXES.index("platform_vertical"))
    armed.cycle(2, control_active=0)
    assert armed.coil("program_run") == b"\x85\x04", "not ACTIVE"


def test_pausing_freezes_the_program_and_running_goes_on(armed) -> None:
    armed.apply(
        generator_axis=AXES.index("platform_vertical"),
        generator_amplitude=0.01,
        generator_frequency=0.5,
        generator_cycles=5,
    )
    armed.coil("program_run")
    armed.cycle(80)
    armed.cycle(10, control_active=0)
    assert armed.read("rig.program") == 2
    frozen = armed.read("platform.vertical")
    armed.cycle(20)
    assert armed.read("platform.vertical") == pytest.approx(frozen, abs=0.3 * mm)
    armed.cycle(2, control_active=1)
    armed.coil("program_run")
    armed.cycle(60)
    assert armed.read("rig.program") == 1


def test_the_stop_button_vents_and_software_cannot_reset_it(armed) -> None:
    armed.hold_height()
    armed.apply(air_left_mode=FILL, air_left_target=3 * bar, air_right_mode=FILL, air_right_target=3 * bar)
    armed.cycle(300)
    before = armed.read("left.auxiliary_pressure")
    armed.rig.press_estop()
    armed.cycle(100)
    assert armed.state == "ESTOP"
    assert armed.read("left.auxiliary_pressure") < 0.7 * before
    assert armed.read("emergency.code") == 0xFF02
    armed.cycle(2, control_reset=1)
    assert armed.coil("reset") == b"\x85\x04"
    assert armed.state == "ESTOP"
    armed.rig.release_estop()
    armed.cycle(2)
    assert armed.state == "ESTOP", "releasing the button starts nothing"
    armed.cycle(2, control_reset=0)
    armed.cycle(2, control_reset=1)
    assert armed.state == "DISABLED"


def test_the_stop_button_empties_a_bellows_that_is_shut_off(armed) -> None:
    """Its air can leave through the auxiliary chamber alone."""
    armed.hold_height()
    armed.apply(air_left_mode=FILL, air_left_target=1 * bar)
    armed.cycle(1000)
    armed.apply(air_left_reservoir=0)
    assert armed.read("left.bellows_pressure") > 0.8 * bar
    armed.rig.press_estop()
    armed.wait(20_000)
    assert armed.read("left.bellows_pressure") < 0.1 * bar, (
        "shut off, it keeps 0.2 bar under the free bolster"
    )


def test_a_limit_holds_and_the_first_one_is_named(armed) -> None:
    armed.cycle(50, lateral_force_setpoint=50 * kN)
    assert armed.state == "FAULT_HOLD"
    assert TABLE.tripped(armed.read("rig.tripped")) is TABLE["lateral.force"]
    assert armed.read("rig.tripped") == 11, "as ever"
    armed.wait(100)
    assert TABLE["rig.tripped_kind"].choices[int(armed.read("rig.tripped_kind"))] == "upper"
    assert 47 * kN < armed.read("rig.tripped_value") * TABLE["lateral.force"].step < 51 * kN
    assert 0 < armed.read("rig.tick") - armed.read("rig.tripped_tick") < 1100
    assert TABLE["rig.reason"].choices[int(armed.read("rig.reason"))] == "limit tripped"


def test_power_can_be_switched_off_and_on(commander) -> None:
    commander.wait(500)
    assert commander.coil("power_off")[0] == 5
    commander.wait(100)
    assert commander.state == "OFF"
    assert commander.coil("power_on")[0] == 5
    commander.wait(500)
    assert commander.state == "DISABLED"


def test_the_shims_move_the_zero_and_not_the_bellows(commander) -> None:
    commander.wait(500)
    height, pressure = commander.read("left.height"), commander.read("left.bellows_pressure")
    commander.apply(rig_nominal_preload=145 * kN)
    commander.wait(1000)
    # Emergency spring of 6 MN/m: 91.5 kN of difference are 15.25 mm.
    assert commander.read("left.height") - height == pytest.approx(15.25 * mm, abs=0.3 * mm)
    assert commander.read("left.bellows_pressure") == pytest.approx(pressure, abs=0.01 * bar)


def test_the_shims_stay_while_the_actuators_hold(armed) -> None:
    armed.stage(rig_nominal_preload=145 * kN)
    assert armed.coil("apply") == b"\x85\x04"


def fill_at_once(commander, pressure: float) -> None:
    """Fill both springs with the bolster held, and wait until bellows and auxiliary chambers agree."""
    commander.hold_height()
    commander.apply(
        air_left_mode=FILL, air_left_target=pressure, air_right_mode=FILL, air_right_target=pressure
    )
    commander.cycle(600)


def swing(commander, **settings: float) -> tuple[float, float]:
    """Amplitudes of bellows and auxiliary pressure (left) while the platform shakes at 7 Hz."""
    commander.apply(
        generator_axis=AXES.index("platform_vertical"),
        generator_wave=WAVES.index("sine"),
        generator_amplitude=1 * mm,
        generator_frequency=7 * Hz,
        generator_cycles=60,
        **settings,
    )
    assert commander.coil("program_run")[0] == 5
    commander.cycle(200)
    rows = []
    for _ in range(100):
        commander.cycle(1)
        rows.append([commander.read("left.bellows_pressure"), commander.read("left.auxiliary_pressure")])
    bellows, auxiliary = np.std(rows, axis=0) * np.sqrt(2)
    return bellows, auxiliary


def test_plates_and_pipes_that_were_changed_by_hand_show_in_the_pressures(make_rig, commander) -> None:
    """Only the inertia of a pipe makes the auxiliary chamber swing further than the bellows."""
    found = {}
    for pipe in (0, 1):
        bench = type(commander)(make_rig())
        bench.wait(500)
        bench.apply(rig_orifice_diameter=40 * mm, rig_pipe=pipe)
        bench.arm()
        fill_at_once(bench, 2 * bar)
        found[pipe] = swing(bench)
    assert found[0][1] < found[0][0]
    assert found[1][1] > 1.5 * found[1][0]


def test_a_wider_plate_lets_the_bellows_empty_faster(make_rig, commander) -> None:
    left = []
    for diameter in (6 * mm, 20 * mm):
        bench = type(commander)(make_rig())
        bench.wait(500)
        bench.apply(rig_orifice_diameter=diameter)
        bench.arm()
        fill_at_once(bench, 3 * bar)
        bench.apply(air_left_mode=VENT, air_right_mode=VENT, air_left_target=0, air_right_target=0)
        bench.cycle(50)
        left.append(bench.read("left.bellows_pressure"))
    assert left[0] > left[1] + 0.5 * bar


CHANGES = [{"rig_orifice_diameter": 16 * mm}, {"rig_pipe": 1}]


@pytest.mark.parametrize("change", CHANGES, ids=str)
def test_plates_and_pipes_stay_while_the_actuators_hold(armed, change) -> None:
    armed.stage(**change)
    assert armed.coil("apply") == b"\x85\x04"
    armed.cycle(2, control_hold=0, control_active=0)
    assert armed.state == "AIR_HIGH"
    assert armed.coil("apply")[0] == 5, "empty and disengaged"


@pytest.mark.parametrize("change", CHANGES, ids=str)
def test_plates_and_pipes_stay_while_there_is_pressure(armed, change) -> None:
    """All or nothing: other staged values are not applied either, and are removed with them."""
    parameters = armed.rig.plant.parameters
    fill_at_once(armed, 1 * bar)
    armed.cycle(2, control_enable=0, control_hold=0, control_active=0)
    armed.coil("disable")
    armed.wait(500)
    before = parameters.tobytes()
    armed.stage(**change, rig_nominal_preload=145 * kN)
    assert armed.state == "DISABLED"
    assert armed.coil("apply") == b"\x85\x04"
    assert parameters.tobytes() == before
    armed.cycle(1000)  # DISABLED vents, and what this commander has staged stays while it commands
    assert armed.read("left.bellows_pressure") < 0.3 * bar
    assert armed.coil("apply")[0] == 5
    assert parameters.tobytes() != before
    assert (parameters.nominal_preload == 145 * kN).all()


@pytest.mark.parametrize("chamber", ["BELLOWS", "AUXILIARY"])
@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("sign", [-1, 1])
def test_the_pressure_of_every_chamber_counts_and_no_sensor_is_asked(
    make_rig, commander, chamber, side, sign
):
    bench = type(commander)(make_rig(sensor_gain=0.4))
    bench.wait(500)
    state, mass = bench.rig.plant.state, PlantState[f"{chamber}_MASS"] + side
    for pressure, code in ((0.35, 0x85), (0.25, 0x05)):
        kept = state.copy()
        state[[mass, mass + 2]] *= 1 + sign * pressure * bar / 101325
        bench.stage(rig_pipe=code == 0x05)
        bench.stage(rig_orifice_diameter=14 * mm)
        assert bench.coil("apply")[0] == code
        state[:] = kept


def test_a_plate_that_was_bored_wrong_stays_in_until_it_is_changed(make_rig, commander) -> None:
    """The setting equals the order; 13 mm as a single on the wire are the default plate."""
    bench = type(commander)(make_rig(orifice_diameter=[13 * mm, 14.5 * mm], pipe_length=[0, 2.0]))
    par = bench.rig.plant.parameters
    bench.arm()
    bench.apply(rig_orifice_diameter=13 * mm, rig_pipe=0)
    assert par.orifice_diameter.tolist() == [13 * mm, 14.5 * mm]
    assert par.pipe_length.tolist() == [0, 2.0]
    bench.cycle(2, control_hold=0, control_active=0)
    bench.apply(rig_orifice_diameter=16 * mm)
    assert par.orifice_diameter == pytest.approx([16 * mm, 16 * mm], rel=1e-12)
    assert par.pipe_length.tolist() == [0, 2.0]
    bench.apply(rig_pipe=1)
    assert par.pipe_length.tolist() == [1.5, 1.5]
    bench.apply(rig_orifice_diameter=13 * mm, rig_pipe=0)
    assert par.orifice_diameter == pytest.approx([13 * mm, 13 * mm], rel=1e-12)
    assert par.pipe_length.tolist() == [0, 0]


def test_same_seed_same_bytes_other_seed_other_bytes(make_rig) -> None:
    def bytes_of(seed: int, batch: int) -> bytes:
        rig = make_rig(seed)
        return b"".join(rig.run(batch).tobytes() for _ in range(2000 // batch))

    assert bytes_of(3, 2000) == bytes_of(3, 1) == bytes_of(3, 40)
    assert bytes_of(3, 2000) != bytes_of(4, 2000)


def test_rates_and_time_stamps_are_those_of_the_table(make_rig) -> None:
    block = make_rig().run(1000)
    for message in TABLE.messages:
        mine = block[block["id"] == message.identifier]
        if message.from_rig and message.rate:
            assert mine.size == message.rate
            assert set(np.diff(mine["time"])) == {round(1e9 / message.rate)}
        else:
            assert mine.size == 0
    assert (np.diff(block["time"]) >= 0).all()


def test_a_rig_with_all_effects_at_once_runs_and_reads_numbers(parameters, commander) -> None:
    given = {
        f"{effect.name}.{place}" if place else effect.name: {effect.amplitude.name: effect.amplitude.typical}
        for effect in CATALOGUE.values()
        for place in effect.places or ("",)
    }
    everything = type(commander)(Rig(with_effects(parameters, given), seed=1))
    everything.arm()
    everything.cycle(50)
    assert everything.state == "ACTIVE"
    assert np.all(np.isfinite(everything.rig.values[[TABLE.index[row.name] for row in MEASUREMENTS]]))
