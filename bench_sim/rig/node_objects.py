"""The values of the rig's CANopen object dictionary: values of the bench that SDO clients can read, and communication
settings.
"""

import math
import struct
from collections.abc import Callable, Mapping
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from bench_protocol import canopen
from bench_protocol.can_codec import Decoder, Encoder
from bench_protocol.messages import Field
from bench_protocol.object_dictionary import (
    COUNTER_SUB,
    ERROR_HISTORY,
    ERROR_REGISTER,
    HEARTBEAT_CONSUMER,
    HEARTBEAT_PRODUCER,
    INTERLOCK_OBJECTS,
    OBJECT_DICTIONARY,
    PDO_COB_ID,
    PDO_OBJECTS,
    READING_OBJECTS,
    REFUSED,
    SETTING_OBJECTS,
    SYNC_COB_ID,
    SYNC_PERIOD,
    TOKEN_OBJECT,
    TPDO_PARAMETERS,
    Entry,
)
from bench_protocol.sdo import AbortCode, SdoAbort
from bench_protocol.table import TABLE
from bench_sim.rig.emergencies import Emergencies

#: The entries by index and sub-index.
ENTRIES: Final = {(one.index, entry.sub): entry for one in OBJECT_DICTIONARY for entry in one.entries}
_INDICES: Final = frozenset(one.index for one in OBJECT_DICTIONARY)
#: Initial values of all entries that an SDO may set.
DEFAULTS: Final[Mapping[tuple[int, int], int]] = {
    place: entry.default
    for place, entry in ENTRIES.items()
    if entry.access == "rw" and place[0] != ERROR_HISTORY and isinstance(entry.default, int)
}
#: The communication parameters of the TPDOs, by row of the table's messages.
TPDOS: Final[Mapping[int, int]] = {
    row: TPDO_PARAMETERS + canopen.pdo_number(message) - 1
    for row, message in enumerate(TABLE.messages)
    if message.from_rig and canopen.is_pdo(message)
}
_MESSAGES: Final = {PDO_OBJECTS + m.identifier: m for m in TABLE.messages if canopen.is_pdo(m)}
_SINGLE: Final = struct.Struct("<f")


class NodeHost(Protocol):
    """The attributes and methods of the rig that its object dictionary uses."""

    values: npt.NDArray[np.float64]  #: all signals by table row, SI; NaN where not available
    emergencies: Emergencies

    @property
    def held(self) -> bool:
        """Whether the bench has a holder."""

    def is_token(self, token: int, peer: str) -> bool:
        """Return whether ``peer`` is the CAN connection of the holder, and ``token`` is the token of the lease."""

    def refuse(self, peer: str, identifier: int) -> None:
        """Count a refused frame of ``peer``. The bench has another holder."""

    def contact(self, name: str) -> bool:
        """Return the state of an interlock."""

    def setting(self, name: str) -> float:
        """Return the value of an active setting (SI)."""


