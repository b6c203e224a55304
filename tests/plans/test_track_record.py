"""A measured track: clear messages for an invalid one, and the platform follows the file."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from astb.rehearsal.rehearsing import rehearse
from astb.rig_file import RigFile, Simulation
from bench_protocol.units import m, mm, mrad, s
from bench_records.record import read as read_record
from bench_records.result import CheckVerdict, Outcome, read_result
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.instruments import ordinary
from test_plans.parameters import ParameterRefused
from test_plans.plans.track_record import DRAWN, WAVES, WAYS, drawn, excitation
from test_plans.steps.wind import RISE, side_force
from test_plans.track_file import BASE, NoTrack, TrackRecord, read_track
from tests.foreign.virtual import VirtualPlc, VirtualYard
from tests.refusals import refuses

slow = pytest.mark.slow
HEAD = "distance [m],vertical [mm],lateral [mm],cant [mm],gauge [mm]"
STEP = 0.25 * m


def waves(x):
    """Vertical (m), lateral (m) and cant (m) of a line at places (m)."""
    return (
        2 * mm * np.sin(2 * np.pi * x / 23.0) + 1 * mm * np.sin(2 * np.pi * x / 11.0),
        1.5 * mm * np.sin(2 * np.pi * x / 17.0 + 1.0),
        4 * mm * np.sin(2 * np.pi * x / 31.0),
    )


@pytest.fixture
def line(tmp_path):
    """A file of 900 m of a line that is known at every place."""
    x = STEP * np.arange(3600)
    table = np.column_stack([x, *(1e3 * way for way in waves(x)), np.full_like(x, 1435.0)])
    path = tmp_path / "line.csv"
    np.savetxt(path, table, "%.6f", ",", header=HEAD, comments="")
    return path


def written(tmp_path, text, name="track.csv"):
    path = tmp_path / name
    path.write_text(text)
    return path


def rows(count=10, head=HEAD, at=lambda k: f"{k * STEP},{k % 3},1,2,1435"):
    return "\n".join([head, *(at(k) for k in range(count)), ""])


def test_a_file_is_read_in_its_units_whatever_program_wrote_it(tmp_path):
    english = read_track(written(tmp_path, rows()))
    german_head = "Distance (m);Vertical (mm);Lateral (mm);Cant (mm)"
    german = rows(10, german_head, lambda k: f"{k * STEP:.2f};{k % 3},0;1,0;2,0".replace(".", ","))
    si_head = "distance [km],vertical [m],lateral [m],cant [m]"
    si = rows(10, si_head, lambda k: f"{k * STEP / 1e3:.5f},{k % 3 / 1e3},0.001,0.002")
    for name, text in {"german.csv": german, "si.csv": si}.items():
        other = read_track(written(tmp_path, text, name))
        np.testing.assert_allclose(other.places, english.places)
        for way, values in english.ways.items():
            np.testing.assert_allclose(other.ways[way], values, err_msg=way)
    assert english.unread == ("gauge",)
    np.testing.assert_allclose(english.ways["platform.roll"], np.arctan(2 * mm / BASE))


def test_columns_of_parquet_and_a_record_by_time(tmp_path):
    import pandas as pd

    t = 0.01 * np.arange(50)
    path = tmp_path / "track.parquet"
    pd.DataFrame({"time [s]": t, "vertical [mm]": t, "roll [mrad]": 2 * t}).to_parquet(path)
    track = read_track(path)
    assert track.timed
    np.testing.assert_allclose(track.times(99.0), t)
    np.testing.assert_allclose(track.ways["platform.roll"], 2 * t * mrad)


@pytest.mark.parametrize(
    ("spoilt", "words"),
    [
        (
            ("vertical [mm]", "vertical"),
            'vertical has no unit; use a head such as "vertical [mm]"',
        ),
        (("vertical [mm]", "vertical [kN]"), "vertical has the unit 'kN'"),
        (("distance [m]", "chainage [m]"), "neither of the columns distance and time"),
        (("gauge [mm]", "time [s]"), "both of the columns distance and time"),
        (("gauge [mm]", "roll [mrad]"), "cant and roll, which state the same"),
        (("0.75,0,", "0.75,,"), "vertical has no number in line 5; fill the gap"),
        (("0.75,0,", "0.75,up,"), '"up" in line 5 is not a number'),
        (("0.75,0,", "0.25,0,"), "distance falls from 0.5 to 0.25 m in line 5; it must rise"),
        (("0.75,0,", "0.5,0,"), "distance stands still at 0.5 m in line 5"),
        (
            ("2.25,0,", "12.25,0,"),
            "distance jumps by 10.25 m in line 11, where rows are mostly 0.25 m apart: a gap",
        ),
    ],
)
def test_an_invalid_track_is_reported_with_line_value_and_fix(tmp_path, spoilt, words):
    text = rows()
    assert spoilt[0] in text
    with pytest.raises(NoTrack) as told:
        read_track(written(tmp_path, text.replace(*spoilt, 1)))
    assert words in str(told.value)
    assert "track.csv" in str(told.value)


def test_few_rows_and_no_ways_are_no_track(tmp_path):
    with refuses(NoTrack, "7 8 more"):
        read_track(written(tmp_path, rows(7)))
    with refuses(NoTrack, "vertical"):
        read_track(written(tmp_path, rows(9, "distance [m],gauge [mm]", lambda k: f"{k},1435")))


@given(data=st.data())
def test_resampled_is_the_mean_of_the_straight_lines_over_each_step(data):
    """Of any rows at any spacing, under any speed; the oracle sums the same lines finely."""
    count = data.draw(st.integers(8, 30))
    gaps = data.draw(st.lists(st.floats(0.1, 1.0), min_size=count - 1, max_size=count - 1))
    heights = data.draw(st.lists(st.floats(-5.0, 5.0), min_size=count, max_size=count))
    speed = data.draw(st.floats(1.0, 60.0))
    places = 7.0 + np.concatenate([[0.0], np.cumsum(gaps)])
    track = TrackRecord("drawn", places, {"platform.vertical": np.array(heights)})
    when = track.times(speed)
    step = when[-1] / 12
    times = step * np.arange(1, 12)  # each mean lies within the record
    fine = (np.arange(400) + 0.5) / 400 - 0.5
    means = np.array([np.interp(t + step * fine, when, heights).mean() for t in times])
    found = track.at(times, speed)["platform.vertical"]
    np.testing.assert_allclose(found, means - means.mean(), atol=2e-2)
    assert abs(found.mean()) < 1e-12


def test_a_wave_that_is_shorter_than_two_steps_becomes_no_longer_one():
    """0.21 m at 20 m/s are 95 Hz: sampled every 20 ms they would look like 4.8 Hz."""
    places = 0.02 * np.arange(4000)
    track = TrackRecord("short", places, {"platform.vertical": 1 * mm * np.sin(2 * np.pi * places / 0.21)})
    times = 0.02 * np.arange(1, 190)
    assert np.abs(track.at(times, 20.0)["platform.vertical"]).max() < 0.2 * mm


def test_all_axes_begin_and_end_at_rest_together(line):
    times, moves = excitation(read_track(line), 20.0, 30.0, 4.0)
    assert set(moves) == {*WAYS, "lateral.force"}
    assert times[-1] == pytest.approx(30.0 + 2 * RISE)
    middle = (times > RISE) & (times < times[-1] - RISE)
    for name, way in moves.items():
        assert way[0] == way[-1] == 0.0, name
    np.testing.assert_allclose(moves["lateral.force"][middle], side_force(4.0, 20.0))
    # 20 ms at 20 m/s are 0.4 m of a wave of 11 m: 0.2 % less in the mean over a step.
    vertical = waves(20.0 * times)[0]
    np.testing.assert_allclose(moves[WAYS[0]][middle], (vertical - vertical.mean())[middle], atol=0.02 * mm)


def test_the_track_that_stands_for_a_file_has_the_waves_of_its_spectrum():
    track = drawn()
    density = np.abs(np.fft.rfft(track.ways[WAYS[0]])) ** 2
    waves_per_m = np.fft.rfftfreq(track.places.size, 0.5)
    outside = (waves_per_m < 0.99 / WAVES[1]) | (waves_per_m > 1.01 / WAVES[0])
    assert density[outside].sum() < 1e-9 * density.sum()
    assert 1 * mm < track.ways[WAYS[0]].std() < 4 * mm
    np.testing.assert_array_equal(track.ways[WAYS[1]], drawn().ways[WAYS[1]])


def test_a_file_that_is_none_is_refused_before_anything_begins(tmp_path):
    with pytest.raises(
        ParameterRefused, match=f"track = .*none.csv is not a file; use {DRAWN}, or a file: a table"
    ):
        plans()["track_record"].given({"track": str(tmp_path / "none.csv")})


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (
            {"speed": "90 m/s"},
            "lasts 9.997 s at 324 km/h, of which 8 s are needed to begin and end; use a duration of at most 1.997 s",
        ),
        ({"track": "high.csv"}, "platform.vertical_setpoint would be"),
        ({"track": "steep.csv"}, "platform.vertical_setpoint would move with"),
        ({"track": "gap.csv"}, "a gap; cut the file there"),
    ],
)
def test_what_the_platform_cannot_do_is_refused_before_anything_moves(judged, line, given, words):
    long = range(2000)
    wave = {
        "high.csv": "\n".join([HEAD, *(f"{k},{400 * np.sin(k / 60):.3f},0,0,1435" for k in long)]),
        "steep.csv": "\n".join([HEAD, *(f"{k},{60 * np.sin(k):.3f},0,0,1435" for k in long)]),
        "gap.csv": "\n".join([HEAD, *(f"{k + 50 * (k > 900)},0,0,0,1435" for k in long)]),
    }
    for name, text in wave.items():
        written(line.parent, text, name)
    asked = {"track": str(line), "speed": "20 m/s"} | given
    if "track" in given:
        asked["track"] = str(line.parent / given["track"])
    result, _ = judged("track_record", given=asked)
    assert result.verdict is Outcome.BLOCKED
    assert words in result.reason
    assert result.duration < 1 * s


def test_a_wind_that_reaches_the_bump_stop_is_refused(judged):
    result, _ = judged("track_record", given={"speed": "300 km/h", "wind": "4 m/s"})
    assert result.verdict is Outcome.BLOCKED
    assert "mm, and it has 25 mm to its bump stop; set a smaller wind or speed" in result.reason
    assert result.duration < 1 * s


def test_the_platform_runs_the_file_through_the_wires(judged, line, tmp_path):
    """What the rig's record has of its platform is what the file has, at one and the same delay of all three ways."""
    asked = {"track": str(line), "speed": "20 m/s", "duration": "20 s", "wind": "4 m/s"}
    result, failed = judged("track_record", given=asked, instruments=ordinary())
    assert result.verdict is Outcome.PASS, result.reason or failed
    record = read_record(tmp_path / "track_record")
    phase = next(one for one in record.phases if one.name == "track")
    begin = phase.start + 2 * s
    lates = []
    for way, name in enumerate(WAYS):
        times, values = record.series(name)
        inside = (times > begin + RISE + 1 * s) & (times < begin + RISE + 19 * s)
        at, seen = times[inside] - begin, values[inside]
        seen = seen - seen.mean()

        def of_the_file(late, way=way, at=at):
            asked = waves(20.0 * (at - late))[way] / (BASE if way == 2 else 1.0)
            return asked - asked.mean()

        delays = np.arange(0.0, 0.2, 1e-3)
        late = min(delays, key=lambda one: np.std(seen - of_the_file(one)))
        lates.append(late)
        assert np.std(seen - of_the_file(late)) < 0.04 * np.std(seen), name
        assert seen.std() == pytest.approx(of_the_file(late).std(), rel=0.02), name
    assert np.ptp(lates) < 5e-3
    times, force = record.series("lateral.force")
    windy = (times > begin + RISE + 1 * s) & (times < begin + RISE + 19 * s)
    calm = (times > phase.start) & (times < begin)
    blown = force[windy].mean() - force[calm].mean()
    assert blown == pytest.approx(side_force(4.0, 20.0), rel=0.02)


