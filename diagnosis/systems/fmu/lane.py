"""FMUs in processes of their own: one for each that asks at the same time, and whoever crashes takes nobody along."""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import weakref
from dataclasses import dataclass, field
from pathlib import Path
from struct import unpack
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.contracts import DiagnosisError
from diagnosis.systems.fmu.calls import Opened
from diagnosis.systems.fmu.description import Fmu, unpack_fmu
from diagnosis.systems.fmu.worker import DONE, INITIALISE, INSTANTIATE, STEP, Request

#: An FMU that comes no further within this time, in s, hangs.
PATIENCE: Final = 60.0
_WORKER: Final = "diagnosis.systems.fmu.worker"
_DOING: Final = {INSTANTIATE: "while it was instantiated", INITIALISE: "while it was initialised"}
_LOG_TOLD: Final = 600


@dataclass(slots=True, eq=False)
class Lanes:
    """Processes that simulate one FMU; `simulate` may be called from several threads."""

    fmu: Fmu
    patience: float = PATIENCE
    folder: Path = field(init=False)
    _free: list[_Lane] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _all: list[_Lane] = field(default_factory=list)
    __weakref__: Any = field(init=False, repr=False)

    def __post_init__(self) -> None:
        temporary = tempfile.TemporaryDirectory(prefix="astb-fmu-")
        self.folder = Path(temporary.name)
        weakref.finalize(self, _end, self._all, temporary)
        unpack_fmu(self.fmu.path, self.folder / "unpacked")

    def simulate(self, request: Request) -> NDArray[np.float64]:
        """Return the outputs (n, k) of a simulation. DiagnosisError says what the FMU refused, or where it crashed."""
        with self._lock:
            lane = self._free.pop() if self._free else None
        if lane is None:
            lane = _Lane(self.fmu, self.folder, self.patience)
            with self._lock:
                self._all.append(lane)
        outputs = lane.ask(request)
        with self._lock:
            self._free.append(lane)
        return outputs


def _end(lanes: list[_Lane], temporary: tempfile.TemporaryDirectory[str]) -> None:
    for lane in lanes:
        lane.end()
    temporary.cleanup()


class _Lane:
    """One process."""

    def __init__(self, fmu: Fmu, folder: Path, patience: float) -> None:
        self.fmu, self.patience = fmu, patience
        own = Path(tempfile.mkdtemp(dir=folder))
        self.mark, self.log = own / "mark", own / "log"
        self.mark.write_bytes(bytes(16))
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", _WORKER],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                cwd=own,
                env=_environment(),
            )
        self.hangs = False
        opened = Opened(
            str(folder / "unpacked"),
            str(self.mark),
            fmu.version,
            fmu.identifier,
            fmu.token,
            fmu.keeps_state,
            fmu.once_per_process,
        )
        self._exchange(opened)

    def ask(self, request: Request) -> NDArray[np.float64]:
        return self._exchange(request)

    def end(self) -> None:
        for stream in (self.process.stdin, self.process.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()
        self.process.kill()
        self.process.wait()

    def _exchange(self, message: Any) -> Any:
        to, back = self.process.stdin, self.process.stdout
        assert to is not None and back is not None
        watch = threading.Thread(target=self._watch, args=(done := threading.Event(),), daemon=True)
        watch.start()
        try:
            good, answer = _exchanged(to, back, message)
        except (OSError, EOFError, pickle.UnpicklingError):
            self.process.wait()
            raise DiagnosisError(self._crashed()) from None
        except BaseException:
            self.end()
            raise
        finally:
            done.set()
        if not good:
            self.end()
            raise DiagnosisError(f"{self.fmu.path.name} {self._where()}: {answer}{self._said()}")
        return answer

    def _watch(self, done: threading.Event) -> None:
        """End the process once it has come no further for too long."""
        last = b""
        while not done.wait(self.patience):
            now = self.mark.read_bytes()
            if now == last:
                self.hangs = True
                self.process.kill()
                return
            last = now

    def _where(self) -> str:
        what, time = unpack("dd", self.mark.read_bytes())
        if what == STEP:
            return f"failed in doStep at {time:.6g} s"
        return f"failed {_DOING.get(what, 'when it was loaded')}"

    def _crashed(self) -> str:
        what, time = unpack("dd", self.mark.read_bytes())
        where = {STEP: f"in doStep at {time:.6g} s", DONE: "when an instance was freed"}.get(
            what, _DOING.get(what, "when its library was loaded")
        )
        code = self.process.returncode
        if self.hangs:
            how = f"came no further for {self.patience:g} s"
        elif code is not None and code < 0:
            how = f"crashed ({signal.Signals(-code).name})"
        else:
            how = f"ended its process (with {code})"
        return (
            f"{self.fmu.path.name} {how} {where}; it ran in a process of its own, and nothing else is lost. Right "
            f"would be an FMU that answers with a status{self._said()}"
        )

    def _said(self) -> str:
        text = self.log.read_text("utf-8", "replace").strip()
        return f"\nIts last words: …{text[-_LOG_TOLD:]}" if text else ""


def _exchanged(to: IO[bytes], back: IO[bytes], message: Any) -> Any:
    pickle.dump(message, to, protocol=5)
    to.flush()
    return pickle.load(back)


def _environment() -> dict[str, str]:
    """Return the environment of a process that finds this project where we did, and uses one core."""
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }
