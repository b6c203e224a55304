"""Crosswind, track and roll at once: five axes move on one time base, sound springs pass, and spoilt ones do not."""

from pathlib import Path

import numpy as np
import pytest

from astb.rehearsal.rehearsing import rehearse
from astb.rig_file import RigFile, Simulation
from bench_protocol.dimensions import ordinary as ordinary_dimensions
from bench_protocol.units import Hz, mm, s
from bench_records.record import read as read_record
from bench_records.result import CheckVerdict, Outcome
from bench_sim.parameters import load
from test_plans.analysis.geometry import ACTUATORS
from test_plans.description import ours
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.instruments import ordinary
from test_plans.parameters import ParameterRefused
from test_plans.plans.crosswind_and_track import PUSHED, TRACK, excitation, foreseen_travel, roll_torque
from test_plans.specimen import ordinary as ordinary_specimen
from test_plans.steps.wind import CAR
from tests.foreign.plc_rig import BUILT
from tests.foreign.virtual import VirtualPlc
from tests.refusals import refuses

slow = pytest.mark.slow
EMPTY, FULL = "crosswind_and_track_aw0", "crosswind_and_track_aw3"
OURS = ours()


@pytest.mark.parametrize("kind", ["steady", "gust", "stochastic"])
@pytest.mark.parametrize("frequency", [0.5 * Hz, 0.77 * Hz, 2 * Hz])
def test_all_axes_begin_and_end_at_rest_together(kind, frequency):
    times, moves, (start, end) = excitation(OURS, 5.0, kind, 20 * mm, frequency, 1)
    assert set(moves) == {"lateral.force", *PUSHED, *TRACK}
    for name, way in moves.items():
        assert way.shape == times.shape, name
        assert way[0] == way[-1] == 0.0
    # Equation (24), by another route: whole cycles of a squared sine while the wind stands.
    z = 20 * mm * np.sin(np.pi * frequency * (times - start)) ** 2 * ((times > start) & (times < end))
    for axis in TRACK:
        np.testing.assert_allclose(moves[axis], z, atol=1e-9)
    assert (end - start) * frequency == pytest.approx(round((end - start) * frequency))
    standing = moves["lateral.force"][(times > start) & (times < end)]
    assert (standing > 0.5 * standing.max()).all() or kind != "steady"


def test_the_roll_torque_is_the_wind_s_moment_about_the_top_plates():
    """Of actuators that do what the wind wants: its force times the height at which it acts; nothing else rolls."""
    _, moves, _ = excitation(OURS, 5.0, "steady", 5 * mm, 1 * Hz, 1)
    still = np.zeros_like(moves["lateral.force"])
    values = {"left.height": still, "right.height": still, "platform.roll": still}
    values |= {name: moves[name] for name in ("lateral.force", *PUSHED)}
    np.testing.assert_allclose(
        roll_torque(values, OURS), -CAR.pressure_height * moves["lateral.force"], atol=1e-6
    )
    assert OURS[ACTUATORS[0]] > 0.0


def test_it_moves_wind_and_track_at_once_through_the_wires_and_judges(judged, tmp_path):
    result, failed = judged(EMPTY, instruments=ordinary())
    assert result.verdict is Outcome.PASS, result.reason or failed
    assert result.duration == pytest.approx(plans()[EMPTY].lasts, rel=0.1)
    record = read_record(tmp_path / EMPTY)
    phase = next(one for one in record.phases if one.name == "wind and track")
    moved = {}
    for name in (*TRACK, "lateral.force", *PUSHED):
        times, values = record.series(name)
        inside = (times > phase.start + 8 * s) & (times < phase.start + 12 * s)
        moved[name] = np.ptp(values[inside]), values[inside].mean() - values[times < phase.start][-20:].mean()
    assert all(moved[axis][0] == pytest.approx(20 * mm, rel=0.02) for axis in TRACK)
    assert moved["lateral.force"][1] > 2000.0
    assert moved[PUSHED[0]][1] == pytest.approx(-moved[PUSHED[1]][1], rel=0.1)