def tables(result, way):
    """The tables of amplitude control of one way, by name; frequencies as ``at``."""
    found = [one for one in result.curves if one.group.startswith(f"Amplitude control: platform {way}")]
    return {one.name: np.array(one.ys) for one in found} | {"at": np.array(found[0].xs)}


def within_one_percent(result):
    for way in ("vertical", "lateral"):
        of = tables(result, way)
        np.testing.assert_allclose(of["reached"], of["wanted"], rtol=0.01, err_msg=way)
        assert np.abs(of["phase"]).max() <= 0.01, way
        assert of["repetitions"].max() <= 3
    assert not [told for told in result.warnings if told.startswith("track")]


@slow
def test_amplitude_control_sends_the_closed_form_of_the_platform_and_that_by_hand(
    judged, bench_composed, tmp_path
):
    """Octave by octave within 1 %: the inverse of the pulse transfer function, and wanted² over reached of a plain run.

    Straight lines between set-points, the second order of the platform and the lag of its transducer, read at the
    interval h of the set-points: H(f) = Σ sinc²(νh) G(ν) L(ν), ν = f + k/h.
    """
    own, damping, step = 15.0, 0.7, 0.02
    plan = plans()["track_record"].given({"duration": "60 s"})
    results = {}
    for control in (False, True):
        with bench_composed(platform_frequency=own) as made:
            made.bench.amplitude_control = control
            results[control] = execute(plan, made.bench, tmp_path / str(control), rig="virtual", seed=0)
    result = results[True]
    within_one_percent(result)
    record = read_record(tmp_path / "False")
    phase = next(one for one in record.phases if one.name == "track")
    times, moves = excitation(drawn(), 100 / 3.6, 60.0, 0.0)
    lines = np.fft.rfftfreq(times.size, step)
    nu = lines + np.arange(-20, 21)[:, None] / step
    ratio = nu / own
    images = np.sinc(nu * step) ** 2 / (1 - ratio**2 + 2j * damping * ratio) / (1 + 2j * np.pi * nu * 1e-3)
    closed = np.abs(images.sum(axis=0))
    for way in ("vertical", "lateral"):
        of, track = tables(result, way), np.abs(np.fft.rfft(moves[f"platform.{way}"]))
        at, values = record.series(f"platform.{way}")
        seen = values[np.searchsorted(at, phase.start + 2 * s) :][: times.size]
        reached = np.abs(np.fft.rfft(seen - seen[0]))
        for k, middle in enumerate(of["at"]):
            octave = (lines >= middle / np.sqrt(2)) & (lines <= middle * np.sqrt(2))
            power = np.sum(track[octave] ** 2)
            more = of["commanded"][k] / of["wanted"][k]
            assert more == pytest.approx(np.sqrt(np.sum((track / closed)[octave] ** 2) / power), rel=0.01)
            assert more == pytest.approx(np.sqrt(power / np.sum(reached[octave] ** 2)), rel=0.01)
        assert more > 1.1, "the platform is too good for this test"


