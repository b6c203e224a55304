"""The instances of a spring FMU in the process that runs them, and the memory that this process shares with the rig."""

from __future__ import annotations

import mmap
from collections.abc import Callable
from ctypes import c_void_p, cast
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.rates import TICK
from bench_sim.fmu.calls import load
from bench_sim.fmu.description import FmuError
from bench_sim.model.external_springs import (
    COMPONENT,
    GET,
    INPUT,
    OUTPUT,
    SET,
    STEP,
    VERSION,
    ExternalSprings,
    Feed,
    Slot,
    layout,
)
from bench_sim.rig.external_springs import Call, Failure, begin_outputs, timed_step
from bench_sim.rig.spring_fmu.mapping import Coupling, fill

_FUNCTIONS: Final = {
    2: ("fmi2SetReal", "fmi2DoStep", "fmi2GetReal"),
    3: ("fmi3SetFloat64", "fmi3DoStep", "fmi3GetFloat64"),
}
_REAL: Final = {2: "Real", 3: "Float64"}
#: Motion of the springs while the duration of steps is measured: m, Hz.
_STROKE: Final = 1e-3
_FREQUENCY: Final = 2.0


def shared(path: Path, coupling: Coupling, *, create: bool = False) -> ExternalSprings:
    """Return the arrays in the file ``path``, mapped into memory that both processes share.

    With ``create``, create the file first, and write the values that follow from ``coupling``.
    """
    shapes = layout(*coupling.sizes)
    sizes = [int(np.prod(shape)) * np.dtype(kind).itemsize for shape, kind in shapes]
    starts = np.concatenate(([0], np.cumsum([-(-size // 64) * 64 for size in sizes])))
    if create:
        path.write_bytes(bytes(int(starts[-1])))
    with path.open("r+b") as file:
        memory = mmap.mmap(file.fileno(), 0)
    e = ExternalSprings(
        *(
            np.frombuffer(memory, kind, int(np.prod(shape)), int(start)).reshape(shape)
            for (shape, kind), start in zip(shapes, starts, strict=False)
        )
    )
    if create:
        _prepare(e, coupling)
    return e


def _prepare(e: ExternalSprings, coupling: Coupling) -> None:
    fill(e._asdict(), coupling)
    n = e.numbers
    n[Slot.ON] = 1
    n[Slot.INSTANCES], _, n[Slot.TAKES] = coupling.sizes
    n[Slot.TICKS] = n[Slot.TICK] = coupling.ticks
    accelerations = (Feed.HEIGHT_ACCELERATION, Feed.LATERAL_ACCELERATION, Feed.ROLL_ACCELERATION)
    n[Slot.BENDS] = bool(np.isin(e.fed, accelerations).any())
    n[Slot.VALVES], n[Slot.HOLD] = coupling.valves, coupling.hold
    n[Slot.PATIENCE] = max(1, round(1e3 * coupling.timeout))
    e.clock[1] = coupling.ticks * TICK
    first_input = first_output = 0
    for k, one in enumerate(coupling.instances):
        e.instances[k, INPUT], e.instances[k, OUTPUT] = first_input, first_output
        first_input, first_output = first_input + len(one.inputs), first_output + len(one.outputs)
    e.instances[len(coupling.instances), [INPUT, OUTPUT]] = first_input, first_output


def initialize(
    e: ExternalSprings,
    coupling: Coupling,
    unpacked: Path,
    feeds: npt.NDArray[np.float64],
    log: Callable[[str], Any],
) -> list[Any]:
    """Create and initialize the instances, with the springs in the state ``feeds``. Return objects that must stay
    alive.

    Raises an exception of FMPy, or FmuError for a failed call. ``e`` contains the number of that call.
    """
    kept: list[Any] = []
    version = coupling.fmu.version
    _feed(e, feeds, feeds)
    for k, one in enumerate(coupling.instances):
        e.numbers[Slot.INSTANCE] = k
        fmi: Any = load(coupling.fmu, unpacked, log)
        fmi.instantiate()
        if one.parameters:
            references, values = zip(*one.parameters, strict=True)
            fmi.set(_REAL[version], list(references), list(values))
        fmi.enter_initialization(0.0)
        places = slice(e.instances[k, INPUT], e.instances[k + 1, INPUT])
        if one.inputs:
            fmi.set(_REAL[version], e.input_references[places].tolist(), e.inputs[0, places].tolist())
        fmi.exit_initialization()
        calls = (cast(getattr(fmi.fmu.dll, name), c_void_p).value or 0 for name in _FUNCTIONS[version])
        component = fmi.fmu.component
        e.instances[k, [SET, STEP, GET]] = list(calls)
        e.instances[k, COMPONENT] = component if isinstance(component, int) else component.value
        e.instances[k, VERSION] = version
        kept.append(fmi)
        if not begin_outputs(e, k):
            raise FmuError(failure_reason(e, coupling))
    e.numbers[Slot.CALL] = Call.NONE
    return kept


def _feed(e: ExternalSprings, held: npt.NDArray[np.float64], at_end: npt.NDArray[np.float64]) -> None:
    for row, feeds in enumerate((held, at_end)):
        e.inputs[row] = e.feed_scale[:, 0] * feeds[e.fed] + e.feed_scale[:, 1]


def time_steps(
    e: ExternalSprings, coupling: Coupling, feeds: npt.NDArray[np.float64], steps: int
) -> npt.NDArray[np.float64]:
    """Return the durations (s) of ``steps`` communication steps, in which both springs move up and down a little.

    Raises FmuError for a failed step.
    """
    spec = np.zeros(2, np.int64)
    durations = np.empty(steps)
    T = e.clock[1]
    omega = 2.0 * np.pi * _FREQUENCY
    middle = 0.5 * T * coupling.hold
    for k in range(steps):
        at = []
        for after in (middle, T):
            moved = feeds.copy()
            t = k * T + after
            moved[Feed.HEIGHT : Feed.HEIGHT + 2] += _STROKE * np.sin(omega * t)
            moved[Feed.HEIGHT_SPEED : Feed.HEIGHT_SPEED + 2] = _STROKE * omega * np.cos(omega * t)
            acceleration = slice(Feed.HEIGHT_ACCELERATION, Feed.HEIGHT_ACCELERATION + 2)
            moved[acceleration] = -_STROKE * omega**2 * np.sin(omega * t)
            at.append(moved)
        _feed(e, *at)
        e.clock[0] = k * T
        e.numbers[Slot.STEPS] = k
        durations[k] = 1e-9 * timed_step(e, spec)
        if e.numbers[Slot.FAILED]:
            raise FmuError(failure_reason(e, coupling))
    return durations


_CALLS: Final = {
    Call.SET: "while setting inputs",
    Call.STEP: "in doStep",
    Call.GET: "while reading outputs",
    Call.NONE: "between two calls",
}
_STATUS: Final = {2: "discard", 3: "error", 4: "fatal", 5: "pending"}


def where(e: ExternalSprings, coupling: Coupling) -> str:
    """Return a text on the present or last call: its name, instance and time."""
    k = e.numbers[Slot.INSTANCE]
    which = f" of the {coupling.instances[k].name} spring" if len(coupling.instances) > 1 else ""
    if not e.instances[k, COMPONENT]:
        return f"during initialization{which}"
    return f"{_CALLS[Call(e.numbers[Slot.CALL])]}{which} at {e.clock[0]:.6g} s"


def failure_reason(e: ExternalSprings, coupling: Coupling) -> str:
    """Return a text with the reason why a call failed."""
    n = e.numbers
    match Failure(n[Slot.FAILED]):
        case Failure.STATUS:
            status = int(n[Slot.STATUS])
            return f"the FMU returned the status {_STATUS.get(status, str(status))}"
        case Failure.NUMBER:
            outputs = [link for one in coupling.instances for link in one.outputs]
            return f"{outputs[n[Slot.STATUS]].name} = {e.outputs[n[Slot.STATUS]]:g} is not finite"
        case Failure.ENDED:
            return "the FMU ended the simulation by itself"
        case _:
            return "no failure"
