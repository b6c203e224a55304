"""The compiled CAN codec: values to frames and back, as the table of signals defines them.

Bit order is little-endian (Intel) in all messages. Of a feedback message::

         bit   0              16              32              48      56      63
               | field 1      | field 2       | field 3       | spare | counter |

and of a command message (end-to-end protected)::

         bit   0     8       12            28            44            60      63
               | CRC | alive | field 1     | field 2     | field 3     | spare |

A command carries the token of its commander in a field, or in the data id of its CRC.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from bench_protocol.e2e import COUNTER_PERIOD, counter_step, crc8
from bench_protocol.frames import FRAME, STANDARD_ID_MAX, Block
from bench_protocol.messages import Protection
from bench_protocol.runtime.binding import bind, cached
from bench_protocol.units import NS
from bench_protocol.wires import Table

_NONE: Final = Protection.NONE.value
_COUNTER: Final = Protection.COUNTER.value
_E2E: Final = Protection.E2E.value

_MESSAGE: Final = np.dtype(
    [
        ("identifier", "<u4"),
        ("first", "<i8"),
        ("count", "<i8"),
        ("protection", "<i8"),
        ("data_id", "<i8"),
        ("bound", "<i8"),  # 1: the CRC uses the data id exclusive-or the token
        ("token_bit", "<i8"),  # bit of the token, -1 if there is none
        ("counter_bit", "<i8"),
        ("period", "<i8"),
    ]
)
_FIELD: Final = np.dtype(
    [
        ("signal", "<i8"),
        ("shift", "<i8"),
        ("bits", "<i8"),
        ("signed", "<i8"),
        ("nullable", "<i8"),
        ("step", "<f8"),
        ("low", "<i8"),
        ("high", "<i8"),
        ("null", "<i8"),
    ]
)


class Tally(IntEnum):
    """Events that a decoder counts."""

    ACCEPTED = 0
    UNKNOWN = 1  #: identifiers that are not in the table
    MALFORMED = 2  #: frames of another length or kind
    LOST = 3  #: gaps in the sample counters
    CORRUPT = 4  #: wrong CRC
    REPEATED = 5  #: the same counter again (doubled or echoed frames)
    OUT_OF_SEQUENCE = 6  #: a counter that jumped too far, or back
    STRANGE = 7  #: valid frames of a client that does not hold the lease
    STRANGE_IDENTIFIER = 8  #: not a count, but the identifier of the last such frame


#: The token of a decoder that accepts the frames of any commander.
ANYBODY: Final = -1
#: The token of a decoder that accepts no commander.
NOBODY: Final = 0


@dataclass(frozen=True)
class FrameLayout:
    """The table of signals as arrays, which the compiled codec reads."""

    messages: npt.NDArray[np.void]
    fields: npt.NDArray[np.void]
    rows: npt.NDArray[np.int64]  #: message row by identifier, -1 where there is none

    @classmethod
    def of(cls, table: Table) -> "FrameLayout":
        """Compile ``table``."""
        messages = np.zeros(len(table.messages), _MESSAGE)
        fields = np.zeros(sum(len(message.fields) for message in table.messages), _FIELD)
        rows = np.full(STANDARD_ID_MAX + 1, -1, np.int64)
        position = 0
        for row, message in enumerate(table.messages):
            rows[message.identifier] = row
            period = round(NS / message.rate) if message.rate else 0
            messages[row] = (
                message.identifier,
                position,
                len(message.fields),
                message.protection.value,
                message.data_id,
                message.bound,
                message.token_bit,
                message.counter_bit,
                period,
            )
            for place, shift in message.placed():
                fields[position] = (
                    table.index[place.signal],
                    shift,
                    place.bits,
                    place.signed,
                    place.nullable,
                    place.step or table[place.signal].step,
                    place.raw_low,
                    place.raw_high,
                    place.raw_null,
                )
                position += 1
        return cls(messages, fields, rows)


@cached
def encode_into(
    values: Any,
    rows: Any,
    time: int,
    messages: Any,
    fields: Any,
    counters: Any,
    out: Any,
    position: int,
) -> int:
    """Write one frame per message in ``rows`` to ``out[position:]``, with the time stamp ``time`` (ns). Return the
    position behind the last frame.

    A row of -1 is skipped.

    ``values`` are SI floats by table row; a value outside its range is sent as the nearest limit, NaN as "not
    available", or as 0 in a field without that code. ``counters`` (by message row) advance by one.
    """
    for row in rows:
        if row < 0:
            continue
        message = messages[row]
        word = np.uint64(0)
        for k in range(message.first, message.first + message.count):
            place = fields[k]
            value = values[place.signal]
            if np.isnan(value):
                raw = place.null if place.nullable else 0
            else:
                # Clamp before the conversion: a float beyond int64 has no defined integer.
                raw = np.int64(min(max(np.rint(value / place.step), float(place.low)), float(place.high)))
            mask = (np.uint64(1) << np.uint64(place.bits)) - np.uint64(1)
            word |= (np.uint64(raw) & mask) << np.uint64(place.shift)
        record = out[position]
        record.time, record.id, record.extended, record.length = time, message.identifier, 0, 8
        if message.protection == _COUNTER or message.protection == _E2E:
            word |= np.uint64(counters[row]) << np.uint64(message.counter_bit)
            counters[row] = (counters[row] + 1) % (COUNTER_PERIOD if message.protection == _E2E else 256)
        for byte in range(8):
            record["data"][byte] = np.uint8(word >> np.uint64(8 * byte) & np.uint64(0xFF))
        if message.protection == _E2E:
            record["data"][0] = crc8(record["data"], message.data_id)
        position += 1
    return position


@cached
def data_word(record: Any) -> Any:
    """Return the data of a frame as one number, little-endian."""
    word = np.uint64(0)
    for byte in range(8):
        word |= np.uint64(record["data"][byte]) << np.uint64(8 * byte)
    return word


@cached
def _is_accepted(record: Any, message: Any, token: int, tally: Any) -> bool:
    """Return whether CRC and token of a command are right. Count a frame with a wrong CRC as corrupt, and one with a
    wrong token as strange.
    """
    crc = record["data"][0]
    if message.bound != 0 and token > NOBODY:
        if crc8(record["data"], message.data_id ^ token) == crc:
            return True
        own = False
    else:
        own = message.bound == 0 or token == ANYBODY
    if crc8(record["data"], message.data_id) != crc:
        tally[Tally.CORRUPT] += 1
        return False
    if message.token_bit >= 0 and token != ANYBODY:
        given = np.int64(data_word(record) >> np.uint64(message.token_bit) & np.uint64(0xFFFF))
        own = token != NOBODY and given == token
    if not own:
        tally[Tally.STRANGE] += 1
        tally[Tally.STRANGE_IDENTIFIER] = record.id
    return own


@cached
def _accept(record: Any, message: Any, row: int, token: int, counters: Any, times: Any, tally: Any) -> bool:
    """Return whether counter, CRC and token of a frame are right, and store its counter.

    A rejected frame changes only ``tally``.
    """
    if message.protection == _NONE:
        return True
    byte = record["data"][message.counter_bit >> 3]
    if message.protection == _COUNTER:
        if counters[row] >= 0:
            advance = (np.int64(byte) - counters[row]) % 256
            if advance == 0:
                tally[Tally.REPEATED] += 1
                return False
            # A counter that advances by half of its range in too short a time belongs to a late old frame.
            if advance >= 128 and record.time - times[row] < 128 * message.period:
                tally[Tally.OUT_OF_SEQUENCE] += 1
                return False
            tally[Tally.LOST] += advance - 1
        counters[row] = byte
        return True
    counter: Any = np.int64(byte) & 0x0F
    if counter >= COUNTER_PERIOD:
        tally[Tally.CORRUPT] += 1
        return False
    if not _is_accepted(record, message, token, tally):
        return False
    # Messages sent only on events have several senders, each with its own start of the counter.
    if counters[row] >= 0 and message.period > 0:
        advance = counter_step(counter, counters[row])
        if advance == 0:
            tally[Tally.REPEATED] += 1
            return False
        # As in the profile's MaxDeltaCounter: silence widens the window, so that reception recovers after a gap.
        if advance > 2 + (record.time - times[row]) // message.period:
            tally[Tally.OUT_OF_SEQUENCE] += 1
            return False
        tally[Tally.LOST] += advance - 1
    counters[row] = counter
    return True


@cached
def decode_into(
    block: Any,
    message_rows: Any,
    messages: Any,
    fields: Any,
    token: int,
    counters: Any,
    times: Any,
    tally: Any,
    latest: Any,
    latest_times: Any,
    out_times: Any,
    out_signals: Any,
    out_values: Any,
) -> int:
    """Decode ``block``; return how many samples were written to the three ``out_`` arrays.

    ``token`` is that of the commander whose frames are accepted, or `ANYBODY`, or `NOBODY`.

    All times are in ns, all values in SI. ``latest`` and ``latest_times`` (by table row) are updated. ``counters`` and
    ``times`` (by message row) keep the counter and the time of the last accepted frame of each message. ``tally``
    counts accepted, lost and rejected frames.
    """
    count = 0
    for record in block:
        if record.extended != 0 or record.id > STANDARD_ID_MAX:
            tally[Tally.UNKNOWN] += 1
            continue
        row = message_rows[record.id]
        if row < 0:
            tally[Tally.UNKNOWN] += 1
            continue
        if record.length != 8:
            tally[Tally.MALFORMED] += 1
            continue
        message = messages[row]
        if not _accept(record, message, row, token, counters, times, tally):
            continue
        times[row] = record.time
        tally[Tally.ACCEPTED] += 1
        word = data_word(record)
        for k in range(message.first, message.first + message.count):
            place = fields[k]
            mask = (np.uint64(1) << np.uint64(place.bits)) - np.uint64(1)
            raw = np.int64(word >> np.uint64(place.shift) & mask)
            if place.signed and raw >> (place.bits - 1):
                raw -= np.int64(1) << place.bits
            value = np.nan if place.nullable and raw == place.null else raw * place.step
            latest[place.signal] = value
            latest_times[place.signal] = record.time
            out_times[count] = record.time
            out_signals[count] = place.signal
            out_values[count] = value
            count += 1
    return count


_NUMBERS, _INDICES, _FRAMES = np.zeros(0), np.zeros(0, np.int64), np.zeros(0, FRAME)
_LAYOUT: Final = np.zeros(0, _MESSAGE), np.zeros(0, _FIELD)
_encode: Final = bind(encode_into, _NUMBERS, _INDICES, 0, *_LAYOUT, _INDICES, _FRAMES, 0)
_decode: Final = bind(
    decode_into,
    _FRAMES,
    _INDICES,
    *_LAYOUT,
    0,
    _INDICES,
    _INDICES,
    _INDICES,
    _NUMBERS,
    _INDICES,
    _INDICES,
    _INDICES,
    _NUMBERS,
)


class Encoder:
    """Encodes values into frames, and keeps the counters of the messages it sends."""

    def __init__(self, table: Table) -> None:
        self.layout = FrameLayout.of(table)
        self._table = table
        self._data_ids = self.layout.messages["data_id"].copy()
        self.counters = np.zeros(len(table.messages), np.int64)

    def rows(self, names: Sequence[str]) -> npt.NDArray[np.int64]:
        """Return the message rows of ``names``, for :meth:`encode`."""
        return np.array([self._table.message_index[name] for name in names], np.int64)

    def bind(self, token: int) -> None:
        """Set the token of the messages whose CRC includes the token."""
        bound = self.layout.messages["bound"] != 0
        self.layout.messages["data_id"] = np.where(bound, self._data_ids ^ token, self._data_ids)

    def encode(self, values: npt.NDArray[np.float64], rows: npt.NDArray[np.int64], time: int) -> Block:
        """Return a block with one frame per message row, stamped ``time`` (ns)."""
        block = np.empty(rows.size, FRAME)
        _encode(values, rows, time, self.layout.messages, self.layout.fields, self.counters, block, 0)
        return block


class Samples(NamedTuple):
    """Decoded samples in the order of arrival: three arrays of one length (ns, table row, SI value)."""

    times: npt.NDArray[np.int64]
    signals: npt.NDArray[np.int64]
    values: npt.NDArray[np.float64]


@dataclass
class Decoder:
    """Decodes frames into samples; detects gaps, repetitions and corruption by counter and CRC."""

    table: Table
    from_rig: bool | None = None  #: take only messages of the rig (True) or of the commander (False)
    token: int = (
        ANYBODY  #: accept the commands with this token; it is needed for frames that carry it in their CRC
    )
    latest: npt.NDArray[np.float64] = field(init=False)  #: last value by table row, NaN before the first
    latest_times: npt.NDArray[np.int64] = field(init=False)  #: time of reception (ns), -1 before the first
    message_times: npt.NDArray[np.int64] = field(init=False)
    counters: npt.NDArray[np.int64] = field(init=False)  #: last counter by message row, -1 before the first
    tally: npt.NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        self.layout = FrameLayout.of(self.table)
        for message in self.table.messages:
            if self.from_rig not in (None, message.from_rig):
                self.layout.rows[message.identifier] = -1  # ignore echoes of our own frames
        size = len(self.table.signals)
        self.latest = np.full(size, np.nan)
        self.latest_times = np.full(size, -1, np.int64)
        self.message_times = np.full(len(self.table.messages), -1, np.int64)
        self.tally = np.zeros(len(Tally), np.int64)
        self.counters = np.full(len(self.table.messages), -1, np.int64)
        self._fields_max = int(self.layout.messages["count"].max())

    def forget(self) -> None:
        """Reset the counters after a reconnection: the next frame of every message is its first."""
        self.counters[:] = -1

    def decode(self, block: Block) -> Samples:
        """Return the samples of all valid frames of ``block``."""
        room = block.size * self._fields_max
        times, signals, values = np.empty(room, np.int64), np.empty(room, np.int64), np.empty(room)
        count = _decode(
            block,
            self.layout.rows,
            self.layout.messages,
            self.layout.fields,
            self.token,
            self.counters,
            self.message_times,
            self.tally,
            self.latest,
            self.latest_times,
            times,
            signals,
            values,
        )
        return Samples(times[:count], signals[:count], values[:count])
