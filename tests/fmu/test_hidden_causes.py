"""Causes in measurements of no FMU: named with their size, or reported as unknown."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from astb.commands.diagnosis import diagnose_command
from diagnosis.finding import Finding, Verdict
from diagnosis.systems.mapping import read_mapped
from tests.fmu import measured
from tests.fmu.asked import HERE, build, save
from tests.fmu.measured import ACTUATOR, ANY_FLOW, OVERFLOW, ROLES, SEEP, TANKS

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

BOTH = TANKS + OVERFLOW + SEEP


def diagnosed(folder: Path, model: str, fmi: int, files: list[Path], text: str) -> Finding:
    """What the command says; of the report alone the FMU is needed, not this process."""
    build(HERE / "models" / f"{model}.py", folder, fmi)
    (folder / "map.toml").write_text(f'simulator = "{model}.fmu"\n{text}{ROLES}')
    done: Result = CliRunner().invoke(
        diagnose_command, [*map(str, files), "--map", str(folder / "map.toml"), "--out", str(folder / "out")]
    )
    assert done.exit_code == 0, done.output
    return Finding.from_json((folder / "out" / "finding.json").read_bytes())


def noise_ratio(finding: Finding) -> float:
    (gain,) = (one for one in finding.gains if one.channel == "all")
    assert gain.noise_ratio is not None and gain.noise_ratio_before is not None
    return gain.noise_ratio


@pytest.mark.parametrize(
    ("hidden", "cause", "size"),
    [({"overflow": 0.003}, "overflow", 0.003), ({"overflow": 0.0, "seep": 2e-4}, "seep", 2e-4)],
    ids=["overflow", "seep"],
)
def test_causes_in_two_tanks_are_named(
    tmp_path: Path, hidden: dict[str, float], cause: str, size: float
) -> None:
    finding = diagnosed(tmp_path, "TwoTanks", 2, measured.tanks(tmp_path, **hidden), BOTH)
    assert finding.names == (cause,) and finding.verdict is Verdict.NAMED
    (amplitude, *shapes) = finding.causes[0].parameters
    assert amplitude.value == pytest.approx(size, abs=3.0 * (amplitude.sd or 0.0))
    assert amplitude.sd is not None and amplitude.sd < 0.1 * size
    for edge in shapes:
        assert edge.value == pytest.approx(0.45, abs=0.005)
    assert noise_ratio(finding) < 1.05


def test_an_unlisted_cause_is_unknown_and_located(tmp_path: Path) -> None:
    files = measured.tanks(tmp_path, overflow=0.003)
    finding = diagnosed(tmp_path, "TwoTanks", 2, files, TANKS + SEEP + ANY_FLOW)
    assert finding.verdict is Verdict.UNKNOWN and finding.names == ()
    (unknown,) = (one for one in finding.unknowns if one.kept)
    assert unknown.surface == "flow over upper and lower"
    (gain,) = (one for one in finding.gains if one.channel == "all")
    assert gain.noise_ratio is not None and gain.noise_ratio_before is not None
    assert gain.noise_ratio < 0.6 * gain.noise_ratio_before


@pytest.mark.parametrize(
    ("hidden", "cause", "size", "within"),
    [
        ({"leak": 0.05}, "leak", 0.05, 0.001),
        ({"seal": 6.0}, "seal", 6.0, 0.1),
        ({"late": 0.015}, "latency.force", 15.0, 0.2),
        ({}, "", 0.0, 0.0),
    ],
    ids=["leak", "seal", "late", "nothing"],
)
def test_an_actuator(
    tmp_path: Path, hidden: dict[str, float], cause: str, size: float, within: float
) -> None:
    finding = diagnosed(tmp_path, "Actuator", 3, measured.actuator(tmp_path, **hidden), ACTUATOR)
    assert finding.names == ((cause,) if cause else ())
    assert finding.verdict is (Verdict.NAMED if cause else Verdict.NO_EFFECT)
    if cause:
        assert finding.causes[0].parameters[0].value == pytest.approx(size, abs=within)
        assert noise_ratio(finding) < 1.05
    assert "sha256" in json.loads((tmp_path / "out" / "finding.json").read_text())["provenance"]["identity"]


def test_a_saved_state_gives_the_same_as_the_way_there(tmp_path: Path, spring_fmus: dict[int, Path]) -> None:
    """The first simulation is made twice: once on its way through the settling, once from the state saved there."""
    import numpy as np

    time = np.arange(0.0, 1.0, 0.005)
    height = 5e-3 * np.sin(6.0 * time) + 2e-3
    speed = 0.03 * np.cos(6.0 * time)
    save(tmp_path / "a.csv", time=time, z=height, v=speed, F=0.0 * time)
    columns = "".join(
        f'"{name}" = {{ column = "{column}", unit = "{unit}" }}\n'
        for name, column, unit in (
            ("left.height", "z", "m"),
            ("right.height", "z", "m"),
            ("left.height_speed", "v", "m/s"),
            ("right.height_speed", "v", "m/s"),
            ("left.vertical_force", "F", "N"),
        )
    )
    rest = "".join(
        f'"{name}" = "0{unit}"\n'
        for name, unit in (
            ("springs.lateral", " m"),
            ("springs.lateral_speed", " m/s"),
            ("springs.lateral_acceleration", " m/s2"),
            *((f"{side}.height_acceleration", " m/s2") for side in ("left", "right")),
            *((f"{side}.{what}", "") for side in ("left", "right") for what in ("leveling", "service_valve")),
            *((f"air.{one}", "") for one in ("left_reservoir", "right_reservoir", "dpv")),
            ("supply.open", ""),
        )
    )
    base = '[fmu.base]\n"left.orifice_diameter" = { spread = "5 %" }\n'
    text = f'[columns]\n{columns}[fmu]\nsettle = "200 ms"\n{base}[settings]\n{rest}'
    forces = []
    for fmi in (2, 3):
        (tmp_path / "map.toml").write_text(text)
        simulator, data = read_mapped([tmp_path / "a.csv"], tmp_path / "map.toml", str(spring_fmus[fmi]))
        forces.append(simulator.run(data.runs[0].experiment, {}, {}))
    assert np.ptp(forces[0]) > 1e3 and forces[0].tobytes() == forces[1].tobytes()
