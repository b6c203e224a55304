"""A simulated rig in this process and in virtual time, with its CAN bus and its Modbus in memory."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Final

from astb.streaming import run_cycles
from bench_protocol.clock import VirtualClock
from bench_protocol.dimensions import ordinary
from bench_protocol.frames import Block
from bench_protocol.runtime.binding import bind
from bench_protocol.units import NS, ms, s
from bench_sim.rig.can_bus import CanBus
from bench_sim.rig.controls import TICK_NS
from bench_sim.rig.faults.insertion import Wires
from bench_sim.rig.peers import sender_of
from drivers.bench import Bench
from drivers.cycle import NO_CYCLE, cycle_frames
from drivers.errors import LinkLost
from drivers.memory import Faults, FaultyCan, InMemoryCan
from drivers.modbus_port import InMemoryModbus
from drivers.wiring.own import own_wiring

if TYPE_CHECKING:
    from bench_protocol.clock import Task
    from bench_sim.rig.rig import Rig
    from drivers.cycle import Cycle
    from drivers.wiring.contract import CyclicStream

#: Longest time (ns) in one call.
BLOCK: Final = round(1 * s * NS)
#: Every change of the rig's state is sent within this time (ns).
STATE_SENT_WITHIN: Final = round(100 * ms * NS)
_NEVER: Final = 2**62


class RigInMemory:
    """A ``rig`` that runs while its virtual ``clock`` advances, and any number of ports to it.

    Ports receive each other's frames as on a real bus. The rig knows the sender of each frame and which ports are
    closed, as with a hub. ``run`` replaces ``rig.run`` if a caller changes the rig between ticks.
    """

    def __init__(self, rig: "Rig", run: Callable[[int], Block] | None = None) -> None:
        self.rig, self.clock = rig, VirtualClock()
        self.bus = CanBus(rig.receive, self.clock, self.clock.now)
        self.bus.connect(self)
        self._run = run
        self.run_cycles: Any = bind(run_cycles, 0, NO_CYCLE, 0, 0, 0, *rig.tick_arguments)
        self._ports: list[_CanPort] = []
        self._clients = 0
        self._ticks = 0
        self._modbus: list[_ModbusPort] = []
        #: The wires that faults have cut.
        self.shut: set[str] = set()
        self._stream: _Stream | None = None
        self._status, self._quiet_from = rig.status, 0
        self.clock.attach(lambda until: self._advance(until, until), self._advance)
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
        """Return a bench on its own ports, not yet connected.

        ``faults``, drawn from ``seed``, disturb its CAN frames (``outward`` those that it sends, if different);
        ``latency`` (s) is that of Modbus; ``absent`` are signals that the bench must not use, with the reasons.
        """
        port = self.can()
        can = port if faults is None else FaultyCan(port, faults, seed, outward=outward)
        bench = Bench(own_wiring(can, self.modbus(latency), absent=absent), self.clock)
        bench.dimensions = ordinary()
        return bench

    def cut(self, reason: str) -> None:
        """Cut the CAN bus, like the crash of a hub; Modbus continues."""
        for port in self._ports:
            port.lose(reason)

    def publish(self, block: Block) -> None:
        """Deliver frames of the rig to every port."""
        for port in self._ports:
            port.receive(block)

    def relay(self, block: Block, peer: str) -> None:
        """Deliver frames to every port except that of their sender."""
        for port in self._ports:
            if port.name != peer:
                port.receive(block)

    def send(self, block: Block, port: "_CanPort") -> None:
        """Send frames from a port, with a time stamp, to all other ports and to the rig."""
        stamped = block.copy()
        stamped["time"] = self.clock.now()
        stamped = self.bus.carry(stamped, port.name)
        if stamped.size:
            self.relay(stamped, port.name)
            self.rig.receive(stamped, port.name)

    def leave(self, port: "_CanPort") -> None:
        """Remove a port from the bus, and report it to the rig."""
        if port in self._ports:
            self._ports.remove(port)
            self.bus.forget(port.name)
            self.rig.peer_lost(port.name)

    def answer(self, request: bytes, peer: str) -> bytes:
        """Return the answer of the rig to a Modbus request, after its faults and delay; b"" if there is none."""
        if "modbus" in self.shut:
            return b""
        filtered = self.rig.faults.points.modbus
        response = filtered.before(self.rig.answer)(request, peer)
        pieces = filtered.pieces(response) if response else []
        if delay := sum(gap for gap, _ in pieces):
            self.clock.sleep_until(self.clock.now() + round(delay * NS))
        return b"".join(piece for _, piece in pieces)

    def leave_modbus(self, port: "_ModbusPort") -> None:
        """Close a Modbus connection, and report it to the rig."""
        if port in self._modbus:
            self._modbus.remove(port)
            self.rig.peer_lost(port.name)

    def disconnect(self, wire: str) -> None:
        """Close the connections of all clients of ``can`` or ``modbus``, and report it to the rig."""
        if wire == "can":
            for port in list(self._ports):
                port.lose("the CAN interface of the rig is down")
                self.leave(port)
        else:
            for client in self._modbus:
                self.rig.peer_lost(client.name)

    def stream(self, cycle: "Cycle", stream: "CyclicStream", port: "_CanPort") -> "Task | None":
        """Send the frames of ``cycle`` from ``port`` at the times of ``stream``.

        Return None if another port sends in cycles.
        """
        if self._stream is not None:
            return None
        self._stream = _Stream(self, cycle, stream, port)
        return self._stream

    @property
    def ticks(self) -> int:
        """Number of ticks that the rig has run on this clock."""
        return self._ticks

    def only(self, port: "_CanPort") -> bool:
        """Return whether ``port`` is the only one on the bus, and not lost."""
        return self._ports == [port] and not port.lost

    def end(self, stream: "_Stream") -> None:
        """End a stream."""
        if self._stream is stream:
            self._stream = None

    def _advance(self, first: int, last: int) -> None:
        """Advance rig and stream to ``first``, and further to ``last`` while no event occurs to which a plan could
        react.
        """
        while (now := self.clock.now()) < first:
            stream = self._stream
            if stream is None or stream.due > first:
                self._pass_to(first)
            elif (end := self._quiet_until(stream, now, last)) >= stream.due:
                self._pass_quietly(stream, end, last)
            else:
                self._pass_cycle(stream, last)

    def _quiet_until(self, stream: "_Stream", now: int, last: int) -> int:
        """Return the time up to which only rig and stream act; ``now`` if that is unknown.

        It is unknown if stages of the bus or other ports receive the frames. After a change of the rig's state it is
        known only one cycle later, when the message of the state has arrived.
        """
        rig = self.rig
        if self._run or self.bus.staged or not stream.is_only_receiver or not rig.steady:
            return now
        if (status := rig.status) != self._status:
            self._status, self._quiet_from = status, now + STATE_SENT_WITHIN
        end = stream.due
        if now >= self._quiet_from:
            end = last if last - now <= BLOCK else stream.cycle_before(now + BLOCK)
        if (fault := rig.next_fault) >= 0 and (ahead := (fault - rig.ticks + self._ticks) * TICK_NS) <= end:
            end = stream.cycle_before(ahead)
        return stream.cycle_before(end + 1) if stream.due % TICK_NS else end

    def _pass_quietly(self, stream: "_Stream", end: int, last: int) -> None:
        """Advance rig and stream to ``end``, or to the end of the cycle in which something happens."""
        before = self.rig.ticks
        with stream.mutex:
            block, happened = self.rig.run_until_event(end // TICK_NS - self._ticks, stream.run)
        self._ticks += self.rig.ticks - before
        self.clock.reach(stream.due - stream.period if happened else end)
        self.bus.publish(block)
        if happened:
            self._quiet_from = self.clock.now() + STATE_SENT_WITHIN
            self._pass_cycle(stream, last)

    def _pass_cycle(self, stream: "_Stream", last: int) -> None:
        """Advance the rig to the next cycle of the stream, and send its frames; only to ``last`` if the cycle is
        later.
        """
        self._pass_to(min(stream.due, last))
        if stream.due <= last:
            stream.send()

    def _run_without_cycles(self, ticks: int, state: tuple[Any, ...], out: Block) -> tuple[int, int, int]:
        """Run ticks without a commander's cycles (`Rig.run`)."""
        done, count, happened, _ = self.run_cycles(ticks, NO_CYCLE, _NEVER, 0, 0, *state, out)
        return done, count, happened

    def _pass_to(self, until: int) -> None:
        ticks = until // TICK_NS - self._ticks
        if ticks > 0:
            self._ticks += ticks
            self.bus.publish(self._run(ticks) if self._run else self.rig.run(ticks, self._run_without_cycles))
        self.clock.reach(until)

    def _name(self, kind: str) -> str:
        self._clients += 1
        return f"{kind}:{self._clients}"


