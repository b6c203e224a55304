"""The rigs of strangers in virtual time: their bytes and frames cross the memory of one process."""

from pathlib import Path

import numpy as np

from bench_protocol.clock import VirtualClock
from bench_protocol.dimensions import read_dimensions
from bench_protocol.frames import FRAME, Block
from bench_protocol.socketcand import iterate
from bench_protocol.table import TABLE
from drivers.bench import Bench
from drivers.memory import InMemoryCan
from drivers.modbus_port import InMemoryModbus
from drivers.wiring.described import open_described
from drivers.wiring.description import read_description
from tests.foreign import wiring_file
from tests.foreign.can_rig import CYCLE as HALL_CYCLE
from tests.foreign.can_rig import CanRig
from tests.foreign.plc_rig import CYCLE as PLC_CYCLE
from tests.foreign.plc_rig import PlcRig
from tests.foreign.yard_rig import CYCLE as YARD_CYCLE
from tests.foreign.yard_rig import UNIT_ID, YardRig

_NS = 1_000_000  # in a millisecond
FRAME_TIME = 270_000  # ns: of eight bytes at 500 kbit/s


class _Paced:
    """A rig that goes through its cycles while the clock passes."""

    name: str
    transport: str
    cycle_time: int

    def __init__(self) -> None:
        self.clock = VirtualClock()
        self._done = 0
        self.silent = False
        self.clock.attach(self._advance)

    def _advance(self, until: int) -> None:
        cycles = until // (self.cycle_time * _NS)
        while self._done < cycles:
            self._done += 1
            self.cycle()

    def cycle(self) -> None:
        raise NotImplementedError

    def bench(self) -> Bench:
        """Return a bench on a separate port and the wiring file of the rig, not yet connected."""
        description = read_description(wiring_file(self.name), TABLE)
        bench = Bench(open_described(self.name, description, {self.transport: self.port}), self.clock)
        bench.dimensions = read_dimensions(Path(__file__).parent / self.name / "dimensions.toml")
        return bench

    def port(self):
        raise NotImplementedError


class VirtualPlc(_Paced):
    """Rig A, and a port to it."""

    name, transport = "plant_a", "plc"
    cycle_time = PLC_CYCLE

    def __init__(self, seed: int = 1, **changes: float) -> None:
        super().__init__()
        self.rig = PlcRig(seed, **changes)

    def cycle(self) -> None:
        self.rig.cycle()

    def port(self) -> InMemoryModbus:
        """Return a new connection."""
        return InMemoryModbus(lambda request: b"" if self.silent else self.rig.answer(request))


class VirtualYard(_Paced):
    """Rig C, and a port to it."""

    name, transport = "yard_c", "plc"
    cycle_time = YARD_CYCLE

    def __init__(self, seed: int = 1, **changes: float) -> None:
        super().__init__()
        self.rig = YardRig(seed, **changes)

    def cycle(self) -> None:
        self.rig.cycle()

    def port(self) -> InMemoryModbus:
        """Return a new connection."""
        return InMemoryModbus(lambda request: b"" if self.silent else self.rig.answer(request), UNIT_ID)


class VirtualHall(_Paced):
    """Rig B, and its bus."""

    name, transport = "hall_b", "bus"
    cycle_time = HALL_CYCLE

    def __init__(self, seed: int = 1, **changes: float) -> None:
        super().__init__()
        self.rig = CanRig(seed, **changes)
        self._ports: list[InMemoryCan] = []

    def cycle(self) -> None:
        frames = self.rig.cycle()
        block = np.zeros(len(frames), FRAME)
        sent = (
            self._done * HALL_CYCLE * _NS - len(frames) * FRAME_TIME
        )  # one after the other, the last one just now
        for record, (identifier, data) in zip(block, frames, strict=True):
            record["time"] = sent = sent + FRAME_TIME
            record["id"], record["extended"], record["length"] = identifier, 1, len(data)
            record["data"][: len(data)] = np.frombuffer(data, np.uint8)
        for port in () if self.silent else self._ports:
            port.receive(block)

    def port(self) -> InMemoryCan:
        """Return a new port of the bus."""
        port = InMemoryCan(self._take)
        self._ports.append(port)
        return port

    def _take(self, block: Block) -> None:
        for _, identifier, extended, data in iterate(block):
            if extended:
                self.rig.receive(identifier, data)
