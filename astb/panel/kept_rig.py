"""A simulated rig that runs as long as a panel or a run needs it: an existing one, or one started here."""

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

from astb.rig_file import RigFile
from astb.session import answers, ready_line, start_rig
from bench_protocol.runtime import LINUX


class KeptRig:
    """Starts the rig of a file if it is simulated and does not answer; any other rig is not changed.

    ``lifeline`` is one end of a pipe, None unless a rig was started here. The rig runs until all holders of this end
    have closed it. A run that inherits it keeps the rig alive when the panel ends, or is killed.
    """

    def __init__(self, rig: RigFile, path: Path, seed: int | None, say: Callable[[str], None]) -> None:
        self._rig, self._path, self._seed, self._say = rig, path, seed, say
        self._process: subprocess.Popen[str] | None = None
        self.lifeline: int | None = None

    def ensure(self) -> None:
        """Start the rig unless it answers. Raises RigFileError or LinkLost if it cannot be started."""
        rig, running = self._rig, self._process is not None and self._process.poll() is None
        if rig.simulation is None or rig.wiring or running or answers(rig):
            return
        if not LINUX:
            self._say("a rig in real time needs Linux; here the panel shows records only")
            return
        self.close()
        self._say(f"no rig answers at {rig.modbus.host}:{rig.modbus.port}: starting one")
        theirs, self.lifeline = os.pipe()
        try:
            self._process = start_rig(rig.simulation, self._path, self._seed, theirs)
        finally:
            os.close(theirs)
        self._say(ready_line(self._process))

    def close(self) -> None:
        """Release the rig; it ends if no run holds it."""
        if self.lifeline is not None:
            os.close(self.lifeline)
            self.lifeline = None
        if self._process is not None:
            for pipe in (self._process.stdout, self._process.stderr):
                assert pipe is not None
                pipe.close()
            self._process = None