def _number(name: str) -> int:
    """Return the number in the name of a port in memory, which stands for a TCP port."""
    return int(name.rpartition(":")[2])


class _Wire:
    """One of the two buses of a rig in memory, CAN or Modbus, which faults can cut."""

    def __init__(self, memory: RigInMemory, wire: str) -> None:
        self._memory, self._wire = memory, wire

    def cut(self) -> None:
        """Close all connections and refuse new ones."""
        self._memory.shut.add(self._wire)
        self._memory.disconnect(self._wire)

    def restore(self) -> None:
        """Accept clients again."""
        self._memory.shut.discard(self._wire)


class _Stream:
    """The cycles of a commander on the bus in memory. Ticks and cycles of a whole interval run in one compiled call."""

    def __init__(self, memory: RigInMemory, cycle: "Cycle", stream: "CyclicStream", port: "_CanPort") -> None:
        self._memory, self._cycle, self._port, self._failed = memory, cycle, port, stream.failed
        self.mutex, self.period, self.due = stream.mutex, stream.period, stream.start + stream.period
        self._sender = sender_of(port.name)

    @property
    def is_only_receiver(self) -> bool:
        """Whether no other port receives the frames."""
        return self._memory.only(self._port)

    def cycle_before(self, time: int) -> int:
        """Return the time of the last cycle before ``time`` (ns)."""
        return self.due - (self.due - time + self.period) // self.period * self.period

    def run(self, ticks: int, state: tuple[Any, ...], out: Block) -> tuple[int, int, int]:
        """Run the rig's ticks with the cycles that are due meanwhile (`Rig.run_until_event`)."""
        late = (self._memory.rig.ticks - self._memory.ticks) * TICK_NS  # of the clock behind the rig's time
        done, count, happened, due = self._memory.run_cycles(
            ticks, self._cycle, self.due + late, self.period, self._sender, *state, out
        )
        self.due = due - late
        return done, count, happened

    def send(self) -> None:
        """Send the frames of the cycle that is due."""
        with self.mutex:
            cycle_frames(self._cycle, self.due)
            self.due += self.period
        try:
            self._port.send(self._cycle.frames)
        except Exception as error:  # the bench reports it where the plan waits
            self.cancel()
            self._failed(
                error if isinstance(error, LinkLost) else LinkLost(f"{type(error).__name__}: {error}")
            )

    def cancel(self) -> None:
        """End the stream."""
        self._memory.end(self)


class _CanPort(InMemoryCan):
    def __init__(self, memory: RigInMemory, name: str) -> None:
        super().__init__(lambda block: memory.send(block, self))
        self.name, self._memory = name, memory
        self.local_ports = {_number(name)}

    def send_cyclic(self, cycle: "Cycle", stream: "CyclicStream") -> "Task | None":
        """Send the frames of ``cycle`` at the times of ``stream``. Return None if another port sends in cycles."""
        return self._memory.stream(cycle, stream, self)

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
