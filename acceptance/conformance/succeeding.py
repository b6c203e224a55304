"""What the next commander finds: that arming moves nothing, and what stands after a connection was closed."""

from typing import Final

from acceptance.conformance.commanding import Stream
from acceptance.conformance.door import Door, Line
from acceptance.conformance.finding import Notebook
from acceptance.conformance.leaving import give_back, leave, note_rest, take
from acceptance.conformance.moving import STEP_WITHIN, reset, way_up
from acceptance.conformance.stillness import (
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

_GROUP: Final = "the next commander"


def succeed(door: Door) -> list[Notebook]:
    """Return what is found by arming the bench as somebody who sends no set-point, and by closing his connection."""
    book = Notebook(_GROUP)
    line = door.line()
    if not (token := take(line)):
        book.skip("arming", "somebody holds the bench")
        return [book]
    stream = Stream(door, token)  # of control bits alone
    stream.start()
    try:
        if not _settled(door):
            book.skip("arming", f"the bench still moved by itself after {SETTLED_WITHIN:g} s")
        elif _arm(door, line, stream, book) and leave(line, targets=True):
            line.close()
            stream.stop()
            door.wait_for(lambda: door.ear.state != "ACTIVE", STEP_WITHIN)
            note_rest(door, book, "the holder's connection is closed in ACTIVE")
    finally:
        stream.stop()
        line.close()
    _clear(door, book)
    return [book]


def _settled(door: Door) -> bool:
    """Wait until nothing moves by itself: springs are vented, and a bolster is set down."""
    deadline = door.clock.now() + round(SETTLED_WITHIN * NS)
    while door.clock.now() < deadline:
        start = door.clock.now()
        door.wait(WATCH)
        if is_still(_since(door, start)):
            return True
    return False


def _arm(door: Door, line: Line, stream: Stream, book: Notebook) -> bool:
    """Lead the bench up by bits alone, and watch it in HOLD and in ACTIVE; return whether it got there."""
    start, steps = door.clock.now(), Notebook(_GROUP)
    door.wait(2 * OVER)
    armed = way_up(door, line, stream, steps, "HOLD")
    door.wait(WATCH)
    note_still(book, "armed by bits alone, and in HOLD", _since(door, start))
    if armed:
        stream.set("control.active", 1.0)
        armed = door.wait_for(lambda: door.ear.state == "ACTIVE", STEP_WITHIN)
        door.wait(WATCH)
        note_still(book, "in ACTIVE, before the first set-point", _since(door, start))
    book.note("the way up", armed, f"it is {door.ear.state}", "it is ACTIVE")
    return armed


def _clear(door: Door, book: Notebook) -> None:
    """Leave the bench DISABLED, and held by nobody."""
    line = door.line()
    if token := take(line):
        stream = Stream(door, token)
        stream.start()
        book.note("it is left at rest", reset(door, stream), f"it is {door.ear.state}", "it is DISABLED")
        stream.stop()
        give_back(line)
    line.close()


def _since(door: Door, start: int) -> Courses:
    courses = door.ear.courses((*PLACES, *PRESSURES), start)
    return {name: (times / NS, values) for name, (times, values) in courses.items()}
