"""A foreign rig's files of two air springs: what the model itself would have measured comes back through the map."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from astb.identify import IdentificationRequest, identify_data
from astb.tables import plain_console
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.layout import Sensor
from bench_sim.parameters import load
from diagnosis.contracts import DiagnosisError, Experiment
from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose
from diagnosis.systems.air_spring.files import air_spring_system
from diagnosis.systems.air_spring.simulator import AirSpring
from diagnosis.systems.mapping import read_mapped
from test_plans.programmes.motions import Part, Programme, Stretch, Wave
from tests.refusals import refuses

STEP = 5e-3

MAP = """
system = "air_spring"
parameters = "{parameters}"
[time]
column = "t"
[columns]
"left.height" = {{ column = "zl", unit = "mm" }}
"right.height" = {{ column = "zr", unit = "mm" }}
"left.bellows_pressure" = {{ column = "pl", unit = "bar", reading = "absolute" }}
"right.bellows_pressure" = {{ column = "pr", unit = "bar", reading = "absolute" }}
"vertical_left.force" = {{ column = "F", unit = "kN", noise = "20 N" }}
[settings]
nominal_preload = "53.5 kN"
ambient_pressure = "1.01325 bar"
"""


def write(folder: Path, parameters: str = "astb") -> tuple[Path, Path]:
    """Write what noiseless sensors on the model read while both springs go up and down by 4 mm at 0.8 Hz."""
    clock = STEP * np.arange(2400)
    height = 4e-3 * np.sin(2.0 * np.pi * 0.8 * clock) * np.clip(clock, 0.0, 1.0)
    names = ("left.bellows_pressure", "right.bellows_pressure", "vertical_left.force")
    model = AirSpring(load("astb"), effects={}, only=names)
    experiment = Experiment(
        "made",
        clock,
        {"left.height": height, "right.height": height},
        {"left.bellows_pressure": 3.5e5, "right.bellows_pressure": 3.5e5, "nominal_preload": 53.5e3},
    )
    columns = dict(zip((c.name for c in model.channels), model.run(experiment, {}, {}).T, strict=True))
    left, right = (1e-5 * columns[name] + 1.01325 for name in names[:2])
    table = np.column_stack((clock, 1e3 * height, 1e3 * height, left, right, 1e-3 * columns[names[2]]))
    data, mapping = folder / "made.csv", folder / "map.toml"
    np.savetxt(data, table, fmt="%.9f", delimiter=",", header="t,zl,zr,pl,pr,F", comments="")
    mapping.write_text(MAP.format(parameters=parameters), encoding="utf-8")
    return data, mapping


@pytest.mark.slow
def test_the_model_recognises_its_own_measurements(tmp_path: Path) -> None:
    data, mapping = write(tmp_path)
    simulator, dataset = read_mapped([data], mapping)
    (run,) = dataset.runs
    names = [channel.name for channel in dataset.channels]
    assert names == ["left.bellows_pressure", "right.bellows_pressure", "vertical_left.force"]
    assert dataset.channels[0].noise > 0.0  # the parameter set knows the sensor
    assert dataset.channels[2].noise == 20.0  # the map knows better
    assert run.experiment.settings["left.bellows_pressure"] == pytest.approx(3.5e5, rel=1e-3)
    left = (run.outputs - simulator.run(run.experiment, {}, {}))[400:]
    swing = np.ptp(run.outputs[400:], axis=0)
    assert np.all(np.std(left, axis=0) < 0.01 * swing)


def test_an_invalid_parameter_set_is_reported_with_the_map(tmp_path: Path) -> None:
    data, mapping = write(tmp_path, "nowhere.toml")
    with refuses(DiagnosisError, "map.toml"):
        read_mapped([data], mapping)


# -- another rig, by the map of the page -------------------------------------------------------------------------------

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "diagnose-other-data.md"
CLOCK = STEP * np.arange(2000)
SWEEP = 5e-3 * np.sin(2.0 * np.pi * (0.2 * CLOCK + 0.14 * CLOCK**2))
SINES = 4e-3 * np.sin(2.0 * np.pi * 0.4 * CLOCK) + 1.5e-3 * np.sin(2.0 * np.pi * 1.7 * CLOCK + 1.0)
AMBIENT = 0.96e5


@pytest.fixture(scope="module")
def other_rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of the page, from springs that leak on the left, with the noise of their sensors."""
    folder = tmp_path_factory.mktemp("other")
    maps = re.findall(r"```toml\n(.*?)```", PAGE.read_text(), flags=re.DOTALL)
    (page_map,) = (one for one in maps if 'system = "air_spring"' in one)
    (folder / "my_rig.toml").write_text(page_map, encoding="utf-8")
    springs = load("astb").with_values(
        effective_area=0.235,
        bellows_volume=26e-3,
        auxiliary_volume=55e-3,
        orifice_diameter=11e-3,
        atmospheric_pressure=AMBIENT,
    )
    names = ("left.bellows_pressure", "right.bellows_pressure", "vertical_left.force", "vertical_right.force")
    model = AirSpring(springs, effects=CATALOGUE, only=names)
    rng = np.random.default_rng(1)
    part = np.clip(CLOCK / 2.0, 0.0, 1.0)
    gently = part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
    for load_name, preload in (("empty", 48e3), ("full", 84e3)):
        for motion, course in (("sweep", SWEEP), ("sines", SINES)):
            height = course * gently
            start = {f"{side}.bellows_pressure": preload / 0.235 for side in ("left", "right")}
            experiment = Experiment(
                motion,
                CLOCK,
                {"left.height": height, "right.height": 0.8 * height},
                {**start, "nominal_preload": preload, "wall_temperature": 299.15},
            )
            outputs = model.run(experiment, {}, {"leak.left": {"area": 0.5e-6}})
            outputs = outputs + rng.standard_normal(outputs.shape) * (150.0, 150.0, 20.0, 20.0)
            travel = -1e3 * np.column_stack((height, 0.8 * height)) + 0.005 * rng.standard_normal((2000, 2))
            table = np.column_stack(
                (1e3 * CLOCK, travel, (outputs[:, :2] + AMBIENT) / 1e5, outputs[:, 2:] / 1e3)
            )
            np.savetxt(
                folder / f"{load_name}_{motion}.csv",
                table,
                fmt="%.6f",
                delimiter=",",
                header="t,travel_l,travel_r,p_l,p_r,F_l,F_r",
                comments="",
            )
    return folder


