"""The import contracts hold, and each of them is seen to bite when it is broken on purpose."""

import json
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).resolve().parents[2]
CONFIG = tomllib.loads((ROOT / "pyproject.toml").read_text())
CONTRACTS = CONFIG["tool"]["importlinter"]["contracts"]
PACKAGES = {
    name: Path("studies" if name == "astb_studies" else "") / name
    for name in CONFIG["tool"]["importlinter"]["root_packages"]
}
"""Each package and its folder, relative to the root."""

LAYERS = "Imports go down; drivers, records and rig are apart"
APART = "In astb: acceptance, campaigns, fmu, panel and watch stay apart, above the rest"
CIRCLES = "No circles, types included"
INSIDE = "Inside the rig: shell, then FMUs and parameters, then model"
PLANS = "Test plans reach the rig only through drivers"
REPLAY = "The diagnosis replays the model: it never sees the rig or the drivers"
DIAGNOSIS = "Inside the diagnosis: twin, then systems and report, then engine, then its contracts"
STUDY = "Inside the paper's study: command, page, pictures, results, checks, experiments, plans"
ENGINE = "The engine of the diagnosis reads no files and knows no bench"
PURE = "The model is pure: no time, no chance, no I/O"
CLOCK = "One clock: only bench_protocol.clock imports time"
PROTOCOL = "The protocol is bytes in, bytes out: no sockets"
RIG = "The rig is sans-IO: only its servers and its SocketCAN interface know sockets"
CAN = "python-can belongs to the drivers"
MODBUS = "pymodbus belongs to drivers.modbus_line and modbus_port"
DASK = "dask belongs to astb.campaigns"
MQTT = "aiomqtt belongs to astb.panel.mqtt_publisher"
OPCUA = "asyncua belongs to drivers.wiring.opcua and astb.panel.opcua_server"

HIDDEN = "def hidden():\n    {}\n"
"""An import inside a function is an import all the same."""

TYPE_ONLY = "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    {}\n"
"""So is one for the eyes of the type checker alone."""

ENVIRONMENT = {"COLUMNS": "200", "NO_COLOR": "1"}

