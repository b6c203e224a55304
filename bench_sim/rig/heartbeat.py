"""The part of the tick for the rig's CANopen node: it sends heartbeats, and returns when the node has something to
do.
"""

from typing import Any

from bench_protocol.canopen import HEARTBEAT_IDENTIFIER
from bench_protocol.frames import LENGTH_MAX
from bench_sim.model.compiled import compiled
from bench_sim.rig.controls import TICK_NS, Happened


@compiled
def send_heartbeat(c: Any, out: Any, position: int) -> int:
    """Write the node's heartbeat to ``out`` if it is due. Return the position after it."""
    if c.heartbeat <= 0 or c.tick < c.heartbeat_due:
        return position
    c.heartbeat_due = c.tick + c.heartbeat
    record = out[position]
    record.time, record.id, record.extended, record.length = c.tick * TICK_NS, HEARTBEAT_IDENTIFIER, 0, 1
    for byte in range(LENGTH_MAX):
        record["data"][byte] = 0
    record["data"][0] = c.node_state
    return position + 1


@compiled
def node_due(c: Any) -> int:
    """Return `Happened.NODE` if a SYNC is due, or if the heartbeat of another node is overdue."""
    due = c.tick == c.sync_due or c.tick == c.guard_due
    return Happened.NODE.value if due else Happened.NOTHING.value
