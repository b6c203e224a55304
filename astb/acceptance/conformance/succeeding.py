"""Tests of a change of commander: arming must move nothing, and a closed connection must leave settings at their rest
values.
"""

from typing import Final

from astb.acceptance.conformance.commanding import Stream
from astb.acceptance.conformance.leaving import give_back, leave, note_rest, take
from astb.acceptance.conformance.moving import STEP_WITHIN, reset, way_up
from astb.acceptance.conformance.raw_access import ModbusConnection, RawAccess
from astb.acceptance.conformance.report import Notebook
from astb.acceptance.conformance.stillness import (
    OVER,
    PLACES,
    PRESSURES,
    SETTLED_WITHIN,
    WATCH,
    Courses,
    is_still,
    note_still,
)
from bench_protocol.units import NS

_GROUP: Final = "next commander"


def succeed(access: RawAccess) -> list[Notebook]:
    """Arm the bench without set-points, close the connection, and return the findings."""
    book = Notebook(_GROUP)
    line = access.modbus()
    if not (token := take(line)):
        book.skip("arming", "another client has the lease")
        return [book]
    stream = Stream(access, token)  # of control bits alone
    stream.start()
    try:
        if not _settled(access):
            book.skip("arming", f"the bench still moved by itself after {SETTLED_WITHIN:g} s")
        elif _arm(access, line, stream, book) and leave(line, targets=True):
            line.close()
            stream.stop()
            access.wait_for(lambda: access.listener.state != "ACTIVE", STEP_WITHIN)
            note_rest(access, book, "end of the connection in ACTIVE")
    finally:
        stream.stop()
        line.close()
    _clear(access, book)
    return [book]


def _settled(access: RawAccess) -> bool:
    """Wait while something still moves by itself, for example because the springs are vented.

    Return whether all is still within `SETTLED_WITHIN`.
    """
    deadline = access.clock.now() + round(SETTLED_WITHIN * NS)
    while access.clock.now() < deadline:
        start = access.clock.now()
        access.wait(WATCH)
        if is_still(_since(access, start)):
            return True
    return False


def _arm(access: RawAccess, line: ModbusConnection, stream: Stream, book: Notebook) -> bool:
    """Bring the bench up with control bits only, and record its motion in HOLD and ACTIVE.

    Return whether it reached ACTIVE.
    """
    start, steps = access.clock.now(), Notebook(_GROUP)
    access.wait(2 * OVER)
    armed = way_up(access, line, stream, steps, "HOLD")
    access.wait(WATCH)
    note_still(book, "HOLD without set-points", _since(access, start))
    if armed:
        stream.set("control.active", 1.0)
        armed = access.wait_for(lambda: access.listener.state == "ACTIVE", STEP_WITHIN)
        access.wait(WATCH)
        note_still(book, "ACTIVE without set-points", _since(access, start))
    book.note("start up to ACTIVE", armed, access.listener.state, "ACTIVE")
    return armed


def _clear(access: RawAccess, book: Notebook) -> None:
    """Reset the bench to DISABLED, record whether this succeeds, and return the lease."""
    line = access.modbus()
    if token := take(line):
        stream = Stream(access, token)
        stream.start()
        book.note("reset at the end", reset(access, stream), access.listener.state, "DISABLED")
        stream.stop()
        give_back(line)
    line.close()


def _since(access: RawAccess, start: int) -> Courses:
    courses = access.listener.courses((*PLACES, *PRESSURES), start)
    return {name: (times / NS, values) for name, (times, values) in courses.items()}
