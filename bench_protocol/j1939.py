"""SAE J1939: identifiers, codes for no value, and messages of several packets (TP)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Literal

from bench_protocol.account import Account

_PDU1_MAX: Final = 0xEF  #: up to this format the next byte is an address, not a part of the group's number
#: Source address in a description of a message that any node may send.
NOBODY: Final = 0xFE
_WHOLE_BYTES: Final = (8, 16, 24, 32)


def group_of(identifier: int) -> int:
    """Return the parameter group number (PGN) of a 29-bit identifier: without priority, source and destination.

    SAE J1939-21, 5.1.2.
    """
    group = identifier >> 8 & 0x3FFFF
    return group if group >> 8 & 0xFF > _PDU1_MAX else group & 0x3FF00


def source_of(identifier: int) -> int:
    """Return the source address of a 29-bit identifier."""
    return identifier & 0xFF


def missing(raw: int, bits: int) -> Literal["", "not available", "error"]:
    """Return the meaning of the bits of an unsigned signal if they are not a value; "" if they are one.

    SAE J1939-71, 5.1.4: whole bytes are tested by the highest byte (FE, FF), twelve bits by the highest eight. For two
    to seven bits, ten, and so on, all ones mean "not available", and all ones minus 1 means an error. A single bit is
    always a value.
    """
    if bits < 2:
        return ""
    shift = bits - 8 if bits in _WHOLE_BYTES or bits == 12 else 0
    top = (1 << bits - shift) - 1
    code = raw >> shift
    return "not available" if code == top else "error" if code == top - 1 else ""


#: Groups of connection management (TP.CM) and of data (TP.DT).
ANNOUNCES, CARRIES = 0xEC00, 0xEB00
_TO_SEND, _TO_ALL, _ABORT = 16, 32, 255  #: first byte of TP.CM: RTS, BAM, and end
_IN_A_PACKET: Final = 7
_PRIORITY: Final = 6
#: Longer than any pause that SAE J1939-21 (5.10.2.4) allows between packets: T2 and T3, ns.
_PATIENCE: Final = 1_250_000_000
_INCOMPLETE: Final = "incomplete J1939 message(s) of several packets (TP)"


@dataclass
class _Message:
    group: int
    size: int
    count: int
    last: int  #: ns
    packets: dict[int, bytes] = field(default_factory=dict)


class Reassembly:
    """Joins packets, in order of time, to messages; incomplete messages are counted."""

    def __init__(self, account: Account) -> None:
        self._account = account
        self._open: dict[tuple[str, int, int], _Message] = {}
        self.whole = 0

    def take(self, time: int, channel: str, identifier: int, data: bytes) -> tuple[int, bytes] | None:
        """Return identifier and data of the message that a packet received at ``time`` (ns) completes; None for any
        other packet.
        """
        ends = source_of(identifier), identifier >> 8 & 0xFF
        if group_of(identifier) == ANNOUNCES:
            self._announced(time, channel, ends, data)
            return None
        key = channel, *ends
        message = self._open.get(key)
        if message is not None and time - message.last > _PATIENCE:
            self._give_up(key)
            message = None
        if message is None or not 1 <= data[:1].ljust(1, b"\0")[0] <= message.count or len(data) < 8:
            self._account.leave_out(
                "J1939 packet(s) (TP) without an announcement", at=f"identifier {identifier:#x}"
            )
            return None
        message.last = time
        message.packets[data[0]] = data[1:8]  # a repeated packet replaces the first one
        if len(message.packets) < message.count:
            return None
        del self._open[key]
        self.whole += 1
        whole = b"".join(message.packets[number] for number in range(1, message.count + 1))[: message.size]
        group = message.group | (ends[1] if message.group >> 8 & 0xFF < 0xF0 else 0)
        return _PRIORITY << 26 | group << 8 | ends[0], whole

    def end(self) -> None:
        """Count the messages that are incomplete at the end of the log."""
        for key in list(self._open):
            self._give_up(key)

    def _announced(self, time: int, channel: str, ends: tuple[int, int], data: bytes) -> None:
        key = channel, *ends
        control = data[0] if len(data) == 8 else 0
        if control == _ABORT:  # from either end
            for one in (key, (channel, ends[1], ends[0])):
                self._give_up(one)
        if control not in (_TO_SEND, _TO_ALL):
            return
        self._give_up(key)
        size, count = int.from_bytes(data[1:3], "little"), data[3]
        if count and (count - 1) * _IN_A_PACKET < size <= count * _IN_A_PACKET:
            self._open[key] = _Message(int.from_bytes(data[5:8], "little") & 0x3FFFF, size, count, time)

    def _give_up(self, key: tuple[str, int, int]) -> None:
        if message := self._open.pop(key, None):
            self._account.leave_out(_INCOMPLETE, at=f"group {message.group:#x}")