@slow
@pytest.mark.parametrize(("made", "speed"), [(VirtualPlc, "50 km/h"), (VirtualYard, "100 km/h")])
def test_described_rigs_reach_the_amplitude_of_a_track(made, speed, tmp_path):
    plan = plans()["track_record"].given({"speed": speed})
    with made(seed=1).bench() as bench:
        bench.amplitude_control = True
        result = execute(plan, bench, tmp_path / "out", rig=made.name, seed=1)
    within_one_percent(result)
    assert tables(result, "lateral")["repetitions"].max() >= 1


@slow
def test_a_rehearsal_repeats_a_track_under_amplitude_control(tmp_path):
    plan = plans()["track_record"].given({"duration": "60 s"})
    rig = RigFile(name="virtual", time="virtual", amplitude_control=True, simulation=Simulation())
    found, directory = rehearse(plan, rig, Path("virtual.toml"), tmp_path)
    assert found.refusal is None
    result = read_result(directory)
    within_one_percent(result)
    assert tables(result, "vertical")["repetitions"].max() >= 1


@slow
@pytest.mark.parametrize("made", [VirtualPlc, VirtualYard])
def test_described_rigs_have_it_streamed(made, line, tmp_path):
    given = {"track": str(line), "speed": "20 m/s", "duration": "20 s"}
    with made(seed=1).bench() as bench:
        result = execute(plans()["track_record"].given(given), bench, tmp_path / "out", rig=made.name, seed=1)
    found = {one.name: one for one in result.checks}
    assert result.verdict in {Outcome.PASS, Outcome.INCOMPLETE}, result.reason
    assert found["platform beside the record, vertical"].verdict is CheckVerdict.PASS


@slow
@pytest.mark.parametrize("most", ["20 mm", "2 mm"])
def test_a_rehearsal_foresees_it(line, tmp_path, most):
    """The platform goes up by 3 mm, and a limit below that refuses the run."""
    plan = plans()["track_record"].given({"track": str(line), "speed": "20 m/s", "duration": "20 s"})
    limit = {"signal": "platform.vertical", "kind": "upper", "at": most, "action": "interlock"}
    rig = RigFile(name="virtual", time="virtual", simulation=Simulation(limits=(limit,)))
    found, _ = rehearse(plan, rig, Path("virtual.toml"), tmp_path)
    if most == "20 mm":
        assert found.refusal is None
    else:
        assert found.refusal is not None
        assert found.refusal.step.endswith("track")
