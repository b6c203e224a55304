"""A scenario of the model run twice: compiled in this process, and in a separate one as plain Python."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np


def run_plain(scenario: str, folder: Path) -> np.ndarray:
    """Return what the ``run()`` of a ``scenario`` (Python text) gives where nothing is compiled."""
    script = scenario + "\nimport numba\nassert numba.config.DISABLE_JIT\nnp.save(sys.argv[1], run())\n"
    environment = os.environ | {
        "NUMBA_DISABLE_JIT": "1",
        "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
    }
    file = folder / "plain.npy"
    subprocess.run(
        [sys.executable, "-W", "error", "-c", script, str(file)], env=environment, check=True, timeout=100
    )
    return np.load(file)


def compiled_and_plain(scenario: str, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return what the ``run()`` of a ``scenario`` (Python text) gives in both; ``folder`` is for the way between."""
    plain = run_plain(scenario, folder)
    scope: dict[str, Any] = {}
    exec(scenario, scope)
    return scope["run"](), plain
