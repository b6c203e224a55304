"""What programs and shells read of `astb`: JSON instead of tables, completion, and what it says of the machine."""

import json
import os
import socket
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

from astb.doctor import examine_machine
from astb.exit_codes import BLOCKED, PASS
from astb.rig_file import read

RIG = 'name = "here"\n[can]\nbus = "tcp"\nport = {}\n[modbus]\nport = {}\n'


@pytest.fixture
def cli(astb_here, tmp_path):
    """Run ``astb`` with arguments in an empty directory: exit code, stdout, stderr."""
    return lambda *arguments: astb_here(tmp_path, *arguments)


@pytest.fixture
def rig(tmp_path):
    """A rig file whose two ports are free, with these ports."""
    with socket.create_server(("127.0.0.1", 0)) as one, socket.create_server(("127.0.0.1", 0)) as other:
        ports = one.getsockname()[1], other.getsockname()[1]
    path = tmp_path / "rig.toml"
    path.write_text(RIG.format(*ports))
    return path, *ports


def findings(path: Path) -> dict[str, tuple[str, str]]:
    return {one.name: (one.state, one.found) for one in examine_machine(read(path), path.parent / "runs")}


@pytest.mark.parametrize("command", ["plans", "list specimens", "list effects", "rig signals"])
def test_a_list_says_the_same_names_to_programs_as_to_people(cli, command: str) -> None:
    status, text, _ = cli(*command.split(), "--json")
    assert status == PASS
    content = json.loads(text)
    names = [row["name"] for row in (content["signals"] if command == "rig signals" else content)]
    said = cli(*command.split())[1]
    first = [line.split()[0] for line in said.splitlines() if not line.startswith(" ")]
    if command == "rig signals":
        assert content["map"] in said
        first = first[1:]
    if command == "plans":  # in two groups, each in the order of its names
        names, first = sorted(names), sorted(line.split()[0] for line in said.splitlines() if line[0] == " ")
    assert names == first


def test_parameters_of_a_plan_are_printed_as_typed(cli) -> None:
    (plan,) = json.loads(cli("plans", "lateral_stiffness", "--json")[1])
    by_name = {one["name"]: one for one in plan["parameters"]}
    assert by_name["amplitude"] == {"name": "amplitude", "default": "10 mm", "allowed": "2 to 20 mm"}


def complete(*words: str) -> list[str]:
    """What bash offers for the last of ``words``."""
    environment = os.environ | {
        "COMP_WORDS": " ".join(words),
        "COMP_CWORD": str(len(words) - 1),
        "_ASTB_COMPLETE": "bash_complete",
    }
    command = [Path(sys.executable).parent / "astb"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=True)
    assert not done.stderr
    return [line.partition(",")[2] for line in done.stdout.splitlines()]


@pytest.mark.slow
def test_the_shell_completes_plans_parameters_and_effects() -> None:
    assert "aw0" in complete("astb", "run", "a")
    assert complete("astb", "run", "lateral_stiffness", "--set", "load") == ["load=AW0", "load=AW3"]
    assert {text.partition("=")[0] for text in complete("astb", "run", "lateral_stiffness", "--set", "")} == {
        "load",
        "amplitude",
        "offset",
    }
    assert complete("astb", "run", "--effect", "leak.l") == ["leak.left="]


def test_bash_takes_the_script(cli) -> None:
    status, script, _ = cli("completion", "bash")
    assert status == PASS
    subprocess.run(["bash", "-n"], input=script, text=True, timeout=10, check=True)


def test_a_program_at_a_needed_port_is_reported(rig) -> None:
    path, can, modbus = rig
    before = findings(path)
    assert before[f"CAN hub 127.0.0.1:{can}"] == ("fine", "free")
    with socket.create_server(("127.0.0.1", can)):
        after = findings(path)
    assert after[f"CAN hub 127.0.0.1:{can}"] == ("missing", "used by another program")
    assert after[f"Modbus 127.0.0.1:{modbus}"] == ("fine", "free")


def test_a_package_of_a_wrong_version_breaks_the_bench(monkeypatch, rig) -> None:
    known = metadata.requires("astb")
    assert findings(rig[0])["packages"][0] == "fine"
    monkeypatch.setattr(metadata, "requires", lambda name: [*known, "numpy<1", "no-such-package>=2"])
    state, said = findings(rig[0])["packages"]
    assert state == "broken"
    assert f"numpy {metadata.version('numpy')} (required: <1)" in said
    assert "no-such-package is missing" in said


def test_doctor_reports_faults_and_remedies(cli, rig) -> None:
    status, text, _ = cli("doctor", "--rig", str(rig[0]), "--json")
    assert status == PASS
    assert all(row["mend"] for row in json.loads(text) if row["state"] != "fine")
    status, text, _ = cli("doctor", "--out", "/proc/none", "--json")
    assert status == BLOCKED
    assert [row["name"] for row in json.loads(text) if row["state"] == "broken"] == [
        "disk space in /proc/none"
    ]
