"""Springs of an external library in the tick: calls of the library, the wait for its answer, and its failures.

Library functions are called by their addresses, in the rig's process or in a separate one (`serve`), without the
Python interpreter.
"""

from enum import IntEnum
from typing import Any, Final

import numpy as np

from bench_protocol.runtime.addresses import INT, NUMBER, WORD, at_address
from bench_protocol.runtime.calls import (
    enter_interpreter,
    leave_interpreter,
    now,
    readable,
    receive_word,
    send_word,
)
from bench_sim.model.actuator import command_actuators
from bench_sim.model.compiled import compiled, compiled_entry, compiled_once
from bench_sim.model.external_springs import (
    COMPONENT,
    GET,
    INPUT,
    INTEGRATED,
    OUTPUT,
    SET,
    STEP,
    VERSION,
    Slot,
    evaluate_around,
    feed_inputs,
    know_outputs,
    let_air_in,
)
from bench_sim.model.runge_kutta import integrate
from bench_sim.model.sensors import follow, true_values


class Failure(IntEnum):
    """The reason why external springs have failed."""

    NONE = 0
    STATUS = 1  #: a call was refused
    NUMBER = 2  #: an output is not finite
    ENDED = 3  #: it requests the end of the simulation, or stopped before the end of its step
    SILENT = 4  #: no answer in time
    GONE = 5  #: its process has ended


class Call(IntEnum):
    """The calls of a communication step."""

    NONE = 0
    SET = 1
    STEP = 2
    GET = 3


_values_2: Final = at_address(WORD, WORD, WORD, WORD)
_values_3: Final = at_address(WORD, WORD, WORD, WORD, WORD)
_step_2: Final = at_address(WORD, NUMBER, NUMBER, INT)
_step_3: Final = at_address(WORD, NUMBER, NUMBER, INT, WORD, WORD, WORD, WORD)


@compiled
def _values(e: Any, k: int, which: int, references: int, count: int, values: int) -> int:
    """Set or get the real variables of instance ``k``, and return the status. ``references`` and ``values`` are
    addresses.
    """
    one = e.instances
    if count == 0:
        return 0
    if one[k, VERSION] == 2:
        return _values_2(one[k, which], (one[k, COMPONENT], references, count, values))
    return _values_3(one[k, which], (one[k, COMPONENT], references, count, values, count))


@compiled
def _fails(e: Any, status: int) -> bool:
    """Return whether the last call failed: its ``status`` is neither ok nor warning. Store the failure."""
    if status == 0 or status == 1:
        return False
    e.numbers[Slot.FAILED] = Failure.STATUS.value
    e.numbers[Slot.STATUS] = status
    return True


@compiled
def _note(e: Any, k: int, call: int) -> None:
    e.numbers[Slot.CALL] = call
    e.numbers[Slot.INSTANCE] = k


@compiled
def _do_step(e: Any, k: int) -> int:
    """Step one instance. Return its status, or -1 if it requested the end or stopped before the end of the step."""
    one, clock = e.instances, e.clock
    if one[k, VERSION] == 2:
        return _step_2(one[k, STEP], (one[k, COMPONENT], clock[0], clock[1], 1))
    e.numbers[Slot.FLAGS] = 0  # bytes: end requested, early return, event
    clock[2] = clock[0] + clock[1]
    flags = e.numbers.ctypes.data + 8 * Slot.FLAGS
    last = clock.ctypes.data + 16
    status = _step_3(
        one[k, STEP], (one[k, COMPONENT], clock[0], clock[1], 1, flags + 2, flags, flags + 1, last)
    )
    short = abs(clock[2] - clock[0] - clock[1]) > 1e-9
    if status <= 1 and (e.numbers[Slot.FLAGS] & 0xFFFF != 0 or short):
        return -1
    return status


@compiled_once
def call_instances(e: Any) -> None:
    """Take one communication step of all instances: set inputs, step, set the inputs at its end, get outputs. Store a
    failure.
    """
    e.numbers[Slot.FAILED] = Failure.NONE.value
    for k in range(e.numbers[Slot.INSTANCES]):
        first, last = e.instances[k, INPUT], e.instances[k + 1, INPUT]
        count = last - first
        references = e.input_references.ctypes.data + 4 * first
        held = e.inputs.ctypes.data + 8 * first
        at_end = held + 8 * e.input_references.size
        _note(e, k, Call.SET.value)
        if _fails(e, _values(e, k, SET, references, count, held)):
            return
        _note(e, k, Call.STEP.value)
        status = _do_step(e, k)
        if status == -1:
            e.numbers[Slot.FAILED] = Failure.ENDED.value
            return
        if _fails(e, status):
            return
        _note(e, k, Call.SET.value)
        if _fails(e, _values(e, k, SET, references, count, at_end)):
            return
        if not take_outputs(e, k):
            return
    e.numbers[Slot.CALL] = Call.NONE.value


