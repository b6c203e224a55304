"""Protection of CAN messages against loss, repetition and corruption: counters and checksums by scheme."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from bench_protocol.e2e import crc_of
from bench_protocol.suggestion import did_you_mean
from drivers.errors import WiringError
from drivers.wiring.user_functions import find_function

#: Function that returns the checksum of a frame. Arguments: identifier, and data in which the checksum is 0.
Checksum = Callable[[int, bytes], int]
SCHEMES: Final = ("sum8", "xor8", "e2e_p1", "function:NAME")
E2E_COUNTER_PERIOD: Final = 15


class ChecksumKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A checksum over all bytes of a frame."""

    signal: str  #: signal with the checksum
    scheme: str  #: sum8 | xor8 | e2e_p1 (AUTOSAR profile 1) | function:NAME of the description's Python file
    data_id: int | None = None  #: of e2e_p1
    start: int = 0  #: initial value of sum8 and xor8
    identifier: bool = False  #: sum8 and xor8 include the identifier (4 bytes, or 2 if it has 11 bits)


def checksum(where: str, keys: ChecksumKeys, extended: bool, functions: Path | None) -> Checksum:
    """Return the function that computes the checksum; with ``extended``, an included identifier has 4 bytes, otherwise
    2. Raises WiringError for an unknown scheme.
    """
    scheme, _, name = keys.scheme.partition(":")
    if scheme not in ("sum8", "xor8", "e2e_p1", "function"):
        raise WiringError(
            f"{where}: scheme = {keys.scheme!r} is unknown; {did_you_mean(keys.scheme, SCHEMES)}"
        )
    if (scheme == "e2e_p1") != (keys.data_id is not None):
        raise WiringError(
            f"{where}: e2e_p1 needs data_id; add a number from 0 to 0xFFFF"
            if scheme == "e2e_p1"
            else f"{where}: data_id = {keys.data_id} is for e2e_p1 only; remove it for {scheme}"
        )
    if scheme == "function":
        return _user_checksum(f"{where}: scheme", name, functions)
    if scheme == "e2e_p1":
        return _profile_1(where, keys.data_id or 0)
    size = (4 if extended else 2) if keys.identifier else 0
    add: Callable[[int, int], int] = xor if scheme == "xor8" else _sum
    return lambda identifier, data: reduce(
        add, identifier.to_bytes(size, "big") + data if size else data, keys.start
    )


def _sum(total: int, byte: int) -> int:
    return (total + byte) & 0xFF


def _profile_1(where: str, data_id: int) -> Checksum:
    if not 0 <= data_id <= 0xFFFF:
        raise WiringError(f"{where}: data_id = {data_id:#x} does not fit in 16 bits; use 0 to 0xFFFF")

    def crc(identifier: int, data: bytes) -> int:
        del identifier
        return int(crc_of(np.frombuffer(bytearray(data), np.uint8), data_id))

    return crc


def _user_checksum(where: str, name: str, functions: Path | None) -> Checksum:
    if functions is None:
        raise WiringError(
            f'{where} = "function:{name}" needs the key functions in the description; add functions = "file.py"'
        )
    function: Callable[..., Any] = find_function(where, functions, name)
    return lambda identifier, data: int(function(identifier, data))