class NodeObjects:
    """The objects of the node. ``parameters`` are its communication settings; ``on_change`` is called after each
    change of them.
    """

    def __init__(
        self, host: NodeHost, encoder: Encoder, decoder: Decoder, on_change: Callable[[], None]
    ) -> None:
        self._host, self._encoder, self._decoder = host, encoder, decoder
        self._on_change = on_change
        self.parameters = dict(DEFAULTS)
        #: The sender of the request that is being answered.
        self.peer = ""
        #: Numbers of refused or dropped frames, by sub-index of the object that reports them.
        self.refused = {sub: 0 for index, sub in ENTRIES if index == REFUSED and sub}
        self._opened_by: str | None = None  # the peer whose download of the token came just now

    def size(self, index: int, sub: int) -> int:
        return _entry(index, sub).type.size

    def read(self, index: int, sub: int) -> bytes:
        entry = _entry(index, sub)
        if not entry.readable:
            raise SdoAbort(AbortCode.WRITE_ONLY)
        if index >= READING_OBJECTS:
            return self._signal(index, entry)
        return _coded(entry, self._value(index, sub, entry))

    def _signal(self, index: int, entry: Entry) -> bytes:
        if index >= INTERLOCK_OBJECTS:
            return bytes((bool(self._host.contact(entry.signal.removeprefix("interlock."))),))
        if index >= SETTING_OBJECTS:
            return _SINGLE.pack(self._host.setting(entry.signal))
        return _SINGLE.pack(self._host.values[TABLE.index[entry.signal]])

    def _value(self, index: int, sub: int, entry: Entry) -> int | str:
        if index in _MESSAGES:
            return self._code(index, sub)
        if (index, sub) in self.parameters:
            return self.parameters[index, sub]
        if index == ERROR_REGISTER:
            return self._host.emergencies.register
        if index == ERROR_HISTORY:
            history = self._host.emergencies.history
            if sub > len(history):
                raise SdoAbort(AbortCode.NO_DATA)
            return history[sub - 1] if sub else len(history)
        if index == REFUSED and sub:
            return self.refused[sub]
        assert isinstance(entry.default, int | str), "what does not change has its value in the dictionary"
        return entry.default

    def _code(self, index: int, sub: int) -> int:
        """Return the integer of a field as in the last frame received, or as in the next frame sent."""
        message = _MESSAGES[index]
        if sub == COUNTER_SUB:
            return int(self._encoder.counters[TABLE.message_index[message.name]] - 1) & 0xFF
        if not 1 <= sub <= len(message.fields):
            return len(message.fields) if sub == 0 else 0
        field = message.fields[sub - 1]
        known = self._host.values if message.from_rig else self._decoder.latest
        return _raw(field, float(known[TABLE.index[field.signal]]))

    def write(self, index: int, sub: int, data: bytes) -> None:
        entry = _entry(index, sub)
        if not entry.writable:
            raise SdoAbort(AbortCode.READ_ONLY)
        if len(data) != entry.type.size:
            raise SdoAbort(AbortCode.TOO_LONG if len(data) > entry.type.size else AbortCode.TOO_SHORT)
        value = int.from_bytes(data, "little")
        if index in _MESSAGES:
            raise SdoAbort(AbortCode.LOCAL_CONTROL)  # set-points come in frames with CRC and counter
        is_open, self._opened_by = self._opened_by == self.peer, None
        if index == TOKEN_OBJECT and (is_open := self._host.is_token(value, self.peer)):
            self._opened_by = self.peer
        if self._host.held and not is_open:
            self.refused[2] += 1
            self._host.refuse(self.peer, canopen.SDO_REQUEST_IDENTIFIER)
            raise SdoAbort(AbortCode.DEVICE_STATE)
        if index == TOKEN_OBJECT:
            return
        if (refusal := _refusal(index, sub, value, entry)) is not None:
            raise SdoAbort(refusal)
        if index == ERROR_HISTORY:
            self._host.emergencies.history.clear()
        else:
            self.parameters[index, sub] = value
            self._on_change()


def _entry(index: int, sub: int) -> Entry:
    try:
        return ENTRIES[index, sub]
    except KeyError:
        known = index in _INDICES
        raise SdoAbort(AbortCode.NO_SUB_INDEX if known else AbortCode.NO_OBJECT) from None


def _coded(entry: Entry, value: int | str) -> bytes:
    if isinstance(value, str):
        return value.encode("ascii")
    return value.to_bytes(entry.type.size, "little", signed=entry.type.signed)


def _raw(field: Field, value: float) -> int:
    """Return the integer for ``value`` (SI) in a frame, as in the compiled codec."""
    if math.isnan(value):
        return field.raw_null if field.nullable else 0
    step = field.step or TABLE[field.signal].step
    return int(min(max(np.rint(value / step), field.raw_low), field.raw_high))


def _refusal(index: int, sub: int, value: int, entry: Entry) -> AbortCode | None:
    """Return the reason why ``value`` is invalid for a parameter, or None if it is valid."""
    low, high = entry.low, entry.high
    good = True
    if index == ERROR_HISTORY:
        good = value == 0
    elif index == SYNC_COB_ID:
        good = value & ~canopen.SYNC_PRODUCED == canopen.SYNC_IDENTIFIER
    elif index == SYNC_PERIOD:
        low, good = canopen.SYNC_US_MIN if value else 0, value % 1000 == 0
    elif index == HEARTBEAT_PRODUCER:
        low = canopen.HEARTBEAT_MS_MIN if value else 0
    elif index == HEARTBEAT_CONSUMER:
        guarded, _ = consumed(value)
        if guarded == canopen.NODE:
            return AbortCode.INCOMPATIBLE
        good = guarded <= canopen.NODE_MAX
    elif index >= TPDO_PARAMETERS and sub == PDO_COB_ID:
        good = value & ~(canopen.NOT_VALID | canopen.NO_REMOTE) == DEFAULTS[index, sub] & ~canopen.NO_REMOTE
    elif index >= TPDO_PARAMETERS:
        good = 1 <= value <= canopen.SYNCHRONOUS_MAX or value in canopen.EVENT_DRIVEN
    if low is not None and value < low:
        return AbortCode.VALUE_TOO_LOW
    if high is not None and value > high:
        return AbortCode.VALUE_TOO_HIGH
    return None if good else AbortCode.VALUE_INVALID


def consumed(value: int) -> tuple[int, int]:
    """Return the node-ID and the time (ms) from an entry of the heartbeat consumer."""
    return value >> 16, value & 0xFFFF
