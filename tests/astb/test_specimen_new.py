"""A specimen with another preload: the model gives the expected values, and a sound spring passes."""

import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner

from astb.commands.named import copy_command
from astb.rig_in_memory import RigInMemory
from astb.specimen_new import Asked, derive
from bench_protocol.units import kN
from bench_records.result import Result
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.specimen import ordinary, read_specimen


def run(folder: Path, specimen: Path) -> Result:
    """Run `aw0` on a sound rig with other sensors than those of which limits were derived."""
    rig = RigInMemory(Rig(load("astb"), seed=3))
    with rig.bench(seed=3) as bench:
        return execute(plans()["aw0"], bench, folder, rig="virtual", seed=3, specimen=read_specimen(specimen))


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_sound_spring_under_another_preload_passes(tmp_path: Path) -> None:
    left_out = derive(Asked(preloads={"AW0": 45 * kN}), tmp_path / "mine.toml", print)
    mine, usual = read_specimen(tmp_path / "mine.toml"), ordinary()
    assert mine.load("AW0").preload == pytest.approx(45 * kN)
    assert mine.load("AW3").limits.bands == usual.load("AW3").limits.bands
    result = run(tmp_path / "run", tmp_path / "mine.toml")
    assert result.verdict == "pass", [
        (one.name, one.value, one.low, one.high) for one in result.checks if not one.passed
    ]
    # Softer, as it is emptier; and by the same part as wide.
    now, then = (one.load("AW0").limits.curve("vertical_stiffness") for one in (mine, usual))
    for place, band in now.items():
        assert 0.75 < band.high / then[place].high < 0.98
        assert band.high / band.low == pytest.approx(then[place].high / then[place].low)
    entries = tomllib.loads((tmp_path / "mine.toml").read_text())["load_case"]["AW0"]
    assert entries["limits"]["vertical_secant"]["provenance"] == "derived"
    stated = set(usual.load("AW0").limits.bands) | set(usual.load("AW0").limits.curves)
    kept = set(mine.load("AW0").limits.bands) | set(mine.load("AW0").limits.curves)
    assert {f"load_case.AW0.limits.{name}" for name in stated - kept} == set(left_out)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["astb"], "TARGET"),
        (["astb", "mine.toml", "--plan", "aw0"], "--plan needs"),
        (
            ["astb", "mine.toml", "--preload", "AW0=45 bar"],
            "--preload AW0 = '45 bar' has a missing or wrong unit; use N",
        ),
        (["astb", "mine.toml", "--preload", "AW7=45 kN"], "no load case AW7"),
        (["astb", "mine.toml", "--set", "volume=3 litre"], "--set volume is not a property of a drawing"),
        (["astb", "mine.toml", "--set", "effective_area=-1 m2"], "effective_area=-1 m2 is not plausible"),
        (["astb", "mine.toml", "--preload", "AW0=0 kN"], "AW0=0 kN is not plausible"),
        (
            ["astb", "mine.toml", "--set", "effective_area_slope=-0.2 m", "--preload", "AW7=45 kN"],
            "no load case AW7",
        ),
        (["astb", "mine", "--preload", "AW0=45 kN"], "mine.toml"),
    ],
)
def test_an_unintended_input_is_refused_before_the_run(
    arguments: list[str], told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(copy_command, ["specimen", *arguments])
    assert done.exit_code == 2 and told in done.output, done.output
    assert not list(tmp_path.iterdir())
