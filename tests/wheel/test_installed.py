"""Installed from a wheel and started in an empty directory, the bench does all that it does at home."""

import json
import re
import signal
import socket
import subprocess
import tarfile
import tomllib
import zipfile
from pathlib import Path, PurePosixPath
from urllib.request import urlopen

import pytest

from astb.exit_codes import MISUSE
from tests.wheel.conftest import ROOT, Built, CleanMachine

CONFIG = tomllib.loads((ROOT / "pyproject.toml").read_text())
PACKAGES = {name.partition(".")[0] for name in CONFIG["tool"]["setuptools"]["packages"]["find"]["include"]}
TOLD = "astb/commit.txt"
EVERY_HELP = """
import click
from click.testing import CliRunner
from astb.cli import commands

def visit(command, words):
    told = CliRunner().invoke(commands, [*words, "--help"])
    assert told.exit_code == 0, (words, told.output)
    assert "Usage: " in told.output and "cannot be used" not in told.output, (words, told.output)
    print(*words)
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            visit(command.get_command(context, name), [*words, name])

visit(commands, [])
"""
#: With pytest installed, its plugin and the catalogue are found.
EVERY_MODULE = """
import importlib, pathlib, pkgutil
import {packages}
for package in ({packages}):
    assert pathlib.Path(package.__file__).is_relative_to({environment!r}), package.__file__
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if not module.name.endswith(("__main__", "astb.pytest_plugin", "astb.catalogue")):
            try:
                importlib.import_module(module.name)
            except ModuleNotFoundError as error:
                if error.name != {of_extras}.get(module.name):
                    raise
"""
#: Modules that are imported only where the library of their extra is installed.
OF_EXTRAS = {
    "astb.mcp_server": "mcp",
    "astb.panel.mqtt_publisher": "aiomqtt",
    "astb.panel.opcua_server": "asyncua",
}


