"""The names of the rig's peers: bus of a connection, its full address, and a unique number."""

from typing import Final

CAN: Final = "can"
MODBUS: Final = "modbus"
_PORT_BITS: Final = 16
#: These bits of a sender are its TCP port; clients on other machines may have the same one.
PORT_MASK: Final = (1 << _PORT_BITS) - 1


def peer_name(wire: str, host: str, port: int, number: int) -> str:
    """Return the name of the connection with this ``number`` from ``port`` of ``host``."""
    return f"{wire}:{host}:{port}#{number}"


def sender_of(peer: str) -> int:
    """Return the number of the connection ``peer`` in the tick: its own number, and its TCP port.

    0 without both, because frames on a SocketCAN interface have no sender.
    """
    address, _, number = peer.partition("#")
    _, colon, port = address.rpartition(":")
    return int(number or 0) << _PORT_BITS | (int(port) if colon and port.isdecimal() else 0)


def is_can(peer: str) -> bool:
    """Return whether ``peer`` sends CAN frames: a connection to the CAN hub, or a SocketCAN interface."""
    return not peer.startswith(f"{MODBUS}:")
