"""Kinds of transports for a description, and the loading of a user's own transport."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bench_protocol.suggestion import did_you_mean
from drivers.errors import WiringError
from drivers.wiring.astb.keys import KIND, AstbKeys
from drivers.wiring.contract import Transport
from drivers.wiring.keys import AllAtOnce, convert
from drivers.wiring.points import Points

if TYPE_CHECKING:
    from drivers.can_port import CanPort
    from drivers.modbus_port import ModbusPort

#: Kinds without a port of `drivers`: the factory of each, called with (name, table, directory) and imported then.
_FACTORIES: Final = {"opcua": "drivers.wiring.opcua.transport:opcua"}
KINDS: Final = ("can", "modbus", "modbus_rtu", *_FACTORIES, KIND)
#: Kinds whose points are all listed in the file.
_LISTING: Final = ("modbus", "modbus_rtu", "opcua")


def open_transport(
    name: str,
    table: Mapping[str, Any],
    where: Path,
    *,
    functions: Path | None = None,
    port: Callable[[], CanPort | ModbusPort] | None = None,
    streamed: Collection[str] = (),
) -> Transport:
    """Return the transport described by ``table``, the content of ``[transports.NAME]``; it is not yet connected.

    ``where`` is the directory for relative paths, ``functions`` the Python file of the description, if any. ``port``
    opens a CAN or Modbus port that replaces the described one, for example in memory. ``streamed`` are the points of
    set-points, which have no value until a command sets them. Raises WiringError with the key, its value and a valid
    value.
    """
    kind = table.get("kind")
    if not isinstance(kind, str) or not (kind in KINDS or ":" in kind):
        kinds = f'use one of {", ".join(KINDS)}, or your own as "package.module:factory" or "file.py:factory"'
        right = did_you_mean(kind, KINDS, kinds) if isinstance(kind, str) else kinds
        raise WiringError(f"transports.{name}: kind = {kind!r} is not a transport; {right}")
    opener: Any = port
    if kind == "can":
        from drivers.wiring.can.transport import CanTransport

        return CanTransport(name, table, where, functions=functions, port=opener, streamed=streamed)
    if kind in ("modbus", "modbus_rtu"):
        from drivers.wiring.modbus.transport import ModbusTransport

        return ModbusTransport(name, table, port=opener)
    if kind in _FACTORIES:
        module, _, factory = _FACTORIES[kind].partition(":")
        made: Transport = getattr(importlib.import_module(module), factory)(name, table, where)
        return made
    return _user_transport(name, kind, table, where)


def open_all(
    where: Path,
    tables: Mapping[str, Mapping[str, Any]],
    points: Iterable[tuple[str, str, bool]],
    *,
    functions: Path | None = None,
    ports: Mapping[str, Callable[[], Any]] | None = None,
    streamed: Mapping[str, Collection[str]] | None = None,
) -> dict[str, Transport]:
    """Return all transports of the file ``where`` that have points, by name, not yet connected.

    ``points`` are the points that the lines of the file name: key, TRANSPORT.POINT, and whether the point is written.
    ``functions``, ``ports`` and ``streamed`` (both by transport) are those of `open_transport`. Raises WiringError with
    all invalid transports and all missing points.
    """
    found: dict[str, Transport] = {}
    with AllAtOnce() as wrong:
        for name, table in tables.items():
            with wrong.next(f"{where}: "):
                if table.get("kind") == KIND:
                    convert(f"transports.{name}", table, AstbKeys)
                    continue
                found[name] = open_transport(
                    name,
                    table,
                    where.parent,
                    functions=functions,
                    port=(ports or {}).get(name),
                    streamed=(streamed or {}).get(name, ()),
                )
        known = Points(found)
        for key, point, written in points:
            name = point.partition(".")[0]
            with wrong.next():
                if name in found:
                    known.require(key, point, writable=written)
                else:
                    _require_listed(key, point, tables[name])
    return found


def _require_listed(key: str, point: str, table: Mapping[str, Any]) -> None:
    """Raise WiringError if ``point`` is not listed in its transport, which is invalid for another reason."""
    transport, _, name = point.partition(".")
    listed = table.get("points")
    if table.get("kind") in _LISTING and isinstance(listed, Mapping) and name not in listed:
        raise WiringError(
            f"{key} = {point!r}: transports.{transport} has no point {name!r}; {did_you_mean(name, listed)}"
        )


def _user_transport(name: str, kind: str, table: Mapping[str, Any], where: Path) -> Transport:
    """Return the transport made by a user's factory: ``factory(name, table, where)``."""
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
    except Exception as error:  # a user's file may raise any error
        raise WiringError(f"{place} cannot be imported: {error}; correct the file or its name") from error
    factory = getattr(module, factory_name, None)
    if not callable(factory):
        raise WiringError(
            f"{place}: {module_name} has no function {factory_name!r}; add it, with the "
            "arguments (name, table, directory)"
        )
    try:
        transport = factory(name, table, where)
    except WiringError:
        raise
    except Exception as error:  # for example a missing key
        raise WiringError(
            f"{place}: the transport could not be created: {error!r}; correct its function"
        ) from error
    if not isinstance(transport, Transport):
        raise WiringError(
            f"{place} returns a {type(transport).__name__}, which is not a Transport; derive its class "
            "from drivers.wiring.contract.Transport"
        )
    return transport
