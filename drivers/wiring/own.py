"""The wiring of our own rig, generated from the table: measurements and set-points on CAN, all else on Modbus."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from bench_protocol.clock import Clock
from bench_protocol.messages import TOKEN
from bench_protocol.rates import PACE
from bench_protocol.table import TABLE
from bench_protocol.wires import Table
from bench_protocol.words import AIR_BY_STATE, FAULT_STATES, LIVE_STATES, STATES
from drivers.errors import BenchError, LinkLost, NotCommander
from drivers.wiring.contract import Capabilities, Conduct, Hear, OnLost, Order, Remark, Step
from drivers.wiring.own_can import OwnEar, OwnOutlet, stale_limits
from drivers.wiring.own_modbus import OwnRegisters, other_map
from drivers.wiring.own_watchdog import WatchdogFeeder

if TYPE_CHECKING:
    from drivers.can_port import CanPort
    from drivers.modbus_port import ModbusPort


def _bits(**bits: bool) -> Order:
    return Order({f"control.{name}": float(bit) for name, bit in bits.items()})


#: Where a reset ends.
_SOUND: Final = tuple(state for state in STATES if state not in FAULT_STATES)

CONDUCT: Final = Conduct(
    up=(
        Step(("OFF",), (Order({"action.power_on": 1.0}),), ("DISABLED", *LIVE_STATES)),
        Step(("BOOT", "INIT"), (), ("DISABLED", *LIVE_STATES)),
        Step(
            ("DISABLED",),
            (_bits(enable=True, hold=False, active=False, reset=False), _bits(reset=True)),
            LIVE_STATES,
            afterwards=(_bits(reset=False),),
        ),
        Step(("AIR_LOW",), (Order({"action.air_high": 1.0}),), LIVE_STATES[1:]),
        Step(("AIR_HIGH",), (_bits(hold=False, active=False), _bits(hold=True)), ("HOLD", "ACTIVE")),
        Step(("HOLD",), (_bits(active=True),), ("ACTIVE",), prepare=(_bits(active=False),), bumpless=True),
    ),
    reset=tuple(
        Step(
            states,
            (_bits(enable=True, hold=held, active=False, reset=False), _bits(reset=True)),
            _SOUND,
            afterwards=(_bits(reset=False),),
        )
        for states, held in ((("FAULT_HOLD",), True), (("FAULT_DISABLED", "ESTOP"), False))
    ),
    rest=(_bits(active=False, reset=False), _bits(hold=False), _bits(enable=False)),
    at_rest=("OFF", "BOOT", "INIT", "DISABLED", "FAULT_DISABLED", "ESTOP"),
    air=AIR_BY_STATE,
)


def _bus_lost(reason: str) -> str:
    return f"the CAN bus is lost: {reason or 'closed'}; see that the rig runs and its CAN interface is up"


class OwnWiring:
    """A CAN port and a Modbus port of a rig that speaks our table; both are closed at its end.

    ``epoch`` is what to subtract from the frames' time stamps (ns) to get times of the bench's clock; 0 in virtual
    time, where they are the same. ``absent`` is what this rig lacks of the table, with the reasons. Who only
    ``listens`` checks what the rig speaks and does not become its commander.
    """

    def __init__(
        self,
        can_port: CanPort,
        modbus_port: ModbusPort,
        epoch: int = 0,
        *,
        table: Table = TABLE,
        rig: str = "the rig",
        absent: Mapping[str, str] | None = None,
        listens: bool = False,
    ) -> None:
        self.can, self.modbus, self.epoch = can_port, modbus_port, epoch
        self.rig, self.table = rig, table
        self.absent: Mapping[str, str] = absent or {}
        self.freshness = stale_limits(table)
        self.freshness[[table.index[name] for name in self.absent]] = 0
        self.capabilities = Capabilities(
            generator=True, lease=True, watchdog=True, identity=True, files=True, pace=PACE
        )
        self.played: Collection[str] = ()
        self.remembered: Collection[str] = ()
        self.conduct = CONDUCT
        self.given: Mapping[str, float] = {}
        self.outlet = OwnOutlet(table, can_port)
        self.registers = OwnRegisters(table, modbus_port)
        self.watchdog = WatchdogFeeder(self.registers)
        self._ear: OwnEar | None = None
        self._clock: Clock
        self._listens = listens
        self._commands = False
        self._map_hash = table.map_hash

    @property
    def failure(self) -> BenchError | None:
        """Why commands no longer count: another map, the lease is somebody else's, or the watchdog cannot be fed."""
        told = math.nan if self._ear is None else self._ear.map_hash
        if not math.isnan(told) and (differs := other_map(int(told), self._map_hash)):
            return differs
        failure = self.watchdog.failure
        if failure is None or isinstance(failure, NotCommander):
            return failure
        return LinkLost(f"the rig's watchdog cannot be fed: {failure}")

    def open(self, clock: Clock, hear: Hear, lost: OnLost, *, within: float) -> None:
        """Check that the rig speaks our table, or enough of it; take the lease, feed the watchdog and listen.

        Both ports are open already, and every answer of Modbus is bounded by its port, not by ``within``.
        """
        del within
        try:
            self._agree(self.registers.probe())
            if not self._listens:
                self._take_command(clock)
            self._hear(clock, hear, lost)
        except BaseException:
            self.close()
            raise

    def _take_command(self, clock: Clock) -> None:
        token = self.registers.take_lease()
        self._commands = True
        self.given = {TOKEN: float(token)}
        self.outlet.bear(token)
        self._clock = clock
        self.watchdog.start(clock)

    def listening(self) -> OwnWiring:
        """Return a wiring that only listens, on the same two ports."""
        return OwnWiring(
            self.can,
            self.modbus,
            self.epoch,
            table=self.table,
            rig=self.rig,
            absent=self.absent,
            listens=True,
        )

    def _hear(self, clock: Clock, hear: Hear, lost: OnLost) -> None:
        self._ear = OwnEar(self.table, clock, self.epoch, hear, self.absent)
        self.can.on_lost(lambda reason: lost(_bus_lost(reason)))
        self.can.subscribe(self._ear.accept)

    def _agree(self, map_hash: int) -> None:
        """Find what our table and the rig's map have in common, if they differ; MapMismatch if that is too little."""
        self._map_hash = map_hash
        if map_hash == self.table.map_hash:
            return
        found = self.registers.differences(map_hash)
        self.absent = {**self.absent, **found.absent}
        self.freshness[[self.table.index[name] for name in self.absent]] = 0
        note = f"the rig speaks another table of signals, hash {map_hash:#010x}: {found}"
        self.capabilities = replace(self.capabilities, notes={"identity": note})

    def close(self) -> None:
        """Let go of the lease and of both connections."""
        try:
            self.watchdog.stop()
            if self._commands:
                with suppress(BenchError):
                    self.registers.return_lease()
        finally:
            self._commands = False
            self.can.close()
            self.modbus.close()

    @property
    def commanded(self) -> bool:
        """Whether it has the lease."""
        return self._commands

    def begin(self) -> None:
        """Do nothing: the rig hears its commander from `open` on."""

    def is_own(self, port: int, token: float) -> bool:
        """Return whether this commander sent what came from a TCP ``port``; 0 is ours once the bench is not."""
        if port:
            return port in self.can.local_ports | self.modbus.local_ports
        return not math.isnan(token) and bool(self.given) and token != self.given[TOKEN]

    @contextmanager
    def silent(self) -> Iterator[None]:
        """Let the watchdog of the PLC starve while the block lasts; then join the same lease again."""
        self.watchdog.stop()
        try:
            yield
        finally:
            self.registers.join_lease(int(self.given[TOKEN]))
            self.watchdog.start(self._clock)

    def write(self, values: Mapping[str, float]) -> None:
        """Stage and apply settings, all or none."""
        self.registers.write(values)

    def read(self, names: Sequence[str]) -> dict[str, float]:
        """Read settings in force, contacts and readings through Modbus."""
        return self.registers.read(names)

    def read_file(self, file: int, record: int, count: int) -> list[int]:
        """Return ``count`` registers of a file from ``record`` on (Modbus function 20)."""
        return self.modbus.read_file(file, record, count)

    def act(self, name: str) -> None:
        """Raise the coil of an action."""
        self.registers.act(name)

    def say(self, points: Mapping[str, float]) -> None:
        """Refuse: our rig has no points but the table's signals."""
        raise KeyError(f"{', '.join(points)}: {self.rig} has no points beside the signals of its table")

    def identity(self) -> str:
        """Return which table of signals the rig speaks, and who holds the bench."""
        differs = self.capabilities.notes.get("identity", "")
        spoken = differs or f"table of signals {self.table.map_hash:#010x}"
        return f"{spoken}; held by {self.registers.whose()}"

    def source(self, name: str) -> str:
        """Return which CAN message or register has a signal."""
        for message in self.table.messages:
            if any(place.signal == name for place in message.fields):
                return f"CAN {message.identifier:#05x}"
        return f"Modbus {self.table[name].address}"

    def stamp(self, name: str) -> None:
        """Return None: nothing is known of the stamps."""

    def remarks(self) -> Mapping[str, Sequence[Remark]]:
        """Return nothing: what the rig does otherwise is counted in `tally`."""
        return {}

    def tally(self) -> dict[str, int]:
        """Return how many frames were accepted, lost, repeated, malformed… since `open`."""
        return {} if self._ear is None else self._ear.tally()
