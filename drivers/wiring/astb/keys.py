"""The keys of a transport of kind ``astb``, and of the ports of a rig with the ASTB table of signals."""

from __future__ import annotations

from typing import Annotated, Final

import msgspec
from msgspec import Meta

#: The kind of transport that carries the signals of the table themselves.
KIND: Final = "astb"
Port = Annotated[int, Meta(ge=1, le=65535)]


class Can(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The address of the rig's CAN bus."""

    bus: str = "auto"  #: auto | tcp | the name of a SocketCAN interface
    host: str = "127.0.0.1"
    port: Port = 29536  #: of the hub, for tcp


class Modbus(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The address of the rig's Modbus/TCP server."""

    host: str = "127.0.0.1"
    port: Port = 15020
    unit: Annotated[int, Meta(ge=0, le=255)] = 1


class AstbKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The table ``[transports.NAME]``."""

    kind: str
    can: Can = Can()
    modbus: Modbus = Modbus()
    commands: bool = True  #: false: only listens, and never becomes the rig's commander
