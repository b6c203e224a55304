"""The player streams what the rig's own generator would do: the generator is the oracle, sample by sample."""

import math

import numpy as np
import pytest

from bench_protocol.dimensions import ordinary
from bench_protocol.rates import TICK
from bench_protocol.table import TABLE
from bench_protocol.units import kN, mm, mrad
from bench_protocol.words import AXES, CONTROL_MODES, PROGRAM_STATES, WAVES
from bench_sim.rig.car import Couplings
from bench_sim.rig.controls import CONTROLS, Target
from bench_sim.rig.generator import FunctionGenerator
from bench_sim.rig.tick import _generate
from drivers.errors import NotAvailable, Refused
from drivers.wiring.lines import PlayerLimits
from drivers.wiring.player import Player
from tests.refusals import refuses

CYCLE = 20_000_000
TICKS = round(CYCLE / 1e9 / TICK)
LEVER = 1.2
COUPLINGS = Couplings({name: one.value for name, one in ordinary().known.items()})
SETTINGS = {
    "generator.amplitude": 12 * mm,
    "generator.roll_amplitude": 8 * mrad,
    "generator.force_amplitude": 3 * kN,
    "generator.frequency": 0.83,
    "generator.cycles": 3.0,
    "generator.delay": 0.0,
}
MODES = {name: CONTROL_MODES.index(name) for name in CONTROL_MODES}


def _player(**settings: float) -> Player:
    limits = PlayerLimits(LEVER, 0.6, 0.2, 50 * kN)
    player = Player("hall", TABLE, limits, {"lateral.force_setpoint": "no force control"})
    player.write(SETTINGS | settings)
    return player


def _rows(axis: str, mode: str) -> dict[int, int]:
    """Return the target of the rig by the table row of its set-point."""
    targets = {"vertical": (0, 1), "roll": (0, 1)}.get(axis) or (Target[axis.upper()],)
    names = [Target(target).name.lower() for target in targets]
    if axis.startswith("platform"):
        names = [f"{name.replace('_', '.', 1)}_setpoint" for name in names]
    else:
        names = [f"{name}.{mode}_setpoint" for name in names]
    return {TABLE.index[name]: int(target) for name, target in zip(names, targets, strict=True)}


def _run(player: Player, mode: str, base: float = 0.0) -> None:
    setpoints = np.full(len(TABLE.signals), base)
    player.run(dict.fromkeys(("vertical.control", "lateral.control"), MODES[mode]), setpoints, active=True)


@pytest.mark.parametrize("wave", WAVES)
@pytest.mark.parametrize(
    ("axis", "mode"),
    [("vertical", "displacement"), ("vertical", "force"), ("roll", "displacement"), ("roll", "force"),
     ("lateral", "displacement"),
     ("platform_vertical", "off"), ("platform_lateral", "force"), ("platform_roll", "off")],
)  # fmt: skip
def test_every_sample_is_that_of_the_rigs_generator(axis, mode, wave):
    settings = SETTINGS | {"generator.axis": AXES.index(axis), "generator.wave": WAVES.index(wave)}
    controls = np.zeros(1, CONTROLS)
    controls["control"] = MODES[mode]
    rig = FunctionGenerator(controls[0], settings, LEVER, COUPLINGS)
    player = _player(**{name: settings[name] for name in ("generator.axis", "generator.wave")})
    assert rig.run()
    _run(player, mode)
    rows = _rows(axis, mode)
    ended = False
    for cycle in range(1 + math.ceil(3.0 / 0.83 * 50) + 5):
        offsets = player.advance(cycle * CYCLE, active=True)
        assert {row: offsets.get(row, 0.0) for row in rows} == pytest.approx(
            {row: float(controls["offset"][0, target]) for row, target in rows.items()}, rel=1e-9, abs=1e-9
        )
        assert set(offsets) <= set(rows)
        told = player.state()
        assert told["rig.program"] == controls["program"][0]
        assert told["rig.generator_cycle"] == math.floor(controls["phase"][0, 0])
        ended = PROGRAM_STATES[int(told["rig.program"])] == "IDLE"
        for _ in range(TICKS):
            _generate(controls[0])
    assert ended
    assert told["rig.generator_cycle"] == 3


