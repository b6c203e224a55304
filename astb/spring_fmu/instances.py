"""The instances of a spring's FMU, in the process in which they run: made, begun, and entered with their addresses."""

from __future__ import annotations

import mmap
from ctypes import c_void_p, cast
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from astb.spring_fmu.keys import SpringFmuError
from astb.spring_fmu.mapping import Plan, fill
from bench_protocol.rates import TICK
from bench_sim.model.elsewhere import (
    COMPONENT,
    GET,
    INPUT,
    OUTPUT,
    SET,
    STEP,
    VERSION,
    Elsewhere,
    Feed,
    Place,
    layout,
)
from bench_sim.rig.elsewhere import Call, Failure, begin_outputs, timed_step
from diagnosis.systems.fmu.calls import Fmi2, Fmi3, Opened

_FUNCTIONS: Final = {
    2: ("fmi2SetReal", "fmi2DoStep", "fmi2GetReal"),
    3: ("fmi3SetFloat64", "fmi3DoStep", "fmi3GetFloat64"),
}
_REAL: Final = {2: "Real", 3: "Float64"}
#: How the springs are moved while it is measured how long they take: m, Hz.
_STROKE: Final = 1e-3
_FREQUENCY: Final = 2.0


def shared(path: Path, plan: Plan, *, create: bool = False) -> Elsewhere:
    """Return the arrays in the file ``path``, which two processes may have open."""
    shapes = layout(*plan.sizes)
    sizes = [int(np.prod(shape)) * np.dtype(kind).itemsize for shape, kind in shapes]
    starts = np.concatenate(([0], np.cumsum([-(-size // 64) * 64 for size in sizes])))
    if create:
        path.write_bytes(bytes(int(starts[-1])))
    with path.open("r+b") as file:
        memory = mmap.mmap(file.fileno(), 0)
    return Elsewhere(
        *(
            np.frombuffer(memory, kind, int(np.prod(shape)), int(start)).reshape(shape)
            for (shape, kind), start in zip(shapes, starts, strict=False)
        )
    )


def prepare(e: Elsewhere, plan: Plan) -> None:
    """Enter everything that is known before there is an instance."""
    fill(e._asdict(), plan)
    n = e.numbers
    n[Place.ON] = 1
    n[Place.INSTANCES], _, n[Place.TAKES] = plan.sizes
    n[Place.TICKS] = n[Place.TICK] = plan.ticks
    accelerations = (Feed.HEIGHT_ACCELERATION, Feed.LATERAL_ACCELERATION, Feed.ROLL_ACCELERATION)
    n[Place.BENDS] = bool(np.isin(e.fed, accelerations).any())
    n[Place.VALVES], n[Place.HOLD] = plan.valves, plan.hold
    n[Place.PATIENCE] = max(1, round(1e3 * plan.patience))
    e.clock[1] = plan.ticks * TICK
    first_input = first_output = 0
    for k, one in enumerate(plan.instances):
        e.instances[k, INPUT], e.instances[k, OUTPUT] = first_input, first_output
        first_input, first_output = first_input + len(one.inputs), first_output + len(one.outputs)
    e.instances[len(plan.instances), [INPUT, OUTPUT]] = first_input, first_output


def begin(
    e: Elsewhere, plan: Plan, folder: Path, feeds: npt.NDArray[np.float64], log: list[str]
) -> list[Any]:
    """Make the instances and let them begin where ``feeds`` has the springs; return what keeps them alive.

    Raises `SpringFmuError` for whatever an FMU refuses; which call it was is noted for a crash.
    """
    kept = []
    version = plan.fmu.version
    opened = Opened(str(folder), "", version, plan.fmu.identifier, plan.fmu.token, False, False)
    _feed(e, feeds, feeds)
    for k, one in enumerate(plan.instances):
        e.numbers[Place.INSTANCE] = k
        try:
            fmi: Any = (Fmi2 if version == 2 else Fmi3)(opened, log)
            fmi.instantiate()
            if one.parameters:
                references, values = zip(*one.parameters, strict=True)
                fmi.put(_REAL[version], list(references), list(values))
            fmi.begin(0.0)
            places = slice(e.instances[k, INPUT], e.instances[k + 1, INPUT])
            if one.inputs:
                fmi.put(_REAL[version], e.input_references[places].tolist(), e.inputs[0, places].tolist())
            fmi.begun()
        except Exception as error:  # whatever FMPy makes of a status
            said = f" It says: {'; '.join(log[-4:])}" if log else ""
            raise SpringFmuError(f"{plan.fmu.path.name} does not begin: {error}{said}") from None
        calls = (cast(getattr(fmi.fmu.dll, name), c_void_p).value or 0 for name in _FUNCTIONS[version])
        component = fmi.fmu.component
        e.instances[k, [SET, STEP, GET]] = list(calls)
        e.instances[k, COMPONENT] = component if isinstance(component, int) else component.value
        e.instances[k, VERSION] = version
        kept.append(fmi)
        if not begin_outputs(e, k):
            raise SpringFmuError(told(e, plan))
    e.numbers[Place.CALL] = Call.NONE
    return kept


def _feed(e: Elsewhere, held: npt.NDArray[np.float64], at_end: npt.NDArray[np.float64]) -> None:
    for row, feeds in enumerate((held, at_end)):
        e.inputs[row] = e.feed_scale[:, 0] * feeds[e.fed] + e.feed_scale[:, 1]


def tried(e: Elsewhere, plan: Plan, feeds: npt.NDArray[np.float64], steps: int) -> npt.NDArray[np.float64]:
    """Return how long (s) each of some communication steps took, while both springs go up and down a little.

    Raises `SpringFmuError` for a step that fails.
    """
    spec = np.zeros(2, np.int64)
    taken = np.empty(steps)
    T = e.clock[1]
    omega = 2.0 * np.pi * _FREQUENCY
    middle = 0.5 * T * plan.hold
    for k in range(steps):
        at = []
        for after in (middle, T):
            moved = feeds.copy()
            t = k * T + after
            moved[Feed.HEIGHT : Feed.HEIGHT + 2] += _STROKE * np.sin(omega * t)
            moved[Feed.HEIGHT_SPEED : Feed.HEIGHT_SPEED + 2] = _STROKE * omega * np.cos(omega * t)
            bent = slice(Feed.HEIGHT_ACCELERATION, Feed.HEIGHT_ACCELERATION + 2)
            moved[bent] = -_STROKE * omega**2 * np.sin(omega * t)
            at.append(moved)
        _feed(e, *at)
        e.clock[0] = k * T
        e.numbers[Place.STEPS] = k
        taken[k] = 1e-9 * timed_step(e, spec)
        if e.numbers[Place.FAILED]:
            raise SpringFmuError(told(e, plan))
    return taken


_CALLS: Final = {
    Call.SET: "when inputs were set",
    Call.STEP: "in doStep",
    Call.GET: "when outputs were asked for",
    Call.NONE: "between two calls",
}
_STATUS: Final = {2: "discard", 3: "error", 4: "fatal", 5: "pending"}


def where(e: Elsewhere, plan: Plan) -> str:
    """Return in which call, of which instance, for which time an FMU is or was."""
    which = (
        f" of the {plan.instances[e.numbers[Place.INSTANCE]].name} spring" if len(plan.instances) > 1 else ""
    )
    return f"{_CALLS[Call(e.numbers[Place.CALL])]}{which} at {e.clock[0]:.6g} s"


def told(e: Elsewhere, plan: Plan) -> str:
    """Return in words how an FMU has failed that still answers."""
    name, n = plan.fmu.path.name, e.numbers
    match Failure(n[Place.FAILED]):
        case Failure.STATUS:
            status = int(n[Place.STATUS])
            return f"{name} returned {_STATUS.get(status, str(status))} {where(e, plan)}"
        case Failure.NUMBER:
            outputs = [link for one in plan.instances for link in one.outputs]
            link = outputs[n[Place.STATUS]]
            return f"{name} gives {link.name} = {e.outputs[n[Place.STATUS]]:g}, which is no number, {where(e, plan)}"
        case Failure.ENDED:
            return f"{name} ended the simulation by itself {where(e, plan)}"
        case _:
            return f"{name} goes on"
