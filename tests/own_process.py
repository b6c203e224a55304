"""Python text that runs in a separate process, which has compiled and imported no module yet."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def output_of(script: str, **environment: str) -> str:
    """Return what a ``script`` (Python text) prints in the root of the project, in a process with ``environment``."""
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", script],
        cwd=ROOT,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    return run.stdout
