"""The transports that a description may name, and the door through which one of somebody's own comes in."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from drivers.errors import WiringError
from drivers.wiring.contract import Transport
from drivers.wiring.keys import meant

if TYPE_CHECKING:
    from drivers.can_port import CanPort
    from drivers.modbus_port import ModbusPort

KINDS: Final = ("can", "modbus", "modbus_rtu", "opcua")


def open_transport(
    name: str,
    table: Mapping[str, Any],
    where: Path,
    *,
    functions: Path | None = None,
    port: Callable[[], CanPort | ModbusPort] | None = None,
    streamed: Collection[str] = (),
) -> Transport:
    """Return the transport that ``table`` describes, which stands under ``[transports.NAME]``; it is not yet connected.

    ``where`` is the directory that paths in the description start from, ``functions`` its Python file, if it has one,
    and ``port`` opens a CAN or Modbus port in the place of the one described: in memory, say. ``streamed`` are the
    points of set-points. WiringError, with the key, its value and what would be right, for what cannot be.
    """
    kind = table.get("kind")
    if not isinstance(kind, str) or not (kind in KINDS or ":" in kind):
        guess = f" {meant(kind, KINDS)};" if isinstance(kind, str) else ""
        raise WiringError(
            f"transports.{name}: kind = {kind!r} is no transport;{guess} it is one of {', '.join(KINDS)}, or one of "
            'your own as "package.module:factory" or "file.py:factory"'
        )
    opener: Any = port
    if kind == "can":
        from drivers.wiring.can import CanTransport

        return CanTransport(name, table, where, functions=functions, port=opener, streamed=streamed)
    if kind in ("modbus", "modbus_rtu"):
        from drivers.wiring.modbus import ModbusTransport

        return ModbusTransport(name, table, port=opener)
    if kind == "opcua":
        from drivers.wiring.opcua import OpcUaTransport

        return OpcUaTransport(name, table)
    return _own(name, kind, table, where)


def _own(name: str, kind: str, table: Mapping[str, Any], where: Path) -> Transport:
    """Return what a factory of somebody's own makes: ``factory(name, table, where)``."""
    module_name, _, factory_name = kind.rpartition(":")
    place = f"transports.{name}: kind = {kind!r}"
    try:
        if module_name.endswith(".py"):
            path = where / module_name
            spec = importlib.util.spec_from_file_location(path.stem, path)
            assert spec is not None and spec.loader is not None
            module = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(module)
        else:
            module = importlib.import_module(module_name)
    except Exception as error:  # whatever a user's file does wrong
        raise WiringError(f"{place} cannot be imported: {error}") from error
    factory = getattr(module, factory_name, None)
    if not callable(factory):
        raise WiringError(
            f"{place}: {module_name} has no {factory_name!r} to call with (name, table, directory)"
        )
    try:
        transport = factory(name, table, where)
    except WiringError:
        raise
    except Exception as error:  # a key that it takes for granted, say
        raise WiringError(f"{place} could not be made: {error!r}") from error
    missing = [part for part in _PARTS if not hasattr(transport, part)]
    if missing:
        raise WiringError(f"{place} makes a {type(transport).__name__} without {', '.join(missing)}")
    return transport


_PARTS: Final = sorted(part for part in vars(Transport) if not part.startswith("_"))
