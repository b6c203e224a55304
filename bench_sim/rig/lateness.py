"""The lateness of ticks: a histogram that is published on CAN and Modbus, and what a late tick causes."""

from typing import Any, Final

from bench_protocol.rates import LATENESS_BINS
from bench_protocol.runtime.pacing import Late
from bench_protocol.table import TABLE
from bench_protocol.units import NS
from bench_sim.model.compiled import compiled
from bench_sim.rig.controls import TICK_NS, Happened

#: Under the policy ``fault``, the lateness that counts as a lost tick.
_LOST: Final = round(0.1 * NS)

_BIN_ROWS: Final = tuple(TABLE.index[one.signal] for one in LATENESS_BINS)
_BIN_EDGES: Final = tuple(one.edge * NS for one in LATENESS_BINS)
_WORST_ROW: Final = TABLE.index["rig.lateness_max"]
_LATE_ROW: Final = TABLE.index["rig.late_ticks"]


@compiled
def count_lateness(values: Any, late: int, pacing: Any) -> int:
    """Count a tick that begins ``late`` ns after its deadline. Return `Happened.TICK_LOST` with the policy FAULT and a
    lateness above 0.1 s, otherwise NOTHING.

    The counts are signals in ``values`` (by table row). With the policy SKIP, all later deadlines are moved by the
    missed periods.
    """
    for k in range(len(_BIN_ROWS)):
        if late < _BIN_EDGES[k]:
            values[_BIN_ROWS[k]] += 1
            break
    values[_WORST_ROW] = max(values[_WORST_ROW], late / NS)
    if late >= TICK_NS:
        values[_LATE_ROW] += 1
    p = pacing.record[0]
    if p.logged < pacing.log.size:
        pacing.log[p.logged] = late
        p.logged += 1
    if p.policy == Late.SKIP and late >= TICK_NS:
        missed = late // TICK_NS * TICK_NS
        p.start += missed
        p.epoch += missed
    return Happened.TICK_LOST.value if p.policy == Late.FAULT and late > _LOST else Happened.NOTHING.value
