"""The wiring of a rig that implements the ASTB table of signals: the supplied description with given ports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any, Final

from bench_protocol.named_files import ORDINARY_RIG, named_files
from bench_protocol.table import TABLE
from bench_protocol.wires import Table
from drivers.wiring.described import DescribedWiring, open_described
from drivers.wiring.description import PACKAGE, read_description
from drivers.wiring.lines import Description

if TYPE_CHECKING:
    from drivers.can_port import CanPort
    from drivers.modbus_port import ModbusPort

#: The name of the transport in the file.
TRANSPORT: Final = "rig"


@cache
def _read(table: Table) -> Description:
    return read_description(named_files(PACKAGE)[ORDINARY_RIG], table)


def own_description(
    *, table: Table = TABLE, absent: Mapping[str, str] | None = None, **ports: Mapping[str, Any]
) -> Description:
    """Return the description of a rig that uses ``table``; ``absent`` are the signals that it lacks, with the reasons.

    ``ports`` are the keys ``can`` and ``modbus`` of its transport.
    """
    base = _read(table)
    if absent:
        base = replace(base, absent={**base.absent, **absent}, carried=base.carried - absent.keys())
    if ports:
        base = replace(base, transports={TRANSPORT: {**base.transports[TRANSPORT], **ports}})
    return base


def own_wiring(
    can: CanPort,
    modbus: ModbusPort,
    *,
    table: Table = TABLE,
    absent: Mapping[str, str] | None = None,
    rig: str = "the rig",
) -> DescribedWiring:
    """Return the wiring of a rig that implements ``table``, over two open ports, which it closes."""
    content = own_description(table=table, absent=absent)
    return open_described(rig, content, {TRANSPORT: lambda: (can, modbus)})
