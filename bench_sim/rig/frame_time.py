"""The length of a classic CAN frame on the bus in bits, with its actual stuff bits or with the largest number of
them.

Source: ISO 11898-1. From the start of frame to the end of the CRC a stuff bit is inserted after five equal bits. CRC
delimiter, acknowledgement, end of frame and intermission have no stuff bits.
"""

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.frames import Block
from bench_sim.model.compiled import compiled, compiled_entry

#: x¹⁵ + x¹⁴ + x¹⁰ + x⁸ + x⁷ + x⁴ + x³ + 1
_POLYNOMIAL: Final = 0x4599
#: CRC delimiter, acknowledgement slot and delimiter, end of frame.
_TAIL: Final = 10
INTERMISSION: Final = 3
#: Bits of a frame in addition to its data, if another one follows at once: (stuffed, total), by format.
_STANDARD, _EXTENDED = (34, 34 + _TAIL + INTERMISSION), (54, 54 + _TAIL + INTERMISSION)


def worst_bits(length: int, *, extended: bool = False) -> int:
    """Return the largest length in bits of a frame with ``length`` data bytes. Stuff bits and intermission are
    included.

    The first stuff bit requires five equal bits, each further one four, because a stuff bit starts the next run.
    """
    stuffed, total = _EXTENDED if extended else _STANDARD
    return total + 8 * length + (stuffed + 8 * length - 1) // 4


def frame_bits(block: Block) -> npt.NDArray[np.int64]:
    """Return the exact length in bits of each frame on the bus, including stuff bits and intermission."""
    bits = np.zeros(block.size, np.int64)
    if block.size:
        _count(
            np.ascontiguousarray(block["id"]),
            np.ascontiguousarray(block["extended"]),
            np.ascontiguousarray(block["length"]),
            np.ascontiguousarray(block["data"]),
            bits,
        )
    return bits


def arbitration_key(identifier: int, *, extended: bool) -> int:
    """Return the priority of a frame in the arbitration of the bus. The frame with the smaller key wins.

    If the first 11 bits are equal, the standard frame wins, because its RTR and IDE bits are dominant.
    """
    if extended:
        return (identifier >> 18) << 19 | 1 << 18 | (identifier & 0x3_FFFF)
    return identifier << 19


@compiled
def _append(levels: Any, position: int, value: int, width: int) -> int:
    """Write ``width`` bits of ``value``, the highest first. Return the position after them."""
    for k in range(width):
        levels[position + k] = (value >> (width - 1 - k)) & 1
    return position + width


@compiled_entry
def _count(ids: Any, extended: Any, lengths: Any, data: Any, bits: Any) -> None:
    levels = np.zeros(128, np.uint8)
    for row in range(ids.size):
        identifier, length = int(ids[row]), int(lengths[row])
        position = _append(levels, 0, 0, 1)  # start of frame
        if extended[row]:
            position = _append(levels, position, identifier >> 18, 11)
            position = _append(levels, position, 0b11, 2)  # SRR and IDE
            position = _append(levels, position, identifier & 0x3FFFF, 18)
            position = _append(levels, position, 0, 3)  # RTR and two reserved bits
        else:
            position = _append(levels, position, identifier, 11)
            position = _append(levels, position, 0, 3)  # RTR, IDE and a reserved bit
        position = _append(levels, position, length, 4)
        for k in range(length):
            position = _append(levels, position, int(data[row, k]), 8)
        crc = 0
        for k in range(position):
            invert = levels[k] ^ (crc >> 14) & 1
            crc = (crc << 1) & 0x7FFF
            if invert:
                crc ^= _POLYNOMIAL
        position = _append(levels, position, crc, 15)
        stuffed, run, last = 0, 0, 2
        for k in range(position):
            if levels[k] == last:
                run += 1
            else:
                last, run = int(levels[k]), 1
            if run == 5:
                stuffed += 1
                last, run = 1 - last, 1
        bits[row] = position + stuffed + _TAIL + INTERMISSION
