"""A CAN message: a classic frame with an 11-bit identifier, its fields and its protection."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Final

from bench_protocol.frames import STANDARD_ID_MAX

FRAME_BITS: Final = 64
#: Number of bits of an integer that a float64 holds exactly.
FIELD_BITS_MAX: Final = 53
#: The signal with the token of the commander, which the rig generated with the lease.
TOKEN: Final = "control.token"
#: Value of `rig.lease` as long as only the Modbus connection of the holder knows the token. No token has this value.
HIDDEN_TOKEN: Final = 0xFFFF
#: Names that a DBC file allows for a message.
_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,31}")


class Protection(Enum):
    """The protection of a CAN message against loss, skew and corruption."""

    NONE = 0
    COUNTER = 8  #: an 8-bit sample counter in the last byte
    E2E = 16  #: AUTOSAR E2E profile 1: CRC in byte 0, alive counter in the low half of byte 1


@dataclass(frozen=True, slots=True)
class Field:
    """A signal's place in a CAN message: ``raw = round(value / step)`` in ``bits`` bits.

    The lowest code of a signed field and the highest of an unsigned one mean "not available" and read as NaN; a
    field without ``nullable`` uses all its codes.
    """

    signal: str
    bits: int
    step: float = 0.0  #: SI; 0 takes the signal's own
    signed: bool = True
    nullable: bool = True

    def __post_init__(self) -> None:
        if not 1 <= self.bits <= FIELD_BITS_MAX:
            raise ValueError(
                f"{self.signal}: a field of {self.bits} bits is not possible; use 1 to {FIELD_BITS_MAX}"
            )

    @property
    def raw_low(self) -> int:
        """Smallest code that carries a value."""
        return -(1 << (self.bits - 1)) + int(self.nullable) if self.signed else 0

    @property
    def raw_high(self) -> int:
        """Largest code that carries a value."""
        return (1 << (self.bits - 1)) - 1 if self.signed else (1 << self.bits) - 1 - int(self.nullable)

    @property
    def raw_null(self) -> int:
        """The code for "not available"."""
        return -(1 << (self.bits - 1)) if self.signed else (1 << self.bits) - 1


@dataclass(frozen=True, slots=True)
class Message:
    """A classic CAN frame with an 11-bit identifier, sent ``rate`` times a second; little-endian fields in order."""

    name: str
    identifier: int
    rate: float  #: Hz; 0 means "on events only"
    from_rig: bool
    fields: tuple[Field, ...]
    protection: Protection
    description: str
    data_id: int = 0  #: for E2E
    bound: bool = False  #: its CRC uses the data id exclusive-or the token; it has no field for `TOKEN`

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise ValueError(
                f"message name {self.name!r} must be up to 32 letters, digits and underscores, for the DBC"
            )
        if not 0 <= self.identifier <= STANDARD_ID_MAX:
            raise ValueError(
                f"{self.name}: identifier {self.identifier:#x} has more than 11 bits; "
                f"the codec knows standard frames only (0 to {STANDARD_ID_MAX:#x})"
            )
        if self.rate < 0:
            raise ValueError(
                f"{self.name}: rate = {self.rate:g} Hz must not be negative; write 0 for a message "
                "that is sent on events only"
            )
        if not 0 <= self.data_id <= 0xFFFF:
            raise ValueError(
                f"{self.name}: data id {self.data_id:#x} does not fit in 16 bits; use 0 to 0xFFFF"
            )
        if self.bound and self.protection is not Protection.E2E:
            raise ValueError(
                f"{self.name}: only an end-to-end protected message can bind a token; use Protection.E2E"
            )
        used = self.first_bit + sum(field.bits for field in self.fields)
        room = FRAME_BITS - (8 if self.protection is Protection.COUNTER else 0)
        if used > room:
            raise ValueError(
                f"{self.name}: its fields end at bit {used}, but the frame has room for {room}; move a "
                "field to another message"
            )

    @property
    def first_bit(self) -> int:
        """The first bit of the fields: an E2E header precedes them, a sample counter follows them."""
        return 12 if self.protection is Protection.E2E else 0

    def placed(self) -> Iterator[tuple[Field, int]]:
        """Yield every field with its first bit."""
        bit = self.first_bit
        for field in self.fields:
            yield field, bit
            bit += field.bits

    @property
    def token_bit(self) -> int:
        """First bit of the field with the token; -1 if there is none."""
        return next((bit for field, bit in self.placed() if field.signal == TOKEN), -1)

    @property
    def counter_bit(self) -> int:
        """First bit of the sample or alive counter."""
        return 8 if self.protection is Protection.E2E else 56
