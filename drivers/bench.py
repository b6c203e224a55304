"""The bench as a test plan sees it: devices with readings and settings, and the verbs that arm and disarm it."""

from __future__ import annotations

import math
from collections.abc import Collection
from contextlib import suppress
from types import TracebackType
from typing import TYPE_CHECKING, Self

from bench_protocol.clock import Clock
from bench_protocol.table import TABLE
from bench_protocol.units import NS, s
from bench_protocol.wires import Table
from bench_protocol.words import ACTUATORS, FAULT_STATES, LIVE_STATES
from drivers.air import Air
from drivers.axes import Lateral, Platform, Vertical, VerticalActuator
from drivers.declarations import Device
from drivers.devices import (
    Actions,
    Control,
    Emergency,
    Interlocks,
    LeaseRequest,
    LoadCells,
    RigStatus,
    Spring,
    Supply,
)
from drivers.errors import BenchError, LinkLost, Misuse, RigFault
from drivers.generator import Generator
from drivers.link import STREAM_BEATS, Link
from drivers.reading import UNKNOWN

if TYPE_CHECKING:
    from drivers.can_port import CanPort
    from drivers.modbus_port import ModbusPort


class Bench(Link):
    """One bench, connected through a CAN port and a Modbus port, which it closes at its own end.

    Its arguments are those of `Link`. Use it as a context manager, or call :meth:`connect` and :meth:`close`.
    """

    __slots__ = (
        "action",
        "air",
        "control",
        "devices",
        "emergency",
        "generator",
        "interlock",
        "lateral",
        "lease",
        "left",
        "load_cell",
        "platform",
        "rig",
        "right",
        "supply",
        "vertical",
        "vertical_left",
        "vertical_right",
    )

    def __init__(
        self,
        can_port: CanPort,
        modbus_port: ModbusPort,
        clock: Clock,
        epoch: int = 0,
        *,
        table: Table = TABLE,
    ) -> None:
        super().__init__(can_port, modbus_port, clock, epoch, table=table)
        self.left = Spring(self, "left")
        self.right = Spring(self, "right")
        self.vertical_left = VerticalActuator(self, "vertical_left")
        self.vertical_right = VerticalActuator(self, "vertical_right")
        self.vertical = Vertical(self, "vertical")
        self.lateral = Lateral(self, "lateral")
        self.platform = Platform(self, "platform")
        self.load_cell = LoadCells(self, "load_cell")
        self.supply = Supply(self, "supply")
        self.rig = RigStatus(self, "rig")
        self.emergency = Emergency(self, "emergency")
        self.control = Control(self, "control")
        self.lease = LeaseRequest(self, "lease")
        self.action = Actions(self, "action")
        self.interlock = Interlocks(self, "interlock")
        self.air = Air(self, "air")
        self.generator = Generator(self, "generator")
        parts = (getattr(self, name) for name in self.__slots__ if name != "devices")
        self.devices: tuple[Device, ...] = tuple(part for part in parts if isinstance(part, Device))

    # -- coming and going ----------------------------------------------------------------------------------------

    def connect(self, within: float = 2 * s) -> None:
        """Check that the rig speaks our table, take the lease, begin to command and to receive.

        MapMismatch, NotCommander or LinkLost if one of them fails; then nothing stays open.
        """
        if self._connected:
            raise Misuse("this bench is connected already")
        self._connected = True
        try:
            self.settings.probe()
            self._strangers = self.settings.reading("rig.strangers")
            self.commander.bear(self.settings.take_lease())
            self.watchdog.start()
            self._port.on_lost(self._on_lost)
            self._port.subscribe(self.receiver.accept)
            self.commander.start()
            self._until(
                lambda: self.state != UNKNOWN and not math.isnan(self.rig.map_hash),
                within,
                "first frames of the rig on CAN",
                LinkLost,
            )
            self.settings.compare(int(self.rig.map_hash))
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Disarm if need be, let go of the lease and of both connections. Harmless when repeated."""
        if not self._connected:
            return
        self._connected = False
        try:
            with suppress(BenchError):
                if self.state in LIVE_STATES:
                    self.disarm()
            self.commander.stop()
            self.watchdog.stop()
            with suppress(BenchError):
                self.settings.return_lease()
        finally:
            self._armed = False
            self.commander.stop()
            self.watchdog.stop()
            self._port.close()
            self._modbus.close()

    def __enter__(self) -> Self:
        self.connect()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # -- states --------------------------------------------------------------------------------------------------

    def arm(self, within: float = 10 * s) -> None:
        """Bring the bench from wherever it is to ACTIVE, all set-points at what is measured.

        Resets a latched fault first. RigFault if the rig refuses or falls into a fault on the way, BenchTimeout if it
        takes longer than ``within`` s.
        """
        deadline = self.clock.now() + round(within * NS)

        def left() -> float:
            return max(0.0, (deadline - self.clock.now()) / NS)

        self._armed = False
        self.reset(left())
        if self.state == "OFF":
            self.settings.act("action.power_on")
        self._reach(("DISABLED", *LIVE_STATES), left())
        if self.state == "DISABLED":
            self._bits(enable=True, hold=False, active=False, reset=False)
            self._bits(reset=True)
            self._reach(LIVE_STATES, left())
            self._bits(reset=False)
        if self.state == "AIR_LOW":
            self.settings.act("action.air_high")
            self._reach(LIVE_STATES[1:], left())
        if self.state == "AIR_HIGH":
            self._bits(hold=False, active=False)
            self._bits(hold=True)
            self._reach(("HOLD", "ACTIVE"), left())
        if self.state == "HOLD":
            self._bits(active=False)
            quantities = [
                f"{actuator}.{mode}" for actuator in ACTUATORS for mode in ("force", "displacement")
            ]
            self.take_over([*quantities, "platform.vertical", "platform.lateral", "platform.roll"])
            self._bits(active=True)
            self._reach(("ACTIVE",), left())
        self._armed = True

    def disarm(self, within: float = 10 * s) -> None:
        """Bring the bench to rest from any state: hold, unload softly, disable. A latched fault stays latched."""
        self._armed = False
        self.commander.freeze()
        with self.despite_faults():
            self._bits(active=False, reset=False)
            self._bits(hold=False)
            self._bits(enable=False)
            self._until(
                lambda: self.state in ("OFF", "BOOT", "INIT", "DISABLED", "FAULT_DISABLED", "ESTOP"),
                within,
                "DISABLED",
            )

    def reset(self, within: float = 5 * s) -> None:
        """Clear a latched fault, if there is one: to HOLD or DISABLED. RigFault if the emergency stop is pressed."""
        if self.state not in FAULT_STATES:
            return
        with self.despite_faults():
            self._until(lambda: self.state != "FAULT_REACTION", within, "end of the fault reaction")
            if self.interlock.estop:
                raise RigFault("the emergency stop is pressed: release the button, then reset")
            self._bits(enable=True, hold=self.state == "FAULT_HOLD", active=False, reset=False)
            self._bits(reset=True)
            self._until(
                lambda: self.state not in FAULT_STATES,
                within,
                f"reset of the fault ({self.describe()})",
                RigFault,
            )
            self._bits(reset=False)

    # -- inside --------------------------------------------------------------------------------------------------

    def _bits(self, **bits: bool) -> None:
        self.commander.set_all({f"control.{name}": float(bit) for name, bit in bits.items()})
        self.wait_beats(STREAM_BEATS)

    def _reach(self, states: Collection[str], within: float) -> None:
        """Wait for one of ``states``; RigFault if the rig falls into a fault instead."""
        wanted = " or ".join(states)
        self._until(lambda: self.state in (*states, *FAULT_STATES), within, wanted)
        if self.state not in states:
            raise RigFault(f"the rig did not reach {wanted}: {self.describe()}")
