"""What SAE J1939 says of identifiers and of codes that stand for no value."""

from __future__ import annotations

from typing import Final, Literal

_PDU1_MAX: Final = 0xEF  #: up to this format the next byte is an address, not a part of the group's number
#: The source address of a description that is anybody's.
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
    """Return what the bits of an unsigned signal say if they are no value; "" if they are one.

    SAE J1939-71, 5.1.4: of whole bytes the highest one decides (FE, FF), and of twelve bits the highest eight. Of two
    to seven bits, ten, and so on, all ones are not available, and one less is an error. A single bit is always a value.
    """
    if bits < 2:
        return ""
    shift = bits - 8 if bits in _WHOLE_BYTES or bits == 12 else 0
    top = (1 << bits - shift) - 1
    code = raw >> shift
    return "not available" if code == top else "error" if code == top - 1 else ""