@slow
@pytest.mark.parametrize(
    ("name", "given", "seed"),
    [
        (FULL, {}, 0),
        (EMPTY, {"kind": "gust"}, 2),
        (FULL, {"kind": "stochastic", "draw": "7"}, 3),
        (EMPTY, {"roll": "10 mrad", "amplitude": "10 mm"}, 0),
        (FULL, {"roll": "-10 mrad"}, 1),
        (EMPTY, {"pressure": "0.85", "frequency": "1.5 Hz", "amplitude": "10 mm"}, 1),
        (FULL, {"pressure": "1.1", "wind": "8 m/s", "amplitude": "25 mm", "frequency": "1.5 Hz"}, 1),
        (EMPTY, {"wind": "8 m/s", "roll": "20 mrad"}, 2),
        (FULL, {"wind": "12 m/s", "roll": "20 mrad"}, 3),
    ],
)
def test_sound_springs_pass(judged, name, given, seed):
    result, failed = judged(name, seed, given=given)
    assert result.verdict is Outcome.PASS, result.reason or failed


def test_a_wind_that_shears_more_than_the_track_leaves_stiffness_unjudged(judged):
    """Friction that the wind loosens makes sound springs softer than the limits of a sine."""
    given = {"kind": "stochastic", "wind": "6.9 m/s", "amplitude": "14 mm", "frequency": "0.67 Hz"}
    result, failed = judged(EMPTY, given=given | {"roll": "9.6 mrad", "pressure": "1.09", "draw": "355031"})
    stiff = next(one for one in result.checks if one.name == "lateral stiffness K'")
    assert result.verdict is Outcome.INCOMPLETE, result.reason or failed
    assert stiff.verdict is CheckVerdict.NOT_AVAILABLE
    assert "times as far as the track; the limits hold up to 0.5" in stiff.note


@slow
@pytest.mark.parametrize(
    ("name", "broken", "expected"),
    [
        (EMPTY, {"shell_stiffness_lateral": 30e3}, {"lateral stiffness K'"}),
        (FULL, {"shell_stiffness_lateral": 15e3}, {"lateral stiffness K'"}),
        (EMPTY, {"effects": [("auxiliary_volume", "-35 %")]}, {"roll torque over roll"}),
    ],
)
def test_spoilt_springs_fail(judged, name, broken, expected):
    """The first two change the lateral stiffness by 9 and 12 %, many times its U of 1 %."""
    result, failed = judged(name, instruments=ordinary(), **broken)
    assert result.verdict is Outcome.FAIL, result.reason
    assert failed == expected
    stiff = next(one for one in result.checks if one.name == "lateral stiffness K'")
    assert stiff.expanded < 0.015 * stiff.number


@pytest.mark.parametrize("load", ["AW0", "AW3"])
@pytest.mark.parametrize("kind", ["steady", "gust", "stochastic"])
def test_the_wind_that_is_named_can_be_held_and_no_stronger_one(judged, load, kind):
    name = f"crosswind_and_track_{load.lower()}"
    result, _ = judged(name, given={"wind": "25 m/s", "kind": kind})
    assert result.verdict is Outcome.BLOCKED
    assert "wind = 25 m/s" in result.reason
    held = float(result.reason.partition("--set wind=")[2].partition("m/s")[0])
    values = plans()[name].given({"wind": f"{held} m/s", "kind": kind}).values
    within, beyond = (
        foreseen_travel(OURS, ordinary_specimen().load(load), values, wind) for wind in (held, held + 0.11)
    )
    assert within <= OURS["stop_gap"] < beyond


def test_crosswind_without_enough_wind_is_reported(judged):
    """The springs of the full car lean on the bump stop when the preload alone rolls them by 50 mrad."""
    result, _ = judged(FULL, given={"roll": "-50 mrad"})
    assert result.verdict is Outcome.BLOCKED
    assert "set a smaller amplitude, frequency or roll" in result.reason


