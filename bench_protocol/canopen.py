"""CANopen on the bench (CiA 301): the rig is one node, and every message is one of its PDOs, or its emergency.

The identifiers do not follow the predefined connection set; the communication parameters of the PDOs state the sending
node. A message of the rig is a TPDO, a message of the commander an RPDO. The PDO number follows from the identifier and
never changes::

    identifier   181h to 190h   281h to 290h   381h to 390h   481h to 490h
    TPDO           1 to 16       17 to 32       33 to 48       49 to 64
    identifier   201h to 210h   301h to 310h   401h to 410h   501h to 510h
    RPDO           1 to 16       17 to 32       33 to 48       49 to 64
"""

from enum import IntEnum
from typing import Final

from bench_protocol.messages import Message, Protection

#: The rig's node-ID.
NODE: Final = 1
NODE_MAX: Final = 127
#: Addresses all nodes in an NMT command.
ALL_NODES: Final = 0

NMT_IDENTIFIER: Final = 0x000
SYNC_IDENTIFIER: Final = 0x080
EMERGENCY_IDENTIFIER: Final = 0x080 + NODE
SDO_RESPONSE_IDENTIFIER: Final = 0x580 + NODE
SDO_REQUEST_IDENTIFIER: Final = 0x600 + NODE
HEARTBEAT_BASE: Final = 0x700
HEARTBEAT_IDENTIFIER: Final = HEARTBEAT_BASE + NODE

#: Heartbeat period of the rig at its start, and the shortest one that the bus load allows (ms).
HEARTBEAT_MS: Final = 1000
HEARTBEAT_MS_MIN: Final = 100
#: The shortest period of SYNC that the bus load allows (µs).
SYNC_US_MIN: Final = 10_000
#: Largest number of heartbeat and SYNC frames in a second.
SERVICE_RATE_MAX: Final = 1e3 / HEARTBEAT_MS_MIN + 1e6 / SYNC_US_MIN

#: Bits of a COB-ID parameter. SYNC: the node produces it. TPDO: remote frames cannot request it; it is not sent at all.
SYNC_PRODUCED: Final = 1 << 30
NO_REMOTE: Final = 1 << 30
NOT_VALID: Final = 1 << 31
#: Transmission types of a PDO: the largest number of SYNCs to wait for, and those that wait for none.
SYNCHRONOUS_MAX: Final = 240
EVENT_DRIVEN: Final = (254, 255)

_PDOS_PER_BLOCK: Final = 16
_BLOCKS: Final = 4
_TPDO_BASE: Final = 0x180
_RPDO_BASE: Final = 0x200


class NmtState(IntEnum):
    """States of a node, by the number that its heartbeat carries."""

    INITIALISING = 0  #: in the boot-up message
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


class NmtCommand(IntEnum):
    """Commands of an NMT master to a node."""

    START = 1
    STOP = 2
    ENTER_PRE_OPERATIONAL = 128
    RESET_NODE = 129
    RESET_COMMUNICATION = 130


class ErrorBehaviour(IntEnum):
    """Reaction of the node's state to a missed heartbeat (object 1029h)."""

    PRE_OPERATIONAL = 0
    NO_CHANGE = 1
    STOPPED = 2


def is_pdo(message: Message) -> bool:
    """Return whether ``message`` is a PDO: all messages except the emergency message."""
    return message.protection is not Protection.NONE


def pdo_number(message: Message) -> int:
    """Return the number of the PDO of ``message``, from 1. Raises ValueError for an identifier without a PDO."""
    block, place = divmod(message.identifier - (_TPDO_BASE if message.from_rig else _RPDO_BASE), 0x100)
    if not (0 <= block < _BLOCKS and 1 <= place <= _PDOS_PER_BLOCK):
        digit = "1, 2, 3 or 4 and 81 to 90" if message.from_rig else "2, 3, 4 or 5 and 01 to 10"
        raise ValueError(
            f"{message.name}: {message.identifier:#05x} is not the identifier of a PDO of the bench; "
            f"use {digit} (hex)"
        )
    return _PDOS_PER_BLOCK * block + place
