"""Whose clocks say when the readings of a bench came."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench_protocol.signals import MEASURED
from drivers.wiring.contract import Stamp

if TYPE_CHECKING:
    from drivers.bench import Bench


def stamps_of(bench: Bench) -> dict[str, Stamp]:
    """Return the stamp of each measurement whose clock is known."""
    wiring = getattr(bench, "wiring", None)
    if wiring is None:
        return {}
    found = {one.name: wiring.stamp(one.name) for one in bench.table.of_kind(*MEASURED)}
    return {name: one for name, one in found.items() if one is not None}


def clocks(bench: Bench) -> dict[str, str]:
    """Return what a record says of the clocks: by transport and message, whose it is and what it may be off by."""
    return {one.shared: f"{one.clock}, within {one.within * 1e6:g} µs" for one in stamps_of(bench).values()}
