"""A rig that stays for as long as a panel or a run needs it: found running, or started and left to its lifeline."""

import os
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from astb.rig_file import RigFile
from astb.session import answers, ready_line, start_rig


@dataclass(frozen=True, slots=True)
class OpenRig:
    """What keeps a rig that was started here alive: whoever holds this end of a pipe; None for a rig found running."""

    lifeline: int | None


@contextmanager
def open_rig(rig: RigFile, path: Path, seed: int | None, say: Callable[[str], None]) -> Iterator[OpenRig]:
    """Yield a rig that runs; a simulated one that does not answer is started.

    A run that inherits the lifeline keeps the rig when the panel ends, or is killed. RigFileError or LinkLost if a rig
    cannot be started.
    """
    if rig.simulation is None or rig.wiring or answers(rig):
        yield OpenRig(None)
        return
    say(f"no rig answers at {rig.modbus.host}:{rig.modbus.port}: starting one")
    theirs, ours = os.pipe()
    process: subprocess.Popen[str] | None = None
    try:
        try:
            process = start_rig(rig.simulation, path, seed, theirs)
        finally:
            os.close(theirs)
        say(ready_line(process))
        yield OpenRig(ours)
    finally:
        os.close(ours)
        for pipe in (process.stdout, process.stderr) if process is not None else ():
            assert pipe is not None
            pipe.close()
