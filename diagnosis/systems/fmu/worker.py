"""The worker process that simulates an FMU.

Before each call of the FMU it writes the name and the time of the call to a file, which the parent process reads after
a crash.
"""

from __future__ import annotations

import mmap
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from ctypes import c_double, c_uint
from dataclasses import dataclass
from pathlib import Path
from struct import pack_into
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from bench_sim.fmu.calls import load
from bench_sim.fmu.description import Fmu
from bench_sim.fmu.process import RequestPipes, print_log

if TYPE_CHECKING:
    from diagnosis.systems.splines import SplineTable

#: Saved states after a start, of an FMU that can save them.
_KEPT: Final = 16
#: File that holds the present call and its time.
MARK: Final = "mark"
INSTANTIATE, INITIALISE, STEP, DONE = 1.0, 2.0, 3.0, 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Feedback:
    """A surface over two signals that is added to an input: an unknown term in the FMU's equations.

    ``over`` holds for each signal whether it is an input, its column, and its unit (SI = factor · number + zero).
    ``size`` is the value of 1 SI unit in the unit of the input.
    """

    column: int
    over: tuple[tuple[bool, int, float, float], tuple[bool, int, float, float]]
    table: SplineTable
    size: float


@dataclass(frozen=True, slots=True, eq=False)
class SimulationRequest:
    """One simulation: start values, inputs, and the outputs to return.

    ``start`` has value references and values by type. ``inputs`` has value references and columns by type. The columns
    refer to ``at`` (n, m), the inputs at the samples, and ``held`` ((n − 1)·parts, m), the inputs in each communication
    step of ``step`` s. Before the first sample the inputs stay constant for ``settle`` communication steps. All numbers
    are in the units of the FMU.
    """

    start: Mapping[str, tuple[Sequence[int], Sequence[float]]]
    inputs: Mapping[str, tuple[Sequence[int], Sequence[int]]]
    outputs: Mapping[str, Sequence[int]]
    at: NDArray[np.float64]
    held: NDArray[np.float64]
    parts: int
    step: float
    settle: int
    feedback: tuple[Feedback, ...] = ()


class _Simulation:
    """The FMU that is loaded in this process."""

    def load(self, message: tuple[Fmu, Path]) -> None:
        """Load the library of an FMU from its unpacked folder."""
        with Path(MARK).open("r+b") as file:
            self.mark = mmap.mmap(file.fileno(), 16)
        self.kept: OrderedDict[Any, tuple[Any, Any]] = OrderedDict()
        self.fmu, unpacked = message
        self.fmi: Any = load(self.fmu, unpacked, print_log)

    def note(self, call: float, time: float) -> None:
        pack_into("dd", self.mark, 0, call, time)

    def run(self, request: SimulationRequest) -> NDArray[np.float64]:
        """Simulate a request and return the outputs (n, k)."""
        self.note(INSTANTIATE, 0.0)
        keeps = self.fmu.keeps_state and request.settle > 0
        begin = -request.settle * request.step
        if keeps:
            self._restore(request, begin)
        else:
            self._start(request, begin)
        outputs = self._simulate(request)
        self.note(DONE, 0.0)
        if not keeps:
            self._free(self.fmi.fmu.component)
        return outputs

    def _free(self, component: Any) -> None:
        if component is not None:
            self.fmi.free(component)
        self.fmi.fmu.component = None

    def _start(self, request: SimulationRequest, begin: float) -> None:
        """Create an instance of the FMU, and simulate it up to the first sample."""
        self.fmi.instantiate()
        for kind, (references, values) in request.start.items():
            self.fmi.set(kind, references, values)
        self.note(INITIALISE, begin)
        self.fmi.enter_initialization(begin)
        inputs = _Inputs(self.fmi, request)
        inputs.put(request.at, 0)
        self.fmi.exit_initialization()
        for k in range(request.settle):
            time = begin + k * request.step
            self.note(STEP, time)
            self.fmi.do_step(time, request.step)

    def _restore(self, request: SimulationRequest, begin: float) -> None:
        """Restore the state at the first sample. If it was not saved before, simulate up to the first sample and save
        the state.
        """
        key = (str(request.start), request.at[0].tobytes(), request.step, request.settle)
        if key in self.kept:
            self.kept.move_to_end(key)
            self.fmi.fmu.component, state = self.kept[key]
            self.fmi.fmu.setFMUState(state)
            return
        while self.kept and len(self.kept) >= (1 if self.fmu.once_per_process else _KEPT):
            _, (component, state) = self.kept.popitem(last=False)
            self.fmi.fmu.component = component
            self.fmi.fmu.freeFMUState(state)
            self._free(component)
        self._start(request, begin)
        self.kept[key] = self.fmi.fmu.component, self.fmi.fmu.getFMUState()

    def _simulate(self, request: SimulationRequest) -> NDArray[np.float64]:
        n = len(request.at)
        inputs, outputs = _Inputs(self.fmi, request), _Outputs(self.fmi, request, n)
        if request.feedback:
            return self._simulate_fed_back(request, inputs, outputs)
        k = 0
        for i in range(n):
            inputs.put(request.at, i)
            outputs.get(i)
            if i + 1 == n:
                break
            for _ in range(request.parts):
                inputs.put(request.held, k)
                self.note(STEP, k * request.step)
                self.fmi.do_step(k * request.step, request.step)
                k += 1
        return outputs.values

    def _simulate_fed_back(
        self, request: SimulationRequest, inputs: _Inputs, outputs: _Outputs
    ) -> NDArray[np.float64]:
        """Return the outputs as `_simulate` does, with surfaces added to inputs during the simulation.

        In the middle of a communication step, outputs are extrapolated from their last two values.
        """
        from diagnosis.systems.splines import spline_value

        def with_terms(row: NDArray[np.float64], seen: NDArray[np.float64]) -> NDArray[np.float64]:
            row = row.copy()
            for one in request.feedback:
                first, second = (
                    factor * float((row if of_input else seen)[place]) + zero
                    for of_input, place, factor, zero in one.over
                )
                row[one.column] += one.size * spline_value(one.table, first, second)
            return row

        inputs.put(request.at, 0)
        previous = seen = outputs.read()
        k = 0
        for i in range(len(request.at)):
            inputs.put(with_terms(request.at[i], seen)[np.newaxis], 0)
            outputs.get(i)
            seen = outputs.values[i]
            if i + 1 == len(request.at):
                break
            for _ in range(request.parts):
                middle = seen + 0.5 * (seen - previous)
                inputs.put(with_terms(request.held[k], middle)[np.newaxis], 0)
                self.note(STEP, k * request.step)
                self.fmi.do_step(k * request.step, request.step)
                previous, seen = seen, outputs.read()
                k += 1
        return outputs.values


