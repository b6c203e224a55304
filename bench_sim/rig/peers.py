"""The names of the rig's peers: which wire a connection uses and which TCP port it comes from."""

from typing import Final

CAN: Final = "can"
MODBUS: Final = "modbus"


def peer_name(wire: str, host: str, port: int) -> str:
    """Return the name of the connection that comes from ``port`` of ``host``."""
    return f"{wire}:{host}:{port}"


def port_of(peer: str) -> int:
    """Return the TCP port in a peer's name, 0 where there is none: a SocketCAN interface knows no senders."""
    _, colon, port = peer.rpartition(":")
    return int(port) if colon and port.isdecimal() else 0


def is_can(peer: str) -> bool:
    """Return whether ``peer`` is a connection to the CAN hub."""
    return peer.startswith(f"{CAN}:")
