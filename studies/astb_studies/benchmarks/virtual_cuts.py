"""Cuts in virtual time: a bench under some load, moving or at rest, loses its commander at some instant."""

import random
from typing import Final

import numpy as np

from astb.rig_in_memory import RigInMemory
from astb_studies.benchmarks.cuts import (
    BOTH_CLOSED,
    CAN_CLOSED,
    CAN_HOLE,
    ESTOP,
    KILLED,
    MODBUS_CLOSED,
    MODBUS_HOLE,
    POWER,
    SAFE_WITHIN,
    STOPPED,
    Cut,
    Hole,
    Witness,
    give_up,
)
from bench_protocol.units import NS, bar, mm, ms, s
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from drivers.bench import Bench
from drivers.wiring.own import own_wiring

#: Between an empty bench and the full car on its springs.
PRESSURES: Final = (0.5 * bar, 5.6 * bar)
HEIGHTS: Final = (-40 * mm, 60 * mm)
_STEP: Final = 50 * ms


class VirtualCuts:
    """One rig in memory that is armed, loaded and cut repeatedly; ``seed`` is the random seed."""

    def __init__(self, seed: int) -> None:
        self._memory = RigInMemory(Rig(load("astb"), seed=seed))
        self._chance = random.Random(seed)
        self._witness = Witness()
        listener = self._memory.can()
        listener.subscribe(self._witness.receive)

    def cut(self, kind: Cut) -> tuple[float, float]:
        """Return the times until the bench held, and until it was safe (s)."""
        memory, clock = self._memory, self._memory.clock
        can, modbus = memory.can(), memory.modbus()
        bench = Bench(own_wiring(can, modbus), clock)
        bench.connect()
        self._load(bench)
        hole = Hole()
        self._witness.start(clock.now())
        if kind in (KILLED, STOPPED):
            bench.commander.stop()
            bench.wiring.carrier.watchdog.stop()
        if kind in (KILLED, CAN_CLOSED, BOTH_CLOSED):
            can.close()
        if kind in (KILLED, MODBUS_CLOSED, BOTH_CLOSED):
            modbus.close()
        if kind == CAN_HOLE:
            memory.bus.add(hole)
        if kind == MODBUS_HOLE:
            bench.wiring.carrier.watchdog.stop()
        if kind == ESTOP:
            memory.rig.press_estop()
        if kind == POWER:
            memory.rig.cut_power()
        deadline = clock.now() + round(2 * SAFE_WITHIN * NS)
        while np.isnan(self._witness.safe) and clock.now() < deadline:
            clock.sleep_until(clock.now() + round(_STEP * NS))
            if kind == MODBUS_HOLE and not np.isnan(self._witness.held):
                give_up(bench)
        if kind == CAN_HOLE:
            memory.bus.remove(hole)
        bench.commander.stop()
        bench.wiring.carrier.watchdog.stop()
        can.close()
        modbus.close()
        memory.rig.release_estop()
        return self._witness.held, self._witness.safe

    def _load(self, bench: Bench) -> None:
        """Arm, and hold the springs with the actuators at a random pressure and height, or move there."""
        chance = self._chance
        bench.arm()
        height = chance.uniform(*HEIGHTS)
        bench.vertical.move_to(height, height, rate=40 * mm / s)
        bench.air.fill(to=chance.uniform(*PRESSURES), tolerance=0.1 * bar)
        if chance.random() < 0.5:
            aim = chance.uniform(*HEIGHTS)
            bench.commander.ramp_all(
                {f"vertical_{side}.displacement_setpoint": aim for side in ("left", "right")}, 20 * mm / s
            )
        bench.clock.sleep_until(bench.clock.now() + chance.randrange(1000) * round(ms * NS))


def virtual_cuts(kind: Cut, count: int, seed: int = 1) -> list[tuple[float, float]]:
    """Return time to hold and time to safe (s) of ``count`` cuts."""
    series = VirtualCuts(seed)
    return [series.cut(kind) for _ in range(count)]
