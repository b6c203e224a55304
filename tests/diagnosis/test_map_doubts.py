"""Maps that cannot be right: every wrong sign and reading of measured data is doubted, the right maps are not."""

from pathlib import Path

import numpy as np
import pytest

from diagnosis.contracts import DiagnosisError
from diagnosis.systems.mapping import read_mapped
from tests.refusals import refuses

DEMOS = Path(__file__).parents[2] / "astb" / "data" / "demos"
MAPS = {name: (DEMOS / name / f"{name}.toml").read_text(encoding="utf-8") for name in ("piston", "chamber")}
TURN_X = ('displacement = { column = 5, unit = "mm"', 'displacement = { column = 5, unit = "mm", sign = -1')
TURN_F = ('force = { column = 7, unit = "N"', 'force = { column = 7, unit = "N", sign = -1')
ABSOLUTE = ('reading = "gauge"', 'reading = "absolute"')
WORK = "columns.force.sign or columns.displacement.sign may be wrong: a loop delivers"
FORCE = "columns.force.sign = -1 may be wrong: with 1 the error of the simulation in force would be 0.0"
PRESSURE = (
    'columns.pressure.reading = "absolute" may be wrong: '
    'with "gauge" the error of the simulation in force would be 0.1'
)
BELOW = "columns.pressure.reading may be wrong: its lowest pressure lies 0.92"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("system", "data", "changes", "doubts"),
    [
        ("piston", "friction__PK_*", (), []),
        ("piston", "friction__NAPN_*", (), []),
        ("piston", "friction__O-ring_*", (), []),
        ("chamber", "chamber__Aluminium*", (), []),
        ("chamber", "chamber__Ultimaker*", (), []),
        ("piston", "friction__PK_*", (TURN_X,), [WORK]),
        ("piston", "friction__PK_*", (TURN_F,), [WORK, FORCE]),
        ("piston", "friction__NAPN_*", (TURN_X, TURN_F), [FORCE]),
        ("piston", "friction__NAPN_*", (ABSOLUTE,), [PRESSURE]),
        ("chamber", "chamber__Ultimaker*", (ABSOLUTE,), [BELOW]),
    ],
)
def test_only_implausible_values_are_doubted(
    system: str, data: str, changes: tuple[tuple[str, str], ...], doubts: list[str], tmp_path: Path
) -> None:
    text = MAPS[system]
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    mapping = tmp_path / "map.toml"
    mapping.write_text(text, encoding="utf-8")
    _, dataset = read_mapped(sorted(DEMOS.rglob(data)), mapping)
    assert len(dataset.doubts) == len(doubts), dataset.doubts
    for said, start in zip(dataset.doubts, doubts, strict=True):
        assert said.startswith(start)


def test_a_column_without_numbers_is_doubted_in_one_file_and_refused_in_all(tmp_path: Path) -> None:
    time = np.arange(0.0, 20.0, 0.1)
    for name, there in (("a", True), ("b", False)):
        rows = [f"{t:.1f},{7.0 - 0.01 * t},{290.0 if there else ''}" for t in time]
        (tmp_path / f"{name}.csv").write_text("time,p,T\n" + "\n".join(rows), encoding="utf-8")
    mapping = tmp_path / "map.toml"
    mapping.write_text(
        'system = "chamber"\n[settings]\nvolume = "1 litre"\n[columns]\ntemperature = { column = "T", unit = "K" }\n'
        'pressure = { column = "p", unit = "bar", reading = "gauge" }\n',
        encoding="utf-8",
    )
    paths = [tmp_path / "a.csv", tmp_path / "b.csv"]
    _, dataset = read_mapped(paths, mapping)
    assert dataset.doubts == (
        "columns.temperature has no number in b: the simulation is not compared with it there",
    )
    with refuses(DiagnosisError, "columns.temperature"):
        read_mapped(paths[1:], mapping)


#: A displacement at rest: a constant, noise of a laser, the last bit of a converter.
STILL = {
    "constant": lambda rng, n: np.zeros(n),
    "noise": lambda rng, n: 0.01 * rng.standard_normal(n),
    "last bit": lambda rng, n: 0.01 * (rng.random(n) < 0.1),
}
PRESSED = """system = "piston"
[settings]
bore = "24 mm"
stroke_from = "-3 mm"
stroke_to = "37 mm"
[columns]
displacement = { column = "x", unit = "mm" }
pressure = { column = "p", unit = "bar", reading = "gauge" }
force = { column = "f", unit = "N" }
"""


@pytest.mark.parametrize("kind", STILL)
@pytest.mark.parametrize("sign", [1, -1])
def test_at_most_one_sign_is_doubted_at_constant_displacement(kind: str, sign: int, tmp_path: Path) -> None:
    """The sign of a force is known from pressure times area; that of a constant displacement is unknown."""
    mapping = tmp_path / "map.toml"
    mapping.write_text(PRESSED, encoding="utf-8")
    time = np.arange(0.0, 10.0, 0.02)
    pressure = 3.0 + 2.0 * np.sin(0.8 * time)
    for seed in range(2):
        rng = np.random.default_rng(seed)
        paths = []
        for run in range(3):
            x = 20.0 * (seed % 2) + STILL[kind](rng, len(time))
            force = sign * (1e5 * pressure * 0.25 * np.pi * 0.024**2 + 3.0) + 0.1 * rng.standard_normal(
                len(time)
            )
            paths.append(tmp_path / f"run{run}.csv")
            table = np.column_stack((time, x, pressure, force))
            np.savetxt(paths[-1], table, delimiter=",", header="time,x,p,f", comments="")
        _, dataset = read_mapped(paths, mapping)
        assert [doubt.split(" may be")[0] for doubt in dataset.doubts] == ["columns.force.sign = 1"] * (
            sign < 0
        )
