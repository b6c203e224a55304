"""How punctual the rig was during a run, by its own account."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import numpy as np

from bench_protocol.table import TICK
from bench_protocol.units import ms, us
from drivers.errors import BenchError

if TYPE_CHECKING:
    from bench_records.result import Timing
    from drivers.bench import Bench

#: Upper edges of the bins of the rig's lateness histogram (s); the last has none.
_EDGES: Final = (50 * us, 100 * us, 250 * us, 500 * us, 1 * ms)
_BINS: Final = ("50us", "100us", "250us", "500us", "1ms", "more")


def lateness(bench: Bench) -> dict[str, float] | None:
    """The rig's own account of its punctuality, or nothing if the rig does not answer any more."""
    try:
        return {name: value for name, value in bench.settings.snapshot().items() if name.startswith("rig.")}
    except BenchError:
        return None


def timing(before: dict[str, float] | None, after: dict[str, float] | None) -> Timing | None:
    """The punctuality during the run: differences of counters; quantiles are the upper edges of their bins."""
    from bench_records.result import Timing

    if before is None or after is None:
        return None
    counts = [round(after[f"rig.lateness_{name}"] - before[f"rig.lateness_{name}"]) for name in _BINS]
    ticks = round(after["rig.tick"] - before["rig.tick"])
    late = round(after["rig.late_ticks"] - before["rig.late_ticks"])
    if ticks < 0 or late < 0 or min(counts) < 0:
        return None  # the rig was started anew, or its counters went round
    if not any(counts):
        return Timing(ticks=ticks, late=late, period=TICK)
    worst = after["rig.lateness_max"]
    quantile: Callable[[float], float] = lambda q: min((*_EDGES, worst)[_bin(counts, q)], worst)  # noqa: E731
    return Timing(
        ticks=ticks,
        late=late,
        period=TICK,
        p50=quantile(0.50),
        p99=quantile(0.99),
        max=worst,
        edges=list(_EDGES),
        counts=counts,
    )


def _bin(counts: list[int], q: float) -> int:
    return int(np.searchsorted(np.cumsum(counts), q * sum(counts)))
