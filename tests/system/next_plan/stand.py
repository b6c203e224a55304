"""A rig in virtual time on which a first plan is lost, and the next one is begun."""

import json
import random
import tempfile
from contextlib import nullcontext, suppress
from dataclasses import replace

from astb.operators import SimulatedHand
from astb.rig_in_memory import RigInMemory
from bench_protocol.dimensions import ordinary as dimensions
from bench_protocol.units import NS, s
from bench_sim.parameters import load
from bench_sim.rig.faults.orders import execute_order
from bench_sim.rig.rig import Rig
from drivers.bench import Bench
from drivers.errors import BenchError
from drivers.wiring.own import own_wiring
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.instruments import ordinary
from test_plans.plan import Plan
from tests.rig.bookmark import Bookmark
from tests.system.next_plan.losses import Gone, Loss

DELAYS = (0.0, 5 * s, 30 * s)
#: When in a first plan something is lost: from before its springs are filled to where they are shaken.
WITHIN = (4 * s, 75 * s)
PARAMETERS = load("astb")


class Reached(BaseException):
    """The next plan has come to its main part."""


class First:
    """The commander of the first plan, as far as others can take something from it."""

    def __init__(self, memory: RigInMemory, seed: int) -> None:
        self.memory, self.seed, self.over = memory, seed, False
        self.successor = memory
        self.can, self.modbus = memory.can(), memory.modbus()
        self.bench = bench_on(memory, self.can, self.modbus)

    def mute(self, *wires: str) -> None:
        """Let nothing that is sent arrive, and nothing be answered, though all connections stand."""
        if "can" in wires or not wires:
            self.can._send = lambda block: None
        if "modbus" in wires or not wires:
            self.modbus._client._answer = lambda request: b""

    def leave(self, wire: str) -> None:
        """Close a connection."""
        if wire == "can":
            self.can.lose("the connection was closed")
            self.memory.leave(self.can)
        else:
            self.memory.leave_modbus(self.modbus)

    def restart_the_rig(self) -> None:
        """End the rig's process and begin another: a connected client finds no server."""
        self.can.lose("the server has gone")
        self.mute()
        self.successor = RigInMemory(Rig(PARAMETERS, seed=self.seed + 1))


def bench_on(memory: RigInMemory, can, modbus) -> Bench:
    bench = Bench(own_wiring(can, modbus), memory.clock)
    bench.instruments, bench.dimensions = ordinary(), dimensions()
    bench.hand = SimulatedHand(
        lambda order: json.loads(execute_order(memory.rig.faults, json.dumps(order).encode(), nullcontext()))
    )
    return bench


def later(clock, seconds: float, act) -> None:
    """Do something once, in so many seconds of the bench's time."""

    def once() -> None:
        task.cancel()
        act()

    task = clock.every(round(seconds * NS), once)


def lost(loss: Loss, plan: str, seed: int, within: tuple[float, float]) -> tuple[RigInMemory, str]:
    """Run ``plan`` into ``loss`` at an instant ``within`` (s from, to) drawn from ``seed``.

    Return the remaining rig, and its messages.
    """
    chance = random.Random(f"{loss.name} {plan} {seed}")
    memory = RigInMemory(Rig(PARAMETERS, seed=seed))
    first = First(memory, seed)
    text = ""
    with tempfile.TemporaryDirectory() as folder:
        try:
            first.bench.connect()
            at = chance.uniform(*within)
            for after in (0.0, *loss.again):
                later(memory.clock, at + after, lambda: first.over or loss.lose(first))
            text = execute(plans()[plan], first.bench, folder).reason
        except (Gone, KeyboardInterrupt) as end:
            text = str(end)
            if isinstance(end, Gone):
                first.mute()
        first.over = True
        first.bench.commander.stop()
        first.bench.wiring.carrier.watchdog.stop()
        if "SIGSTOP" not in loss.name:
            with suppress(BenchError, KeyboardInterrupt):
                first.bench.close()
    return first.successor, text


class FaultRig:
    """The rig after a loss, at which every next plan starts again."""

    def __init__(self, loss: Loss, first: str, seed: int, within: tuple[float, float] = WITHIN) -> None:
        self.loss = loss
        self.memory, self.told = lost(loss, first, seed, within)
        self.rig = self.memory.rig
        self._left = Bookmark(self.memory)
        self.delay = 0.0

    def wait(self, delay: float) -> None:
        """Let every next plan come ``delay`` s after the first one was over."""
        clock = self.memory.clock
        self._left.restore()
        clock.sleep_until(clock.now() + round((delay - self.delay) * NS))
        self.delay = delay
        self._left = Bookmark(self.memory)

    def next(self, name: str) -> str:
        """Begin the plan ``name``; return "" if it comes to its main part, else its reason."""
        self._left.restore()
        plan: Plan = replace(plans()[name], main=_reached)
        bench = bench_on(self.memory, self.memory.can(), self.memory.modbus())
        try:
            with tempfile.TemporaryDirectory() as folder:
                try:
                    bench.connect()
                    return execute(plan, bench, folder).reason
                finally:
                    bench.commander.stop()
                    bench.wiring.carrier.watchdog.stop()
        except Reached:
            return ""
        except BenchError as error:  # the message of `astb run` without a connection
            return f"connecting: {error}"


def _reached(run) -> None:
    del run
    raise Reached
