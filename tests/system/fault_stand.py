"""A rig in memory on which faults are ordered, and the list of what each was seen to do."""

import json
from collections.abc import Callable

import numpy as np

from astb.rig_in_memory import RigInMemory
from bench_protocol.frames import Block, join
from bench_protocol.table import TABLE
from bench_protocol.units import NS, s
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig

IDENTIFIER = {message.name: message.identifier for message in TABLE.messages}
PARAMETERS = load()
#: What a fault was seen to do, by its name.
SEEN: dict[str, Callable[["FaultRig"], None]] = {}


class FaultRig:
    """A rig in memory with a connected bench, and the fault panel by its orders."""

    def __init__(self) -> None:
        self.memory = RigInMemory(Rig(PARAMETERS, seed=1))
        self.rig, self.clock = self.memory.rig, self.memory.clock
        self.bench = self.memory.bench()
        self.bench.connect()
        self.heard: list[tuple[int, Block]] = []
        self.ear = self.memory.can()
        self.ear.subscribe(lambda block: self.heard.append((self.clock.now(), block.copy())))

    def order(self, **order: object) -> dict:
        return json.loads(self.rig.order(json.dumps(order).encode()))

    def on(self, name: str, lasting: str | None = None, **values: str | float) -> None:
        answer = self.order(do="on", name=name, values=values, **({"for": lasting} if lasting else {}))
        assert "error" not in answer, answer

    def off(self, name: str = "all") -> None:
        answer = self.order(do="off", name=name)
        assert "error" not in answer, answer

    def wait(self, time: float) -> None:
        """Let time pass, whatever becomes of the bench."""
        self.clock.sleep_until(self.clock.now() + round(time * NS))

    def frames(self, time: float = 0.5 * s) -> Block:
        """Return the frames that another client on the bus receives in the next ``time``."""
        self.heard.clear()
        self.wait(time)
        return join(block for _, block in self.heard)

    def readings(self, name: str, time: float = 1 * s) -> np.ndarray:
        """Return the samples of the next ``time`` that the bench takes for readings."""
        with self.bench.capture(name) as capture:
            self.wait(time)
        return capture.values(name)

    def truth(self, name: str) -> float:
        """Return the rig's internal value, without a wire: for values that are not received while wires are cut."""
        return float(self.rig.values[TABLE.index[name]])

    def arm(self, pressure: float = 0.0) -> None:
        """Arm the bench, hold the bolster where it is, and fill both springs to a gauge pressure."""
        self.bench.arm()
        self.bench.vertical.hold_position()
        if pressure:
            self.bench.air.fill(pressure)
            self.bench.air.hold()
            self.bench.wait(20 * s)  # the compressed gas cools down

    def tally(self, what: str) -> int:
        return self.bench.wiring.carrier.tally()[what]


def seen(function: Callable[[FaultRig], None]) -> Callable[[FaultRig], None]:
    SEEN[function.__name__] = function
    return function
