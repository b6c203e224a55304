"""The names of the clients of a rig. Each consists of the bus, the full address, and a unique number of the
connection.
"""

from typing import Final

CAN: Final = "can"
MODBUS: Final = "modbus"
_PORT_BITS: Final = 16
#: These bits of a sender are its TCP port; clients on other machines may have the same one.
PORT_MASK: Final = (1 << _PORT_BITS) - 1


def peer_name(wire: str, host: str, port: int, number: int) -> str:
    """Return the name of a connection from ``port`` of ``host``. ``wire`` is the bus, and ``number`` is unique."""
    return f"{wire}:{host}:{port}#{number}"


def sender_of(peer: str) -> int:
    """Return the integer that identifies the connection ``peer`` in the tick. It contains the number and the TCP port
    of the connection.

    Frames on a SocketCAN interface have no sender, and the result is 0.
    """
    address, _, number = peer.partition("#")
    _, colon, port = address.rpartition(":")
    return int(number or 0) << _PORT_BITS | (int(port) if colon and port.isdecimal() else 0)


def is_can(peer: str) -> bool:
    """Return whether ``peer`` sends CAN frames: a connection to the CAN hub, or a SocketCAN interface."""
    return not peer.startswith(f"{MODBUS}:")
