"""AUTOSAR E2E profile 1: the CRC and alive counter that protect every command against loss, mix-up and corruption.

Layout of a protected frame::

    byte 0   CRC-8 SAE-J1850 (polynomial 0x1D, start 0, over data id low, data id high, bytes 1 to 7)
    byte 1   low half: alive counter 0..14; high half: first bits of the data
    byte 2+  data

A rejected frame never changes the counter of the receiver.
"""

from typing import Final

import numpy as np

from bench_protocol.runtime.binding import bind, cached

COUNTER_PERIOD: Final = 15
POLYNOMIAL: Final = 0x1D


def _table() -> np.ndarray:
    rows = np.zeros(256, np.uint8)
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = (crc << 1) ^ POLYNOMIAL if crc & 0x80 else crc << 1
            crc &= 0xFF
        rows[byte] = crc
    return rows


_CRC: Final = _table()


@cached
def crc8(data: np.ndarray, data_id: int) -> int:
    """Return the profile-1 CRC over ``data_id`` and ``data[1:]`` (uint8[8])."""
    crc = _CRC[data_id & 0xFF]
    crc = _CRC[crc ^ (data_id >> 8 & 0xFF)]
    for position in range(1, data.size):
        crc = _CRC[crc ^ data[position]]
    return crc


@cached
def counter_step(received: int, last: int) -> int:
    """Return the increment of the alive counter, 0 for a repetition."""
    return (received - last) % COUNTER_PERIOD


@cached
def token_mark(token: int) -> int:
    """Return the bits of the CRC that change if ``token`` is combined with the data id by exclusive-or. They are the
    same for all frames.
    """
    return crc8(np.zeros(8, np.uint8), token)


#: The same functions for Python, compiled at import: compiling them when a commander takes the lease would delay the
#: answer too much.
crc_of: Final = bind(crc8, np.zeros(8, np.uint8), 0)
mark_of: Final = bind(token_mark, 0)
