"""The transport to a rig with the ASTB table of signals: measurements and set-points on CAN, all else on Modbus/TCP.

It carries the signals themselves, in SI, by a compiled codec, and keeps the cycle of the set-points. In a wiring file
it serves every signal that has no line of its own::

    [transports.rig]
    kind = "astb"
    can = { bus = "tcp", host = "127.0.0.1", port = 29536 }     # bus: auto, tcp, or a SocketCAN interface
    modbus = { host = "127.0.0.1", port = 15020, unit = 1 }
    commands = true               # false: only listens, and never commands the rig
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import cached_property
from typing import TYPE_CHECKING, Any

from bench_protocol.arrays import Ints
from bench_protocol.clock import Clock, VirtualClock
from bench_protocol.messages import HIDDEN_TOKEN, TOKEN
from bench_protocol.rates import PACE
from bench_protocol.wires import Table
from drivers.errors import BenchError, LinkLost, NotCommander
from drivers.stamps import StampClock
from drivers.wiring.astb.can import AstbListener, AstbOutlet, stale_limits
from drivers.wiring.astb.keys import AstbKeys
from drivers.wiring.astb.modbus import AstbRegisters, other_map
from drivers.wiring.contract import Capabilities, OnLost, OnSamples
from drivers.wiring.keys import convert

if TYPE_CHECKING:
    from drivers.can_port import CanPort
    from drivers.modbus_port import ModbusPort
from typing import TYPE_CHECKING, Final

from bench_protocol.clock import Task
from bench_protocol.units import NS, ms, s

if TYPE_CHECKING:
    from drivers.wiring.astb.modbus import AstbRegisters


#: The rig holds the bench after this time without a write.
WATCHDOG: Final = 1 * s
#: Two late feedings are tolerated.
_PERIOD: Final = round(400 * ms * NS)


class WatchdogFeeder:
    """Arms the rig's watchdog and rewrites its register, in its own task, from ``start`` to ``stop``.

    When that fails, ``failure`` keeps the reason and the feeding ends. The watchdog then trips.
    """

    def __init__(self, registers: AstbRegisters) -> None:
        self._registers = registers
        self._task: Task | None = None
        self.failure: BenchError | None = None

    def start(self, clock: Clock) -> None:
        """Arm the watchdog, and start to feed it."""
        self.failure = None
        self._registers.watch(WATCHDOG)
        self._task = clock.every(_PERIOD, lambda: self._registers.between_requests(self._feed))

    def stop(self) -> None:
        """Stop feeding the watchdog."""
        if self._task is not None:
            self._task.cancel()
            self._task = None

    def _feed(self) -> None:
        if self.failure is not None or self._task is None:
            return
        try:
            self._registers.watch(WATCHDOG)
        except BenchError as failure:
            self.failure = failure


def _bus_lost(reason: str) -> str:
    return f"the CAN bus is lost: {reason or 'closed'}; check that the rig runs and its CAN interface is up"


class AstbTransport:
    """The connection ``[transports.NAME]`` with the keys ``keys`` to a rig that implements ``table``, or most of it.

    ``ports`` opens a CAN and a Modbus port that replace the described ones, for example in memory. Both are opened at
    the first use, and closed at the end. Raises WiringError for invalid keys.
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
        #: Functions that the rig provides.
        self.capabilities = Capabilities(lease=True, watchdog=True, identity=True, files=True, pace=PACE)
        self.differs = ""  #: differences of the rig's table, as text
        self.absent: Mapping[
            str, str
        ] = {}  #: signals that the rig's table lacks or has elsewhere, with the reasons
        self.given: Mapping[str, float] = {}
        self.commands = False  #: whether this client holds the lease
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
        """The port of the CAN bus."""
        return self._ports[0]

    @cached_property
    def modbus(self) -> ModbusPort:
        """The Modbus port of the PLC."""
        return self._ports[1]

    @cached_property
    def outlet(self) -> AstbOutlet:
        """The sender of the set-points."""
        return AstbOutlet(self._table, self.can)

    @cached_property
    def registers(self) -> AstbRegisters:
        """The rig's Modbus map."""
        return AstbRegisters(self._table, self.modbus)

    @cached_property
    def watchdog(self) -> WatchdogFeeder:
        """The task that feeds the watchdog of the rig."""
        return WatchdogFeeder(self.registers)

    @property
    def freshness(self) -> Ints:
        """Age (ns) above which a sample is stale, by table row; 0 for signals that are polled on request or missing."""
        limits = stale_limits(self._table)
        limits[[self._table.index[name] for name in self.absent]] = 0
        return limits

    @property
    def failure(self) -> BenchError | None:
        """The error that makes commands ineffective: another signal map, a lost lease, or a failed watchdog feed."""
        map_hash = math.nan if self._listener is None else self._listener.map_hash
        if not math.isnan(map_hash) and (differs := other_map(int(map_hash), self._map_hash)):
            return differs
        failure = self.watchdog.failure if self.commands else None
        if failure is None or isinstance(failure, NotCommander):
            return failure
        return LinkLost(f"the watchdog of the rig cannot be reset: {failure}")

    # -- connection ----------------------------------------------------------------------------------------------

    def connect(self, clock: Clock, lost: OnLost) -> None:
        """Check that the rig implements the ASTB table of signals, or enough of it. Take the lease and feed the
        watchdog.

        A client that only listens does neither. The port limits the time of every Modbus answer.
        """
        self._clock, self._lost = clock, lost
        self._agree(self.registers.probe())
        if not self._keys.commands:
            return
        token = self.registers.take_lease()
        self.commands = True
        self.given = {TOKEN: float(token)}
        self.outlet.set_token(token)
        self.watchdog.start(clock)

    def subscribe(self, receive: OnSamples, silent: Collection[str]) -> None:
        """Start to receive samples, except those of the signals ``silent``."""
        stamps = None if isinstance(self._clock, VirtualClock) else StampClock()
        self._listener = AstbListener(self._table, self._clock, stamps, receive, silent)
        self.can.on_lost(lambda reason: self._lost(_bus_lost(reason)))
        self.can.subscribe(self._listener.receive)

    def _agree(self, map_hash: int) -> None:
        """Find the common part of the ASTB table and the rig's different map. Raises MapMismatch if it is too small."""
        self._map_hash = map_hash
        if map_hash != self._table.map_hash:
            found = self.registers.differences(map_hash)
            self.absent = found.absent
            self.differs = f"the rig uses another table of signals, hash {map_hash:#010x}: {found}"

    def close(self) -> None:
        """Release the lease and close both connections. Repeated calls are harmless."""
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
        """Stop feeding the watchdog of the PLC inside the block, then rejoin the same lease and feed it again."""
        self.watchdog.stop()
        try:
            yield
        finally:
            self.registers.join_lease(int(self.given[TOKEN]))
            self.watchdog.start(self._clock)

    # -- reading and writing -------------------------------------------------------------------------------------

    def write(self, values: Mapping[str, float]) -> None:
        """Stage and apply settings, all or none."""
        self.registers.write(values)

    def read(self, names: Sequence[str]) -> dict[str, float]:
        """Read active settings, contacts and readings through Modbus. Return them (SI) by name."""
        return self.registers.read(names)

    def act(self, name: str) -> None:
        """Raise the coil of an action."""
        self.registers.act(name)

    def read_file(self, file: int, record: int, count: int) -> list[int]:
        """Return ``count`` registers of a file from ``record`` on (Modbus function 20)."""
        return self.modbus.read_file(file, record, count)

    def is_own(self, port: int, token: float) -> bool:
        """Return whether a frame or request came from this commander, by its TCP ``port`` (0: a bus without ports).

        A client on another machine may use the same port number. CAN frames are therefore attributed to this
        commander only if it no longer holds the lease, or if the holder is unknown.
        """
        lost = not math.isnan(token) and bool(self.given) and token != self.given[TOKEN]
        if not port:
            return lost and token != HIDDEN_TOKEN
        return port in self.modbus.local_ports or (
            port in self.can.local_ports and (lost or math.isnan(token))
        )

    def identity(self) -> str:
        """Return as text which signal table the rig uses (its hash, or the difference to ours), and who holds the
        lease.
        """
        table = self.differs or f"signal map {self._table.map_hash:#010x}"
        return f"{table}; lease: {self.registers.holder_text()}"

    def source(self, name: str) -> str:
        """Return the CAN message or register of a signal."""
        for message in self._table.messages:
            if any(place.signal == name for place in message.fields):
                return f"CAN {message.identifier:#05x}"
        return f"Modbus {self._table[name].address}"

    def tally(self) -> dict[str, int]:
        """Return the counts of frames since the connection: accepted, lost, repeated, malformed…"""
        return {} if self._listener is None else self._listener.tally()
