"""The transport to a rig that speaks our table: measurements and set-points on CAN, all else on Modbus/TCP.

It carries the signals themselves, in SI, by a compiled codec, and keeps the cycle of the set-points. In a description
it stands for every signal that no line is for::

    [transports.rig]
    kind = "astb"
    can = { bus = "tcp", host = "127.0.0.1", port = 29536 }     # bus: auto, tcp, or a SocketCAN interface
    modbus = { host = "127.0.0.1", port = 15020, unit = 1 }
    commands = true               # false: only listens, and never becomes the rig's commander
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import cached_property
from typing import TYPE_CHECKING, Any

from bench_protocol.clock import Clock, VirtualClock
from bench_protocol.messages import HIDDEN_TOKEN, TOKEN
from bench_protocol.rates import PACE
from bench_protocol.wires import Table
from drivers.errors import BenchError, LinkLost, NotCommander
from drivers.stamps import StampClock
from drivers.wiring.astb.can import AstbListener, AstbOutlet, stale_limits
from drivers.wiring.astb.keys import AstbKeys
from drivers.wiring.astb.modbus import AstbRegisters, other_map
from drivers.wiring.astb.watchdog import WatchdogFeeder
from drivers.wiring.contract import Capabilities, Ints, OnLost, OnSamples
from drivers.wiring.keys import convert

if TYPE_CHECKING:
    from drivers.can_port import CanPort
    from drivers.modbus_port import ModbusPort


def _bus_lost(reason: str) -> str:
    return f"the CAN bus is lost: {reason or 'closed'}; see that the rig runs and its CAN interface is up"


class AstbTransport:
    """The connection ``[transports.NAME]``, whose keys are ``keys``, to a rig that speaks ``table``, or much of it.

    ``ports`` opens a CAN and a Modbus port in the place of the described ones: in memory, say. Both are opened when
    they are first needed, and closed at the end. WiringError for keys that cannot be.
    """

    def __init__(
        self,
        name: str,
        keys: Mapping[str, Any],
        table: Table,
        ports: Callable[[], tuple[CanPort, ModbusPort]] | None = None,
    ) -> None:
        self._keys = convert(f"transports.{name}", keys, AstbKeys)
        self._table, self._opener = table, ports or self._opened
        #: What the rig does by itself.
        self.capabilities = Capabilities(lease=True, watchdog=True, identity=True, files=True, pace=PACE)
        self.differs = ""  #: in words, what the rig's table has otherwise
        self.absent: Mapping[
            str, str
        ] = {}  #: signals that the rig's table has not, or elsewhere, with the reasons
        self.given: Mapping[str, float] = {}
        self.commands = False  #: whether it has the lease
        self._listener: AstbListener | None = None
        self._map_hash = table.map_hash
        self._clock: Clock
        self._lost: OnLost

    def _opened(self) -> tuple[CanPort, ModbusPort]:
        from drivers.can_port import open_can
        from drivers.modbus_port import open_modbus

        can, modbus = self._keys.can, self._keys.modbus
        with ExitStack() as stack:
            port = open_modbus(modbus.host, modbus.port, unit=modbus.unit)
            stack.callback(port.close)
            bus = open_can(can.bus, host=can.host, port=can.port)
            stack.pop_all()
        return bus, port

    @cached_property
    def _ports(self) -> tuple[CanPort, ModbusPort]:
        return self._opener()

    @cached_property
    def can(self) -> CanPort:
        """The port of the bus."""
        return self._ports[0]

    @cached_property
    def modbus(self) -> ModbusPort:
        """The port of the PLC."""
        return self._ports[1]

    @cached_property
    def outlet(self) -> AstbOutlet:
        """Where set-points go."""
        return AstbOutlet(self._table, self.can)

    @cached_property
    def registers(self) -> AstbRegisters:
        """The rig's Modbus map."""
        return AstbRegisters(self._table, self.modbus)

    @cached_property
    def watchdog(self) -> WatchdogFeeder:
        """What lets the rig know that its commander lives."""
        return WatchdogFeeder(self.registers)

    @property
    def freshness(self) -> Ints:
        """For each table row, after how many ns a sample is stale; 0 for what is read when asked, or absent."""
        limits = stale_limits(self._table)
        limits[[self._table.index[name] for name in self.absent]] = 0
        return limits

    @property
    def failure(self) -> BenchError | None:
        """Why commands no longer count: another map, the lease is somebody else's, or the watchdog cannot be fed."""
        told = math.nan if self._listener is None else self._listener.map_hash
        if not math.isnan(told) and (differs := other_map(int(told), self._map_hash)):
            return differs
        failure = self.watchdog.failure if self.commands else None
        if failure is None or isinstance(failure, NotCommander):
            return failure
        return LinkLost(f"the rig's watchdog cannot be fed: {failure}")

    # -- coming and going ----------------------------------------------------------------------------------------

    def connect(self, clock: Clock, lost: OnLost) -> None:
        """Check that the rig speaks our table, or enough of it; take the lease and feed the watchdog.

        Who only listens does neither. Every answer of Modbus is bounded by its port.
        """
        self._clock, self._lost = clock, lost
        self._agree(self.registers.probe())
        if not self._keys.commands:
            return
        token = self.registers.take_lease()
        self.commands = True
        self.given = {TOKEN: float(token)}
        self.outlet.bear(token)
        self.watchdog.start(clock)

    def subscribe(self, receive: OnSamples, silent: Collection[str]) -> None:
        """Let samples come from now on, but for the signals ``silent``."""
        stamps = None if isinstance(self._clock, VirtualClock) else StampClock()
        self._listener = AstbListener(self._table, self._clock, stamps, receive, silent)
        self.can.on_lost(lambda reason: self._lost(_bus_lost(reason)))
        self.can.subscribe(self._listener.receive)

    def _agree(self, map_hash: int) -> None:
        """Find what our table and the rig's map have in common, if they differ; MapMismatch if that is too little."""
        self._map_hash = map_hash
        if map_hash != self._table.map_hash:
            found = self.registers.differences(map_hash)
            self.absent = found.absent
            self.differs = f"the rig speaks another table of signals, hash {map_hash:#010x}: {found}"

    def close(self) -> None:
        """Let go of the lease and of both connections. Harmless when repeated."""
        if "_ports" not in self.__dict__:  # nothing was opened
            return
        try:
            self.watchdog.stop()
            if self.commands:
                with suppress(BenchError):
                    self.registers.return_lease()
        finally:
            self.commands = False
            self.can.close()
            self.modbus.close()

    @contextmanager
    def silent(self) -> Iterator[None]:
        """Let the watchdog of the PLC starve while the block lasts; then join the same lease again."""
        self.watchdog.stop()
        try:
            yield
        finally:
            self.registers.join_lease(int(self.given[TOKEN]))
            self.watchdog.start(self._clock)

    # -- what is said and asked ----------------------------------------------------------------------------------

    def write(self, values: Mapping[str, float]) -> None:
        """Stage and apply settings, all or none."""
        self.registers.write(values)

    def read(self, names: Sequence[str]) -> dict[str, float]:
        """Read settings in force, contacts and readings through Modbus."""
        return self.registers.read(names)

    def act(self, name: str) -> None:
        """Raise the coil of an action."""
        self.registers.act(name)

    def read_file(self, file: int, record: int, count: int) -> list[int]:
        """Return ``count`` registers of a file from ``record`` on (Modbus function 20)."""
        return self.modbus.read_file(file, record, count)

    def is_own(self, port: int, token: float) -> bool:
        """Return whether this commander sent what came from a TCP ``port``; 0 is ours once the bench is not.

        A client on another machine may have the same port: frames from there are ours only if the bench is not.
        """
        lost = not math.isnan(token) and bool(self.given) and token != self.given[TOKEN]
        if not port:
            return lost and token != HIDDEN_TOKEN
        return port in self.modbus.local_ports or (
            port in self.can.local_ports and (lost or math.isnan(token))
        )

    def identity(self) -> str:
        """Return which table of signals the rig speaks, and who holds the bench."""
        spoken = self.differs or f"table of signals {self._table.map_hash:#010x}"
        return f"{spoken}; held by {self.registers.whose()}"

    def source(self, name: str) -> str:
        """Return which CAN message or register has a signal."""
        for message in self._table.messages:
            if any(place.signal == name for place in message.fields):
                return f"CAN {message.identifier:#05x}"
        return f"Modbus {self._table[name].address}"

    def tally(self) -> dict[str, int]:
        """Return how many frames were accepted, lost, repeated, malformed… since it was connected."""
        return {} if self._listener is None else self._listener.tally()
