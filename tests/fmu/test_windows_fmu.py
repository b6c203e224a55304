"""The library for Windows under wine: it computes what the library for Linux does."""

import os
import shutil
import subprocess
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import fmpy
import numpy as np
import pytest

from astb.fmu.export import WINDOWS, platforms
from tests.fmu.test_spring_fmu import equal

pytestmark = pytest.mark.slow

HERE = Path(__file__).parent
STEPS, STEP = 400, 5e-3
#: Inputs that move: amplitude, and frequency in Hz. Without a frequency they change at once and stay.
MOVED = {
    "spring": {
        "left.height": (20e-3, 1.2),
        "right.height": (-15e-3, 0.9),
        "springs.lateral": (30e-3, 0.7),
        "left.leveling": (1.0, 0.0),
        "right.service_valve": (-0.3, 0.0),
    },
    "bench": {
        "vertical_left.force_setpoint": (4e3, 1.0),
        "lateral.force_setpoint": (3e3, 0.6),
        "platform.roll_setpoint": (3e-3, 2.0),
        "left.service_valve": (0.2, 0.0),
    },
    "car": {"car.wind": (5e4, 0.5), "track.lateral": (5e-3, 1.1), "left.vertical_force": (3e3, 2.0)},
}


def run(folder: Path, *command: str, **settings: str) -> str:
    """Return what a command prints in a folder."""
    done = subprocess.run(
        command,
        cwd=folder,
        env=os.environ | settings,
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wine(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., str]:
    """`run` for programs of Windows."""
    found = shutil.which("wine64") or shutil.which("wine64", path="/usr/lib/wine")
    if found is None or shutil.which("cc") is None or WINDOWS not in platforms():
        pytest.skip("wine64 or mingw-w64 is not installed (apt-get install wine64 gcc-mingw-w64-x86-64)")
    return partial(
        lambda folder, *command, **settings: run(folder, found, *command, **settings),
        WINEPREFIX=str(tmp_path_factory.mktemp("wine") / "prefix"),
        WINEDEBUG="-all",
        WINEDLLOVERRIDES="mscoree,mshtml=",
    )


@pytest.mark.parametrize(("name", "version"), [("spring", 2), ("spring", 3), ("bench", 3), ("car", 3)])
def test_both_libraries_compute_the_same(wine, request, tmp_path, name, version):
    """Windows has its own exp, pow and tanh, so the last bits differ: by 6e-14 of a range, and by 0 for the car."""
    fmu = request.getfixturevalue(f"{name}_fmus")[version]
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path)
    described = fmpy.read_model_description(fmu)
    inputs = [one for one in described.modelVariables if one.causality == "input"]
    outputs = [one.valueReference for one in described.modelVariables if one.causality == "output"]
    assert [one.valueReference for one in inputs] == list(range(len(inputs)))
    rows = np.tile([float(one.start) for one in inputs], (STEPS, 1))
    time, names = STEP * np.arange(STEPS), [one.name for one in inputs]
    for moved, (size, frequency) in MOVED[name].items():
        rows[:, names.index(moved)] += size * (np.sin(2 * np.pi * frequency * time) if frequency else 1.0)
    rows.tofile(tmp_path / "given")
    token = described.guid if version == 2 else described.instantiationToken
    found, said = [], []
    for system, compiler, runner in (
        ("linux64" if version == 2 else "x86_64-linux", "cc", run),
        ("win64" if version == 2 else "x86_64-windows", WINDOWS.compilers[0], wine),
    ):
        run(tmp_path, compiler, "-std=c99", "-o", f"{system}.exe", str(HERE / "steps.c"))
        (library,) = (tmp_path / "binaries" / system).iterdir()
        numbers = map(str, (outputs[0], len(inputs), *outputs))
        given = str(library.relative_to(tmp_path)), token, str(STEP), "given", system
        said.append(runner(tmp_path, f"./{system}.exe", *given, *numbers))
        found.append(np.fromfile(tmp_path / system).reshape(STEPS, len(outputs)))
    linux, windows = found
    moving = np.ptp(linux, axis=0) > 1e-2 * np.abs(linux).max(axis=0)
    assert moving.sum() > len(outputs) / 2
    assert equal(windows, linux, 1e-12)
    assert said[0] == said[1]
    assert "is calculated and cannot be set" in said[0]