@pytest.mark.slow
def test_the_map_of_the_page_makes_the_model_that_of_the_other_rig(other_rig: Path) -> None:
    simulator, dataset = read_mapped(sorted(other_rig.glob("*.csv")), other_rig / "my_rig.toml")
    assert dataset.doubts == ()
    loads = {run.experiment.name: run.experiment.settings["nominal_preload"] for run in dataset.runs}
    assert loads == {"empty_sines": 48e3, "empty_sweep": 48e3, "full_sines": 84e3, "full_sweep": 84e3}
    assert [run.role for run in dataset.runs] == ["select", "fit", "report", "fit"]
    for (
        run
    ) in dataset.runs:  # the right spring has no leak: it reads what the model predicts, but for the noise
        left = (run.outputs - simulator.run(run.experiment, {}, {}))[:, 1]
        assert np.std(left) == pytest.approx(150.0, rel=0.1)


@pytest.mark.slow
def test_a_column_read_wrongly_on_the_other_rig_is_doubted_with_those_that_share_the_mistake(
    other_rig: Path,
) -> None:
    text = (other_rig / "my_rig.toml").read_text(encoding="utf-8")
    wrong = other_rig / "wrong.toml"
    for old, new, said in (
        (
            'unit = "mm", sign = -1',
            'unit = "mm"',
            "columns.left.height.sign and columns.right.height.sign = 1 may",
        ),
        (
            'travel_l", unit = "mm", sign = -1',
            'travel_l", unit = "mm"',
            "columns.left.height.sign = 1 may be wrong",
        ),
        (
            '"absolute"',
            '"gauge"',
            "columns.left.bellows_pressure.reading and columns.right.bellows_pressure.reading",
        ),
        (
            '"kN"',
            '"kN", sign = -1',
            "columns.vertical_left.force.sign and columns.vertical_right.force.sign = -1",
        ),
    ):
        wrong.write_text(text.replace(old, new), encoding="utf-8")
        _, dataset = read_mapped([other_rig / "full_sweep.csv"], wrong)
        (doubt,) = dataset.doubts
        assert doubt.startswith(said)


