"""What a library of an extra is for, where it is missing, and what would be right."""

import sys
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner
from packaging.requirements import Requirement

from astb.campaigns.workers import ClusterError, cluster
from astb.cli import commands
from astb.exit_codes import MISUSE
from bench_protocol.extras import EXTRAS, install_command, installed, lacking, requirements
from tests.contracts.test_imports import PACKAGES

ROOT = Path(__file__).resolve().parents[2]
CONFIG = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = CONFIG["project"]


def test_extras_are_those_of_the_project() -> None:
    declared = PROJECT["optional-dependencies"]
    assert set(EXTRAS) | {"dev", "docs"} == set(declared)
    for extra in EXTRAS:
        assert [Requirement(text) for text in requirements(extra)] == list(map(Requirement, declared[extra]))
        assert install_command(extra) == "pip install " + " ".join(f"'{text}'" for text in declared[extra])


def test_packages_of_typed_code_say_so() -> None:
    assert PACKAGES
    assert all((ROOT / folder / "py.typed").exists() for folder in PACKAGES.values())


def test_a_missing_library_is_named_with_what_installs_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert installed("campaign")
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert not installed("campaign")
    sentence = lacking("campaign", "campaigns")
    assert sentence.startswith(
        "campaigns need dask and distributed, which are not installed: pip install 'dask>="
    )
    with pytest.raises(ClusterError) as caught, cluster():
        pass
    assert str(caught.value) == sentence
    monkeypatch.chdir(tmp_path)
    Path("campaign.toml").write_text('plans = ["leak_down"]\n')
    for command in (["campaign", "campaign.toml"], ["paper", "--quick", "--out", "paper"]):
        told = CliRunner().invoke(commands, command)
        assert told.exit_code == MISUSE
        assert install_command("campaign") in told.output
    assert not Path("paper").exists()
