"""Frames of CAN FD, with up to 64 bytes of data each."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from bench_protocol.frames import Block, frame

#: Data bytes that a frame of CAN FD can have.
FD_LENGTHS: Final = (*range(9), 12, 16, 20, 24, 32, 48, 64)
FD_LENGTH_MAX: Final = FD_LENGTHS[-1]
#: The fields of ``FRAME`` with 64 data bytes, and a flag for frames of CAN FD.
FD_FRAME: Final = np.dtype(
    [
        ("time", "<i8"),
        ("id", "<u4"),
        ("extended", "u1"),
        ("length", "u1"),
        ("fd", "u1"),
        ("data", "u1", (FD_LENGTH_MAX,)),
    ]
)


@dataclass(frozen=True, slots=True)
class Fd:
    """Options for sending frames of CAN FD."""

    bitrate_switch: bool = False  #: send the data bytes at the fast rate


def fd_frame(
    identifier: int, data: bytes, time: int = 0, *, extended: bool = False, classic: bool = False
) -> Block:
    """Return a block of one frame for a CAN FD bus at ``time`` (ns), padded with zeros to a valid length. ``classic``:
    a frame that is not CAN FD.
    """
    head = frame(identifier, data[:8], time, extended=extended)
    length = next((one for one in FD_LENGTHS if one >= len(data)), 0)
    if len(data) > length:
        raise ValueError(
            f"data = {len(data)} bytes does not fit in a frame of CAN FD (0 to {FD_LENGTH_MAX} bytes)"
        )
    block = np.zeros(1, FD_FRAME)
    for field in ("time", "id", "extended"):
        block[field] = head[field]
    block["length"], block["fd"] = length, not classic
    block["data"][0, : len(data)] = np.frombuffer(data, np.uint8)
    return block