def content(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def test_a_wheel_holds_the_files_of_its_packages_and_no_other(built: Built) -> None:
    files = content(built.of_sources)
    held = {name for name in files if ".dist-info/" not in name}
    expected = {name for name in built.tracked if PurePosixPath(name).parts[0] in PACKAGES and "/" in name}
    assert held == expected | {TOLD}
    assert {name: files[name] for name in expected} == {name: (ROOT / name).read_bytes() for name in expected}


def test_a_wheel_installs_no_name_but_those_of_its_packages(built: Built) -> None:
    names = {PurePosixPath(name).parts[0] for name in content(built.of_sources) if ".dist-info/" not in name}
    assert names == PACKAGES


def test_an_sdist_gives_the_same_wheel(built: Built) -> None:
    assert content(built.of_sdist) == content(built.of_sources)
    with tarfile.open(built.sdist) as archive:
        names = {str(PurePosixPath(*PurePosixPath(name).parts[1:])) for name in archive.getnames()}
    assert {"pyproject.toml", "setup.py", "README.md", "LICENSE", "CHANGELOG.md", TOLD} <= names


def test_the_version_states_the_commit(built: Built, clean_machine: CleanMachine) -> None:
    head = subprocess.run(
        ["git", "rev-parse", "HEAD"], cwd=built.source, capture_output=True, text=True, timeout=60, check=True
    ).stdout[:12]
    text = clean_machine.astb("--version").strip()
    assert re.fullmatch(
        rf"astb {re.escape(CONFIG['project']['version'])} \(commit {head}( \+ changes)?\)", text
    ), text


def test_every_module_is_imported_and_every_command_explains_itself(clean_machine: CleanMachine) -> None:
    lines = clean_machine.python(EVERY_HELP).splitlines()
    assert {"run", "panel", "diagnose", "campaign", "rig new", "list"} <= set(lines)
    base = PACKAGES & set(CONFIG["tool"]["importlinter"]["root_packages"])
    environment = str(clean_machine.bin.parent)
    clean_machine.python(
        EVERY_MODULE.format(packages=", ".join(sorted(base)), environment=environment, of_extras=OF_EXTRAS)
    )


def test_names_are_those_of_a_checkout(clean_machine: CleanMachine) -> None:
    data = ROOT / "astb" / "data"
    names = {
        "rigs": [path.parent.name for path in data.glob("rigs/*/rig.toml")],
        "specimens": [path.stem for path in data.glob("specimens/*.toml")],
        "demos": [path.name for path in data.glob("demos/*/")],
    }
    for kind, expected in names.items():
        listed = json.loads(clean_machine.astb("list", kind, "--json"))
        assert [one["name"] for one in listed] == sorted(expected)
    clean_machine.astb("rig", "signals", "--dbc", "astb.dbc", "--csv", "map.csv", "--eds", "astb.eds")


def test_what_needs_an_extra_says_so_and_works_with_it(built: Built, clean_machine: CleanMachine) -> None:
    (clean_machine.here / "few.toml").write_text('plans = ["leak_down"]\nseeds = [3]\n')
    refused = clean_machine.try_astb("campaign", "few.toml")
    assert refused.returncode == MISUSE
    assert re.search(r"need dask and distributed, .*: pip install 'dask>=.*' 'distributed>=", refused.stderr)
    assert "Traceback" not in refused.stderr
    clean_machine.install(f"{built.of_sources}[campaign]")
    assert re.search(
        r"pass\nleak_down +as it is +1\n", clean_machine.astb("campaign", "few.toml", "--workers", "1")
    )


def test_plans_run_in_virtual_time_with_reports(clean_machine: CleanMachine) -> None:
    clean_machine.astb("run", "aw0", "aw3", "--virtual", "--out", "runs/virtual")
    for plan in ("aw0", "aw3"):
        directory = clean_machine.here / "runs" / "virtual" / plan
        page = (directory / "report.html").read_text(encoding="utf-8")
        (directory / "report.html").unlink()
        clean_machine.astb("report", directory)
        assert (directory / "report.html").read_text(encoding="utf-8") == page
        assert "uPlot" in page
    assert "aw3" in clean_machine.astb("runs", "--out", "runs/virtual")


def test_a_report_is_printed_where_a_browser_is(clean_machine: CleanMachine) -> None:
    from bench_records.printing import browser

    if browser() is None:
        pytest.skip("no Chromium")
    clean_machine.astb("report", "runs/virtual/aw0", "--pdf")
    (printed,) = (clean_machine.here / "runs" / "virtual" / "aw0").glob("*.pdf")
    assert printed.read_bytes().startswith(b"%PDF")


def test_measured_data_that_come_along_are_diagnosed(clean_machine: CleanMachine) -> None:
    clean_machine.astb("copy", "demo", "chamber", "chamber")
    clean_machine.astb(
        *(
            "diagnose",
            "chamber/chamber__Ultimaker_015.csv",
            "--map",
            "chamber/chamber.toml",
            "--out",
            "printed",
        )
    )
    assert json.loads((clean_machine.here / "printed" / "finding.json").read_text())
    assert (clean_machine.here / "printed" / "report.html").exists()


def test_a_record_is_diagnosed(clean_machine: CleanMachine) -> None:
    clean_machine.astb(
        "run", "small_fast_sines", "--virtual", "--effect", "leak.left=1mm2", "--out", "runs/leaky"
    )
    clean_machine.astb("diagnose", "runs/leaky/small_fast_sines", "--effects", "leak", "--out", "finding")
    assert json.loads((clean_machine.here / "finding" / "finding.json").read_text())
    assert (clean_machine.here / "finding" / "report.html").exists()


def test_the_machine_is_fit(clean_machine: CleanMachine) -> None:
    found = {one["name"]: one for one in json.loads(clean_machine.astb("doctor", "--json"))}
    assert not [one for one in found.values() if one["state"] == "broken"]
    assert found["packages"]["state"] == found["compiled code"]["state"] == "fine"
    assert str(clean_machine.bin.parent) in found["compiled code"]["found"]


def rig_of_ones_own(clean_machine: CleanMachine) -> Path:
    """Return a copy of the ordinary rig at free ports: another rig may use the ordinary ones."""
    path = clean_machine.here / "mine" / "rig.toml"
    if not path.exists():
        clean_machine.astb("copy", "rig", "local", path.parent)
        with socket.create_server(("127.0.0.1", 0)) as one, socket.create_server(("127.0.0.1", 0)) as other:
            ports = [one.getsockname()[1], other.getsockname()[1]]
        text = path.read_text()
        for was, port in zip((29536, 15020), ports, strict=True):
            assert f"port = {was}" in text
            text = text.replace(f"port = {was}", f"port = {port}")
        path.write_text(text.replace('bus = "auto"', 'bus = "tcp"'))
    return path


def test_a_plan_runs_in_real_time(clean_machine: CleanMachine) -> None:
    clean_machine.astb(
        "run", "lateral_stiffness", "--rig", rig_of_ones_own(clean_machine), "--out", "runs/real"
    )
    assert (clean_machine.here / "runs" / "real" / "lateral_stiffness" / "report.html").exists()


def test_the_panel_serves_its_page_its_script_and_plots(clean_machine: CleanMachine) -> None:
    command = [clean_machine.bin / "astb", "panel", "--port", "0", "--rig", rig_of_ones_own(clean_machine)]
    with subprocess.Popen(
        [*map(str, command), "--out", "runs/virtual"],
        cwd=clean_machine.here,
        env=clean_machine.env | {"PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        text=True,
    ) as panel:
        try:
            assert panel.stdout
            said = iter(panel.stdout.readline, "")
            address = next(found[1] for line in said if (found := re.search(r"to watch: +(\S+)/", line)))

            def served(path: str) -> str:
                with urlopen(f"{address}{path}", timeout=60) as answer:
                    return str(answer.read().decode())

            page = served("/")
            linked = set(re.findall(r'(?:src|href)="(/[^"#]+)"', page))
            assert any(path.endswith(".js") for path in linked) and any(
                path.endswith(".css") for path in linked
            )
            for path in linked:
                assert served(path)
            assert any("uPlot" in served(path) for path in linked)
            for name in sorted(path.name for path in (ROOT / "astb" / "panel" / "page").glob("*.js")):
                assert served(f"/page/{name}") == (ROOT / "astb" / "panel" / "page" / name).read_text()
        finally:
            panel.send_signal(signal.SIGINT)
            panel.wait(60)
