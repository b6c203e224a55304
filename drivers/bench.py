"""The bench as a test plan sees it: devices with readings and settings, verbs, and bounded waits where time passes."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from types import TracebackType
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from bench_protocol.clock import Clock
from bench_protocol.signals import Table
from bench_protocol.table import ACTUATORS, TABLE
from bench_protocol.units import NS, minutes, s
from drivers.commander import BEAT, Commander
from drivers.devices import (
    AVERAGE_OVER,
    STREAM_BEATS,
    Actions,
    Air,
    Control,
    Emergency,
    Generator,
    Interlocks,
    Lateral,
    LoadCells,
    Platform,
    RigStatus,
    Spring,
    Supply,
    Vertical,
    VerticalActuator,
)
from drivers.errors import BenchError, BenchTimeout, LinkLost, Misuse, NotCommander, RigFault, Stale
from drivers.reading import UNKNOWN, Device, Readings, Sample
from drivers.receiver import Capture, Receiver
from drivers.settings import Settings

if TYPE_CHECKING:
    from drivers.can_port import CanPort
    from drivers.modbus_port import ModbusPort

FAULT_STATES: Final = ("FAULT_REACTION", "FAULT_HOLD", "FAULT_DISABLED", "ESTOP")
#: Where a bench that was armed must not be found.
DOWN_STATES: Final = (*FAULT_STATES, "OFF", "BOOT", "INIT", "DISABLED")
LIVE_STATES: Final = ("AIR_LOW", "AIR_HIGH", "HOLD", "ACTIVE")
#: A silent bus counts as lost only after so many looks in a row: one look may come before the receiver had its turn.
SILENT_BEATS: Final = 25
#: How often the lease is looked at during waits: a Modbus server may hang up on a client that stays silent.
LEASE_PERIOD: Final = 5 * s
#: No single wait of a plan is longer than this; a longer one is a wrong unit.
WAIT_MAX: Final = 24 * 3600 * s
SHOWN_MAX: Final = 12


class Bench:
    """One bench, connected through a CAN port and a Modbus port, which it closes at its own end.

    ``epoch`` is what to subtract from the frames' time stamps (ns) to get times of ``clock``; ``token`` names this
    commander in the rig's lease register. Use as a context manager, or call :meth:`connect` and :meth:`close`.
    """

    __slots__ = (
        "_armed",
        "_connected",
        "_lease_seen",
        "_lost",
        "_modbus",
        "_port",
        "_silent",
        "_token",
        "_tolerant",
        "action",
        "air",
        "clock",
        "commander",
        "control",
        "devices",
        "emergency",
        "generator",
        "interlock",
        "lateral",
        "left",
        "load_cell",
        "platform",
        "readings",
        "receiver",
        "rig",
        "right",
        "settings",
        "supply",
        "table",
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
        token: int = 1,
        table: Table = TABLE,
    ) -> None:
        self.table, self.clock = table, clock
        self._port, self._modbus, self._token = can_port, modbus_port, token
        self._lost = ""
        self._silent = 0
        self._lease_seen = 0
        self._armed = self._tolerant = self._connected = False
        self.receiver = Receiver(table, clock, epoch)
        self.commander = Commander(table, clock, can_port)
        self.settings = Settings(table, modbus_port)
        self.readings = Readings(self.receiver, self.settings.reading)

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
        self.action = Actions(self, "action")
        self.interlock = Interlocks(self, "interlock")
        self.air = Air(self, "air")
        self.generator = Generator(self, "generator")
        parts = (getattr(self, name) for name in self.__slots__ if name not in ("devices", "_lost"))
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
            self.settings.take_lease(self._token)
            self._lease_seen = self.clock.now()
            self._port.on_lost(self._on_lost)
            self._port.subscribe(self.receiver.accept)
            self.commander.start()
            self._until(
                lambda: self.rig.state != UNKNOWN and not math.isnan(self.rig.map_hash),
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
                if self.rig.state in LIVE_STATES:
                    self.disarm()
            with suppress(BenchError):
                self.settings.return_lease()
        finally:
            self._armed = False
            self.commander.stop()
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
        if self.rig.state == "OFF":
            self.settings.act("action.power_on")
        self._reach(("DISABLED", *LIVE_STATES), left())
        if self.rig.state == "DISABLED":
            self._bits(enable=True, hold=False, active=False, reset=False)
            self._bits(reset=True)
            self._reach(LIVE_STATES, left())
            self._bits(reset=False)
        if self.rig.state == "AIR_LOW":
            self.settings.act("action.air_high")
            self._reach(LIVE_STATES[1:], left())
        if self.rig.state == "AIR_HIGH":
            self._bits(hold=False, active=False)
            self._bits(hold=True)
            self._reach(("HOLD", "ACTIVE"), left())
        if self.rig.state == "HOLD":
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
                lambda: self.rig.state in ("OFF", "BOOT", "INIT", "DISABLED", "FAULT_DISABLED", "ESTOP"),
                within,
                "DISABLED",
            )

    def reset(self, within: float = 5 * s) -> None:
        """Clear a latched fault, if there is one: to HOLD or DISABLED. RigFault if the emergency stop is pressed."""
        if self.rig.state not in FAULT_STATES:
            return
        with self.despite_faults():
            self._until(lambda: self.rig.state != "FAULT_REACTION", within, "end of the fault reaction")
            if self.interlock.estop:
                raise RigFault("the emergency stop is pressed: release the button, then reset")
            self._bits(enable=True, hold=self.rig.state == "FAULT_HOLD", active=False, reset=False)
            self._bits(reset=True)
            self._until(
                lambda: self.rig.state not in FAULT_STATES,
                within,
                f"reset of the fault ({self.describe()})",
                RigFault,
            )
            self._bits(reset=False)

    @contextmanager
    def despite_faults(self) -> Iterator[None]:
        """Let waits go on though the rig is in a fault: for tear-down and diagnosis."""
        before, self._tolerant = self._tolerant, True
        try:
            yield
        finally:
            self._tolerant = before

    def describe(self) -> str:
        """Return the rig's state with its reason and the limit that tripped first, in words."""
        text = f"state {self.rig.state}, reason: {self.rig.reason}"
        tripped = self.rig.tripped
        if tripped >= 1 and tripped <= len(self.table.signals):
            text += f", first limit: {self.readings.show(self.table.signals[int(tripped) - 1].name)}"
        return text

    # -- time ----------------------------------------------------------------------------------------------------

    @property
    def now(self) -> float:
        """The time of the bench's clock (s)."""
        return self.clock.now() / NS

    def wait(self, duration: float) -> None:
        """Let ``duration`` s pass. Raises RigFault or LinkLost as soon as the rig or the link fails."""
        deadline = self.clock.now() + _nanoseconds("duration", duration)
        self.check()
        while (now := self.clock.now()) < deadline:
            self.clock.sleep_until(min(deadline, now + self._to_beat(now)))
            self.check()

    def wait_beats(self, beats: int) -> None:
        """Let so many command blocks go out that each of the last ``beats`` carries the present set-points."""
        self.wait((beats + 1) * BEAT / NS)

    def wait_for(
        self,
        condition: Callable[[], bool],
        within: float,
        what: str = "the condition",
        *,
        steady: float = 0.0,
    ) -> None:
        """Wait until ``condition()`` is true, and has been for ``steady`` s; it is asked every 20 ms.

        BenchTimeout after ``within`` s says what was waited for and what the readings are; RigFault and LinkLost
        come at once.
        """
        self._until(condition, within, what, steady=steady)

    def settle(
        self, *names: str, band: float, over: float = 1 * s, within: float = 2 * minutes
    ) -> dict[str, float]:
        """Wait until the means over ``over`` s change by no more than ``band`` (SI); return the last means.

        BenchTimeout after ``within`` s, with what still moved.
        """
        deadline = self.clock.now() + _nanoseconds("within", within)
        means = self.averages(*names, over=over)
        while True:
            before, means = means, self.averages(*names, over=over)
            if all(abs(means[name] - before[name]) <= band for name in names):
                return means
            if self.clock.now() >= deadline:
                moved = ", ".join(
                    f"{name} moved from {self.table[name].show(before[name])} to {self.table[name].show(means[name])}"
                    for name in names
                )
                raise BenchTimeout(f"not settled within {within:g} s: in the last {over:g} s {moved}")

    def check(self) -> None:
        """Raise what has happened meanwhile: LinkLost, NotCommander, or RigFault of an armed bench."""
        if self._lost:
            raise LinkLost(f"the CAN bus is lost: {self._lost}")
        if self.commander.failure is not None:
            raise LinkLost(f"commands cannot be sent: {self.commander.failure}")
        if self.receiver.failure is not None:
            raise Misuse(f"what takes the samples failed: {self.receiver.failure}") from self.receiver.failure
        if self._connected and self.clock.now() - self._lease_seen > LEASE_PERIOD * NS:
            self._see_lease()
        if not self._armed or self._tolerant:
            return
        state = self.rig.state
        self._silent = self._silent + 1 if state == UNKNOWN else 0
        if self._silent > SILENT_BEATS:
            age = self.readings.sample("rig.state").age
            raise LinkLost(f"the rig is silent: no State message for {age:.2g} s, 50 a second are right")
        if state in DOWN_STATES:
            raise RigFault(f"the rig left ACTIVE: {self.describe()}")

    # -- measuring -----------------------------------------------------------------------------------------------

    def sample(self, name: str) -> Sample:
        """Return value (SI), age (s) and quality of a reading."""
        return self.readings.sample(name)

    def capture(self, *names: str) -> Capture:
        """Return a context manager that keeps all samples of these signals while it is entered."""
        return Capture(self.receiver, names)

    def average(self, name: str, over: float = 1 * s) -> float:
        """Return the mean (SI) of the samples of ``name`` that come in the next ``over`` s; Stale if none does."""
        return self.averages(name, over=over)[name]

    def averages(self, *names: str, over: float = 1 * s) -> dict[str, float]:
        """Return the means (SI) of several signals over the same ``over`` s; Stale if one has no samples."""
        with self.capture(*names) as capture:
            self.wait(over)
        means = {}
        for name in names:
            values = capture.values(name)
            good = values[~np.isnan(values)]
            if good.size == 0:
                raise Stale(f"no sample of {name} came within {over:g} s: {self.readings.show(name)}")
            means[name] = float(good.mean())
        return means

    def take_over(self, names: Sequence[str]) -> None:
        """Let the set-points of ``names`` (``lateral.force``) be what is measured, and stream them a few beats."""
        means = self.averages(*names, over=AVERAGE_OVER)
        setpoints = {f"{name}_setpoint": mean for name, mean in means.items()}
        # A transducer's noise may lie beyond what a set-point can be, at the very end of its range.
        within = {
            name: min(max(value, self.table[name].low), self.table[name].high)
            for name, value in setpoints.items()
        }
        self.commander.set_all(within)
        self.wait_beats(STREAM_BEATS)

    # -- inside --------------------------------------------------------------------------------------------------

    def _see_lease(self) -> None:
        self._lease_seen = self.clock.now()
        holder = self.settings.holder()
        if holder != self._token:
            who = f"the commander with token {holder}" if holder else "nobody"
            raise NotCommander(f"the bench is held by {who}, no longer by this one (token {self._token})")

    def _on_lost(self, reason: str) -> None:
        self._lost = reason or "closed"

    def _bits(self, **bits: bool) -> None:
        self.commander.set_all({f"control.{name}": float(bit) for name, bit in bits.items()})
        self.wait_beats(STREAM_BEATS)

    def _reach(self, states: Collection[str], within: float) -> None:
        """Wait for one of ``states``; RigFault if the rig falls into a fault instead."""
        wanted = " or ".join(states)
        self._until(lambda: self.rig.state in (*states, *FAULT_STATES), within, wanted)
        if self.rig.state not in states:
            raise RigFault(f"the rig did not reach {wanted}: {self.describe()}")

    def _to_beat(self, now: int) -> int:
        return BEAT - (now - self.commander.origin) % BEAT

    def _until(
        self,
        condition: Callable[[], bool],
        within: float,
        what: str,
        error: type[BenchError] = BenchTimeout,
        *,
        steady: float = 0.0,
    ) -> None:
        start = self.clock.now()
        deadline = start + _nanoseconds("within", within)
        kept = round(steady * NS)
        since = -1
        while True:
            self.check()
            now = self.clock.now()
            if condition():
                since = now if since < 0 else since
                if now - since >= kept:
                    return
            else:
                since = -1
            if now >= deadline:
                raise error(self._why(condition, within, what))
            self.clock.sleep_until(min(deadline, now + self._to_beat(now)))

    def _why(self, condition: Callable[[], bool], within: float, what: str) -> str:
        with self.readings.watched() as seen:
            condition()
        shown = [self.readings.show(name) for name in list(seen)[:SHOWN_MAX]]
        now = f"; now {', '.join(shown)}" if shown else ""
        return f"{what}: not reached within {within:g} s{now}"


def _nanoseconds(name: str, seconds: float) -> int:
    if not 0 <= seconds <= WAIT_MAX:
        raise ValueError(f"{name} = {seconds:g} s is not a time to wait (0 to {WAIT_MAX:g} s)")
    return round(seconds * NS)
