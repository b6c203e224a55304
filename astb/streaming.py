"""The commander's cycles and the rig's ticks of a whole interval in one compiled call, for virtual time."""

from typing import Any

from bench_protocol.runtime.pacing import Pacing
from bench_protocol.runtime.ring import Ring, push
from bench_sim.model.compiled import compiled_entry
from bench_sim.rig.commands import Incoming
from bench_sim.rig.controls import TICK_NS
from bench_sim.rig.tick import PlantArrays, Sampling, Sending, run_ticks
from drivers.cycle import Cycle, make_block


@compiled_entry
def run_cycles(
    ticks: int,
    cycle: Cycle,
    due: int,
    period: int,
    sender: int,
    controls: Any,
    plant: PlantArrays,
    sampling: Sampling,
    sending: Sending,
    incoming: Incoming,
    outgoing: Ring,
    pacing: Pacing,
    out: Any,
) -> tuple[int, int, int, int]:
    """Run up to ``ticks`` ticks, and queue the frames of ``cycle`` at ``due`` and every ``period`` (ns) after it.

    Return (ticks run, frames written to ``out``, event of the last tick, the next ``due``). It stops after a tick with
    an event, before it queues the frames that are due then. The caller holds the mutexes.
    """
    done = position = happened = 0
    while done < ticks and happened == 0:
        part = min(ticks - done, due // TICK_NS - controls[0].tick)
        ran, count, happened = run_ticks(
            part, controls, plant, sampling, sending, incoming, outgoing, pacing, out[position:]
        )
        done += ran
        position += count
        if happened == 0 and controls[0].tick == due // TICK_NS:
            make_block(cycle, due)
            push(incoming.ring, cycle.frames, 0, cycle.frames.size, sender)
            due += period
    return done, position, happened, due
