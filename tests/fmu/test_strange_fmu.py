"""Diagnosis of third-party FMUs: their names, their findings, and their errors."""

import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from bench_protocol import input_limits
from bench_protocol.input_limits import PARSED_BYTES
from bench_sim.fmu.description import FmuError, read_fmu, unpack_fmu
from diagnosis.contracts import DiagnosisError
from diagnosis.finding import Finding
from diagnosis.systems.fmu.simulator import FmuSimulator
from diagnosis.systems.mapping import read_mapped
from tests.fmu.asked import HERE, altered, build, page_files, save
from tests.refusals import refuses

ROOT = HERE.parents[1]
TIME = np.arange(0.0, 0.5, 0.01)
BOMB = """
[columns]
u = { column = "u", unit = "N" }
y = { column = "y", unit = "N", noise = "0.1 N" }
[fmu]
patience = "2 s"
[fmu.base]
gain = { spread = "0.1" }
[settings]
mood = "0"
"""
MASS = """
[columns]
drive = { column = "F", unit = "kN" }
displacement = { column = "x", unit = "mm" }
[fmu.base]
mass = { spread = "0.1 kg" }
"""


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with FMUs that are not ours."""
    folder = tmp_path_factory.mktemp("strange")
    page_files(folder)
    build(folder / "ShakenMass.py", folder, fmi=3)
    for name in ("Bomb", "TwoTanks"):
        build(HERE / "models" / f"{name}.py", folder)
    wave = np.sin(20.0 * TIME)
    save(folder / "bomb.csv", time=TIME, u=wave, y=wave)
    save(folder / "mass.csv", time=TIME, F=0.01 * wave, x=0.0 * wave)
    return folder


def mapped(folder: Path, data: str, text: str, fmu: str) -> FmuSimulator:
    path = folder / "map.toml"
    path.write_text(text)
    simulator, _ = read_mapped([folder / data], path, str(folder / fmu))
    assert isinstance(simulator, FmuSimulator)
    return simulator


# -- descriptions ------------------------------------------------------------------------------------------------------


def test_an_fmu_is_known_by_its_token_and_its_hash(folder: Path) -> None:
    import hashlib

    fmu = read_fmu(folder / "ShakenMass.fmu")
    assert fmu.version == 3 and fmu.token in fmu.identity
    assert hashlib.sha256((folder / "ShakenMass.fmu").read_bytes()).hexdigest() in fmu.identity
    assert fmu.variables["damping"].unit.si == "N*s/m"
    assert read_fmu(folder / "TwoTanks.fmu").version == 2


@pytest.mark.parametrize(
    ("words", "keep", "message"),
    [
        ({"CoSimulation ": "ModelExchange "}, "", r"for model exchange only .* export the model for co-simulation"),
        ({'fmiVersion="3.0"': 'fmiVersion="1.0"'}, "", r"has FMI version 1.0|is not a readable FMU"),
        ({}, "linux", r"no library for this system, binaries/x86_64-linux/ShakenMass.so; it has x86_64-windows"),
        ({'<BaseUnit m="1"/>': '<BaseUnit factor="0.01" m="1"/>'}, "", r'is in "m", which the FMU defines as 0.01 m'),
        ({"<BaseUnit kg=\"1\" s=\"-2\"/>": '<BaseUnit kg="1" s="-1"/>'}, "", r'"N/m", which the FMU defines as 1 kg/s'),
    ],
)  # fmt: skip
def test_a_description_that_cannot_be_used_is_refused_with_what_would_be_right(
    folder: Path, tmp_path: Path, words: dict[str, str], keep: str, message: str
) -> None:
    bad = altered(
        folder / "ShakenMass.fmu", tmp_path / "bad.fmu", words, lambda name: not keep or keep not in name
    )
    with pytest.raises(FmuError, match=message):
        read_fmu(bad)


def test_what_is_no_fmu_is_refused(tmp_path: Path) -> None:
    (tmp_path / "no.fmu").write_text("nothing")
    with refuses(FmuError, "archive"):
        read_fmu(tmp_path / "no.fmu")
    with refuses(FmuError, "gone.fmu"):
        read_fmu(tmp_path / "gone.fmu")


@pytest.mark.parametrize("name", ["resources/data.bin", "modelDescription.xml"])
def test_a_small_file_that_unpacks_to_much_is_refused(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(input_limits, "UNPACKED_BYTES", 2 * PARSED_BYTES)
    with zipfile.ZipFile(tmp_path / "bomb.fmu", "w", zipfile.ZIP_DEFLATED) as archive:
        for number in range(1 if name == "modelDescription.xml" else 3):
            archive.writestr(name if not number else f"{name}{number}", bytes(PARSED_BYTES + 1))
    assert (tmp_path / "bomb.fmu").stat().st_size < 1 << 20
    for use in (read_fmu, lambda path: unpack_fmu(path, tmp_path / "to")):
        if use is read_fmu or name != "modelDescription.xml":
            with pytest.raises(
                FmuError, match=r"bomb.fmu .*(unpacks to 48|modelDescription.xml with 16) MiB"
            ):
                use(tmp_path / "bomb.fmu")
    assert not (tmp_path / "to").exists()


def test_missing_fmpy_names_the_package_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with refuses(FmuError, "FMUs 'fmpy"):
        read_fmu(tmp_path / "any.fmu")


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("drive =", "drvie =", "columns.drvie ShakenMass.fmu 'drive'"),
        ('unit = "kN"', 'unit = "bar"', 'columns.drive.unit "bar"'),
        ('drive = { column = "F", unit = "kN" }\n', "", "settings.drive"),
        ("mass =", "maas =", "fmu.base.maas ShakenMass.fmu 'mass'"),
        ("mass =", "displacement =", "base.displacement"),
        ('"0.1 kg"', '"0.1 N"', 'fmu.base.mass.spread "0.1 N" "N"'),
        ('"0.1 kg"', '"0 kg"', 'fmu.base.mass.spread "0 kg"'),
        ('"0.1 kg"', '"0.1 kg", low = "11 kg"', "10 kg 11 inf"),
        (
            "[fmu.base]",
            '[fmu.effects.e]\nvariable = "cubic"\ntypical = "1 N/m3"\nlow = "1 N/m3"\n[fmu.base]',
            "effects.e off 0 N/m3 1 inf",
        ),
        ("[fmu.base]", '[fmu]\ngauge = ["drive"]\n[fmu.base]', "fmu.gauge"),
        ("[fmu.base]", '[fmu.measured.mass]\n[fmu.base]', "fmu.measured.mass"),
    ],
)  # fmt: skip
def test_a_map_that_does_not_suit_the_fmu_is_refused(
    folder: Path, before: str, after: str, message: str
) -> None:
    assert before in MASS
    with refuses(DiagnosisError, message):
        mapped(folder, "mass.csv", MASS.replace(before, after), "ShakenMass.fmu")


def test_an_fmu_needs_a_map_and_its_keys_need_an_fmu(folder: Path, tmp_path: Path) -> None:
    with refuses(DiagnosisError, "FMU --map MAP"):
        read_mapped([folder / "mass.csv"], None, str(folder / "ShakenMass.fmu"))
    (tmp_path / "map.toml").write_text('system = "piston"\n' + MASS)
    with refuses(DiagnosisError, "fmu FMU"):
        read_mapped([folder / "mass.csv"], tmp_path / "map.toml")


def test_a_parameter_set_takes_the_place_of_the_fmus_own_values(folder: Path) -> None:
    from diagnosis.systems.fmu.written import _ssv

    fmu = read_fmu(folder / "ShakenMass.fmu")
    (folder / "set.ssv").write_bytes(_ssv(fmu, {"friction": 1.5, "damping": 31.0}))
    text = MASS.replace("[fmu.base]", '[fmu]\nparameters = "set.ssv"\n[fmu.base]')
    simulator = mapped(folder, "mass.csv", text, "ShakenMass.fmu")
    assert simulator.starts(None, {"mass": 11.0}, {}) == {"friction": 1.5, "damping": 31.0, "mass": 11.0}
    (folder / "set.ssv").write_bytes(_ssv(fmu, {"friction": 1.5}).replace(b'unit="N"', b'unit="kN"'))
    with pytest.raises(DiagnosisError, match=r'set.ssv (has friction in "kN", but the FMU in "N"|is no)'):
        mapped(folder, "mass.csv", text, "ShakenMass.fmu")
    (folder / "set.ssv").write_text("<no/>")
    with refuses(DiagnosisError, "fmu.parameters"):
        mapped(folder, "mass.csv", text, "ShakenMass.fmu")


# -- simulations -------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mood", "message"),
    [
        (1, "(SIGSEGV) doStep 0.15 s"),
        (2, "2 s doStep 0.15 s"),
        (3, "Bomb.fmu doStep 0.15 s fmi2DoStep"),
        (4, "simulated"),
        (5, "nan 0.16 s"),
    ],
)  # fmt: skip
def test_a_faulty_fmu_is_reported_and_other_results_are_kept(folder: Path, mood: int, message: str) -> None:
    with refuses(DiagnosisError, message):
        mapped(folder, "bomb.csv", BOMB.replace('"0"', f'"{mood}"'), "Bomb.fmu")
    mapped(folder, "bomb.csv", BOMB, "Bomb.fmu")


@pytest.mark.slow
def test_a_fixed_step_is_kept(folder: Path, tmp_path: Path) -> None:
    words = {
        'canHandleVariableCommunicationStepSize="true"': 'canHandleVariableCommunicationStepSize="false"',
        "<ModelVariables>": '<DefaultExperiment stepSize="0.004"/><ModelVariables>',
    }
    altered(folder / "Bomb.fmu", folder / "Fixed.fmu", words)
    with refuses(DiagnosisError, "step 0.004 s 0.01 s whole"):
        mapped(folder, "bomb.csv", BOMB, "Fixed.fmu")
    mapped(folder, "bomb.csv", BOMB.replace("[fmu]", '[time]\nstep = "8 ms"\n[fmu]'), "Fixed.fmu")
    with refuses(DiagnosisError, "step 0.003 s 0.01 s"):
        mapped(folder, "bomb.csv", BOMB.replace("[fmu]", '[fmu]\nstep = "3 ms"'), "Bomb.fmu")


@pytest.mark.slow
def test_a_step_that_shows_is_doubted(folder: Path) -> None:
    drive = 30.0 * np.sin(30.0 * TIME)
    save(folder / "fast.csv", time=TIME, F=drive, x=0.0 * drive)
    text = MASS.replace('"kN"', '"N"').replace('unit = "mm"', 'unit = "mm", noise = "0.01 mm"')
    told = []
    for step in ("10 ms", "0.5 ms"):
        path = folder / "map.toml"
        path.write_text(text.replace("[fmu.base]", f'[fmu]\nstep = "{step}"\n[fmu.base]'))
        _, data = read_mapped([folder / "fast.csv"], path, str(folder / "ShakenMass.fmu"))
        told.append([one for one in data.doubts if "communication step" in one])
    assert "where the communication step is 0.005 s and not 0.01 s" in told[0][0]
    assert not told[1]


@pytest.mark.slow
def test_the_effect_of_a_step_on_numbers_is_predicted(folder: Path) -> None:
    """A fit with steps of 10 ms to what the same FMU does in steps of 0.5 ms is wrong by what the doubt says."""
    time = np.arange(0.0, 6.0, 0.01)
    drive = 30.0 * np.sin(2.0 * np.pi * np.cumsum(np.linspace(0.5, 6.0, len(time))) * 0.01)
    text = MASS.replace('"kN"', '"N"').replace('unit = "mm"', 'unit = "mm", noise = "0.002 mm"')
    path, file = folder / "map.toml", folder / "swept.csv"
    base = 'damping = { spread = "3 N*s/m" }\nstiffness = { spread = "80 N/m" }\n'
    path.write_text(text.replace("[fmu.base]", f'[fmu]\nstep = "10 ms"\n[fmu.base]\n{base}'))
    save(file, time=time, F=drive, x=0.0 * drive)
    simulator, data = read_mapped([file], path, str(folder / "ShakenMass.fmu"))
    experiment = data.runs[0].experiment
    right = simulator.with_step(5e-4).run(experiment, {}, {})
    save(file, time=time, F=drive, x=1e3 * right[:, 0])
    simulator, data = read_mapped([file], path, str(folder / "ShakenMass.fmu"))
    names = [one.name for one in simulator.nuisances]
    nominal = np.array([one.nominal for one in simulator.nuisances])

    def missed(parts: np.ndarray) -> np.ndarray:
        values = dict(zip(names, (nominal * (1.0 + parts)).tolist(), strict=True))
        return (simulator.run(experiment, values, {}) - right)[:, 0] / 2e-6

    fitted = least_squares(missed, np.zeros(len(names)), x_scale=1e-3, diff_step=1e-4).x
    (doubt,) = (one for one in data.doubts if "the fitted parameters of ShakenMass.fmu" in one)
    content = {name: 1e-2 * float(size) for name, size in re.findall(r"(\w+) by (\S+) %", doubt)}
    assert set(content) == set(names)
    assert [content[name] for name in names] == pytest.approx(fitted.tolist(), rel=0.1)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_page_does_what_it_says(folder: Path, tmp_path: Path) -> None:
    page_files(tmp_path)
    shutil.copy(folder / "ShakenMass.fmu", tmp_path)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    names = [f"run{k}.csv" for k in range(5)]
    for command in (
        ["measure.py"],
        ["-m", "astb", "diagnose", *names, "--simulator", "ShakenMass.fmu", "--map", "shaken.toml", "--out", "out"],
    ):  # fmt: skip
        done = subprocess.run(
            [sys.executable, *command],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
    doubt, _, wrong, *_ = done.stdout.splitlines()
    assert doubt.startswith("doubtful: "), done.stdout
    assert "communication step of 0.005 s" in doubt and "mass by -0.07" in doubt, done.stdout
    assert "There is dry friction" in wrong and ": 1.49" in wrong, done.stdout
    finding = Finding.from_json((tmp_path / "out" / "finding.json").read_bytes())
    assert finding.names == ("friction",)
    assert finding.provenance.identity == read_fmu(folder / "ShakenMass.fmu").identity
    (gain,) = (one for one in finding.gains if one.channel == "all")
    assert gain.noise_ratio is not None and 0.9 < gain.noise_ratio < 1.1
    assert finding.provenance.identity in (tmp_path / "out" / "report.html").read_text()
    _another_tool_reads(tmp_path, finding)


def _another_tool_reads(folder: Path, finding: Finding) -> None:
    """FMPy reads the parameter set, and simulates the measured runs with it."""
    from fmpy import simulate_fmu
    from fmpy.ssp.ssd import read_ssv

    found = {
        one.name: float(one.value) for one in read_ssv(str(folder / "out" / "parameters.ssv")).parameters
    }
    assert found["friction"] == pytest.approx(finding.models.effects["friction"]["friction"])
    table = np.genfromtxt(folder / "run4.csv", delimiter=",", names=True)
    drive = np.rec.fromarrays((table["time"], table["drive"]), names=("time", "drive"))
    result = simulate_fmu(
        str(folder / "ShakenMass.fmu"), stop_time=14.99, output_interval=2.5e-4,
        start_values=found, input=drive, output=["displacement"],
    )  # fmt: skip
    error = result["displacement"][::40] - table["displacement"]
    assert np.std(error) < 1.2 * 5e-5
