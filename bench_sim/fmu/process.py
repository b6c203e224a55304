"""Runs an FMU in a separate process, because its library may crash, hang, print or change the working folder.

The parent unpacks the FMU with `FmuRunner`, which starts worker processes. `Worker.request` sends a request and waits
for the answer, with a timeout. If the worker fails, the error message contains the FMU call that was in progress and
the end of the log. In the worker process, `RequestPipes` receives the requests.
"""

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
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from bench_sim.fmu.description import Fmu, FmuError, unpack_fmu

#: Characters from the end of a log that a message repeats.
_LOG_TAIL: Final = 400


class FmuRunner:
    """An FMU that is unpacked in a temporary folder, and its worker processes, which run the Python ``module``.
    `close` ends the processes and removes the folder.
    """

    def __init__(self, fmu: Fmu, module: str) -> None:
        self.fmu, self._module = fmu, module
        temporary = tempfile.TemporaryDirectory(prefix="astb-fmu-")
        self.folder = Path(temporary.name)
        self.unpacked = self.folder / "unpacked"
        self._workers: list[Worker] = []
        self.close = weakref.finalize(self, _close, self._workers, temporary)
        unpack_fmu(fmu.path, self.unpacked)

    def start(self) -> Worker:
        """Start and return a worker process, which gets a working folder of its own."""
        worker = Worker(self.fmu.path.name, self._module, Path(tempfile.mkdtemp(dir=self.folder)))
        self._workers.append(worker)
        return worker


def _close(workers: list[Worker], temporary: tempfile.TemporaryDirectory[str]) -> None:
    for worker in workers:
        worker.close()
    temporary.cleanup()


class Worker:
    """A worker process that runs an FMU. The parent process uses this object to start it and to send requests."""

    def __init__(self, name: str, module: str, folder: Path) -> None:
        self.name, self.folder, self._log = name, folder, folder / "log"
        self._timeout = 0.0  #: s, after which the process was killed
        paths = (path or str(Path.cwd()) for path in sys.path)
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", module],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                cwd=folder,
                env={
                    **os.environ,
                    "PYTHONPATH": os.pathsep.join(paths),
                    "OPENBLAS_NUM_THREADS": "1",
                    "OMP_NUM_THREADS": "1",
                },
            )
        assert self._process.stdin is not None and self._process.stdout is not None
        self._stdin, self._stdout = self._process.stdin, self._process.stdout

    @property
    def descriptors(self) -> tuple[int, int]:
        """Return the file descriptors for writing to the worker and for reading from it."""
        return self._stdin.fileno(), self._stdout.fileno()

    def request(
        self,
        message: Any,
        *,
        timeout: float,
        where: Callable[[], str],
        progress: Callable[[], bytes] = bytes,
    ) -> Any:
        """Send a message and return the answer. If ``progress`` returns the same value for ``timeout`` s, the process
        is killed. FmuError reports a failed call, a crash or a timeout; ``where`` returns the text that names the
        call.
        """
        done = threading.Event()
        supervisor = threading.Thread(target=self._supervise, args=(done, timeout, progress), daemon=True)
        supervisor.start()
        try:
            pickle.dump(message, self._stdin, protocol=5)
            self._stdin.flush()
            good, answer = pickle.load(self._stdout)
        except (OSError, EOFError, pickle.UnpicklingError):
            raise FmuError(
                f"{self.name} {self.ending()} {where()}. It ran in a separate process, so nothing else stopped. "
                f"Correct the FMU: each of its calls must return a status{self.log_tail()}"
            ) from None
        except BaseException:
            self.close()
            raise
        finally:
            done.set()
            # The caller may remove the files that ``progress`` reads.
            supervisor.join()
        if not good:
            self.close()
            raise FmuError(f"{self.name} failed {where()}: {answer}; correct the FMU{self.log_tail()}")
        return answer

    def _supervise(self, done: threading.Event, timeout: float, progress: Callable[[], bytes]) -> None:
        last = progress()
        while not done.wait(timeout):
            if (now := progress()) == last:
                self.kill(timeout)
                return
            last = now

    def kill(self, timeout: float) -> None:
        """Kill the process because it made no progress for ``timeout`` s."""
        self._timeout = timeout
        self._process.kill()

    def ending(self) -> str:
        """Wait for the end of the process, and return the reason of its end as text."""
        code = self._process.wait()
        if self._timeout:
            return f"made no progress for {self._timeout:g} s"
        if code < 0:
            return f"crashed ({signal.Signals(-code).name})"
        return f"ended its process (exit code {code})"

    def log_tail(self) -> str:
        """Return a sentence with the end of the worker's log, or "" if the log is empty."""
        return log_tail(self._log.read_text("utf-8", "replace")) if self._log.exists() else ""

    def close(self) -> None:
        """Kill the process, and close the pipes to it."""
        self._process.kill()
        self._process.wait()
        for stream in (self._stdin, self._stdout):
            with contextlib.suppress(OSError):
                stream.close()


def log_tail(log: str) -> str:
    """Return a sentence with the end of a ``log``, or "" for an empty one."""
    return f". Its log ends with: {text[-_LOG_TAIL:]}" if (text := log.strip()) else ""


def print_log(text: str) -> None:
    """Write a message of the FMU to the log of this worker."""
    print(text, file=sys.stderr, flush=True)


class RequestPipes:
    """The pipes of a worker process: requests from its parent, and answers to it. From its creation on, all that the
    FMU prints goes to the log, and standard input is empty.
    """

    def __init__(self) -> None:
        self._requests, self._answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
        with Path(os.devnull).open("rb") as nothing:
            os.dup2(nothing.fileno(), 0)
        os.dup2(2, 1)
        self.descriptors = self._requests.fileno(), self._answers.fileno()

    def answer(self, handle: Callable[[Any], Any]) -> None:
        """Wait for one request, and send the result of ``handle`` back. If the parent has closed its pipe, end this
        process.
        """
        try:
            request = pickle.load(self._requests)
        except EOFError:
            os._exit(0)  # runs no code of the library
        with contextlib.suppress(OSError):
            os.ftruncate(2, 0)
        try:
            answer = True, handle(request)
        except Exception as error:  # FMPy raises several types
            answer = False, str(error)
        pickle.dump(answer, self._answers, protocol=5)
        self._answers.flush()
