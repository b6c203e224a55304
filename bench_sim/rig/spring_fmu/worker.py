"""The worker process of a spring FMU. It initializes the FMU, then takes a communication step at each request.

The number of the present call is in shared memory, so the rig can report it after a crash.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from bench_protocol.clock import hurry
from bench_sim.fmu.process import RequestPipes, print_log
from bench_sim.rig.external_springs import serve
from bench_sim.rig.spring_fmu.instances import initialize, shared, time_steps
from bench_sim.rig.spring_fmu.mapping import Coupling

#: The same as that of the rig's tick, which waits for it.
_PRIORITY = 10


@dataclass(frozen=True, slots=True, eq=False)
class StartOrder:
    """A request to initialize the FMU in the folder ``unpacked``, and to take ``steps`` steps as a trial."""

    coupling: Coupling
    unpacked: Path
    memory: Path
    feeds: npt.NDArray[np.float64]
    steps: int = 0


def main() -> None:
    """Answer a `StartOrder` with the durations (s) of its trial steps. Then take a step at each request of the rig."""
    started: list[Any] = []

    def start(order: StartOrder) -> npt.NDArray[np.float64]:
        e = shared(order.memory, order.coupling)
        started.extend((e, initialize(e, order.coupling, order.unpacked, order.feeds, print_log)))
        return time_steps(e, order.coupling, order.feeds, order.steps)

    pipes = RequestPipes()
    pipes.answer(start)
    if started:
        hurry(_PRIORITY)
        serve(started[0], *pipes.descriptors)
    os._exit(0)  # runs no code of the library


if __name__ == "__main__":
    main()
