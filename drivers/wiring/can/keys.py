"""The keys of messages and signals of a CAN transport."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

import msgspec
from msgspec import Meta

from drivers.can_fd import FD_LENGTH_MAX


class CanKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The keys under ``[transports.NAME]``."""

    kind: str
    bus: str = "auto"
    host: str = "127.0.0.1"
    port: Annotated[int, Meta(ge=1, le=0xFFFF)] = 29536
    interface: str | None = None
    channel: str | None = None
    options: dict[str, Any] = {}
    dbc: str | None = None
    charset: str | None = None  #: of the DBC
    node: str | None = None
    fd: bool = False
    bitrate_switch: bool = False
    j1939: bool | None = None
    stale: str | None = None
    burst: str | None = None  #: frames within this time after the first one were sampled with it
    burst_begins: str | None = None  #: the message that is sent first
    answers: bool = True
    messages: dict[str, Any] = {}
    points: dict[str, Any] = {}


class MessageKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The keys under ``[transports.NAME.messages.MESSAGE]``."""

    id: Annotated[int, Meta(ge=0)] | None = None  #: of a message that no DBC describes
    extended: bool | None = None  #: its identifier has 29 bits
    length: Annotated[int, Meta(ge=0)] | None = None  #: number of bytes; default 8
    every: str | None = None  #: period of sending; default: sent when it is written
    stale: str | None = None  #: time without the message after which its points are stale
    counter: str | None = None  #: the signal that counts its frames
    counter_period: Annotated[int, Meta(ge=2)] | None = (
        None  #: number of frames after which the counter restarts at 0
    )
    checksum: dict[str, Any] | None = None
    values: dict[str, float] = {}  #: constant values of signals that nothing else writes
    source: Annotated[int, Meta(ge=0, le=0xFD)] | None = None  #: J1939: address of the sender


class CommonKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The keys under ``[transports.NAME.messages."*"]``: defaults for all messages that have these signals."""

    counter: str | None = None
    checksum: dict[str, Any] | None = None


class SignalKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True, rename={"is_float": "float"}):
    """A point of a CAN message: number = scale · raw + offset. With a DBC only ``null`` may be given."""

    start: Annotated[int, Meta(ge=0, le=8 * FD_LENGTH_MAX - 1)] | None = None  #: bit, counted as in a DBC
    length: Annotated[int, Meta(ge=1, le=64)] | None = None  #: bits
    byte_order: Literal["little", "big"] = "little"
    signed: bool = False
    is_float: bool = False  #: IEEE 754 in 16, 32 or 64 bits
    scale: float = 1.0
    offset: float = 0.0
    page: int | None = None  #: value of the selector in frames that have this signal
    selector: bool = False  #: the value of this signal states the page
    #: The raw values that mean "not available"; default: those that the DBC names so.
    null: float | list[float] | None = None


DBC_SAYS: Final = frozenset(SignalKeys.__struct_fields__) - {"null"}
