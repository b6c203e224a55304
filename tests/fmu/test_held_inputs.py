"""Inputs that are held between samples, and units that an FMU defines: two tanks in C whose steps are exact."""

import json
import shutil
import tomllib
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from astb.commands.diagnosis import identify_command
from astb.diagnose import DiagnosisRequest, diagnose_data
from astb.tables import plain_console
from bench_protocol.unit_names import read_unit
from bench_protocol.units import UNITS as BENCH_UNITS
from bench_sim.fmu.description import library_of, read_fmu
from diagnosis.contracts import DiagnosisError
from diagnosis.finding import Verdict
from diagnosis.systems.cutting import resample_held
from diagnosis.systems.mapping import read_mapped
from diagnosis.systems.system import conversion
from tests.fmu.asked import HERE, save
from tests.fmu.measured import ROLES
from tests.fmu.strange_spring import build_c
from tests.refusals import refuses

UNITS = {
    "l/s": '<BaseUnit m="3" s="-1" factor="0.001"/>',
    "l/(s.m)": '<BaseUnit m="2" s="-1" factor="0.001"/>',
    "m": '<BaseUnit m="1"/>',
    "m2": '<BaseUnit m="2"/>',
}
VARIABLES = (
    ("flow", "input", "l/s", 0.0),
    ("upper", "output", "m", None),
    ("lower", "output", "m", None),
    ("upper_hole", "parameter", "l/(s.m)", 2.0),
    ("lower_hole", "parameter", "l/(s.m)", 3.0),
    ("upper_area", "parameter", "m2", 0.05),
    ("lower_area", "parameter", "m2", 0.09),
    ("upper_start", "parameter", "m", 0.2),
    ("lower_start", "parameter", "m", 0.1),
)
TRUE = {"upper_hole": 2.06, "lower_hole": 2.9, "upper_area": 0.0512, "upper_start": 0.2, "lower_start": 0.1}
MAP = """
simulator = "tanks.fmu"
[columns]
flow = { column = "Q", unit = "l/s" }
upper = { column = "h1", unit = "mm", noise = "1 mm" }
lower = { column = "h2", unit = "mm", noise = "1 mm" }
[fmu.base]
upper_hole = { spread = "10 %", low = "0.5 l/(s.m)" }
lower_hole = { spread = "10 %", low = "0.5 l/(s.m)" }
upper_area = { spread = "10 %", low = "0.01 m2" }
"""


def description(flow: str, words: Mapping[str, str] | None = None) -> str:
    """Return the description, with the variability of its input and other words."""
    rows = []
    for reference, (name, causality, unit, start) in enumerate(VARIABLES):
        varies = {"input": flow, "output": "continuous", "parameter": "fixed"}[causality]
        begins = "" if start is None else f' start="{start}"'
        rows.append(
            f'<ScalarVariable name="{name}" valueReference="{reference}" causality="{causality}" '
            f'variability="{varies}"><Real unit="{unit}"{begins}/></ScalarVariable>'
        )
    defined = "".join(f'<Unit name="{name}">{base}</Unit>' for name, base in UNITS.items())
    text = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="tanks" guid="tanks">
<CoSimulation modelIdentifier="tanks" canHandleVariableCommunicationStepSize="true"/>
<UnitDefinitions>{defined}</UnitDefinitions>
<ModelVariables>{"".join(rows)}</ModelVariables>
<ModelStructure><Outputs><Unknown index="2"/><Unknown index="3"/></Outputs></ModelStructure>
</fmiModelDescription>
"""
    for before, after in (words or {}).items():
        assert before in text
        text = text.replace(before, after)
    return text


@pytest.fixture(scope="session")
def tanks(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The FMU with either variability of its input, each in a separate folder."""
    made = {}
    for flow in ("continuous", "discrete"):
        folder = tmp_path_factory.mktemp(flow)
        made[flow] = build_c(HERE / "c" / "tanks.c", description(flow), folder / "tanks.fmu")
    return made


def levels(flow: np.ndarray, step: float, start: tuple[float, float], of: dict[str, float]) -> np.ndarray:
    """Return both levels (n, 2) in m for a flow (n,) in l/s that is held, by the exponential of the matrix."""
    k1, k2, a1, a2 = 1e-3 * of["upper_hole"], 1e-3 * of["lower_hole"], of["upper_area"], 0.09
    matrix = np.zeros((3, 3))
    matrix[:2] = [[-k1 / a1, 0.0, 1e-3 / a1], [k1 / a2, -k2 / a2, 0.0]]
    over = expm(step * matrix)
    state, found = np.array([*start, 0.0]), []
    for value in flow:
        state[2] = value
        found.append(state[:2].copy())
        state = over @ state
    return np.array(found)