def test_the_page_knows_every_signal_and_setting() -> None:
    system = air_spring_system(load("astb"))
    text = PAGE.read_text()
    for one in (*system.inputs, *system.outputs, *system.settings):
        assert f"`{one.name}`" in text
    same = {setting.name for setting in system.settings if not setting.per_file}
    assert set(re.findall(r"^\| `(\w+)` \| no ", text, flags=re.MULTILINE)) == same


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_the_leak_of_the_other_rig_is_named(other_rig: Path) -> None:
    simulator, dataset = read_mapped(sorted(other_rig.glob("*.csv")), other_rig / "my_rig.toml")
    effects = ("maxwell", "leak.left", "leak.right")
    finding = diagnose(dataset, simulator, Config(effects=effects))
    assert finding.names == ("leak.left",)
    (area,) = finding.causes[0].parameters
    assert area.low <= 0.5 <= area.high


@pytest.mark.slow
def test_the_springs_of_the_other_rig_are_identified_with_what_its_map_states(
    other_rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sheared = Stretch((Wave("lateral", 5e-3, 1.0, 3),), condition=())
    further = Programme("further", "Further", (Part("AW0", (sheared,)),), "What they never did.")
    monkeypatch.setattr("astb.identify.IDENTIFICATION", further)
    path, files = tmp_path / "theirs.toml", sorted(other_rig.glob("*_sweep.csv"))
    request = IdentificationRequest(files, other_rig / "my_rig.toml", "astb", None, None)
    rows = {row.name: row for row in identify_data(request, path, plain_console(stderr=True)).rows}
    for name, true in (("right.effective_area", 0.235), ("right.bellows_volume", 26.0)):
        assert rows[name].told
        assert rows[name].value == pytest.approx(true, rel=0.03)
    assert not rows["shell_stiffness_lateral"].told, "nothing was sheared"
    theirs = load(path)
    assert theirs.entries["orifice_diameter"].value == pytest.approx(11e-3)
    assert theirs.record.sensor_noise[Sensor.LEFT_HEIGHT] == pytest.approx(5e-6)
    assert theirs.record.effective_area[1] == pytest.approx(rows["right.effective_area"].value, rel=1e-5)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('nominal_preload = "84 kN"', 'ambient_pressure = "1 bar"', "ambient_pressure air_spring"),
        ('nominal_preload = "84 kN"', 'colour = "1 m"', "settings.colour air_spring"),
        ('effective_area = "0.235 m2"', 'effective_area = "2 m2"', "my_rig.toml 2"),
        ('effective_area = "0.235 m2"', 'effective_aera = "0.2 m2"', "my_rig.toml"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_the_map_of_another_rig_is_named(
    other_rig: Path, tmp_path: Path, old: str, new: str, message: str
) -> None:
    mapping = tmp_path / "my_rig.toml"
    text = (other_rig / "my_rig.toml").read_text(encoding="utf-8")
    assert old in text
    mapping.write_text(text.replace(old, new), encoding="utf-8")
    with refuses(DiagnosisError, message):
        read_mapped([other_rig / "full_sweep.csv"], mapping)


@given(share=st.floats(0.0025, 0.45), amplitude=st.floats(1e-3, 50e-3), phase=st.floats(0.0, 2.0 * np.pi))
def test_no_motion_to_and_fro_is_a_rest(share, amplitude, phase):
    clock = STEP * np.arange(2000)
    wave = amplitude * np.sin(2.0 * np.pi * share / STEP * clock + phase)
    noise = 0.01e-3 * np.random.default_rng(1).standard_normal(len(clock))
    rest = air_spring_system(load("astb")).rest
    assert not rest(STEP, clock, {"left.height": wave + noise})[100:-100].any()
    assert rest(
        STEP, clock, {"left.height": np.where(np.arange(2000) % 3, np.nan, 0.1e-3 * clock + noise)}
    ).all()
