"""The C controls: compiled by the machine's own gcc, in a temporary directory, each time again."""

import shutil
import subprocess
from pathlib import Path
from typing import Final

from astb_studies.benchmarks.measure import Skipped

_HERE: Final = Path(__file__).parent


def compiled(source: str, directory: Path, *options: str) -> Path:
    """Compile ``source``, a file next to this one, with ``-O2`` and return the output file.

    Raises Skipped if gcc or a library in ``options`` is missing.
    """
    gcc = shutil.which("gcc")
    if gcc is None:
        raise Skipped("there is no gcc on this machine")
    target = directory / Path(source).stem
    command = [gcc, "-O2", "-Wall", "-Werror", "-o", str(target), str(_HERE / source), "-lm", *options]
    done = subprocess.run(command, check=False, timeout=60, stderr=subprocess.PIPE, text=True)
    if done.returncode:
        raise Skipped(f"{source} cannot be compiled: {done.stderr.strip().splitlines()[-1]}")
    return target
