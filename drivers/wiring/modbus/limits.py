"""Why a device does not answer a request for many registers: which of them, or how many, it does not take."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from bench_protocol.modbus import ILLEGAL_ADDRESS, ILLEGAL_VALUE
from drivers.errors import BenchError, LinkLost, Refused
from drivers.wiring.modbus.registers import Span

Read = Callable[[Span], Sequence[int]]
#: Number of points that are polled one by one.
_TRIED_MAX: Final = 32


def explained(span: Span, error: BenchError, read: Read, gap: int) -> BenchError:
    """Return ``error``, of a reading of ``span``, with the reason found by smaller readings."""
    if span.count == 1 or (isinstance(error, Refused) and error.code not in (ILLEGAL_ADDRESS, ILLEGAL_VALUE)):
        return error
    points = span.points[:_TRIED_MAX]
    alone = [Span(one.table, one.address, one.size, (one,)) for one in points]
    if isinstance(error, LinkLost) and not _reads(alone[0], read):
        return error
    bad = [f"{one.points[0].name} ({one.table} {one.address})" for one in alone if not _reads(one, read)]
    if bad:
        hint = f"it refuses {', '.join(bad)}" + (", and reads the others" if len(bad) < len(points) else "")
    else:
        narrow = _most(span, read)
        hint = (
            f"it reads {narrow} at once: request_max = {narrow}"
            if narrow
            else "it reads each point by itself"
        )
        if gap:
            hint += ", or gap = 0, if there is a hole between the points"
    said = f"{error}; {hint}"
    return Refused(said, error.code) if isinstance(error, Refused) else LinkLost(said)


def _reads(span: Span, read: Read) -> bool:
    try:
        read(span)
    except BenchError:
        return False
    return True


def _most(span: Span, read: Read) -> int:
    """Return how many registers from the beginning of ``span`` are read at once."""
    low, high = 0, span.count
    while high - low > 1:
        middle = (low + high) // 2
        if _reads(Span(span.table, span.address, middle, ()), read):
            low = middle
        else:
            high = middle
    return low
