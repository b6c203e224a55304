"""A rig process for the lateness benchmark: the real loop and ports, twelve frames a tick, every lateness kept.

python -m astb_studies.benchmarks.lateness_rig SECONDS FILE
    prints its ports, the time of a deadline (ns, monotonic) and the processor on which it ticks, then writes the
    lateness of every tick (ns) to FILE
"""

import os
import sys
import threading
import time
from pathlib import Path
from typing import Final

from astb_studies.benchmarks.lateness import FRAMES
from bench_protocol.clock import RealClock
from bench_protocol.table import TABLE
from bench_protocol.units import NS, ms
from bench_sim.parameters import load
from bench_sim.rig.process import run_rig
from bench_sim.rig.rig import Rig

#: Clients connect meanwhile; not measured.
WARM_UP_TICKS: Final = 2000
_LOOK: Final = 100 * ms


def main(seconds: int, file: Path) -> None:
    """Run the rig for a time and write the latenesses to ``file``."""
    ticks = WARM_UP_TICKS + 1000 * seconds
    messages = [message.name for message in TABLE.messages if message.from_rig and message.rate]
    rig = Rig(load("astb"), log=ticks, every_tick=messages[:FRAMES])
    stop = threading.Event()
    # The end of the input shows that the parent has ended.
    threading.Thread(target=lambda: (sys.stdin.read(), stop.set()), daemon=True).start()

    def look() -> None:
        if rig.pacing.log_is_full:
            stop.set()

    def ready(can: str, modbus: str, control: str) -> None:
        while not rig.pacing.real:
            time.sleep(ms)
        # The tick stays on one processor, so that the control loop can run on the same.
        processor = max(os.sched_getaffinity(0))
        tick = next(thread for thread in threading.enumerate() if thread.name == "tick")
        os.sched_setaffinity(tick.native_id, {processor})
        start = int(rig.pacing.record[0]["start"])
        print(can.rpartition(":")[2], modbus.rpartition(":")[2], start, processor, flush=True)

    watching = RealClock().every(round(_LOOK * NS), look)
    run_rig(rig, can="tcp", can_port=0, modbus_port=0, stop=stop, ready=ready)
    watching.cancel()
    rig.pacing.log[WARM_UP_TICKS:].tofile(file)


if __name__ == "__main__":
    main(int(sys.argv[1]), Path(sys.argv[2]))
