"""What a Modbus request is in words, whether it can be one at all, and what came in the place of its answer."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

#: Transaction, protocol, length, unit.
HEADER: Final = struct.Struct(">HHHB")


@dataclass(frozen=True, slots=True)
class SerialLine:
    """How bits travel on a serial line."""

    device: str
    baudrate: int = 19200
    parity: str = "none"
    stopbits: int = 1
    local_echo: bool = False  #: what is sent comes back, as from some adapters of two wires


def request_in_words(verb: str, address: int, count: int, count_max: int, where: str) -> str:
    """Return what is asked of ``where``; ValueError if no request can carry it."""
    what = f"{verb} {address}" + (f" to {address + count - 1}" if count > 1 else "") + f" of {where}"
    if not 1 <= count <= count_max:
        raise ValueError(f"{verb}: count = {count} does not fit in one request (1 to {count_max})")
    if not 0 <= address <= 0x1_0000 - count:
        raise ValueError(f"{verb}: address = {address} with count = {count} is outside 0 to 65535")
    return what


def in_registers(what: str, values: Sequence[int]) -> list[int]:
    """Return ``values`` as numbers of registers; ValueError for one that does not fit."""
    numbers = [int(value) for value in values]
    for value in numbers:
        if not 0 <= value <= 0xFFFF:
            raise ValueError(f"{what}: {value} does not fit in a register (0 to 65535)")
    return numbers


def instead(request: bytes, came: bytes, *, framed: bool) -> str:
    """Return what came in the place of an answer to ``request``; ``framed``: both have the head of Modbus/TCP."""
    if not came:
        return ""
    if not framed:
        return f"; {len(came)} bytes came that are no sound frame, or another unit's: baudrate, parity, unit?"
    if len(came) < HEADER.size or len(request) < HEADER.size:
        return f"; {len(came)} bytes came, less than an answer"
    (asked, _, _, unit), (told, protocol, _, answering) = (
        HEADER.unpack_from(request),
        HEADER.unpack_from(came),
    )
    if protocol:
        return '; what came is no Modbus/TCP: another protocol, or kind = "modbus_rtu"?'
    if answering != unit:
        return f"; it answers as unit {answering} and not as {unit}: another unit, or echo = false"
    if told != asked:
        return f"; it answers to request number {told} and not to {asked}: echo = false"
    return f"; {len(came)} bytes of an answer came"
