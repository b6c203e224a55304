"""One tick of the rig in virtual time, compared with a step of the model alone."""

from typing import Any

import numpy as np

from astb.rig_file import Simulation
from astb.session import build_rig, virtual_session
from astb_studies.benchmarks.measure import Effort, Section, compare, cpu
from bench_protocol.units import bar, minutes, mm, ms, s
from bench_sim.model.plant import Plant
from bench_sim.parameters import load

BATCH = 20


def run(effort: Effort) -> Section:
    """Time ``rig.run`` inside a session in which the bench is ACTIVE and shaken, cycle by cycle."""
    rig: Any = build_rig(Simulation())
    run_ticks = rig.run
    batches: list[float] = []

    def timed(ticks: int, *streamed: Any) -> Any:
        block = None

        def go() -> None:
            nonlocal block
            block = run_ticks(ticks, *streamed)

        seconds = cpu(go, ticks)
        if ticks == BATCH:
            batches.append(seconds)
        return block

    rig.run = timed
    plant = Plant.at_rest(load("astb").record)
    ours: list[float] = []
    control: list[float] = []
    with virtual_session(rig, Simulation()) as session:
        bench = session.bench
        bench.connect()
        bench.arm()
        bench.vertical.hold_position()
        bench.air.fill(to=2 * bar, within=2 * minutes)
        for repetition in range(1 + effort.repetitions):
            batches.clear()
            for cycle in range(100):
                bench.platform.vertical_setpoint = 5 * mm * np.sin(0.1 * cycle)
                bench.wait(BATCH * ms)
            bare = [cpu(lambda: plant.step(BATCH), BATCH) for _ in range(100)]
            if repetition:
                ours.append(float(np.median(batches)))
                control.append(float(np.median(bare)))
        bench.disarm(within=10 * s)
    row = compare(f"one tick of {BATCH} in one call", ours, f"one step of {BATCH} in one call", control)
    note = (
        "Rig ACTIVE, bolster held in place, springs filled, platform moving: set-points, air control, model, sensors "
        "at 200 Hz, limits, watchdog, frames. Processor time of one thread."
    )
    return Section("One tick of the rig in virtual time", (row,), (note,))
