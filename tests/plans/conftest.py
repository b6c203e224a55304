"""A virtual rig with a bench on it, in memory and virtual time."""

from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from bench_protocol.clock import VirtualClock
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from bench_sim.rig.tick import TICK_NS
from drivers.bench import Bench
from drivers.memory import FaultyCan, InMemoryCan
from drivers.modbus_port import InMemoryModbus
from test_plans import PLANS
from test_plans.execution import execute


@contextmanager
def composed(seed=0, faults=None, latency=0.0, **changes):
    rig = Rig(load("astb").with_values(**changes), seed=seed)
    clock, done = VirtualClock(), 0
    can = InMemoryCan(lambda block: rig.receive(block, "plan"))

    def answer(request):
        clock.sleep_until(clock.now() + round(latency * 1e9))
        return rig.answer(request, "plan")

    modbus = InMemoryModbus(answer)

    def advance(until):
        nonlocal done
        ticks = until // TICK_NS - done
        if ticks > 0:
            done += ticks
            can.deliver(rig.run(ticks))

    clock.attach(advance)
    bench = Bench(can if faults is None else FaultyCan(can, faults, seed), modbus, clock)
    bench.connect()
    try:
        yield SimpleNamespace(rig=rig, clock=clock, can=can, bench=bench)
    finally:
        bench.close()


@pytest.fixture(scope="session")
def bench_composed():
    """A virtual rig with a connected bench: ``with bench_composed(seed, **changes) as made``."""
    return composed


class After:
    """Does something once the bench's time has come."""

    def __init__(self, clock, seconds, act):
        self.task = clock.every(round(seconds * 1e9), self)
        self.act = act

    def __call__(self):
        self.task.cancel()
        self.act()


@pytest.fixture
def bench_run(tmp_path):
    """Run a plan on a fresh virtual rig; ``at=(seconds, act)`` lets something happen to it meanwhile."""

    def run(name, seed=0, *, at=None, faults=None, latency=0.0, directory="out", **changes):
        with composed(seed, faults, latency, **changes) as made:
            if at is not None:
                After(made.clock, at[0], lambda: at[1](made))
            result = execute(PLANS[name], made.bench, tmp_path / directory, rig="virtual", seed=seed)
            return SimpleNamespace(
                result=result,
                failed={one.name for one in result.checks if not one.passed},
                directory=tmp_path / directory,
                state=made.rig.state.name,
                pressure=max(made.bench.left.bellows_pressure, made.bench.right.bellows_pressure),
            )

    return run
