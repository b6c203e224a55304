"""Third-party files: all formats give the same numbers, gaps stay gaps, errors state the fix."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from astb.frames_import import columns_of_frames
from diagnosis.contracts import DataQuality, Dataset, DiagnosisError
from diagnosis.engine.diagnose import verdict_on
from diagnosis.finding import Verdict
from diagnosis.systems.cutting import pieces_by_length, pieces_by_reversals, resample, reversals
from diagnosis.systems.mapping import read_mapped
from diagnosis.systems.system import difference, quantity
from tests.refusals import refuses

TIME = np.arange(0.0, 12.0, 0.01)
X = 17.0 + 20.0 * (2.0 / np.pi) * np.arcsin(np.sin(2.0 * np.pi * TIME / 4.0 - np.pi / 2.0))  # mm
PRESSURE = 5.0 + 0.04 * np.sign(np.gradient(X))  # bar gauge
FORCE = 1e5 * PRESSURE * np.pi / 4.0 * 25e-3**2

MAP = """
system = "piston"
{file}
[time]
column = "t"
unit = "ms"
step = "10 ms"
[columns]
displacement = {{ column = "x", unit = "mm" }}
pressure = {{ column = "p", unit = "bar", reading = "gauge" }}
force = {{ column = "F", unit = "N", noise = "0.1 N" }}
[settings]
bore = "25 mm"
stroke_from = "-3 mm"
stroke_to = "37 mm"
{rest}
"""


def write_map(folder: Path, file: str = "", rest: str = "", change: tuple[str, str] = ("", "")) -> Path:
    path = folder / "map.toml"
    path.write_text(MAP.format(file=file, rest=rest).replace(*change), encoding="utf-8")
    return path


def write_csv(
    path: Path, delimiter: str = ",", decimal: str = ".", header: bool = True, gap: slice | None = None
) -> Path:
    rows = [delimiter.join(["t", "x", "p", "F"])] if header else []
    for i, (t, *values) in enumerate(zip(1e3 * TIME, X, PRESSURE, FORCE, strict=True)):
        if gap is None or i not in range(*gap.indices(len(TIME))):
            rows.append(
                delimiter.join([f"{t:.0f}", *(f"{value:.9f}".replace(".", decimal) for value in values)])
            )
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def test_csv_becomes_one_run_in_si(tmp_path: Path) -> None:
    simulator, dataset = read_mapped([write_csv(tmp_path / "a.csv")], write_map(tmp_path))
    (run,) = dataset.runs
    assert simulator.channels == dataset.channels
    assert dataset.channels[0].noise == 0.1
    assert run.experiment.name == "a" and run.role == "fit" and run.scored.all()
    assert run.experiment.step == pytest.approx(0.01)
    assert run.outputs[:, 0] == pytest.approx(FORCE, rel=1e-8)
    assert run.experiment.inputs["pressure"] == pytest.approx(1e5 * PRESSURE)
    assert simulator.run(run.experiment, {}, {}) == pytest.approx(run.outputs, rel=1e-8)


@pytest.mark.parametrize(
    ("file", "options", "change"),
    [
        ('[file]\ndelimiter = ";"\ndecimal = ","', {"delimiter": ";", "decimal": ","}, ("", "")),
        ('[file]\ndelimiter = "\\t"', {"delimiter": "\t"}, ("", "")),
    ],
)
def test_dialects_of_csv_agree(
    tmp_path: Path, file: str, options: dict[str, str], change: tuple[str, str]
) -> None:
    _, plain = read_mapped([write_csv(tmp_path / "a.csv")], write_map(tmp_path))
    _, other = read_mapped(
        [write_csv(tmp_path / "b.txt", **options)], write_map(tmp_path, file, change=change)
    )
    assert np.array_equal(plain.runs[0].outputs, other.runs[0].outputs)


def test_columns_go_by_number_where_there_is_no_header(tmp_path: Path) -> None:
    _, plain = read_mapped([write_csv(tmp_path / "a.csv")], write_map(tmp_path))
    mapping = write_map(tmp_path, "[file]\nheader = false")
    text = mapping.read_text(encoding="utf-8")
    for number, name in enumerate("txpF", 1):
        text = text.replace(f'column = "{name}"', f"column = {number}")
    mapping.write_text(text, encoding="utf-8")
    _, other = read_mapped([write_csv(tmp_path / "b.csv", header=False)], mapping)
    assert np.array_equal(plain.runs[0].outputs, other.runs[0].outputs)


def test_dots_between_thousands_are_no_decimal_points(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    clock = [f"{round(1e6 * t):,}".replace(",", ".") for t in TIME]  # 1.230.000 is 1.23 s
    rows = [f"{t};{x:.6f};{p:.6f};{f:.6f}" for t, x, p, f in zip(clock, X, PRESSURE, FORCE, strict=True)]
    path.write_text("t;x;p;F\n" + "\n".join(rows), encoding="utf-8")
    mapping = write_map(
        tmp_path, '[file]\ndelimiter = ";"', change=('unit = "ms"', 'unit = "us"\nthousands = "."')
    )
    _, dataset = read_mapped([path], mapping)
    assert dataset.runs[0].outputs[:, 0] == pytest.approx(FORCE, rel=1e-6)


def test_parquet_agrees_with_csv(tmp_path: Path) -> None:
    import pandas as pd

    _, plain = read_mapped([write_csv(tmp_path / "a.csv")], write_map(tmp_path))
    frame = pd.read_csv(tmp_path / "a.csv")
    frame.to_parquet(tmp_path / "a.parquet")
    _, other = read_mapped([tmp_path / "a.parquet"], write_map(tmp_path))
    assert np.array_equal(plain.runs[0].outputs, other.runs[0].outputs)


@pytest.mark.mdf
def test_mdf_channels_keep_their_own_rates(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf", reason="MDF needs the extra mdf: `make test-mdf`")
    slow = slice(None, None, 2)
    with asammdf.MDF(version="4.10") as mdf:
        mdf.append([asammdf.Signal(values, TIME, name=name) for name, values in (("x", X), ("F", FORCE))])
        mdf.append([asammdf.Signal(PRESSURE[slow], TIME[slow], name="p")])
        mdf.save(tmp_path / "a.mf4")
    mapping = write_map(tmp_path, change=('column = "t"\nunit = "ms"\n', ""))
    _, dataset = read_mapped([tmp_path / "a.mf4"], mapping)
    (run,) = dataset.runs
    n = len(TIME) - 1  # the slow pressure ends one sample earlier
    assert run.outputs[:, 0] == pytest.approx(FORCE[:n])
    assert run.experiment.inputs["pressure"][::2] == pytest.approx(1e5 * PRESSURE[slow])


def test_without_asammdf_the_error_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "asammdf", None)
    (tmp_path / "a.mf4").write_bytes(b"MDF")
    with refuses(DiagnosisError, "'asammdf>=8,<9'"):
        read_mapped([tmp_path / "a.mf4"], write_map(tmp_path))


@pytest.mark.parametrize(("gap", "told"), [(slice(300, 340), True), (slice(300, 301), False)])
def test_a_gap_is_a_row_of_the_data_quality(tmp_path: Path, gap: slice, told: bool) -> None:
    path = write_csv(tmp_path / "a.csv", gap=gap)
    _, dataset = read_mapped([path], write_map(tmp_path))
    rows = {row.column: row for row in dataset.quality if row.check == "missing"}
    assert bool(rows) is told
    if told:
        assert rows.keys() == {"displacement", "pressure", "force"}
        assert all(row.file == "a.csv" and "0.4 s and starts at 3 s" in row.found for row in rows.values())
        assert (
            "straight line" in rows["pressure"].consequence
            and "straight line" not in rows["force"].consequence
        )


def test_in_a_gap_outputs_are_missing_and_inputs_go_straight(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "a.csv", gap=slice(300, 340))
    _, dataset = read_mapped([path], write_map(tmp_path))
    (run,) = dataset.runs
    missing = np.isnan(run.outputs[:, 0])
    assert np.flatnonzero(missing).tolist() == list(range(300, 340))
    pressure = run.experiment.inputs["pressure"][299:341]
    assert np.diff(pressure) == pytest.approx(np.diff(pressure)[0], abs=1e-6)


def test_absolute_pressure_becomes_gauge_and_signs_turn(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "a.csv")
    change = ('reading = "gauge"', 'reading = "absolute", sign = -1, offset = "0.5 bar"')
    _, dataset = read_mapped([path], write_map(tmp_path, rest='ambient_pressure = "0.98 bar"', change=change))
    assert dataset.runs[0].experiment.inputs["pressure"] == pytest.approx(1e5 * (-PRESSURE + 0.5 - 0.98))


RUNS = """
[runs]
cut = "strokes"
signal = "displacement"
reversal = "2 mm"
strokes = 2
lead = "0.5 s"
[[runs.role]]
files = "b*"
role = "report"
[[runs.role]]
runs = [1]
role = "select"
[[runs.role]]
role = "fit"
"""


def test_strokes_become_runs_with_a_lead_and_a_role(tmp_path: Path) -> None:
    paths = [write_csv(tmp_path / name) for name in ("a.csv", "b.csv")]
    _, dataset = read_mapped(paths, write_map(tmp_path, rest=RUNS))
    names = [(run.experiment.name, run.role) for run in dataset.runs]
    assert names == [("a 1", "select"), ("a 2", "fit"), ("b 1", "report"), ("b 2", "report")]
    for run in dataset.runs:
        assert run.experiment.time[0] == 0.0
        assert (~run.scored).sum() == 50 and not run.scored[:50].any()
        assert run.scored.sum() == pytest.approx(400, abs=1)  # two strokes of 2 s
        travelled = np.diff(run.experiment.inputs["displacement"][run.scored])
        assert abs(travelled.sum()) < 1e-3 < np.abs(travelled).sum()


CHAMBER = """
system = "chamber"
[time]
column = "t"
unit = "ms"
[columns]
pressure = { column = "p", unit = "bar", reading = "gauge" }
[settings]
volume = "1 litre"
[runs]
cut = "time"
length = "3 s"
"""


def test_runs_of_what_does_not_forget_begin_with_their_file_and_share_its_start(tmp_path: Path) -> None:
    mapping = tmp_path / "chamber.toml"
    mapping.write_text(CHAMBER, encoding="utf-8")
    paths = [write_csv(tmp_path / name) for name in ("a.csv", "b.csv")]
    _, dataset = read_mapped(paths, mapping)
    assert [run.experiment.record for run in dataset.runs] == ["a"] * 4 + ["b"] * 4
    for run in dataset.runs:
        assert run.experiment.inputs["time"][0] == 0.0
        assert (
            run.experiment.settings["start_pressure"] == dataset.runs[0].experiment.settings["start_pressure"]
        )
    scored = np.array([np.pad(run.scored, (0, 1200 - len(run.scored))) for run in dataset.runs[:4]])
    assert (scored.sum(axis=0) == 1).all()  # every sample counts once
    mapping.write_text(CHAMBER + 'lead = "2 s"', encoding="utf-8")
    with refuses(DiagnosisError, "runs.lead"):
        read_mapped(paths, mapping)


def test_the_digest_sees_data_and_map(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "a.csv")
    digests = {read_mapped([path], write_map(tmp_path, rest=rest))[1].digest for rest in ("", "# another")}
    path.write_text(path.read_text(encoding="utf-8").replace("17.0", "17.1"), encoding="utf-8")
    digests.add(read_mapped([path], write_map(tmp_path))[1].digest)
    assert len(digests) == 3


@pytest.mark.parametrize(
    ("change", "rest", "message"),
    [
        (('system = "piston"', 'system = "pistn"'), "", 'map.toml system "pistn" air_spring'),
        (('column = "x"', 'column = "way"'), "", 'a.csv displacement.column "way"'),
        (('column = "x"', "column = 7"), "", "displacement.column 7 1 4"),
        (('unit = "mm"', 'unit = "bar"'), "", 'columns.displacement.unit "bar"'),
        ((', reading = "gauge"', ""), "", 'columns.pressure.reading None "gauge" "absolute"'),
        (('unit = "N"', 'unit = "N", reading = "gauge"'), "", "columns.force.reading gauge"),
        (('"25 mm"', '"25 m"'), "", "settings.bore 25 m 0.001 1 m"),
        (('"25 mm"', '"wide"'), "", 'settings.bore "wide" "12.5 mm"'),
        (('bore = "25 mm"', ""), "", "settings.bore"),
        (("", ""), 'colour = "1 m"', "settings.colour"),
        (("force =", "weight ="), "", "columns.weight"),
        (('pressure = { column = "p", unit = "bar", reading = "gauge" }\n', ""), "", "columns.pressure"),
        (('step = "10 ms"', 'stop = "10 ms"'), "", "map.toml time.stop 'step'"),
        (('step = "10 ms"', 'step = "10 bar"'), "", 'time.step "10 bar" "bar"'),
        (('step = "10 ms"', 'start = "60 s"'), "", "fewer"),
        (("", ""), '[runs]\ncut = "strokes"', "runs.signal runs.reversal"),
        (("", ""), '[runs]\ncut = "time"', "runs.length"),
        (("", ""), "[runs]\nskip = 1", "found 12 s runs.skip 1"),
        (("", ""), '[[runs.role]]\nfiles = "b*"\nrole = "fit"', "[[runs.role]] 1 a.csv"),
    ],
)  # fmt: skip
def test_errors_say_whose_fault_it_is(
    tmp_path: Path, change: tuple[str, str], rest: str, message: str
) -> None:
    path = write_csv(tmp_path / "a.csv")
    with refuses(DiagnosisError, message):
        read_mapped([path], write_map(tmp_path, rest=rest, change=change))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda text: text.replace("17.000000000", "n/a?", 1), 'a.csv "n/a?"'),
        (lambda text: text.replace("\n20,", "\n5,", 1), "0.01 s 0.005 s line 4"),
        (lambda text: "t,x,p,F\n", "rows"),
        (lambda text: "", "a.csv"),
    ],
)
def test_damaged_tables_are_refused(tmp_path: Path, damage, message: str) -> None:
    path = write_csv(tmp_path / "a.csv")
    path.write_text(damage(path.read_text(encoding="utf-8")), encoding="utf-8")
    with refuses(DiagnosisError, message):
        read_mapped([path], write_map(tmp_path))


def test_missing_and_nameless_files_are_refused(tmp_path: Path) -> None:
    with refuses(DiagnosisError, "none.csv"):
        read_mapped([tmp_path / "none.csv"], write_map(tmp_path))
    with refuses(DiagnosisError, "files"):
        read_mapped([], write_map(tmp_path))
    with refuses(DiagnosisError, '".xyz"'):
        read_mapped([write_csv(tmp_path / "a.xyz")], write_map(tmp_path))


def test_quantities_have_units_and_zeros() -> None:
    assert quantity("20 degC", "K", "here") == pytest.approx(293.15)
    assert difference("20 degC", "K", "here") == pytest.approx(20.0)
    assert quantity("250 kPa", "Pa", "here") == pytest.approx(2.5e5)
    with refuses(DiagnosisError, "finite"):
        quantity("nan mm", "m", "here")


@given(st.data())
def test_resampling_never_extrapolates_and_hits_every_sample(data: st.DataObject) -> None:
    steps = data.draw(st.lists(st.floats(1e-3, 1.0), min_size=2, max_size=30))
    time = np.cumsum(steps)
    values = np.array(data.draw(st.lists(st.floats(-1e3, 1e3), min_size=len(time), max_size=len(time))))
    gap = data.draw(st.floats(1e-3, 2.0))
    assert resample(time, values, time, gap) == pytest.approx(values)
    between = 0.5 * (time[1:] + time[:-1])
    middle = resample(time, values, between, gap)
    far = np.diff(time) > gap
    assert np.isnan(middle[far]).all()
    # A line is as steep as its ends say, and the middle is known to the rounding of the time there.
    rounding = np.abs(np.diff(values)) / np.diff(time) * np.spacing(time[1:])
    off = np.abs(middle - 0.5 * (values[1:] + values[:-1]))
    assert (off <= rounding + 1e-12 * (1.0 + np.abs(values[1:]) + np.abs(values[:-1])))[~far].all()
    assert np.isnan(resample(time, values, np.array([time[0] - 1.0, time[-1] + 1.0]), gap)).all()


@given(st.lists(st.integers(1, 20), min_size=1, max_size=12), st.floats(0.0, 0.4))
def test_reversals_are_the_turning_points_and_noise_is_none(legs: list[int], noise: float) -> None:
    corners = np.cumsum([0, *(leg * (-1) ** i for i, leg in enumerate(legs))]).astype(float)
    # Ten samples to a leg; alternate samples carry noise, but not the corners.
    x = np.interp(np.arange(10 * len(legs) + 1), 10 * np.arange(len(corners)), corners)
    x[1::2] += noise * np.where(np.arange(len(x[1::2])) % 2 == 0, 1.0, -1.0) * 0.1
    expected = [10 * i for i in range(1, len(legs))]
    assert np.abs(reversals(x, 0.9) - np.array(expected)).max(initial=0) <= 1
    pieces = pieces_by_reversals(x, 0.9, 1)
    assert len(pieces) == max(len(legs) - 2, 0)


def test_pieces_by_length_cover_all_but_a_short_rest() -> None:
    assert pieces_by_length(25, 10) == [(0, 10), (10, 20), (20, 25)]
    assert pieces_by_length(24, 10) == [(0, 10), (10, 20)]


@pytest.mark.parametrize(
    ("head", "factor", "unit", "right"),
    [
        ("F [KN]", 1e-3, "", True),
        ("F/kN", 1e-3, "", True),
        ("F [kgf]", 1.0 / 9.80665, "", True),
        ("F [N]", 1.0, ', unit = "newton"', True),
        ("F [KN]", 1e-3, ', unit = "kN"', True),
        ("F [KN]", 1.0, ', unit = "N"', True),  # the head is wrong, and the simulation shows it
        ("F [KN]", 1e-3, ', unit = "N"', False),
        ("F [furlong]", 1.0, ', unit = "N"', False),
        ("F [furlong]", 1.0, ', unit = "N", ignore_head_unit = true', True),
        ("F [mm]", 1.0, "", False),
        ("F", 1.0, "", False),
    ],
)
def test_a_unit_in_a_head_is_converted_noted_or_refused(
    tmp_path: Path, head: str, factor: float, unit: str, right: bool
) -> None:
    path = tmp_path / "a.csv"
    rows = [
        f"{1e3 * t:.0f},{x:.9f},{p:.9f},{factor * f:.9f}"
        for t, x, p, f in zip(TIME, X, PRESSURE, FORCE, strict=True)
    ]
    path.write_text(f"t,x,p,{head}\n" + "\n".join(rows), encoding="utf-8")
    old = 'force = { column = "F", unit = "N", noise = "0.1 N" }'
    mapping = write_map(tmp_path)
    text = mapping.read_text(encoding="utf-8")
    assert old in text
    mapping.write_text(text.replace(old, f'force = {{ column = "{head}"{unit} }}'), encoding="utf-8")
    if not right:
        with refuses(DiagnosisError, "columns.force.unit"):
            read_mapped([path], mapping)
        return
    _, dataset = read_mapped([path], mapping)
    assert dataset.runs[0].outputs[:, 0] == pytest.approx(FORCE, rel=1e-5)
    contradicts = head in ("F [KN]", "F [furlong]") and factor == 1.0
    assert any("as the head of its column says" in line for line in dataset.readings) is contradicts


@settings(max_examples=15, deadline=None)
@given(
    st.sampled_from((9.9e37, -9999.0, 65535.0, 0.0)),
    st.floats(0.001, 0.05),
    st.integers(0, 1000),
)
def test_a_code_never_reaches_a_simulation_without_a_doubt(code: float, share: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    force = FORCE + 0.1 * rng.standard_normal(len(FORCE))
    places = rng.random(len(FORCE)) < share
    places[rng.integers(len(FORCE))] = True
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.csv"
        table = np.column_stack((1e3 * TIME, X, PRESSURE, np.where(places, code, force)))
        np.savetxt(path, table, delimiter=",", header="t,x,p,F", comments="", fmt="%.9g")
        _, dataset = read_mapped([path], write_map(Path(folder)))
    assert any("undeclared code" in doubt for doubt in dataset.doubts)
    (row,) = (row for row in dataset.quality if row.doubt)
    assert (row.file, row.column, row.count) == ("a.csv", "force", places.sum())
    assert f"line {np.argmax(places) + 2}," in row.first
    (run,) = dataset.runs
    seen, true = run.outputs[:, 0], np.interp(run.experiment.time, TIME, FORCE)
    assert np.abs(seen - true)[np.isfinite(seen)].max() < 1.0 + np.ptp(FORCE)


def test_no_finding_in_doubtful_data_is_no_pass() -> None:
    rows = [
        DataQuality("a.csv", "force", "stuck", 10, 100, "line 3", "", "kept", doubt)
        for doubt in (True, False)
    ]
    for row in rows:
        data = Dataset((), (), quality=(row,))
        expected = Verdict.DOUBTFUL if row.doubt else Verdict.NO_EFFECT
        assert verdict_on(Verdict.NO_EFFECT, data) is expected
        assert verdict_on(Verdict.NAMED, data) is Verdict.NAMED


def test_the_format_of_the_map_counts_before_the_ending(tmp_path: Path) -> None:
    mapping = write_map(tmp_path, '[file]\nformat = "csv"')
    _, dataset = read_mapped([write_csv(tmp_path / "a.asc")], mapping, frames=columns_of_frames)
    assert len(dataset.runs) == 1
