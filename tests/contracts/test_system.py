"""What only Linux has is used in one package, and the rest of the house starts without it."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from tests.contracts.test_imports import PACKAGES
from tests.not_linux import MODULES, ONLY_LINUX, ONLY_UNIX

ROOT = Path(__file__).resolve().parents[2]
SHIM = ROOT / "tests" / "not_linux.py"
PLACE = ROOT / "bench_protocol" / "runtime"
#: Modules that only a run in real time loads; their imports exist there.
IN_REAL_TIME = {
    "astb/commands/rig.py",
    "astb/doctor.py",
    "astb/live/door.py",
    "astb/panel/runs.py",
    "bench_protocol/clock.py",
    "bench_sim/rig/capture.py",
    "bench_sim/rig/socketcan.py",
    "drivers/can_port.py",
    "drivers/hub_bus.py",
    # May know nothing of the bench, and has no more than a condition.
    "diagnosis/engine/memory.py",
}
NAMES = {
    (module, name)
    for lacking in (ONLY_LINUX, ONLY_UNIX)
    for module, names in lacking.items()
    for name in names
} | {("sys", "platform"), ("os", "name"), ("ctypes", "CDLL")}


def asked_for(source: str) -> set[str]:
    """Return what a module asks for of what not every system has, by name and without a second thought."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {one.name for one in node.names if one.name in MODULES["win32"]}
        elif isinstance(node, ast.ImportFrom):
            found |= {node.module} & MODULES["win32"]
            found |= {f"{node.module}.{one.name}" for one in node.names if (node.module, one.name) in NAMES}
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            found |= {f"{module}.{name}" for module, name in {(node.value.id, node.attr)} & NAMES}
    return found


def test_what_not_every_system_has_is_asked_for_in_its_places() -> None:
    asking = {
        str(one.relative_to(ROOT)): found
        for folder in PACKAGES.values()
        for one in sorted((ROOT / folder).rglob("*.py"))
        if PLACE not in one.parents
        and "benchmarks" not in one.parts
        and (found := asked_for(one.read_text(encoding="utf-8")))
    }
    assert {name: found for name, found in asking.items() if name not in IN_REAL_TIME} == {}
    assert set(asking) == IN_REAL_TIME, "no exception without a need"


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("import fcntl", {"fcntl"}),
        ("from os import sched_getaffinity", {"os.sched_getaffinity"}),
        ("import signal\nsignal.signal(signal.SIGHUP, print)", {"signal.SIGHUP"}),
        ("import sys\nsys.platform == 'linux'", {"sys.platform"}),
        ("import os\nos.getpid()", set()),
    ],
)
def test_questions_about_the_system_are_detected(source: str, found: set[str]) -> None:
    assert asked_for(source) == found


@pytest.mark.parametrize("system", ["win32", "darwin"])
def test_a_rig_in_real_time_says_that_it_needs_linux(system: str) -> None:
    done = subprocess.run(
        [sys.executable, str(SHIM), system, "rig"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 3
    assert done.stderr.startswith(
        f"astb: a rig in real time needs Linux, and this system is {system}. Use --virtual to run"
    )
    assert done.stderr.count("\n") == 1
