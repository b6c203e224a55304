"""The rig's map as one of its files (Modbus function 20): the place of each signal, for a driver with another table.

File 1000::

    register 0       1      2 ...
             format  bytes  that many bytes, two in a register: zlib of UTF-8 text

The text has a line ``place: content`` for each of the places of `Table.places`, whose hash is the map hash.
"""

import zlib
from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np

from bench_protocol.registers import SEQUENCE
from bench_protocol.wires import Table, hash_of

MAP_FILE: Final = 1000
_FORMAT: Final = 1
_HEAD: Final = 2
#: A file has no more than 10 000 registers; their unpacked size is limited too.
_BYTES_MAX: Final = 2 * (10_000 - _HEAD)
_TEXT_MAX: Final = 1_000_000

#: Reads ``count`` registers of a file: (file, record, count).
ReadFile = Callable[[int, int, int], Sequence[int]]


def map_registers(table: Table) -> list[int]:
    """Return the registers of the file that describes ``table``."""
    text = "\n".join(f"{place}: {content}" for place, content in table.places.items())
    packed = zlib.compress(text.encode(), 9)
    words = np.frombuffer(packed + bytes(len(packed) % 2), ">u2").tolist()
    return [_FORMAT, len(packed), *words]


def read_places(read: ReadFile, at_once: int, map_hash: int) -> dict[str, str]:
    """Return the places that a rig reports. A request reads up to ``at_once`` registers.

    Raises ValueError if the format is unknown, the data are corrupt, or their hash is not ``map_hash``.
    """
    form, size = read(MAP_FILE, 0, _HEAD)
    if form != _FORMAT or size > _BYTES_MAX:
        raise ValueError(
            f"its signal map has format {form} and {size} bytes; this version reads format {_FORMAT} only"
        )
    words: list[int] = []
    for first in range(0, (size + 1) // 2, at_once):
        words += read(MAP_FILE, _HEAD + first, min(at_once, (size + 1) // 2 - first))
    packed = np.array(words, np.uint16).astype(">u2").tobytes()[:size]
    try:
        text = zlib.decompressobj().decompress(packed, _TEXT_MAX).decode()
    except (zlib.error, UnicodeDecodeError) as error:
        raise ValueError(f"its signal map cannot be unpacked: {error}") from None
    places = _lines(text)
    if hash_of(places) != map_hash:
        raise ValueError(
            f"its signal map has the hash {hash_of(places):#010x}, but its hash register reads "
            f"{map_hash:#010x}"
        )
    return places


def _lines(text: str) -> dict[str, str]:
    pairs = (line.partition(": ") for line in text.split("\n"))
    return {place: content for place, _, content in pairs}


def sequences(places: Mapping[str, str]) -> list[int]:
    """Return the addresses of the input registers that have the sequence number of a block."""
    return [
        int(place.split()[1])
        for place, content in places.items()
        if place.startswith("input ") and content.startswith(f"{SEQUENCE} ")
    ]
