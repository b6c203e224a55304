"""The names of the rig's peers: the wire of a connection, its full address, and a number that no other one has."""

from typing import Final

CAN: Final = "can"
MODBUS: Final = "modbus"
_PORT_BITS: Final = 16
#: These bits of a sender are its TCP port; clients on other machines may have the same one.
PORT_MASK: Final = (1 << _PORT_BITS) - 1


def peer_name(wire: str, host: str, port: int, number: int) -> str:
    """Return the name of the connection with this ``number`` that comes from ``port`` of ``host``."""
    return f"{wire}:{host}:{port}#{number}"


def sender_of(peer: str) -> int:
    """Return the number by which the tick knows the connection ``peer``: its own number, and its TCP port.

    0 where there is neither: frames on a SocketCAN interface have no sender.
    """
    address, _, number = peer.partition("#")
    _, colon, port = address.rpartition(":")
    return int(number or 0) << _PORT_BITS | (int(port) if colon and port.isdecimal() else 0)


def is_can(peer: str) -> bool:
    """Return whether ``peer`` sends CAN frames: a connection to the CAN hub, or a SocketCAN interface."""
    return not peer.startswith(f"{MODBUS}:")
