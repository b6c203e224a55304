"""The bench as a test plan uses it: devices with readings and settings, and the methods that arm and disarm it."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Literal, NoReturn, Self

from bench_protocol.clock import Clock
from bench_protocol.signals import Kind
from bench_protocol.units import NS, s
from bench_protocol.words import ACTUATORS, FAULT_STATES, LIVE_STATES, PLATFORM_AXES
from drivers.air import Air
from drivers.axes import Lateral, Platform, Vertical, VerticalActuator
from drivers.car import Car
from drivers.declarations import Device, no_such_attribute
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
from drivers.errors import TRY_AGAIN, BenchError, LinkLost, Misuse, NotAvailable, Refused, RigFault
from drivers.generator import Generator
from drivers.link import STREAM_CYCLES, Link
from drivers.settings import UNKNOWN
from drivers.waveform import Waveform
from drivers.wiring.contract import NO_WATCHDOG, Order, Step, Wiring

#: Readings with a set-point: forces and displacements of the actuators, positions of the platform.
_COMMANDED: Final = (
    *(f"{actuator}.{mode}" for actuator in ACTUATORS for mode in ("force", "displacement")),
    *(f"platform.{axis}" for axis in PLATFORM_AXES),
)


class Bench(Link):
    """A test bench with all its devices, connected to a rig by a wiring.

    Use it as a context manager, or call :meth:`connect` and :meth:`close`. All devices exist on any rig; access to a
    signal that the rig lacks raises an error with the reason.
    """

    #: The texts are printed by ``help``.
    __slots__ = {
        "about": "What records say of where this bench is from, by keyword.",
        "action": "The coils: `bench.action.program_stop()`.",
        "air": "The valves of both springs.",
        "amplitude_control": "Whether plans correct the command of a wave or track until its amplitude is reached.",
        "car": "A car that the rig computes in its tick.",
        "closing": "What else ends with this bench: a context stack that `close` closes.",
        "control": "The bits of the Control message.",
        "devices": "All devices.",
        "dimensions": "Masses, spacings and lags of the rig, if stated.",
        "emergency": "The last CANopen emergency of the rig.",
        "generator": "The function generator.",
        "hand": "Performs manual actions of a plan on a simulated rig.",
        "instruments": "Instruments of the readings, if stated.",
        "interlock": "The contacts, read when asked.",
        "last_run": "When the last plan on this bench ended (ns of its clock).",
        "lateral": "The lateral actuator and its transducers.",
        "lease": "A request for the lease on CAN.",
        "left": "The left air spring with its auxiliary chamber.",
        "load_cell": "The six cells under the platform.",
        "platform": "The vibration platform.",
        "rig": "State and set-up of the rig.",
        "right": "The right air spring with its auxiliary chamber.",
        "supply": "The air supply.",
        "vertical": "Both vertical actuators together.",
        "vertical_left": "The left vertical actuator.",
        "vertical_right": "The right vertical actuator.",
        "waveform": "A motion of any shape, streamed as set-points.",
    }

    def __init__(self, wiring: Wiring, clock: Clock) -> None:
        super().__init__(wiring, clock)
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
        self.car = Car(self, "car")
        self.waveform = Waveform(self, "waveform")
        self.about: Mapping[str, Any] = {}
        self.amplitude_control = False
        self.hand: Any = None
        self.dimensions: Any = None
        self.instruments: Any = None
        self.last_run: int | None = None
        self.closing = ExitStack()
        parts = (getattr(self, name) for name in self.__slots__ if name != "devices")
        self.devices: tuple[Device, ...] = tuple(part for part in parts if isinstance(part, Device))

    # -- connection ----------------------------------------------------------------------------------------------

    def connect(self, within: float = 2 * s) -> None:
        """Open the wiring, become the commander, and start to receive and send.

        Raises MapMismatch, NotCommander or LinkLost on failure. LinkLost also means that the rig was silent for
        ``within`` s. The bench is then closed again.
        """
        if self._connected:
            raise Misuse("this bench is connected already; close it first")
        self._connected = True
        try:
            self.wiring.open(self.clock, self.receiver.receive, self._on_lost, within=within)
            self.readings.renew()
            self.commander.start()
            self._until(self._introduced, within, "first report of the rig's state", LinkLost)
            # The last frames of the previous commander have arrived by now.
            if self.has("rig.strangers"):
                self._strangers = self.settings.reading("rig.strangers")
            if self.wiring.capabilities.lease and self.has("rig.rejected_commands"):
                self._rejected = self.settings.reading("rig.rejected_commands")
            self.check()
        except BaseException:
            self.close()
            raise

    def _introduced(self) -> bool:
        """Whether the rig has reported its state, and also its signal map if it can report one."""
        return self.state != UNKNOWN and not (
            self.wiring.capabilities.identity and math.isnan(self.readings.value("rig.map_hash"))
        )

    def close(self) -> None:
        """Disarm if necessary, and close the wiring. Repeated calls are harmless."""
        if not self._connected:
            return
        self._connected = False
        try:
            with suppress(BenchError):
                # A client that only read from an active rig does not change its state.
                if self.state in LIVE_STATES and self.wiring.commanded:
                    self.disarm()
        finally:
            self._armed = False
            self.commander.stop()
            self.wiring.close()
            self.closing.close()

    def __enter__(self) -> Self:
        if not self._connected:
            self.connect()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        code = self.readings.known("rig.state")
        name = UNKNOWN if math.isnan(code) else self.table["rig.state"].show(code)
        state = f"state {name}" if self._connected else "not connected"
        names = ", ".join(device._name for device in self.devices)
        return f"<{type(self).__name__} on {self.wiring.rig}, {state}: {names}>"

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> NoReturn:
            raise no_such_attribute(self, name, "bench")

    # -- states --------------------------------------------------------------------------------------------------

    def arm(self, within: float = 10 * s, *, to: str = "ACTIVE") -> None:
        """Bring the bench from any state to ACTIVE, with all set-points at the measured values.

        Resets a latched fault first. If ``to`` is an earlier state of the start-up sequence, stops there. Raises Misuse
        if that sequence does not lead to ``to``, RigFault if the rig refuses or enters a fault, and BenchTimeout if it
        takes longer than ``within`` s.
        """
        left = self._countdown(within)
        steps = self.wiring.sequences.up
        if not any(to in step.end for step in steps):
            ends = " or ".join(dict.fromkeys(state for step in steps for state in step.end))
            raise Misuse(f"the start sequence of {self.wiring.rig} does not lead to {to}; use {ends}")
        self._armed = False
        self.reset(left())
        self._reach((*(state for step in steps for state in step.start), "ACTIVE"), left())
        for step in steps:
            if self.state in step.start and self.state != to:
                self._run_step(step, left)
        self._reach((to,), left())
        self._armed = to == "ACTIVE"

    def disarm(self, within: float = 10 * s) -> None:
        """Bring the bench to rest from any state: hold, unload softly, disable. A latched fault is not reset. Raises
        BenchTimeout if it takes longer than ``within`` s.
        """
        sequences = self.wiring.sequences
        self._armed = False
        self.commander.freeze()
        with self.despite_faults():
            refused: list[Refused] = []
            for order in sequences.rest:
                try:
                    self._write_order(order)
                except Refused as one:  # the remaining orders may still bring it to rest
                    refused.append(one)
            what = "; ".join(("the bench at rest", *map(str, refused)))
            self._until(lambda: self.state in sequences.at_rest, within, what)

    def reset(self, within: float = 5 * s) -> None:
        """Reset a latched fault, if there is one; the rig is then in HOLD or DISABLED. Raises RigFault if the emergency
        stop is pressed or the reset fails, and BenchTimeout if the rig does not accept a reset within ``within`` s.
        """
        if self.state not in FAULT_STATES:
            return
        steps = self.wiring.sequences.reset
        ready = {state for step in steps for state in step.start}
        with self.despite_faults():
            self._until(
                lambda: self.state in ready or self.state not in FAULT_STATES,
                within,
                "end of the fault reaction",
            )
            if self.has("interlock.estop") and self.interlock.estop:
                raise RigFault("the emergency stop is pressed: release the button, then reset")
            for step in steps:
                if self.state in step.start:
                    self._run_step(step, lambda: within)

    @contextmanager
    def silent(self, about: Literal["set-points", "settings"]) -> Iterator[None]:
        """Send no set-points, or nothing on the connection for settings (``about``), inside the block.

        This simulates a broken cable. From then on the bench counts as disarmed. Faults of the rig raise no error
        inside the block. Raises NotAvailable, without a change, if it is unknown whether the rig detects a silent
        commander.
        """
        if not self.wiring.capabilities.watchdog:
            raise NotAvailable(NO_WATCHDOG.format(self.wiring.rig))
        self._armed = False
        with self.despite_faults():
            if about == "settings":
                with self.wiring.silent():
                    yield
                return
            self.commander.stop()
            try:
                yield
            finally:
                self.commander.start()

    # -- inside --------------------------------------------------------------------------------------------------

    def _countdown(self, within: float) -> Callable[[], float]:
        """Return a function that returns the remaining part of ``within`` (s)."""
        deadline = self.clock.now() + round(within * NS)
        return lambda: max(0.0, (deadline - self.clock.now()) / NS)

    def _run_step(self, step: Step, left: Callable[[], float]) -> None:
        """Send the orders of one step of a sequence and wait for its end state; ``left`` returns the remaining time
        (s).
        """
        for order in step.prepare:
            self._write_order(order)
        if step.bumpless:
            self.take_over(_COMMANDED)
        for order in step.orders:
            self._write_order(order)
        within = left() if step.within is None else min(left(), step.within)
        if set(step.start) <= set(FAULT_STATES):
            what = _state_with_orders(f"reset of the fault ({self.describe()})", step.orders)
            self._until(lambda: self.state in step.end, within, what, RigFault)
        else:
            self._reach(step.end, within, step.orders)
        for order in step.afterwards:
            self._write_order(order)

    def _write_order(self, order: Order) -> None:
        """Write an order and wait until it takes effect."""
        index = self.table.index
        setpoints = {
            name: value
            for name, value in order.values.items()
            if name in index and self.table[name].kind is Kind.SETPOINT
        }
        if setpoints:
            self.commander.set_all(setpoints)
        self.settings.give(order)
        if setpoints:
            self.wait_cycles(STREAM_CYCLES)
        elif latency := self.wiring.capabilities.latency:
            self.wait(latency)

    def _reach(self, states: Collection[str], within: float, orders: Collection[Order] = ()) -> None:
        """Wait until the rig is in one of ``states``, at most ``within`` s. Raises RigFault if a fault occurs first.
        The text of a time-out error contains the ``orders``.
        """
        expected = " or ".join(dict.fromkeys(states))
        faults = [state for state in FAULT_STATES if state not in states]
        self._until(lambda: self.state in (*states, *faults), within, _state_with_orders(expected, orders))
        if self.state not in states:
            raise RigFault(f"the rig did not reach {expected}: {self.describe()}; {TRY_AGAIN}")


def _state_with_orders(states: str, orders: Collection[Order]) -> str:
    """Return the expected state and the orders sent for it, as text."""
    text = "; ".join(
        ", ".join(f"{name} = {value:g}" for name, value in order.values.items()) for order in orders
    )
    return f"{states} (after {text})" if text else states