@compiled
def take_outputs(e: Any, k: int) -> bool:
    """Get the outputs of one instance. Return False if it failed."""
    first, last = e.instances[k, OUTPUT], e.instances[k + 1, OUTPUT]
    references = e.output_references.ctypes.data + 4 * first
    _note(e, k, Call.GET.value)
    status = _values(e, k, GET, references, last - first, e.outputs.ctypes.data + 8 * first)
    if _fails(e, status):
        return False
    for place in range(first, last):
        if not abs(e.outputs[place]) < 1e300:
            e.numbers[Slot.FAILED] = Failure.NUMBER.value
            e.numbers[Slot.STATUS] = place
            return False
    return True


@compiled_entry
def begin_outputs(e: Any, k: int) -> bool:
    """Get the initial outputs of one instance. Return False if it failed."""
    good = take_outputs(e, k)
    know_outputs(e)
    return good


@compiled_once
def _request_step(e: Any) -> None:
    """Request a communication step from the library's process, and wait for the answer up to the time limit."""
    n = e.numbers
    spare = n.ctypes.data + 8 * Slot.SPARE
    if not send_word(n[Slot.ASK], spare):
        n[Slot.FAILED] = Failure.GONE.value
    elif not readable(n[Slot.ANSWER], n[Slot.PATIENCE], Slot.SPARE, n):
        n[Slot.FAILED] = Failure.SILENT.value
    elif not receive_word(n[Slot.ANSWER], spare):
        n[Slot.FAILED] = Failure.GONE.value


@compiled_entry
def timed_step(e: Any, spec: Any) -> int:
    """Take one communication step. Return its duration in ns. ``spec`` (int64[2]) is working memory for the clock."""
    start = now(spec)
    call_instances(e)
    return int(now(spec) - start)


@compiled_entry
def serve(e: Any, asked: int, answers: int) -> None:
    """Take a communication step at each request on the pipe ``asked``, until the pipe is closed. For a separate
    process.
    """
    spare = np.zeros(1, np.int64)
    thread = leave_interpreter()
    while receive_word(asked, spare.ctypes.data):
        call_instances(e)
        if not send_word(answers, spare.ctypes.data):
            break
    enter_interpreter(thread)


@compiled
def _exchange(e: Any) -> None:
    """Take one communication step. Store the outputs of the springs at its start and at its end in SI."""
    n = e.numbers
    e.clock[0] = n[Slot.STEPS] * e.clock[1]
    if n[Slot.APART] != 0:
        _request_step(e)
    else:
        call_instances(e)
    if n[Slot.FAILED] != 0:
        return
    n[Slot.STEPS] += 1
    for k in range(n[Slot.TAKES]):
        e.known[0, k] = e.known[1, k]
    know_outputs(e)


@compiled_once
def step_around(
    e: Any, x: Any, mem: Any, u: Any, par: Any, dt: float, work: Any, out: Any, values: Any
) -> bool:
    """Take a step like `bench_sim.model.kernel.step`, with external springs. After a failure return False; in later
    steps only the time advances.
    """
    n = e.numbers
    if n[Slot.FAILED] != 0:
        mem.time += dt
        mem.step += 1
        return False
    command_actuators(x, mem, u, par, dt)
    if n[Slot.TICK] == n[Slot.TICKS]:
        evaluate_around(0.0, x, mem, u, par, (e, 1.0, 0.0), work[0], out)
        let_air_in(e, x, mem, u, par, work[0], out)
        feed_inputs(e, x, u, par, work[0], out)
        _exchange(e)
        if n[Slot.FAILED] != 0:
            return False
        n[Slot.TICK] = 0
    given = e, n[Slot.TICK] / n[Slot.TICKS], 1.0 / e.clock[1]
    evaluate_around(0.0, x, mem, u, par, given, work[0], out)
    true_values(x, mem, par, out, values)
    follow(mem, par, values, dt)
    integrate(evaluate_around, dt, (1, INTEGRATED), x, mem, u, par, given, work, out)
    n[Slot.TICK] += 1
    mem.step += 1
    return True


@compiled_once
def observe_around(e: Any, x: Any, mem: Any, u: Any, par: Any, dx: Any, out: Any, values: Any) -> None:
    """Compute the present readings like `bench_sim.model.kernel.observe`, with external springs."""
    n = e.numbers
    evaluate_around(0.0, x, mem, u, par, (e, n[Slot.TICK] / n[Slot.TICKS], 0.0), dx, out)
    true_values(x, mem, par, out, values)
