"""How late the ticks of the rig were during a run, from the rig's own counters."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import numpy as np

from bench_protocol.rates import LATENESS_BINS, TICK
from bench_records.result import Timing
from drivers.errors import BenchError

if TYPE_CHECKING:
    from drivers.bench import Bench

#: Counters of the rig that describe how late its ticks are.
_ACCOUNT: Final = ("rig.tick", "rig.late_ticks", "rig.lateness_max", *(one.signal for one in LATENESS_BINS))
#: Upper edges of all bins of the rig's lateness histogram but the last, which has none.
_EDGES: Final = tuple(one.edge for one in LATENESS_BINS[:-1])


def lateness(bench: Bench) -> dict[str, float] | None:
    """Return the rig's counters of late ticks; None if it has none or does not answer."""
    try:
        counters = bench.settings.readings(*_ACCOUNT)
    except BenchError:
        return None
    return None if any(map(math.isnan, counters.values())) else counters


def timing(
    before: dict[str, float] | None, after: dict[str, float] | None, disturbed: dict[str, int]
) -> Timing | None:
    """Return how punctual the rig was during the run, from the differences of its counters; None if they are not known.

    Quantiles of the lateness are the upper edges of their bins. ``disturbed`` are the late ticks during the measurement
    of a check, by its name.
    """
    if before is None or after is None:
        return None
    counts = [round(after[one.signal] - before[one.signal]) for one in LATENESS_BINS]
    ticks = round(after["rig.tick"] - before["rig.tick"])
    late = round(after["rig.late_ticks"] - before["rig.late_ticks"])
    if ticks < 0 or late < 0 or min(counts) < 0:
        return None  # the rig was started again, or its counters went round
    if not any(counts):
        return Timing(ticks=ticks, late=late, disturbed=disturbed, period=TICK)
    worst = after["rig.lateness_max"]
    quantile: Callable[[float], float] = lambda q: min((*_EDGES, worst)[_bin(counts, q)], worst)  # noqa: E731
    return Timing(
        ticks=ticks,
        late=late,
        disturbed=disturbed,
        period=TICK,
        p50=quantile(0.50),
        p99=quantile(0.99),
        max=worst,
        edges=list(_EDGES),
        counts=counts,
    )


def _bin(counts: list[int], q: float) -> int:
    return int(np.searchsorted(np.cumsum(counts), q * sum(counts)))