def test_a_held_program_stays_where_it_is_and_goes_on():
    player = _player()
    _run(player, "displacement")
    for cycle in range(30):
        before = player.advance(cycle * CYCLE, active=True)
    player.hold()
    assert player.advance(100 * CYCLE, active=True) == before
    assert PROGRAM_STATES[int(player.state()["rig.program"])] == "HOLD"
    _run(player, "displacement")
    assert player.advance(101 * CYCLE, active=True) == before
    assert player.advance(102 * CYCLE, active=True) != before


def test_no_wave_jumps_over_a_stall():
    """Cycles of 250 ms come too late, all at once: the wave goes on from where it was, by two cycles at the most."""
    stalled, sound = _player(), _player()
    for player in (stalled, sound):
        _run(player, "displacement")
        for cycle in range(40):
            player.advance(cycle * CYCLE, active=True)
    late = stalled.advance(52 * CYCLE, active=True)
    assert late == sound.advance(41 * CYCLE, active=True)
    stalled.stop()
    sound.stop()
    assert stalled.advance(80 * CYCLE, active=True) == sound.advance(42 * CYCLE, active=True)


def test_a_stopped_program_comes_back_within_a_second():
    player = _player()
    _run(player, "displacement")
    for cycle in range(46):
        last = player.advance(cycle * CYCLE, active=True)
    player.stop()
    assert PROGRAM_STATES[int(player.state()["rig.program"])] == "STOPPED"
    way = [player.advance((46 + k) * CYCLE, active=True) for k in range(52)]
    row = min(last)
    assert abs(last[row]) > 1 * mm
    assert [offset.get(row, 0.0) for offset in way[:51]] == pytest.approx(np.linspace(last[row], 0.0, 51))
    assert way[51] == {}


def test_a_bench_that_is_not_active_any_more_has_no_program():
    player = _player()
    _run(player, "displacement")
    player.advance(0, active=True)
    player.advance(CYCLE, active=True)
    assert player.advance(2 * CYCLE, active=False) == {}
    assert not player.busy
    assert PROGRAM_STATES[int(player.state()["rig.program"])] == "STOPPED"


@pytest.mark.parametrize(
    ("settings", "mode", "message"),
    [
        ({}, "off", "vertical cannot make this motion: vertical.control is off"),
        ({"generator.axis": 1}, "off", "roll cannot make this motion: vertical.control is off"),
        ({"generator.amplitude": 90 * mm, "generator.frequency": 2}, "displacement",
         "displacement_setpoint would reach 1.13 m/s in this sine, but [player]"),
        ({"generator.frequency": 12, "generator.amplitude": 0}, "displacement", "12 Hz is too fast for 50"),
        ({"generator.force_amplitude": 9 * kN}, "force", "186 kN to 204 kN, beyond its range -200 to 200 kN"),
    ],
)  # fmt: skip
def test_what_a_generator_refuses(settings, mode, message):
    with pytest.raises(Refused) as told:
        _run(_player(**settings), mode, base=195 * kN if mode == "force" and len(settings) == 1 else 0.0)
    assert message in str(told.value)


def test_states_without_an_action():
    player = _player()
    for act in (player.hold, player.stop):
        with refuses(Refused, "program"):
            act()
    with refuses(Refused, "ACTIVE"):
        player.run({}, np.zeros(len(TABLE.signals)), active=False)
    with refuses(Refused, "value"):
        _run(player, "displacement", base=math.nan)
    with refuses(NotAvailable, "lateral.force_setpoint"):
        _run(_player(**{"generator.axis": AXES.index("lateral")}), "force")
    _run(player, "displacement")
    with refuses(Refused):
        _run(player, "displacement")