def measured(folder: Path, noise: float, runs: int = 1, lasts: int = 50) -> list[Path]:
    """Runs of so many s at 1 Hz; the flow is a set-point that changes every 25 s."""
    rng, time, files = np.random.default_rng(4), np.arange(0.0, lasts), []
    for run in range(runs):
        flow = np.repeat(rng.uniform(0.2, 0.9, lasts // 25), 25)
        h = levels(flow, 1.0, (0.2, 0.1), TRUE) + noise * rng.standard_normal((lasts, 2))
        files.append(save(folder / f"run{run}.csv", time=time, Q=flow, h1=1e3 * h[:, 0], h2=1e3 * h[:, 1]))
    return files


def with_hold(hold: str) -> str:
    return MAP.replace('unit = "l/s"', f'unit = "l/s", hold = {hold}') if hold else MAP


@pytest.mark.parametrize(
    ("flow", "hold", "step", "exact"),
    [
        ("discrete", "", "", True),
        ("discrete", "", "0.25 s", True),
        ("continuous", "true", "", True),
        ("continuous", "true", "0.25 s", True),
        ("discrete", "false", "0.25 s", False),
        ("continuous", "", "0.25 s", False),
    ],
)
def test_a_held_input_drives_the_model_as_it_drove_the_thing(
    tanks: dict[str, Path], flow: str, hold: str, step: str, exact: bool
) -> None:
    folder = tanks[flow].parent
    files = measured(folder, 0.0)
    (folder / "map.toml").write_text(with_hold(hold) + (f'[fmu]\nstep = "{step}"\n' if step else ""))
    simulator, data = read_mapped(files, folder / "map.toml")
    si = {"upper_hole": 1e-3 * TRUE["upper_hole"], "lower_hole": 1e-3 * TRUE["lower_hole"]}
    outputs = simulator.run(data.runs[0].experiment, {**si, "upper_area": TRUE["upper_area"]}, {})
    error = np.abs(outputs - data.runs[0].outputs).max()
    assert error < 1e-9 if exact else error > 1e-4
    late = {"lag.flow", "latency.flow"} & set(simulator.catalogue)
    assert bool(late) is not exact


@settings(deadline=None)
@given(data=st.data())
def test_the_integral_of_held_inputs_is_kept(data: st.DataObject) -> None:
    """The mean of each step of the grid adds up to the integral of the stairs."""
    gaps = data.draw(st.lists(st.floats(0.01, 3.0), min_size=2, max_size=30))
    time = np.concatenate([[0.0], np.cumsum(gaps)])
    values = np.array(data.draw(st.lists(st.floats(-10, 10), min_size=len(time), max_size=len(time))))
    step = data.draw(st.floats(0.05, 2.0))
    grid = step * np.arange(int(time[-1] / step) + 2)
    held = resample_held(time, values, grid)
    edges = np.append(grid, grid[-1] + step)
    ends = np.append(time[1:], edges[-1])
    inside = [np.clip(edge, time, ends) - time for edge in edges]
    right = np.array([float(one @ values) for one in inside])
    assert np.concatenate([[0.0], np.cumsum(step * held)]) == pytest.approx(
        right, abs=1e-4 * step * len(grid)
    )
    assert set(resample_held(time, values, grid, whole=True)) <= set(values)
    on_samples = time[0] + step * np.arange(len(values))
    assert resample_held(on_samples, values, on_samples).tolist() == values.tolist()


@pytest.mark.slow
@pytest.mark.parametrize("step", ["", '[fmu]\nstep = "0.25 s"\n'], ids=["at 1 s", "at 0.25 s"])
def test_the_exact_model_has_no_doubt_and_no_cause(tanks: dict[str, Path], tmp_path: Path, step: str) -> None:
    folder = tanks["continuous"].parent
    (folder / "map.toml").write_text(with_hold("true") + step + ROLES)
    files = measured(folder, 1e-3, 5, 600)
    request = DiagnosisRequest(files, folder / "map.toml", None, "astb", None, 1)
    finding = diagnose_data(request, tmp_path / "out", plain_console(stderr=True))
    assert finding.verdict is Verdict.NO_EFFECT and not finding.doubts
    shifts = {one.name: one for one in finding.shifts if not one.run}
    assert set(shifts) == {"upper_hole", "lower_hole", "upper_area"}
    for name, one in shifts.items():
        assert one.sd_after is not None and abs(one.after - TRUE[name]) < 3.0 * one.sd_after, name


@pytest.mark.parametrize(
    ("of_type", "of_variable", "relative"),
    [("", "true", True), ("true", "", True), ("true", "false", False), ("", "", False)],
)
@pytest.mark.parametrize("fmi", [2, 3])
def test_the_zero_of_a_unit_does_not_count_for_a_difference(
    tmp_path: Path, fmi: int, of_type: str, of_variable: str, relative: bool
) -> None:
    def attribute(value: str) -> str:
        return f'relativeQuantity="{value}"' if value else ""

    real = f'unit="degC" {attribute(of_variable)} declaredType="T"'
    row = 'name="y" valueReference="0" causality="output"'
    if fmi == 2:
        kind = f'<SimpleType name="T"><Real {attribute(of_type)}/></SimpleType>'
        row = f"<ScalarVariable {row}><Real {real}/></ScalarVariable>"
    else:
        kind, row = f'<Float64Type name="T" {attribute(of_type)}/>', f"<Float64 {row} {real}/>"
    token = "guid" if fmi == 2 else "instantiationToken"
    text = f"""<fmiModelDescription fmiVersion="{fmi}.0" modelName="m" {token}="t"><CoSimulation modelIdentifier="m"/>
<UnitDefinitions><Unit name="degC"><BaseUnit K="1" offset="273.15"/></Unit></UnitDefinitions>
<TypeDefinitions>{kind}</TypeDefinitions><ModelVariables>{row}</ModelVariables><ModelStructure/>
</fmiModelDescription>"""
    with zipfile.ZipFile(tmp_path / "m.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", text)
        archive.writestr(library_of(fmi, "m"), b"")
    unit = read_fmu(tmp_path / "m.fmu").variables["y"].unit
    assert unit.to_si(20.0) == pytest.approx(20.0 if relative else 293.15)
    assert unit.from_si(unit.to_si(7.0)) == pytest.approx(7.0) and unit.offset == 273.15


def test_a_difference_in_another_unit_is_a_difference(tmp_path: Path) -> None:
    """A temperature that an FMU calls a difference is the measured one, in any unit."""
    words = {
        'name="upper" valueReference="1" causality="output" variability="continuous"><Real unit="m"': (
            'name="upper" valueReference="1" causality="output" variability="continuous">'
            '<Real unit="degC" relativeQuantity="true"'
        ),
        "<UnitDefinitions>": '<UnitDefinitions><Unit name="degC"><BaseUnit K="1" offset="273.15"/></Unit>',
    }
    build_c(HERE / "c" / "tanks.c", description("discrete", words), tmp_path / "tanks.fmu")
    flow = np.full(50, 0.5)
    upper = levels(flow, 1.0, (0.2, 0.1), TRUE | {"upper_hole": 2.0, "upper_area": 0.05})[:, 0]
    text = MAP[: MAP.index("lower = ")] + '[fmu.base]\nlower_hole = { spread = "10 %" }\n'
    for unit, factor in (("degC", 1.0), ("K", 1.0), ("degF", 1.8)):
        save(tmp_path / "run.csv", time=np.arange(50.0), Q=flow, h1=factor * upper)
        (tmp_path / "map.toml").write_text(
            text.replace('"mm", noise = "1 mm"', f'"{unit}", noise = "0.1 {unit}"')
        )
        simulator, data = read_mapped([tmp_path / "run.csv"], tmp_path / "map.toml")
        (run,) = data.runs
        assert run.outputs == pytest.approx(simulator.run(run.experiment, {}, {}), abs=1e-9)
        assert data.channels[0].noise == pytest.approx(0.1 / factor)


@example("s", "H")
@example("m7", "m7")
@given(
    st.sampled_from(sorted({one.si for one in BENCH_UNITS.values()} | {"m7", "K/m2"})), st.text(max_size=5)
)
def test_a_unit_that_is_refused_leaves_a_choice(si: str, unit: str) -> None:
    try:
        conversion(unit, si, "here")
    except DiagnosisError as error:
        assert str(error).rpartition("one of ")[2], error
    else:
        if unit not in BENCH_UNITS and unit != si:  # another usual spelling, such as H for hours
            assert read_unit(unit).unit.si == si
        else:
            assert unit == si or BENCH_UNITS[unit].si == si


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        ('unit = "l/s"', 'unit = "l/tick"', 'columns.flow.unit "l/tick"'),
        ('unit = "l/s"', 'unit = "bar"', 'columns.flow.unit "bar"'),
        ('"0.5 l/(s.m)" }\nlower', '"0.5 l/s" }\nlower', 'upper_hole.low "0.5 l/s"'),
        ('"1 mm" }\nlower', '"1 mm", hold = true }\nlower', "columns.upper.hold"),
        ("[fmu.base]", '[fmu]\nmeasured.flow.causes = ["lag"]\n[fmu.base]', "fmu.measured.flow.causes"),
    ],
)
def test_errors_of_a_map_are_reported(tanks: dict[str, Path], before: str, after: str, told: str) -> None:
    folder = tanks["discrete"].parent
    assert before in MAP
    (folder / "map.toml").write_text(MAP.replace(before, after))
    with refuses(DiagnosisError, told):
        read_mapped(measured(folder, 0.0), folder / "map.toml")


