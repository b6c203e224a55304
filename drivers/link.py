"""The link to a rig: its readings, set-points and settings, and the bounded waits in which time passes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Final

import numpy as np

from bench_protocol.clock import Clock
from bench_protocol.units import NS, minutes, ms, s
from bench_protocol.words import LIVE_STATES, REASONS_OF_THE_LINK, STATES
from drivers.commander import CYCLE, Commander
from drivers.errors import (
    BenchError,
    BenchTimeout,
    Fault,
    LinkLost,
    NotCommander,
    NotRecorded,
    RigFault,
    Stale,
)
from drivers.reading import Quality, Readings, Sample
from drivers.receiver import Capture, Receiver
from drivers.settings import UNKNOWN, Settings
from drivers.wiring.contract import Wiring

#: Where a bench that was armed must not be found.
DOWN_STATES: Final = tuple(state for state in STATES if state not in LIVE_STATES)
#: A silent bus counts as lost only after so many looks in a row: one look may come before the receiver had its turn.
SILENT_CYCLES: Final = 25
#: No single wait of a plan is longer than this; a longer one is a wrong unit.
WAIT_MAX: Final = 24 * 3600 * s
SHOWN_MAX: Final = 12
#: So many commands may come twice or spoilt on any bus.
REJECTED_SOME: Final = 20
#: How long set-points are averaged and streamed before a control mode changes: several cycles, no visible pause.
AVERAGE_OVER: Final = 200 * ms
STREAM_CYCLES: Final = 3
#: A rig of which other signals come tells each of its status signals within this time.
TOLD_WITHIN: Final = 5 * s


class Link:
    """The wiring of one rig, with everything that is read, set and streamed through it.

    Devices are given the link; `Bench` is a link with its devices.
    """

    __slots__ = (
        "_armed",
        "_connected",
        "_lost",
        "_rejected",
        "_silent",
        "_strangers",
        "_tolerant",
        "clock",
        "commander",
        "readings",
        "receiver",
        "settings",
        "table",
        "wiring",
    )

    def __init__(self, wiring: Wiring, clock: Clock) -> None:
        self.wiring, self.table, self.clock = wiring, wiring.table, clock
        self._lost = ""
        self._silent = 0
        self._strangers = self._rejected = 0.0  # that were counted before this commander came
        self._armed = self._tolerant = self._connected = False
        self.receiver = Receiver(wiring, clock)
        self.commander = Commander(wiring, clock)
        self.settings = Settings(wiring)
        self.readings = Readings(self.receiver, self.settings.reading)

    @property
    def state(self) -> str:
        """The rig's state by name, ``"unknown"`` unless it was told lately."""
        return self.readings.choice("rig.state")

    @property
    def lost(self) -> bool:
        """Whether a connection is known to be lost: what came by itself tells nothing of now."""
        return bool(self._lost)

    def has(self, *names: str) -> bool:
        """Return whether this rig has all the signals ``names``; KeyError for one that the table does not know."""
        return not self.lacks(*names)

    def lacks(self, *names: str) -> str:
        """Return in words which of the signals ``names`` this rig does not have, and why; "" if it has them all."""
        absent = self.wiring.absent
        missing: dict[str, list[str]] = {}  # the same reason is said once
        for name in dict.fromkeys(names):
            if self.table[name].name in absent:
                missing.setdefault(absent[name], []).append(name)
        return "; ".join(f"{self.wiring.rig} has no {', '.join(n)}: {why}" for why, n in missing.items())

    def describe(self) -> str:
        """Return the rig's state with its reason and the limit that tripped first, in words."""
        text = f"state {self.state}"
        if self.has("rig.reason"):
            text += f", reason: {self.readings.choice('rig.reason')}"
        if self.state == "OFF":
            text += ", the power of valves and actuators was lost or switched off"
        tripped = self.table.tripped(self.readings.told("rig.tripped"))
        if tripped is not None:
            text += f", first limit: {self.readings.show(tripped.name)}"
            if self.readings.sample(tripped.name).quality is Quality.UNAVAILABLE:
                text += " (its transducer gives no value; repair it)"
        return "; ".join(filter(None, (text, self.strangers(), self.rejected())))

    def rejected(self) -> str:
        """Return in words how many of this commander's frames the bench has lately thrown away, "" if none."""
        leased = self.wiring.capabilities.lease
        count = self.readings.told("rig.rejected_commands") - self._rejected if leased else 0.0
        if not count > REJECTED_SOME:
            return ""
        return (
            f"the bench has rejected {count:.0f} frames of its commander, whose CRC or counter is wrong: check "
            "what lies between on the CAN bus"
        )

    def strangers(self) -> str:
        """Return in words whose commands the bench has refused since this commander came, "" if nobody's.

        They are somebody else's, unless they come from where this commander sends: then he has lost the bench.
        """
        count = self.readings.told("rig.strangers") - self._strangers
        if not count > 0:
            return ""
        port = self.readings.told("rig.stranger")
        token = self.readings.told("rig.lease")
        if self.wiring.is_own(int(port) if port > 0 else 0, token):
            return (
                "the bench no longer accepts this commander's commands, because it regards it as lost: connect "
                f"again ({count:.0f} frames or requests refused)"
            )
        identifier = self.readings.told("rig.stranger_identifier")
        what = f"CAN frame {int(identifier):#05x}" if identifier > 0 else "a Modbus request"
        where = f"from TCP port {port:.0f} (`ss -tnp` shows its program)" if port > 0 else "from the bus"
        return (
            f"somebody else tries to command the bench and should be stopped: {count:.0f} frames or requests refused, "
            f"the last {what} {where}"
        )

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
            self.clock.sleep_until(min(deadline, now + self._to_cycle(now)))
            self.check()

    def wait_cycles(self, cycles: int, *told: str) -> None:
        """Let so many cycles pass that each of the last ``cycles`` carries the present set-points, and shows.

        Of signals ``told`` it goes on until they were told in one of the last two cycles or later: frames are lost.
        """
        latency = self.wiring.capabilities.latency
        since = self.now + (cycles - 1) * CYCLE / NS + latency
        self.wait((cycles + 1) * CYCLE / NS + latency)
        for name in told:
            self._until(partial(self._told_since, name, since), TOLD_WITHIN, f"a new sample of {name}")

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
        """Wait until the means over ``over`` s change by no more than ``band`` (SI) three times in a row; return them.

        Once is not enough: what turns stands still for a moment, as gas does that was hot from filling and now cools.
        BenchTimeout after ``within`` s, with what still moved.
        """
        deadline = self.clock.now() + _nanoseconds("within", within)
        means, stood = self.averages(*names, over=over), 0
        while True:
            before, means = means, self.averages(*names, over=over)
            stands = all(abs(means[name] - before[name]) <= band for name in names)
            stood = stood + 1 if stands else 0
            if stood == 3:
                return means
            if self.clock.now() >= deadline:
                moved = ", ".join(
                    f"{name} moved from {self.table[name].reads(before[name])} to {self.table[name].reads(means[name])}"
                    for name in names
                )
                raise BenchTimeout(f"not settled within {within:g} s: in the last {over:g} s {moved}")

    def check(self) -> None:
        """Raise what has happened meanwhile: LinkLost, NotCommander, or RigFault of an armed bench."""
        if self._lost:
            raise LinkLost(self._lost)
        if self.commander.failure is not None:
            raise LinkLost(f"commands cannot be sent: {self.commander.failure}")
        failed = self.receiver.failure
        if failed is not None and self.receiver.needed:
            self.receiver.needed = False  # said once: the bench can be brought to rest without a record
            raise NotRecorded(str(failed) or type(failed).__name__) from failed
        # In tear-down, the set-points alone can still bring the bench to rest.
        if failure := self.wiring.failure:
            if isinstance(failure, NotCommander):
                raise NotCommander(f"this commander has lost the bench: {failure}") from failure
            if not self._tolerant:
                raise failure
        if not self._armed or self._tolerant:
            return
        state = self.state
        self._silent = self._silent + 1 if state == UNKNOWN else 0
        if self._silent > SILENT_CYCLES:
            told = self.readings.sample("rig.state")
            limit = int(self.wiring.freshness[self.table.index["rig.state"]]) / NS
            if told.quality is Quality.UNAVAILABLE:
                raise LinkLost("the rig reports no known state")
            raise LinkLost(
                f"the rig is silent: its state came {told.age:.2g} s ago, and is stale after {limit:g} s"
            )
        if state in DOWN_STATES:
            reason = self.readings.choice("rig.reason") if self.has("rig.reason") else UNKNOWN
            fault: Fault = "link" if reason in REASONS_OF_THE_LINK else "rig"
            raise RigFault(f"the rig left ACTIVE: {self.describe()}", fault)

    @contextmanager
    def despite_faults(self) -> Iterator[None]:
        """Let waits go on though the rig is in a fault: for tear-down and diagnosis."""
        before, self._tolerant = self._tolerant, True
        try:
            yield
        finally:
            self._tolerant = before

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
            self.receiver.rates[name] = good.size / over
        return means

    def take_over(self, names: Sequence[str]) -> None:
        """Let the set-points of ``names`` (``lateral.force``) be what is measured, and stream them a few cycles.

        What the rig cannot be told, or does not measure, is left out.
        """
        names = [name for name in names if self.has(name, f"{name}_setpoint")]
        means = self.averages(*names, over=AVERAGE_OVER + self.wiring.capabilities.latency)
        setpoints = {f"{name}_setpoint": mean for name, mean in means.items()}
        # A transducer's noise may lie beyond what a set-point can be, at the very end of its range.
        within = {
            name: min(max(value, self.table[name].low), self.table[name].high)
            for name, value in setpoints.items()
        }
        self.commander.set_all(within)
        self.wait_cycles(STREAM_CYCLES)

    # -- inside --------------------------------------------------------------------------------------------------

    def _on_lost(self, reason: str) -> None:
        self._lost = reason or f"the connection to {self.wiring.rig} is closed"

    def _told_since(self, name: str, since: float) -> bool:
        return self.now - self.readings.sample(name).age > since

    def _to_cycle(self, now: int) -> int:
        return CYCLE - (now - self.commander.origin) % CYCLE

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
            self.clock.sleep_until(min(deadline, now + self._to_cycle(now)))

    def _why(self, condition: Callable[[], bool], within: float, what: str) -> str:
        with self.readings.watched() as seen:
            condition()
        shown = [self.readings.show(name) for name in list(seen)[:SHOWN_MAX]]
        now = f"now {', '.join(shown)}" if shown else ""
        rejected = self.rejected()
        known = [now, "" if rejected in what else rejected]
        return "; ".join(filter(None, (f"{what}: not reached within {within:g} s", *known)))


def _nanoseconds(name: str, seconds: float) -> int:
    if not 0 <= seconds <= WAIT_MAX:
        raise ValueError(f"{name} = {seconds:g} s is not a time to wait (0 to {WAIT_MAX:g} s)")
    return round(seconds * NS)