def test_a_program_that_is_stopped_while_the_last_one_comes_back_does_not_jump():
    player = _player()
    _run(player, "displacement")
    for cycle in range(46):
        offset = player.advance(cycle * CYCLE, active=True)
    player.stop()
    way = [offset, *(player.advance((46 + k) * CYCLE, active=True) for k in range(5))]
    _run(player, "displacement")
    way += [player.advance((51 + k) * CYCLE, active=True) for k in range(3)]
    player.stop()
    way += [player.advance((54 + k) * CYCLE, active=True) for k in range(60)]
    row = min(offset)
    assert abs(offset[row]) > 5 * mm
    steps = np.abs(np.diff([one.get(row, 0.0) for one in way]))
    assert steps.max() < 2 * mm  # of 12 mm at 0.83 Hz there are 1.25 mm in a cycle
    assert way[-1] == {}


def test_waves_of_a_program_are_those_of_the_rigs_generator_at_once():
    """Four waves of three forms on five set-points, each after its delay; two of them move the same actuators."""
    waves = [
        {"axis": AXES.index("vertical"), "amplitude": 4 * mm, "frequency": 1.2, "cycles": 3.0, "delay": 0.5},
        {"axis": AXES.index("roll"), "wave": WAVES.index("plateau"), "frequency": 0.9, "delay": 0.1},
        {"axis": AXES.index("lateral"), "wave": WAVES.index("unilateral_cosine"), "cycles": 2.0},
        {"axis": AXES.index("platform_lateral"), "frequency": 2.0, "cycles": 9.0, "delay": 1.0},
    ]
    controls = np.zeros(1, CONTROLS)
    controls["control"] = MODES["displacement"]
    settings = SETTINGS | {"generator.axis": 0.0, "generator.wave": 0.0}
    rig, player = FunctionGenerator(controls[0], settings, LEVER, COUPLINGS), _player()
    setpoints = np.zeros(len(TABLE.signals))
    modes = dict.fromkeys(("vertical.control", "lateral.control"), MODES["displacement"])
    for wave in waves:
        now = SETTINGS | {"generator.axis": 0.0, "generator.wave": 0.0}
        now |= {f"generator.{name}": value for name, value in wave.items()}
        settings.update(now)
        player.write(now)
        assert rig.add()
        player.add(modes, setpoints, active=True)
    assert rig.run()
    player.run(modes, setpoints, active=True)
    names = ("vertical_left", "vertical_right", "lateral")
    names = (*(f"{name}.displacement_setpoint" for name in names), "platform.vertical_setpoint",
             "platform.lateral_setpoint", "platform.roll_setpoint")  # fmt: skip
    seen = np.zeros(len(names))
    for cycle in range(1 + math.ceil(5.5 * 50) + 3):
        offsets = player.advance(cycle * CYCLE, active=True)
        asked = [offsets.get(TABLE.index[name], 0.0) for name in names]
        assert asked == pytest.approx(controls["offset"][0].tolist(), rel=1e-9, abs=1e-9)
        seen = np.maximum(seen, np.abs(asked))
        told = player.state()
        assert told["rig.program"] == controls["program"][0]
        for _ in range(TICKS):
            _generate(controls[0])
    assert (seen[[0, 1, 2, 4]] > 3 * mm).all()
    assert seen[[3, 5]].tolist() == [0.0, 0.0]
    assert seen[0] > 8 * mrad * LEVER + 1 * mm  # both waves together
    assert PROGRAM_STATES[int(told["rig.program"])] == "IDLE"
    assert told["rig.generator_cycle"] == 9


def test_waves_that_are_too_fast_together_are_refused_and_the_first_stays():
    player = _player(**{"generator.amplitude": 45 * mm, "generator.frequency": 1.5})
    setpoints, modes = np.zeros(len(TABLE.signals)), {"vertical.control": MODES["displacement"]}
    player.add(modes, setpoints, active=True)
    with refuses(Refused, "0.848 m/s these"):
        player.add(modes, setpoints, active=True)
    with refuses(Refused, "ACTIVE"):
        player.add(modes, setpoints, active=False)
    player.stop()
    with refuses(Refused, "program"):
        player.stop()
