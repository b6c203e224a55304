"""FMUs of the springs, compiled once, and simulations of them where this project is not."""

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

from bench_fmu.export import compile_springs, write_springs
from bench_protocol.system.file_locks import hold
from bench_sim.parameters import load

HERE = Path(__file__).parent


@pytest.fixture(scope="session")
def spring_fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """The springs as an FMU of each version."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "fmus"
    made = {version: folder / f"spring{version}.fmu" for version in (2, 3)}
    folder.mkdir(exist_ok=True)
    with (folder / "lock").open("w") as lock:  # workers compile it once
        hold(lock.fileno(), wait=True)
        if not made[3].exists():
            compile_springs(folder)
            for version, path in made.items():
                write_springs(load(), path, fmi=version, compiled=folder)
    return made


@pytest.fixture
def alone(tmp_path: Path) -> Callable[..., Any]:
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
