"""Worker processes that simulate one FMU at the same time, one for each thread that requests a simulation."""

from __future__ import annotations

from pathlib import Path
from struct import unpack
from typing import Any, Final

from numpy.typing import NDArray

from bench_sim.fmu.description import Fmu, FmuError
from bench_sim.fmu.process import FmuRunner, Worker
from diagnosis.contracts import DiagnosisError
from diagnosis.systems.fmu.worker import DONE, INITIALISE, INSTANTIATE, MARK, STEP, SimulationRequest

#: Seconds without progress after which an FMU is stopped.
TIMEOUT: Final = 60.0
_WORKER: Final = "diagnosis.systems.fmu.worker"
_CALLS: Final = {
    INSTANTIATE: "during instantiation",
    INITIALISE: "during initialization",
    DONE: "while freeing an instance",
}


class FmuPool:
    """Simulates one FMU in worker processes. Several threads may call `simulate`. Raises DiagnosisError if the FMU
    cannot be unpacked.
    """

    def __init__(self, fmu: Fmu, timeout: float = TIMEOUT) -> None:
        self.fmu, self._timeout = fmu, timeout
        self._free: list[Worker] = []
        try:
            self._runner = FmuRunner(fmu, _WORKER)
        except FmuError as error:
            raise DiagnosisError(str(error)) from None

    def simulate(self, request: SimulationRequest) -> NDArray[Any]:
        """Return the outputs (n, k) of a simulation. Raises DiagnosisError if the FMU refuses a call, crashes or does
        not respond.
        """
        try:
            worker = self._free.pop()
        except IndexError:
            worker = self._runner.start()
            (worker.folder / MARK).write_bytes(bytes(16))
            self._request(worker, (self.fmu, self._runner.unpacked))
        outputs = self._request(worker, request)
        self._free.append(worker)
        return outputs

    def _request(self, worker: Worker, message: Any) -> Any:
        mark = worker.folder / MARK
        try:
            return worker.request(
                message, timeout=self._timeout, where=lambda: _current_call(mark), progress=mark.read_bytes
            )
        except FmuError as error:
            raise DiagnosisError(str(error)) from None


def _current_call(mark: Path) -> str:
    call, time = unpack("dd", mark.read_bytes())
    return f"in doStep at {time:.6g} s" if call == STEP else _CALLS.get(call, "while loading its library")