@slow
@pytest.mark.parametrize("seed", range(8))
def test_the_travel_is_bounded_before_the_start(judged, seed):
    """Over the ranges of wind, track and roll: sound springs stay within the prediction, and within the gap."""
    name, load = [(EMPTY, "AW0"), (FULL, "AW3")][seed % 2]
    draw = np.random.default_rng(seed).uniform
    given = {
        "wind": f"{draw(3, 7):.2f} m/s",
        "kind": ["steady", "gust", "stochastic"][seed % 3],
        "amplitude": f"{draw(5, 25):.1f} mm",
        "frequency": f"{draw(0.5, 1.6):.2f} Hz",
        "roll": f"{draw(-5, 20):.1f} mrad",
    }
    result, _ = judged(name, seed, given=given)
    values = plans()[name].given(given).values
    foreseen = foreseen_travel(OURS, ordinary_specimen().load(load), values, values["wind"])
    if result.verdict is Outcome.BLOCKED:
        assert foreseen > OURS["stop_gap"]
        return
    travel = next(one for one in result.checks if one.name == "largest travel of the bolster")
    assert 0.55 * foreseen < travel.number <= foreseen


@slow
@pytest.mark.parametrize("by", ["host", "rig"])
def test_a_rig_that_speaks_otherwise_streams_it(tmp_path, by):
    """Rig A, by Modbus registers; built as ours, for limits of roll hold for that."""
    par = load("astb")
    with VirtualPlc(seed=1, **{one: par.entries[one].value for one in BUILT}).bench() as bench:
        bench.dimensions = ordinary_dimensions()
        result = execute(plans()[EMPTY].given({"by": by}), bench, tmp_path / "out", rig="plant_a")
    assert result.verdict is Outcome.PASS, result.reason


@slow
@pytest.mark.parametrize("name", [EMPTY, FULL])
def test_the_rig_s_generator_and_the_host_find_the_same(judged, name):
    """Wind and track as one program of the generator, at the rig's tick, and the same streamed by the host."""
    found = []
    for by in ("host", "rig"):
        result, failed = judged(name, given={"by": by})
        assert result.verdict is Outcome.PASS, result.reason or failed
        found.append({one.name: one.number for one in result.checks})
    host, rig = found
    assert rig["lateral stiffness K'"] == pytest.approx(host["lateral stiffness K'"], rel=0.01)
    assert rig["lateral damping c"] == pytest.approx(host["lateral damping c"], rel=0.03)
    assert rig["roll torque over roll"] == pytest.approx(host["roll torque over roll"], rel=0.02)


def test_a_gust_is_no_wave_of_a_generator(judged):
    result, _ = judged(EMPTY, given={"by": "rig", "kind": "gust"})
    assert result.verdict is Outcome.BLOCKED
    assert "the generator of the rig cannot play a gust wind; use by=host" in result.reason


@slow
@pytest.mark.parametrize("by", ["host", "rig"])
def test_the_rehearsal_foresees_all_axes(tmp_path, by):
    """The travel of platform and bolster is predicted before motion, and a limit on one of them refuses the run."""
    limit = {"signal": "platform.lateral", "kind": "upper", "at": "15 mm", "action": "interlock"}
    rig = RigFile("virtual", time="virtual", simulation=Simulation(limits=(limit,)))
    found, _ = rehearse(plans()[EMPTY].given({"by": by}), rig, Path("virtual.toml"), tmp_path)
    assert found.refusal is not None
    assert found.refusal.step.endswith("wind and track")


def test_a_refusal_lists_the_accepted_values():
    with refuses(ParameterRefused, "amplitude 40 mm 5 25 mm"):
        plans()[FULL].given({"amplitude": "40 mm"})
    with refuses(ParameterRefused, "parameter"):
        plans()[FULL].given({"load": "AW0"})