def test_all_errors_of_a_map_are_reported_at_once(tanks: dict[str, Path]) -> None:
    folder = tanks["discrete"].parent
    wrong = MAP.replace('unit = "l/s"', 'unit = "l/tick"').replace('noise = "1 mm"', 'noise = "1 s"', 1)
    wrong = wrong.replace('upper_area = { spread = "10 %"', 'uper_area = { spread = "10 %"')
    wrong = wrong.replace("lower_hole = { spread", 'lower_hole = { value = "2 bar", spread')
    wrong += '[settings]\nlower_area = "3 s"\n[fmu.effects.e]\nvariable = "none"\ntypical = "1 m"\n'
    (folder / "map.toml").write_text(wrong)
    with pytest.raises(DiagnosisError) as found:
        read_mapped(measured(folder, 0.0), folder / "map.toml")
    lines = str(found.value).splitlines()
    for key in (
        "columns.flow",
        "columns.upper",
        "fmu.base.uper_area",
        "fmu.base.lower_hole",
        "settings.lower_area",
    ):
        assert sum(key in line for line in lines) == 1, (key, lines)
    assert len(lines) == 6


@pytest.mark.slow
def test_named_parameters_are_identified_without_a_catalogue(tanks: dict[str, Path], tmp_path: Path) -> None:
    """Only a range of each parameter is known; the result enters the next diagnosis as a parameter set."""
    folder = tanks["discrete"].parent
    base = """[fmu.base]
upper_hole = { low = "1 l/(s.m)", high = "4 l/(s.m)" }
lower_hole = { low = "1 l/(s.m)", high = "6 l/(s.m)" }
upper_area = { low = "0.02 m2", high = "0.1 m2" }
upper_start = { spread = "20 mm", per_run = true }
"""
    text = MAP[: MAP.index("[fmu.base]")] + base
    (folder / "map.toml").write_text(text)
    data = [str(path) for path in measured(folder, 1e-3, 7, 300)]
    out = tmp_path / "found.toml"
    asked = [*data, "--map", str(folder / "map.toml"), "--out", str(out), "--json"]
    done = CliRunner().invoke(identify_command, asked)
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout)
    assert answer["doubts"] == []
    rows = {row["name"]: row for row in answer["rows"]}
    assert set(rows) == {"upper_hole", "lower_hole", "upper_area"}
    for name, row in rows.items():
        width = row["high"] - row["value"]
        assert row["told"] and abs(row["value"] - TRUE[name]) < 1.5 * width < 0.01 * TRUE[name], row
    assert rows["upper_hole"]["unit"] == "l/(s.m)"
    written = tomllib.loads(out.read_text())["parameters"]
    assert float(written["upper_area"].split()[0]) == pytest.approx(rows["upper_area"]["value"], rel=1e-6)
    shutil.copy(out.with_suffix(".ssv"), folder / "found.ssv")
    (folder / "map.toml").write_text(
        text.replace("[fmu.base]", '[fmu]\nparameters = "found.ssv"\n[fmu.base]')
    )
    simulator, _ = read_mapped(measured(folder, 0.0), folder / "map.toml")
    for one in simulator.nuisances:
        if not one.per_run:
            assert one.nominal / one.scale == pytest.approx(rows[one.name]["value"], rel=1e-6)
    done = CliRunner().invoke(identify_command, [*asked, "--expect", "screening"])
    assert done.exit_code == 2 and "--expect: tanks.fmu is not a model of the bench" in done.output


def test_a_parameter_without_a_prior_is_refused(tanks: dict[str, Path]) -> None:
    folder = tanks["discrete"].parent
    (folder / "map.toml").write_text(MAP.replace('spread = "10 %", low = "0.01 m2"', 'low = "0.01 m2"'))
    with refuses(DiagnosisError, "fmu.base.upper_area.spread"):
        read_mapped(measured(folder, 0.0), folder / "map.toml")
