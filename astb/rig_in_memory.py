"""A simulated rig in this process and in virtual time, with its CAN bus and its Modbus in memory."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from bench_protocol.clock import VirtualClock
from bench_protocol.dimensions import ordinary
from bench_protocol.frames import Block
from bench_protocol.units import NS
from bench_sim.rig.can_bus import CanBus
from bench_sim.rig.controls import TICK_NS
from bench_sim.rig.faults.insertion import Wires
from drivers.bench import Bench
from drivers.memory import Faults, FaultyCan, InMemoryCan
from drivers.modbus_port import InMemoryModbus
from drivers.wiring.own import own_wiring

if TYPE_CHECKING:
    from bench_sim.rig.rig import Rig


class RigInMemory:
    """A ``rig`` that ticks while its ``clock`` passes, and any number of ports to it.

    Ports hear one another as on a real bus, and the rig knows who sent what and who is gone, as its hub does.
    ``run`` replaces ``rig.run`` where a user has to do something to the rig between ticks.
    """

    def __init__(self, rig: "Rig", run: Callable[[int], Block] | None = None) -> None:
        self.rig, self.clock = rig, VirtualClock()
        self.bus = CanBus(rig.receive, self.clock, self.clock.now)
        self.bus.connect(self)
        self._run = run or rig.run
        self._ports: list[_CanPort] = []
        self._clients = 0
        self._ticks = 0
        self._modbus: list[_ModbusPort] = []
        #: The wires that faults have cut.
        self.shut: set[str] = set()
        self.clock.attach(self._advance)
        rig.faults.points.connect(Wires(self.bus, _Wire(self, "can"), _Wire(self, "modbus")))

    def can(self) -> InMemoryCan:
        """Return a new port of the CAN bus."""
        port = _CanPort(self, self._name("can"))
        self._ports.append(port)
        if "can" in self.shut:
            self.disconnect("can")
        return port

    def modbus(self, latency: float = 0.0) -> InMemoryModbus:
        """Return a new Modbus connection whose answers take ``latency`` (s)."""
        port = _ModbusPort(self, self._name("modbus"), round(latency * NS))
        self._modbus.append(port)
        return port

    def bench(
        self,
        *,
        faults: Faults | None = None,
        outward: Faults | None = None,
        seed: int = 0,
        latency: float = 0.0,
        absent: Mapping[str, str] | None = None,
    ) -> Bench:
        """Return a bench on ports of its own, not yet connected.

        ``faults``, drawn from ``seed``, befall its CAN frames (``outward`` those that it sends, where they differ);
        ``latency`` (s) is that of Modbus; ``absent`` is what the bench is to do without, with the reasons.
        """
        port = self.can()
        can = port if faults is None else FaultyCan(port, faults, seed, outward=outward)
        bench = Bench(own_wiring(can, self.modbus(latency), absent=absent), self.clock)
        bench.dimensions = ordinary()
        return bench

    def cut(self, reason: str) -> None:
        """Cut the CAN bus, as a hub that dies would; Modbus goes on."""
        for port in self._ports:
            port.lose(reason)

    def publish(self, block: Block) -> None:
        """Deliver frames of the rig to every port."""
        for port in self._ports:
            port.receive(block)

    def relay(self, block: Block, peer: str) -> None:
        """Deliver frames to every port but that of their sender."""
        for port in self._ports:
            if port.name != peer:
                port.receive(block)

    def send(self, block: Block, port: "_CanPort") -> None:
        """Take frames from a port, stamped with the time, to all other ports and to the rig."""
        stamped = block.copy()
        stamped["time"] = self.clock.now()
        stamped = self.bus.carry(stamped, port.name)
        if stamped.size:
            self.relay(stamped, port.name)
            self.rig.receive(stamped, port.name)

    def leave(self, port: "_CanPort") -> None:
        """Take a port off the bus; the rig hears that it is gone."""
        if port in self._ports:
            self._ports.remove(port)
            self.bus.forget(port.name)
            self.rig.peer_lost(port.name)

    def answer(self, request: bytes, peer: str) -> bytes:
        """Return the answer of the rig, or what its faults leave of it, when it has arrived; nothing is silence."""
        if "modbus" in self.shut:
            return b""
        filtered = self.rig.faults.points.modbus
        response = filtered.before(self.rig.answer)(request, peer)
        pieces = filtered.pieces(response) if response else []
        if delay := sum(gap for gap, _ in pieces):
            self.clock.sleep_until(self.clock.now() + round(delay * NS))
        return b"".join(piece for _, piece in pieces)

    def leave_modbus(self, port: "_ModbusPort") -> None:
        """Close a Modbus connection; the rig hears that it is gone."""
        if port in self._modbus:
            self._modbus.remove(port)
            self.rig.peer_lost(port.name)

    def disconnect(self, wire: str) -> None:
        """Let all clients of ``can`` or ``modbus`` lose their connections, and the rig hear of it."""
        if wire == "can":
            for port in list(self._ports):
                port.lose("the CAN interface of the rig is down")
                self.leave(port)
        else:
            for client in self._modbus:
                self.rig.peer_lost(client.name)

    def _advance(self, until: int) -> None:
        ticks = until // TICK_NS - self._ticks
        if ticks > 0:
            self._ticks += ticks
            self.bus.publish(self._run(ticks))

    def _name(self, kind: str) -> str:
        self._clients += 1
        return f"{kind}:{self._clients}"


def _number(name: str) -> int:
    """Return what represents a TCP port in the name of a port in memory."""
    return int(name.rpartition(":")[2])


class _Wire:
    """One of the two wires of a rig in memory, as its faults know it."""

    def __init__(self, memory: RigInMemory, wire: str) -> None:
        self._memory, self._wire = memory, wire

    def cut(self) -> None:
        """Close all connections and let no one in."""
        self._memory.shut.add(self._wire)
        self._memory.disconnect(self._wire)

    def restore(self) -> None:
        """Let clients in again."""
        self._memory.shut.discard(self._wire)


class _CanPort(InMemoryCan):
    def __init__(self, memory: RigInMemory, name: str) -> None:
        super().__init__(lambda block: memory.send(block, self))
        self.name, self._memory = name, memory
        self.local_ports = {_number(name)}

    def close(self) -> None:
        super().close()
        self._memory.leave(self)


class _ModbusPort(InMemoryModbus):
    def __init__(self, memory: RigInMemory, name: str, latency: int) -> None:
        self.name, self._memory, self._latency = name, memory, latency
        super().__init__(self._answer)
        self.local_ports = {_number(name)}

    def _answer(self, request: bytes) -> bytes:
        if self._latency:
            clock = self._memory.clock
            clock.sleep_until(clock.now() + self._latency)
        return self._memory.answer(request, self.name)

    def close(self) -> None:
        super().close()
        self._memory.leave_modbus(self)
