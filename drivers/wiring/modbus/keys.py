"""The keys of a Modbus transport, and the port that they describe."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.util import find_spec
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import msgspec
from msgspec import Meta

from bench_protocol.modbus import REGISTERS_READ_MAX
from drivers.errors import WiringError
from drivers.modbus_port import open_modbus, open_serial
from drivers.modbus_words import SerialLine
from drivers.wiring.keys import convert
from drivers.wiring.modbus.registers import ByteOrder, WordOrder

if TYPE_CHECKING:
    from drivers.modbus_port import ModbusPort

#: Modbus functions for writing. "single": 5 and 6. "multiple": 15 and 16. "any": detected by trial. "parts": 5 and 6,
#: also one after the other for a number of several registers. "combined": 23 for registers, which writes and reads.
Writes = Literal["any", "single", "multiple", "parts", "combined"]
#: Hint in an error where one request cannot write a number of several registers.
IN_PARTS: Final = (
    "the register would hold a wrong number between two requests. Use a point of one register. If the device accepts "
    'a number only with its last register, set writes = "parts"'
)
RTU: Final = "modbus_rtu"


class GroupKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Points that are read together, periodically."""

    every: str
    stale: str | None = None
    gap: Annotated[int, Meta(ge=0, le=124)] = 0


class CommonKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """The keys under ``[transports.NAME]`` for all kinds of lines."""

    kind: str
    points: dict[str, Any]
    port: Annotated[int, Meta(ge=1, le=0xFFFF)] = 502
    unit: Annotated[int, Meta(ge=0, le=0xFF)] = 1
    word_order: WordOrder = "high"
    byte_order: ByteOrder = "big"
    timeout: str = "500 ms"
    patience: str = "1 s"
    stream: str = "50 ms"
    alive: dict[str, Any] | None = None
    groups: dict[str, Any] = {}
    writes: Writes = "any"
    request_max: Annotated[int, Meta(ge=1, le=REGISTERS_READ_MAX)] = REGISTERS_READ_MAX
    connection: Literal["kept", "each", "shared"] = "kept"


class ModbusKeys(CommonKeys, frozen=True, kw_only=True):
    """The keys under ``[transports.NAME]`` for Modbus/TCP."""

    host: str
    echo: bool = True


class RtuKeys(CommonKeys, frozen=True, kw_only=True):
    """The keys under ``[transports.NAME]`` for serial frames, on a serial line or over TCP."""

    line: str | None = None
    host: str | None = None
    baudrate: Annotated[int, Meta(ge=50, le=4_000_000)] = 19200
    parity: Literal["even", "odd", "none"] = "none"
    stopbits: Literal[1, 2] = 1
    local_echo: bool = False


def read_keys(where: str, table: Mapping[str, Any]) -> ModbusKeys | RtuKeys:
    """Return the keys in ``table``. Raises WiringError, which begins with ``where``, for invalid keys."""
    if table.get("kind") != RTU:
        return convert(where, table, ModbusKeys)
    keys = convert(where, table, RtuKeys)
    if (keys.line is None) == (keys.host is None):
        raise WiringError(
            f"{where} has both line and host; remove one of them"
            if keys.line is not None
            else f'{where} has neither line nor host; add line = "/dev/ttyUSB0" (a serial line) or host = "192.0.2.10" '
            "(frames of a serial line over TCP)"
        )
    if keys.line is None:
        for key in ("baudrate", "parity", "stopbits", "local_echo"):
            if key in table:
                raise WiringError(
                    f"{where}: {key} is for a serial line only; remove it, because over TCP the "
                    "gateway sets it"
                )
    elif "port" in table or "connection" in table:
        raise WiringError(f"{where}: port and connection are for TCP only; remove them for a serial line")
    elif find_spec("serial") is None:
        raise WiringError(f"{where}: line = {keys.line!r} needs the library pyserial: pip install pyserial")
    return keys


def place_of(keys: ModbusKeys | RtuKeys) -> str:
    """Return the address of the device as text."""
    return keys.line if isinstance(keys, RtuKeys) and keys.line else f"{keys.host}:{keys.port}"


def opener(keys: ModbusKeys | RtuKeys, timeout: float) -> Callable[[float], ModbusPort]:
    """Return a function that opens the port of ``keys`` within the given time (s)."""

    def open_port(within: float) -> ModbusPort:
        rtu = isinstance(keys, RtuKeys)
        if isinstance(keys, RtuKeys) and keys.line is not None:
            line = SerialLine(keys.line, keys.baudrate, keys.parity, keys.stopbits, keys.local_echo)
            return open_serial(line, unit=keys.unit, timeout=timeout)
        assert keys.host is not None
        return open_modbus(
            keys.host,
            keys.port,
            unit=keys.unit,
            timeout=timeout,
            within=within,
            rtu=rtu,
            each=keys.connection == "each",
            shared=keys.connection == "shared",
            echo=True if isinstance(keys, RtuKeys) else keys.echo,
        )

    return open_port