SABOTAGE = [
    (LAYERS, "bench_protocol/__init__.py", "import drivers"),
    (LAYERS, "drivers/__init__.py", "import bench_sim.rig"),
    (LAYERS, "bench_sim/rig/__init__.py", "import drivers"),
    (LAYERS, "bench_records/__init__.py", HIDDEN.format("from bench_sim import rig")),
    (LAYERS, "drivers/__init__.py", "import bench_records"),
    (LAYERS, "test_plans/__init__.py", "import astb"),
    (LAYERS, "astb/__init__.py", HIDDEN.format("import astb_studies.paper")),
    (APART, "astb/session.py", HIDDEN.format("import astb.acceptance")),
    (APART, "astb/commands/run.py", HIDDEN.format("import astb.panel")),
    (APART, "astb/acceptance/__init__.py", "import astb.panel"),
    (LAYERS, "diagnosis/__init__.py", "from astb_studies.paper import subject"),
    (CIRCLES, "astb/session.py", "from astb.run import run_plans"),
    (CIRCLES, "drivers/settings.py", HIDDEN.format("from drivers.link import Link")),
    (
        CIRCLES,
        "studies/astb_studies/paper/bench_results.py",
        TYPE_ONLY.format("from astb_studies.paper.study import Study"),
    ),
    (CIRCLES, "test_plans/run.py", TYPE_ONLY.format("from test_plans.plan import Plan")),
    (INSIDE, "bench_sim/model/__init__.py", "import bench_sim.parameters"),
    (INSIDE, "bench_sim/parameters/__init__.py", HIDDEN.format("from bench_sim import rig")),
    (INSIDE, "bench_sim/newcomer.py", '"""A module that no layer knows."""'),
    (PLANS, "test_plans/__init__.py", "import bench_sim.model"),
    (PLANS, "test_plans/__init__.py", HIDDEN.format("from bench_sim import parameters")),
    (PLANS, "studies/astb_studies/paper/plans/__init__.py", "import bench_sim.model"),
    (REPLAY, "diagnosis/systems/__init__.py", "import bench_sim.rig"),
    (REPLAY, "diagnosis/systems/__init__.py", HIDDEN.format("from drivers import bench")),
    (DIAGNOSIS, "diagnosis/engine/__init__.py", "import diagnosis.systems"),
    (DIAGNOSIS, "diagnosis/contracts.py", HIDDEN.format("from diagnosis import engine")),
    (DIAGNOSIS, "diagnosis/newcomer.py", '"""A module that no layer knows."""'),
    (
        STUDY,
        "studies/astb_studies/paper/checks/gas.py",
        HIDDEN.format("from astb_studies.paper.study import Study"),
    ),
    (STUDY, "studies/astb_studies/paper/newcomer.py", '"""A module that no layer knows."""'),
    (ENGINE, "diagnosis/engine/__init__.py", "import bench_sim.model"),
    (ENGINE, "diagnosis/contracts.py", HIDDEN.format("import bench_records")),
    (PURE, "bench_sim/model/__init__.py", "import random"),
    (PURE, "bench_sim/model/__init__.py", "import threading"),
    (PURE, "bench_sim/model/__init__.py", HIDDEN.format("from pathlib import Path")),
    (PURE, "bench_sim/model/__init__.py", HIDDEN.format("from bench_protocol import clock")),
    (CLOCK, "bench_sim/rig/__init__.py", "from time import monotonic_ns"),
    (CLOCK, "drivers/__init__.py", HIDDEN.format("import time")),
    (CLOCK, "astb/__init__.py", "import time as wall"),
    (CLOCK, "studies/astb_studies/paper/__init__.py", "import time"),
    (PROTOCOL, "bench_protocol/__init__.py", "import socket"),
    (RIG, "bench_sim/rig/__init__.py", HIDDEN.format("import asyncio")),
    (RIG, "bench_sim/rig/tick.py", "import socket"),
    (CAN, "test_plans/__init__.py", "import can"),
    (CAN, "bench_records/__init__.py", HIDDEN.format("from can import Message")),
    (MODBUS, "drivers/__init__.py", "from pymodbus.client import ModbusTcpClient"),
    (MODBUS, "test_plans/__init__.py", HIDDEN.format("import pymodbus")),
    (APART, "astb/__init__.py", HIDDEN.format("import astb.campaigns")),
    (DASK, "studies/astb_studies/paper/__init__.py", HIDDEN.format("from distributed import Client")),
    (MQTT, "astb/panel/__init__.py", "import paho.mqtt.client"),
    (OPCUA, "drivers/bench.py", HIDDEN.format("import asyncua")),
]
"""(the contract that must go red, the file, the line added to it)."""


def sources(package: str) -> Iterator[Path]:
    """The package's Python files, relative to the root."""
    return (path.relative_to(ROOT) for path in sorted((ROOT / PACKAGES[package]).rglob("*.py")))


def reported(code: int, said: str) -> set[str]:
    """Return the names of the contracts that lint-imports reports as broken."""
    assert "Contracts:" in said, said
    found = set(re.findall(r"^(.+) BROKEN", said, flags=re.MULTILINE))
    assert code == bool(found), said
    return found


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of every package, with the project's own contracts, to break things in."""
    copy = tmp_path_factory.mktemp("tree")
    shutil.copy(ROOT / "pyproject.toml", copy)
    for package in PACKAGES:
        for path in sources(package):
            (copy / path).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / path, copy / path)
    return copy


#: Breaks the tree in the working directory in several ways, and prints the linter's answer to each.
SABOTEUR = """
import contextlib, io, json, pathlib, sys
from importlinter.cli import lint_imports
said = []
for path, line in json.load(sys.stdin):
    victim = pathlib.Path(path)
    before = victim.read_text() if victim.exists() else None
    victim.write_text(f"{before or ''}\\n{line}\\n")
    with contextlib.redirect_stdout(io.StringIO()) as out:
        code = lint_imports(no_cache=True)
    said.append((code, out.getvalue()))
    victim.unlink() if before is None else victim.write_text(before)
json.dump(said, sys.stdout)
"""


