"""FMUs of springs, bench and car, compiled once, and simulations of them where this project is not."""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from astb.fmu.export import compile_code, write_unit
from astb.fmu.models import unit_of
from bench_protocol.runtime.file_locks import hold

HERE = Path(__file__).parent


def _made(name: str, factory: pytest.TempPathFactory) -> dict[int, Path]:
    """Return FMUs of each version."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    base = factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "fmus"
    made = {version: folder / f"{name}{version}.fmu" for version in (2, 3)}
    folder.mkdir(exist_ok=True)
    with (folder / f"{name}.lock").open("w") as lock:  # workers compile it once
        hold(lock.fileno(), wait=True)
        if not made[3].exists():
            unit = unit_of(name)
            compile_code(unit.code, folder)
            for version, path in made.items():
                write_unit(unit, path, fmi=version, compiled=folder)
    return made


@pytest.fixture(scope="session")
def spring_fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """The springs as an FMU of each version."""
    return _made("spring", tmp_path_factory)


@pytest.fixture(scope="session")
def bench_fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """The bench as an FMU of each version."""
    return _made("bench", tmp_path_factory)


@pytest.fixture(scope="session")
def car_fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """The car as an FMU of each version."""
    return _made("car", tmp_path_factory)


@pytest.fixture
def isolated(tmp_path: Path) -> Callable[..., Any]:
    """What `alone.py` answers about an FMU."""

    def ask(fmu: Path, what: str, **given: Any) -> Any:
        arguments = [sysconfig.get_path("purelib"), str(fmu), what]
        if given:
            np.savez(tmp_path / "given.npz", **given)
            arguments.append(str(tmp_path / "given.npz"))
        done = subprocess.run(
            [sys.executable, "-I", "-S", str(HERE / "alone.py"), *arguments],
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
            cwd=tmp_path,
        )
        assert done.returncode == 0, done.stderr
        printed, _, answer = done.stdout.rpartition("ANSWER ")
        assert not printed, f"the FMU wrote to stdout: {printed}"
        return json.loads(answer)

    return ask
