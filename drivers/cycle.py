"""The compiled cycle of the command stream: it moves set-points and encodes and sends frames without the interpreter.

A computation in a plan holds the interpreter: one call of a C library can take 47 ms and more. After 100 ms of silence
the rig assumes the loss of its commander. In real time the cycle therefore does not wait for the interpreter: compiled
code sleeps, moves the set-points, encodes and writes to the socket.

The cycle must stop when the plan stops. Python therefore permits a number of cycles in advance and renews the
permission periodically. If the interpreter is blocked for longer, the cycle stops sending, and the rig reacts to the
silence. In virtual time, and on buses that only Python can write to, Python makes each block with the same codec.
"""

from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from bench_protocol.can_codec import Encoder, encode_into
from bench_protocol.frames import FRAME, LENGTH_MAX, Block
from bench_protocol.runtime.binding import bind, inlined
from bench_protocol.runtime.calls import SPEC_WORDS, lock_mutex, sleep_until, unlock_mutex
from bench_protocol.runtime.sending import send_all
from bench_protocol.table import TABLE
from drivers.setpoints import Setpoints, advance, entry

COUNTS: Final = np.dtype(
    [
        ("sent", "<i8"),  # blocks
        ("granted", "<i8"),  # total number of blocks that Python permits
        ("stop", "<i8"),  # 1: return before the next cycle
    ]
)

#: A struct can_frame, and the longest line of socketcand: ``< send 12345678 8 00 11 22 33 44 55 66 77 >``.
_CAN_FRAME: Final = 16
_LINE: Final = 44
_EXTENDED_FLAG: Final = 0x8000_0000


class Cycle(NamedTuple):
    """The data that a cycle reads and writes; its counts ``granted`` and ``stop`` may be written without the mutex."""

    setpoints: Setpoints
    rows: npt.NDArray[np.int64]  #: of the messages that go out
    messages: npt.NDArray[np.void]
    fields: npt.NDArray[np.void]
    counters: npt.NDArray[np.int64]
    frames: Block
    text: npt.NDArray[np.uint8]  #: the same frames, as they are sent
    counts: npt.NDArray[np.void]  #: one `COUNTS`
    work: npt.NDArray[np.int64]  #: work space of the system calls

    @classmethod
    def of(cls, encoder: Encoder, rows: npt.NDArray[np.int64], setpoints: Setpoints) -> "Cycle":
        """Return a cycle of the messages ``rows`` of ``encoder``, which carry ``setpoints``."""
        return cls(
            setpoints,
            rows,
            encoder.layout.messages,
            encoder.layout.fields,
            encoder.counters,
            np.zeros(rows.size, FRAME),
            np.zeros(_LINE * rows.size, np.uint8),
            np.zeros(1, COUNTS),
            np.zeros(SPEC_WORDS, np.int64),
        )


@entry
def make_block(cycle: Any, time: int) -> None:
    """Move the set-points by one cycle and encode the frames, with the time stamp ``time`` (ns)."""
    advance(cycle.setpoints)
    encode_into(
        cycle.setpoints.values,
        cycle.rows,
        time,
        cycle.messages,
        cycle.fields,
        cycle.counters,
        cycle.frames,
        0,
    )


@inlined
def _hex(text: Any, place: int, number: int, digits: int, ten: int) -> int:
    """Write a number with ``digits`` hexadecimal digits; return the index after it. ``ten``: code of A or a."""
    for k in range(digits):
        digit = (number >> (4 * (digits - 1 - k))) & 0xF
        text[place + k] = 48 + digit if digit < 10 else ten + digit - 10
    return place + digits


@inlined
def _write_line(record: Any, text: Any, place: int) -> int:
    """Write a line such as ``< send 204 8 00 11 >``; return the index after it."""
    for k, character in enumerate((60, 32, 115, 101, 110, 100, 32)):
        text[place + k] = character
    place = _hex(text, place + 7, np.int64(record.id), 8 if record.extended != 0 else 3, 65)
    text[place], text[place + 1] = 32, 48 + record.length
    place += 2
    for k in range(record.length):
        text[place] = 32
        place = _hex(text, place + 1, np.int64(record["data"][k]), 2, 97)
    text[place], text[place + 1] = 32, 62
    return place + 2


@inlined
def _write_frame(record: Any, text: Any, place: int) -> int:
    """Write a struct can_frame, little-endian; return the index after it."""
    word = np.int64(record.id) | (_EXTENDED_FLAG if record.extended != 0 else 0)
    for k in range(4):
        text[place + k] = (word >> (8 * k)) & 0xFF
        text[place + 4 + k] = 0
    text[place + 4] = record.length
    for k in range(LENGTH_MAX):
        text[place + 8 + k] = record["data"][k] if k < record.length else 0
    return place + _CAN_FRAME


@entry
def write_text(frames: Any, text: Any, lines: bool) -> int:
    """Write ``frames`` to ``text`` as ``lines`` of socketcand, or as struct can_frame; return the number of bytes."""
    place = 0
    for record in frames:
        place = _write_line(record, text, place) if lines else _write_frame(record, text, place)
    return place


@entry
def send_cycles(
    cycle: Any, mutex: int, wire: Any, wire_mutex: int, lines: bool, start: int, period: int
) -> int:
    """Send a block at each ``start + k period`` (monotonic, ns), k = 1, 2, …; return 0 when stopped, else an errno.

    ``wire`` (1,) has the descriptor of the socket. ``mutex`` is the address of the mutex of the set-points,
    ``wire_mutex`` that of the socket. ``lines`` selects lines of socketcand, else struct can_frame.
    """
    counts = cycle.counts[0]
    due = start
    while True:
        due += period
        sleep_until(due, cycle.work)
        lock_mutex(mutex)
        go = counts.stop == 0 and counts.sent < counts.granted
        size = 0
        if go:
            counts.sent += 1
            make_block(cycle, 0)
            size = write_text(cycle.frames, cycle.text, lines)
        stop = counts.stop != 0
        unlock_mutex(mutex)
        if stop:
            return 0
        if not go:
            continue
        piece = size if lines else _CAN_FRAME
        lock_mutex(wire_mutex)
        error = 0
        for first in range(0, size, piece):
            if error == 0:
                error = send_all(wire[0], cycle.text.ctypes.data + first, piece, cycle.work)
        unlock_mutex(wire_mutex)
        if error != 0:
            return error


#: A cycle without frames.
NO_CYCLE: Final = Cycle.of(Encoder(TABLE), np.zeros(0, np.int64), Setpoints.of(0))
frames_to_text: Final = bind(write_text, NO_CYCLE.frames, NO_CYCLE.text, True)
cycle_frames: Final = bind(make_block, NO_CYCLE, 0)
run_cycles: Final = bind(send_cycles, NO_CYCLE, 0, np.zeros(1, np.int64), 0, True, 0, 0)
#: False with ``NUMBA_DISABLE_JIT=1``: every cycle then needs the interpreter.
COMPILED: Final = hasattr(send_cycles, "get_overload")
