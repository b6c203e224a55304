"""The link to a rig: its readings, set-points and settings, and waits with a time limit."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Final, Literal

import numpy as np

from bench_protocol.clock import Clock
from bench_protocol.units import NS, minutes, ms, s
from bench_protocol.words import LIVE_STATES, REASONS_OF_THE_LINK, STATES
from drivers.commander import CYCLE, Commander
from drivers.errors import (
    TRY_AGAIN,
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

#: States that are an error while the bench is armed.
DOWN_STATES: Final = tuple(state for state in STATES if state not in LIVE_STATES)
#: Number of cycles without a fresh state after which the bus counts as lost. A few may pass if the receiver runs late.
SILENT_CYCLES: Final = 25
#: Longest single wait of a plan. A longer one indicates a wrong unit.
WAIT_MAX: Final = 24 * 3600 * s
SHOWN_MAX: Final = 12
#: Number of repeated or corrupt commands that is normal on any bus.
REJECTED_SOME: Final = 20
#: Averaging time of set-points before a control mode changes: several cycles, but no noticeable pause.
AVERAGE_OVER: Final = 200 * ms
STREAM_CYCLES: Final = 3
#: Longest time between two samples of a status signal on any rig.
SAMPLE_WITHIN: Final = 5 * s


class Link:
    """The connection to one rig: its wiring, readings, settings and commander.

    Every device has a reference to the link. `Bench` is a link with devices.
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
        self._strangers = self._rejected = 0.0  # counts before this commander connected
        self._armed = self._tolerant = self._connected = False
        self.receiver = Receiver(wiring, clock)
        self.commander = Commander(wiring, clock)
        self.settings = Settings(wiring)
        self.readings = Readings(self.receiver, self.settings.reading)

    @property
    def state(self) -> str:
        """The rig's state by name, ``"unknown"`` without a fresh sample."""
        return self.readings.choice("rig.state")

    @property
    def lost(self) -> bool:
        """Whether a connection is known to be lost. Received samples are then out of date."""
        return bool(self._lost)

    def has(self, *names: str) -> bool:
        """Return whether this rig has all the signals ``names``. Raises KeyError for a name outside the table."""
        return not self.lacks(*names)

    def lacks(self, *names: str) -> str:
        """Return as text which of the signals ``names`` this rig lacks, and why; "" if it has all."""
        absent = self.wiring.absent
        found: dict[str, list[str]] = {}  # each reason is printed once
        for name in dict.fromkeys(names):
            if self.table[name].name in absent:
                found.setdefault(absent[name], []).append(name)
        return "; ".join(f"{self.wiring.rig} has no {', '.join(n)}: {reason}" for reason, n in found.items())

    def describe(self) -> str:
        """Return the rig's state as text, with its reason and the limit that tripped first."""
        text = f"state {self.state}"
        if self.has("rig.reason"):
            text += f", reason: {self.readings.choice('rig.reason')}"
        if self.state == "OFF":
            text += "; valves and actuators have no power"
        tripped = self.table.tripped(self.readings.value_or_nan("rig.tripped"))
        if tripped is not None:
            text += f", first limit tripped by {self.readings.show(tripped.name).replace(' = ', ', now ')}"
            if self.readings.sample(tripped.name).quality is Quality.UNAVAILABLE:
                text += " (its transducer gives no value; repair it)"
        return "; ".join(filter(None, (text, self.strangers(), self.rejected())))

    def rejected(self) -> str:
        """Return as text how many of this commander's frames the bench rejected since connecting, "" if few or none."""
        leased = self.wiring.capabilities.lease
        count = self.readings.value_or_nan("rig.rejected_commands") - self._rejected if leased else 0.0
        if not count > REJECTED_SOME:
            return ""
        return (
            f"the bench has rejected {count:.0f} frames of its commander, because their CRC or counter "
            "is wrong; check the devices between this computer and the bench on the CAN bus"
        )

    def strangers(self) -> str:
        """Return as text how many commands the bench refused as foreign since this commander connected, "" if none.

        They come from another client, or from this commander if it has lost its lease.
        """
        count = self.readings.value_or_nan("rig.strangers") - self._strangers
        if not count > 0:
            return ""
        port = self.readings.value_or_nan("rig.stranger")
        token = self.readings.value_or_nan("rig.lease")
        if self.wiring.is_own(int(port) if port > 0 else 0, token):
            return (
                "this commander has lost its lease, and the bench refuses its commands; "
                f"connect again ({count:.0f} frames or requests refused)"
            )
        identifier = self.readings.value_or_nan("rig.stranger_identifier")
        what = f"CAN frame {int(identifier):#05x}" if identifier > 0 else "a Modbus request"
        where = f"from TCP port {port:.0f} (`ss -tnp` shows its program)" if port > 0 else "from the bus"
        return (
            f"another client tries to command the bench; stop it: {count:.0f} frames or requests refused, "
            f"the last {what} {where}"
        )

    # -- time ----------------------------------------------------------------------------------------------------

    @property
    def now(self) -> float:
        """The time of the bench's clock (s)."""
        return self.clock.now() / NS

    def wait(self, duration: float) -> None:
        """Wait ``duration`` s. Raises RigFault or LinkLost at once if the rig or the link fails."""
        deadline = self.clock.now() + _nanoseconds("duration", duration)
        self.check()
        while (now := self.clock.now()) < deadline:
            self.clock.rest_until(min(deadline, now + self._to_cycle(now)), deadline)
            self.check()

    def wait_cycles(self, cycles: int, *signals: str) -> None:
        """Wait until the present set-points were sent in ``cycles`` cycles and the readings show their effect.

        Then wait for each signal in ``signals`` until its latest sample is from the last two cycles of this wait, or
        newer. This takes longer if frames are lost.
        """
        latency = self.wiring.capabilities.latency
        since = self.now + (cycles - 1) * CYCLE / NS + latency
        self.wait((cycles + 1) * CYCLE / NS + latency)
        for name in signals:
            self._until(partial(self._sampled_after, name, since), SAMPLE_WITHIN, f"a new sample of {name}")

    def wait_for(
        self,
        condition: Callable[[], bool],
        within: float,
        what: str = "the condition",
        *,
        steady: float = 0.0,
        not_before: float = 0.0,
    ) -> None:
        """Wait until ``condition()`` has been true for ``steady`` s. It is evaluated every 20 ms.

        In virtual time, the first ``not_before`` s may pass without an evaluation as long as no event occurs. Raises
        BenchTimeout after ``within`` s, with ``what`` as the name of the condition, and the readings. RigFault and
        LinkLost are raised at once.
        """
        self._until(condition, within, what, steady=steady, not_before=not_before)

    def wait_for_status(
        self, name: Literal["rig.state", "rig.program"], choices: Collection[str], within: float, what: str
    ) -> None:
        """Wait until a status of the rig is one of ``choices``, at most ``within`` s. Errors, and the name ``what`` in
        them, are those of `wait_for`.
        """
        self._until(lambda: self.readings.choice(name) in choices, within, what, not_before=within)

    def settle(
        self, *names: str, band: float, over: float = 1 * s, within: float = 2 * minutes
    ) -> dict[str, float]:
        """Wait until the means over ``over`` s change by no more than ``band`` (SI) three times in a row; return the
        last means by name.

        Three times, because a signal is also steady for a moment when it reverses: gas heats during filling, then
        cools. Raises BenchTimeout after ``within`` s, with the signals that still changed.
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
                raise BenchTimeout(
                    f"not settled within {within:g} s: in the last {over:g} s {moved}; allow more time"
                )

    def check(self) -> None:
        """Raise an error that occurred in the background: LinkLost, NotCommander, NotRecorded, RigFault if armed."""
        if self._lost:
            raise LinkLost(self._lost)
        if self.commander.failure is not None:
            raise LinkLost(
                f"commands cannot be sent: {self.commander.failure}; check the adapter and the bus"
            )
        failed = self.receiver.failure
        if failed is not None and self.receiver.needed:
            self.receiver.needed = False  # raised once: the bench can be brought to rest without a record
            raise NotRecorded(str(failed) or type(failed).__name__) from failed
        # During tear-down, set-points alone can still bring the bench to rest.
        if failure := self.wiring.failure:
            if isinstance(failure, NotCommander):
                raise NotCommander(
                    f"this commander no longer has the lease of the bench: {failure}"
                ) from failure
            if not self._tolerant:
                raise failure
        if not self._armed or self._tolerant:
            return
        state = self.state
        self._silent = self._silent + 1 if state == UNKNOWN else 0
        if self._silent > SILENT_CYCLES:
            signals = self.readings.sample("rig.state")
            limit = int(self.wiring.freshness[self.table.index["rig.state"]]) / NS
            if signals.quality is Quality.UNAVAILABLE:
                raise LinkLost("the rig reports no state (rig.state is unavailable); check its controller")
            raise LinkLost(
                f"the rig is silent: its last state is {signals.age:.2g} s old, and is stale after {limit:g} s; "
                "check the rig and its connection"
            )
        if state in DOWN_STATES:
            reason = self.readings.choice("rig.reason") if self.has("rig.reason") else UNKNOWN
            fault: Fault = "link" if reason in REASONS_OF_THE_LINK else "rig"
            raise RigFault(f"the rig left ACTIVE: {self.describe()}; {TRY_AGAIN}", fault)

    @contextmanager
    def despite_faults(self) -> Iterator[None]:
        """Raise no error for faults of the rig inside the block, so that waits work during tear-down and diagnosis."""
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
        """Return a context manager that keeps all samples of these signals inside its block."""
        return Capture(self.receiver, names)

    def average(self, name: str, over: float = 1 * s) -> float:
        """Return the mean (SI) of the samples of ``name`` over the next ``over`` s. Raises Stale without a sample."""
        return self.averages(name, over=over)[name]

    def averages(self, *names: str, over: float = 1 * s) -> dict[str, float]:
        """Return the means (SI) of several signals over the same ``over`` s. Raises Stale if one has no sample."""
        with self.capture(*names) as capture:
            self.wait(over)
        means = {}
        for name in names:
            values = capture.values(name)
            good = values[~np.isnan(values)]
            if good.size == 0:
                raise Stale(
                    f"no sample of {name} came within {over:g} s: {self.readings.show(name)}; check its sensor"
                )
            means[name] = float(good.mean())
            self.receiver.rates[name] = good.size / over
        return means

    def take_over(self, names: Sequence[str]) -> None:
        """Set the set-points of ``names`` (such as ``lateral.force``) to the measured values and send them for a few
        cycles.

        Names without a set-point or a measurement on this rig are skipped.
        """
        names = [name for name in names if self.has(name, f"{name}_setpoint")]
        means = self.averages(*names, over=AVERAGE_OVER + self.wiring.capabilities.latency)
        setpoints = {f"{name}_setpoint": mean for name, mean in means.items()}
        # At the end of its range, the noise of a transducer may exceed the limits of the set-point.
        within = {
            name: min(max(value, self.table[name].low), self.table[name].high)
            for name, value in setpoints.items()
        }
        self.commander.set_all(within)
        self.wait_cycles(STREAM_CYCLES)

    # -- inside --------------------------------------------------------------------------------------------------

    def _on_lost(self, reason: str) -> None:
        self._lost = reason or f"the connection to {self.wiring.rig} is closed"

    def _sampled_after(self, name: str, since: float) -> bool:
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
        not_before: float = 0.0,
    ) -> None:
        start = self.clock.now()
        deadline = start + _nanoseconds("within", within)
        not_before_ns = start + round(min(not_before, within) * NS)
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
                raise error(self._reason(condition, within, what))
            cycle = min(deadline, now + self._to_cycle(now))
            self.clock.rest_until(cycle, max(cycle, not_before_ns))

    def _reason(self, condition: Callable[[], bool], within: float, what: str) -> str:
        with self.readings.watched() as names:
            condition()
        shown = [self.readings.show(name) for name in list(names)[:SHOWN_MAX]]
        now = f"now {', '.join(shown)}" if shown else ""
        rejected = self.rejected()
        known = [now, "check the rig, or allow more time" if rejected in what else rejected]
        return "; ".join(filter(None, (f"{what}: not reached within {within:g} s", *known)))


def _nanoseconds(name: str, seconds: float) -> int:
    if not 0 <= seconds <= WAIT_MAX:
        raise ValueError(f"{name} = {seconds:g} s is outside 0 to {WAIT_MAX:g} s")
    return round(seconds * NS)