def _reals(kind: str) -> bool:
    return kind in {"Real", "Float64"}


class _Inputs:
    """Sets the inputs of the FMU from rows of an array."""

    def __init__(self, fmi: Any, request: SimulationRequest) -> None:
        self.fmi = fmi
        self.groups = [
            (kind, (c_uint * len(references))(*references), list(references), list(columns))
            for kind, (references, columns) in request.inputs.items()
        ]

    def put(self, rows: NDArray[np.float64], row: int) -> None:
        for kind, array, references, columns in self.groups:
            if _reals(kind):
                values = (c_double * len(columns))(*rows[row, columns])
                self.fmi.set_reals(array, len(columns), values)
            elif kind == "Float32":
                self.fmi.set(kind, references, rows[row, columns].tolist())
            elif kind == "Boolean":
                self.fmi.set(kind, references, [bool(one > 0.5) for one in rows[row, columns]])
            else:
                self.fmi.set(kind, references, [round(one) for one in rows[row, columns]])


class _Outputs:
    """Reads the outputs of the FMU, grouped by type, into rows of an array."""

    def __init__(self, fmi: Any, request: SimulationRequest, rows: int) -> None:
        self.fmi = fmi
        self.groups, first = [], 0
        for kind, references in request.outputs.items():
            count = len(references)
            into = (c_double * count)()
            self.groups.append((kind, (c_uint * count)(*references), list(references), first, into))
            first += count
        self.values = np.empty((rows, first))

    def get(self, row: int) -> None:
        self._into(self.values[row])

    def read(self) -> NDArray[np.float64]:
        """Return the present outputs (k,)."""
        seen = np.empty(self.values.shape[1])
        self._into(seen)
        return seen

    def _into(self, seen: NDArray[np.float64]) -> None:
        for kind, array, references, first, into in self.groups:
            if _reals(kind):
                self.fmi.get_reals(array, len(references), into)
                seen[first : first + len(references)] = into
            else:
                seen[first : first + len(references)] = self.fmi.get(kind, references)


def main() -> None:
    """Answer requests from the parent process: the first loads the FMU, each further one is a simulation."""
    pipes, simulation = RequestPipes(), _Simulation()
    pipes.answer(simulation.load)
    while True:
        pipes.answer(simulation.run)


if __name__ == "__main__":
    main()
