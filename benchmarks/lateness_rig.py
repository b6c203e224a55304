"""A rig process for the lateness benchmark: the real loop and doors, twelve frames a tick, every lateness kept.

python -m benchmarks.lateness_rig SECONDS FILE    prints its ports, then writes the lateness of every tick (ns) to FILE
"""

import sys
import threading
from pathlib import Path
from typing import Final

import numpy as np

from bench_protocol.frames import Block
from bench_protocol.units import NS
from bench_sim.parameters import load
from bench_sim.rig.controls import SLOW, TICK_NS
from bench_sim.rig.process import run_rig
from bench_sim.rig.rig import Rig
from bench_sim.rig.tick import FRAMES_PER_TICK_MAX

#: Clients connect meanwhile; not measured.
WARM_UP_TICKS: Final = 2000


class LatenessRig(Rig):
    """Sends twelve frames in every tick, stops after so many ticks, and keeps the lateness of each."""

    def __init__(self, ticks: int, stop: threading.Event) -> None:
        super().__init__(load("astb"))
        self.lateness = np.zeros(ticks, np.int64)
        self._ticks = 0
        self._stop = stop
        self._frames = self.run(SLOW)[-FRAMES_PER_TICK_MAX:]

    def report_lateness(self, lateness: float, *, lost: bool = False) -> None:
        super().report_lateness(lateness, lost=lost)
        k = self._ticks - WARM_UP_TICKS
        if 0 <= k < self.lateness.size:
            self.lateness[k] = round(lateness * NS)
        elif k >= self.lateness.size:
            self._stop.set()
        self._ticks += 1

    def tick(self) -> Block:
        super().tick()
        block = self._frames.copy()
        block["time"] = self._controls["tick"] * TICK_NS
        return block


def main(seconds: int, file: Path) -> None:
    """Run the rig for so long and leave the latenesses in ``file``."""
    stop = threading.Event()
    rig = LatenessRig(1000 * seconds, stop)
    # The end of the input says that the parent has ended.
    threading.Thread(target=lambda: (sys.stdin.read(), stop.set()), daemon=True).start()

    def ready(can: str, modbus: str) -> None:
        print(can.rpartition(":")[2], modbus.rpartition(":")[2], flush=True)

    run_rig(rig, can="tcp", can_port=0, modbus_port=0, stop=stop, ready=ready)
    rig.lateness.tofile(file)


if __name__ == "__main__":
    main(int(sys.argv[1]), Path(sys.argv[2]))
