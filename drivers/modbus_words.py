"""Texts for Modbus requests and wrong answers, and checks that a request is valid."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

#: Header of Modbus/TCP: transaction, protocol, length, unit.
HEADER: Final = struct.Struct(">HHHB")


@dataclass(frozen=True, slots=True)
class SerialLine:
    """The settings of a serial line."""

    device: str
    baudrate: int = 19200
    parity: str = "none"
    stopbits: int = 1
    local_echo: bool = False  #: sent bytes are received again, as with some two-wire adapters


def request_in_words(verb: str, address: int, count: int, count_max: int, where: str) -> str:
    """Return the text of a request to ``where``. Raises ValueError if no request can have these numbers."""
    what = f"{verb} {address}" + (f" to {address + count - 1}" if count > 1 else "") + f" of {where}"
    if not 1 <= count <= count_max:
        raise ValueError(f"{verb}: count = {count} does not fit in one request; use 1 to {count_max}")
    if not 0 <= address <= 0x1_0000 - count:
        raise ValueError(
            f"{verb}: address = {address} with count = {count} is outside the addresses 0 to 65535; "
            "correct the address or the count"
        )
    return what


def in_registers(what: str, values: Sequence[int]) -> list[int]:
    """Return ``values`` as register contents. Raises ValueError for one that does not fit."""
    numbers = [int(value) for value in values]
    for value in numbers:
        if not 0 <= value <= 0xFFFF:
            raise ValueError(f"{what}: {value} does not fit in a register; use 0 to 65535")
    return numbers


def instead(request: bytes, came: bytes, *, framed: bool) -> str:
    """Return the end of an error message: the bytes ``came`` were received instead of an answer; "" if none came.

    ``framed``: request and answer have a Modbus/TCP header.
    """
    if not came:
        return ""
    if not framed:
        return (
            f"; {len(came)} bytes came that are not a valid frame, or are from another unit; check "
            "baudrate, parity and unit"
        )
    if len(came) < HEADER.size or len(request) < HEADER.size:
        return f"; {len(came)} bytes came, which is too short for an answer"
    (number, _, _, unit), (answer_number, protocol, _, answer_unit) = (
        HEADER.unpack_from(request),
        HEADER.unpack_from(came),
    )
    if protocol:
        return '; the answer is not Modbus/TCP; use another protocol, or kind = "modbus_rtu"'
    if answer_unit != unit:
        return f"; the answer is from unit {answer_unit} instead of {unit}; correct unit, or set echo = false"
    if answer_number != number:
        return f"; the answer has the request number {answer_number} instead of {number}; set echo = false"
    return f"; {len(came)} bytes of an answer came"