@pytest.fixture(scope="module")
def broken(tree: Path) -> dict[tuple[str, str], set[str]]:
    """Which contracts are broken by each sabotage: all in one process, as starting it takes longer than the work."""
    acts = [(path, line) for _, path, line in SABOTAGE]
    run = subprocess.run(
        [sys.executable, "-c", SABOTEUR],
        cwd=tree,
        env=ENVIRONMENT | {"PYTHONPATH": f"{tree}:{tree / 'studies'}"},
        input=json.dumps(acts),
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    return {act: reported(*said) for act, said in zip(acts, json.loads(run.stdout), strict=True)}


def test_the_tree_keeps_every_contract(tree: Path) -> None:
    run = subprocess.run(
        [sys.executable, "-c", "from importlinter.cli import lint_imports_command as c; c()", "--no-cache"],
        cwd=tree,
        env=ENVIRONMENT | {"PYTHONPATH": f"{tree}:{tree / 'studies'}"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert reported(run.returncode, run.stdout + run.stderr) == set()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("contract", "act"),
    [pytest.param(name, (path, line), id=f"{path}: {line.strip()}") for name, path, line in SABOTAGE],
)
def test_a_broken_contract_is_named(contract: str, act: tuple[str, str], broken: dict) -> None:
    assert contract in broken[act]


def test_every_contract_is_broken_on_purpose() -> None:
    assert {contract["name"] for contract in CONTRACTS} == {name for name, _, _ in SABOTAGE}


def test_the_layers_are_exhaustive() -> None:
    """import-linter cannot see a new package at the root: every list of packages must name the same ones."""
    on_disk = {top.parent.name for top in (*ROOT.glob("*/__init__.py"), *ROOT.glob("studies/*/__init__.py"))}
    layers = next(contract["layers"] for contract in CONTRACTS if contract["name"] == LAYERS)
    packaged = CONFIG["tool"]["setuptools"]["packages"]["find"]["include"]
    assert sorted(packaged) == sorted(
        f"{name}{end}" for name in set(PACKAGES) - {"astb_studies"} for end in ("", ".*")
    )
    assert on_disk == set(PACKAGES)
    assert {name.strip() for layer in layers for name in layer.split("|")} == set(PACKAGES)
    typed = {"astb_studies.mutations", "astb_studies.oscillator", "astb_studies.paper", "tools.generate"}
    assert set(CONFIG["tool"]["mypy"]["packages"]) == {*PACKAGES, *typed} - {"astb_studies"}


@pytest.mark.parametrize(
    ("path", "line", "rule"),
    [
        ("bench_sim/model/chance.py", "import numpy as np\n\nnp.random.normal()", "TID251"),
        ("bench_sim/model/files.py", 'open("noise.txt")', "PTH123"),
        ("astb/heavy.py", "import pandas\n\npandas.DataFrame()", "TID253"),
        ("bench_records/heavy.py", "from matplotlib import pyplot\n\npyplot.plot()", "TID253"),
    ],
)
def test_ruff_holds_what_import_linter_cannot_see(tree: Path, path: str, line: str, rule: str) -> None:
    """Parts of packages (numpy.random), builtins (open), and heavy imports that would slow `astb --help`."""
    (tree / path).write_text(f'"""Broken on purpose."""\n\n{line}\n')
    try:
        run = subprocess.run(
            [sys.executable, "-m", "ruff", "check", "--no-cache", "--output-format=concise", path],
            cwd=tree,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    finally:
        (tree / path).unlink()
    assert run.returncode == 1, run.stdout + run.stderr
    assert f"{path}:" in run.stdout and rule in run.stdout


def circles(graph: grimp.ImportGraph) -> list[set[str]]:
    """Return the modules that import one another, in groups: each can reach all others of its group."""
    below = {module: graph.find_upstream_modules(module) for module in graph.modules}
    return [
        group
        for module in sorted(graph.modules)
        if (group := {module} | {other for other in below[module] if module in below[other]}) != {module}
        and module == min(group)
    ]


def test_no_package_imports_a_part_that_imports_it() -> None:
    """Not covered by the contract of siblings: a package's own file and the files in its folder."""
    graph = grimp.build_graph(*PACKAGES, cache_dir=None)
    assert circles(graph) == []
    graph.add_import(importer="bench_sim.parameters.effects", imported="bench_sim.parameters")
    assert {"bench_sim.parameters", "bench_sim.parameters.effects"} <= circles(graph)[0]
