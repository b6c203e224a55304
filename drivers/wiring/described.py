"""A wiring that a file describes: signals of the bench from and to points of transports."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from bench_protocol.clock import Clock
from bench_protocol.modbus import DEVICE_FAILURE
from bench_protocol.units import NS, ms
from bench_protocol.words import STATES
from drivers.errors import BenchError, LinkLost, MapMismatch, Misuse, NotAvailable, Refused, WiringError
from drivers.wiring.contract import (
    Capabilities,
    Conduct,
    Floats,
    Hear,
    Ints,
    OnLost,
    Order,
    Outlet,
    Remark,
    Remarking,
    Stamp,
    Stamping,
    Transport,
    refuse_absent,
)
from drivers.wiring.lines import Description, SettingTarget
from drivers.wiring.player import Player
from drivers.wiring.sources import Sources
from drivers.wiring.streaming import Streaming, by_transport
from drivers.wiring.transports import open_transport

if TYPE_CHECKING:
    from drivers.can_port import CanPort
    from drivers.modbus_port import ModbusPort

#: How often a rig is asked whether it has taken over a setting, or is there.
_LOOK: Final = round(20 * ms * NS)
#: What the player says of itself comes with every beat of the set-points; ten of them may be late.
_PLAYED_STALE: Final = round(200 * ms * NS)
_PLAYER_READINGS: Final = ("rig.program", "rig.generator_cycle")
_ACTIVE: Final = float(STATES.index("ACTIVE"))


def open_described(
    rig: str, description: Description, ports: Mapping[str, Callable[[], CanPort | ModbusPort]] | None = None
) -> DescribedWiring:
    """Return the wiring of ``rig`` with the transports of its description, not yet connected.

    ``ports``, by transport, open a CAN or Modbus port in the place of the one described: in memory, say. WiringError
    for what a transport cannot be, or does not have.
    """
    where = description.where
    transports = {}
    for name, table in description.transports.items():
        port = (ports or {}).get(name)
        try:
            transports[name] = open_transport(
                name,
                table,
                where.parent,
                functions=description.functions,
                port=port,
                streamed=by_transport(one.point for one in description.setpoints.values()).get(name, ()),
            )
        except WiringError as error:
            raise WiringError(f"{where}: {error}") from error
    return DescribedWiring(rig, description, transports)


class DescribedWiring:
    """The wiring of ``rig`` as ``description`` has it, over ``transports`` by name, which it closes.

    WiringError for a point that a transport does not have, or that cannot be written.
    """

    def __init__(self, rig: str, description: Description, transports: Mapping[str, Transport]) -> None:
        self.rig, self.table = rig, description.table
        self._description, self._transports = description, dict(transports)
        self._check_points()
        self.absent: Mapping[str, str] = description.absent
        self.capabilities: Capabilities = description.capabilities
        self.conduct: Conduct = description.conduct
        self.given: Mapping[str, float] = {}
        self.failure: BenchError | None = None
        limits = description.player
        self._player = Player(rig, self.table, limits, self.absent) if limits else None
        self._sources = Sources(description, self._stale)
        self._check_state()
        self.freshness: Ints = self._freshness()
        self._known = {name: setting.initial for name, setting in description.settings.items()}
        self._lock = threading.Lock()
        self._hear: Hear | None = None
        self._clock: Clock | None = None
        self._streaming = Streaming(rig, description, self._transports)
        self._active = self._greeted = False
        self._setpoints: Floats = np.full(len(self.table.signals), np.nan)

    @property
    def outlet(self) -> Outlet:
        """Where set-points go: `send`."""
        return self

    # -- coming and going ----------------------------------------------------------------------------------------

    def open(self, clock: Clock, hear: Hear, lost: OnLost, *, within: float) -> None:
        self._clock, self._hear, self.failure = clock, hear, None
        self._streaming.open()
        deadline = clock.now() + round(within * NS)
        told = threading.Lock()  # held for good by the first connection that is lost

        def on_lost(name: str, reason: str) -> None:
            if told.acquire(blocking=False):
                lost(f"{name}: {reason}")

        try:
            for name, transport in self._transports.items():
                left = max(deadline - clock.now(), 0) / NS
                transport.connect(clock, partial(on_lost, name), within=left)
            self._check_identity(clock, deadline)
            self._greeted = True
            if self._description.greetings.open:
                self.begin()
            self._say(self._description.greetings.open)
            self.given = self._read_given(clock, deadline)
            for name, transport in self._transports.items():
                transport.subscribe(partial(self._accept, f"{name}."))
            for name, transport in self._transports.items():
                if transport.period > 0:
                    self._await_news(name, transport, clock, deadline, within)
            self._await_settings(clock, deadline)
            self._tell_player(clock.now())
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        self._hear = None
        if self._greeted:
            self._greeted = False
            with contextlib.suppress(BenchError, ValueError):
                self._say(self._description.greetings.close)
        for transport in reversed(self._transports.values()):
            transport.close()

    def _await_news(
        self, name: str, transport: Transport, clock: Clock, deadline: int, within: float
    ) -> None:
        while math.isinf(transport.alive()):
            if clock.now() >= deadline:
                raise LinkLost(f"{self.rig} is silent: nothing came on transport {name} within {within:g} s")
            clock.sleep_until(min(deadline, clock.now() + _LOOK))

    def _await_settings(self, clock: Clock, deadline: int) -> None:
        """Let every setting be told once. What never comes stays unknown."""
        self._told(
            [setting.read for setting in self._description.settings.values() if setting.read], clock, deadline
        )

    def _told(self, points: Sequence[str], clock: Clock, deadline: int) -> dict[str, float]:
        """Return points once all have a value, NaN for one that has none by then: on a bus they come in their turn."""
        while True:
            told = self._read_points(points)
            if not any(map(math.isnan, told.values())) or clock.now() >= deadline:
                return told
            clock.sleep_until(min(deadline, clock.now() + _LOOK))

    def _read_given(self, clock: Clock, deadline: int) -> dict[str, float]:
        targets = {name: one for name, one in self._description.setpoints.items() if one.given}
        told = self._told([one.given for one in targets.values()], clock, deadline)
        given = {name: one.conversion.si(told[one.given]) for name, one in targets.items()}
        for name, value in given.items():
            if math.isnan(value):
                raise LinkLost(f"{self.rig} does not tell {name}: {targets[name].given} has no value")
        return given

    def _check_identity(self, clock: Clock, deadline: int) -> None:
        wanted = self._description.identity
        for point, found in self._told(list(wanted), clock, deadline).items():
            if found != wanted[point]:
                raise MapMismatch(
                    f"this is not the rig that the wiring of {self.rig} describes: {point} reads {found:g}, and "
                    f"identity in {self._description.where.name} says {wanted[point]:g}"
                )

    # -- what comes ----------------------------------------------------------------------------------------------

    def _accept(self, prefix: str, time: int, points: Mapping[str, float]) -> None:
        """Take points of one transport that came at ``time`` (ns)."""
        with self._lock:
            try:
                samples = self._sources.samples(prefix, time, points)
            except Exception as error:  # a user's function: the thread that receives must outlive it
                self.failure = self.failure or Misuse(
                    f"what comes from {self.rig} could not be made signals of, with the functions of "
                    f"{self._description.functions}: {error!r}"
                )
                return
            state = samples.get(self.table.index["rig.state"], math.nan)
            if not math.isnan(state):
                self._active = state == _ACTIVE
            self._tell(time, samples)

    def _tell(self, time: int, samples: Mapping[int, float]) -> None:
        hear = self._hear
        if hear is not None and samples:
            rows = np.fromiter(samples.keys(), np.int64, len(samples))
            values = np.fromiter(samples.values(), np.float64, len(samples))
            hear(np.full(len(samples), time, np.int64), rows, values, time)

    def _tell_player(self, time: int) -> None:
        if self._player is not None:
            told = self._player.told()
            self._tell(time, {self.table.index[name]: told[name] for name in _PLAYER_READINGS})

    # -- what goes -----------------------------------------------------------------------------------------------

    @property
    def commanded(self) -> bool:
        return self._streaming.commanded

    def begin(self) -> None:
        if self._clock is not None:
            self._streaming.begin(self._clock)

    def send(self, values: Floats, time: int) -> None:
        """Stream set-points (SI, by table row, NaN where nothing was given yet) and what the player adds to them."""
        offsets: Mapping[int, float] = {}
        with self._lock:
            self._setpoints = values.copy()
            if self._player is not None:
                offsets = self._player.advance(time, active=self._active)
                self._tell_player(time)
        active = self._active or "rig.state" not in self._description.readings
        self.failure = self.failure or self._streaming.send(values, offsets, time, active=active)

    def stamp(self, name: str) -> Stamp | None:
        """Return whose stamps a signal has: those of the first of its points."""
        if name not in self._sources.limits:
            return None
        transport, _, point = self._description.readings[name].points[0].partition(".")
        one = self._transports[transport]
        return one.stamp(point) if isinstance(one, Stamping) else None

    def remarks(self) -> dict[str, list[Remark]]:
        """Return what the transports have noticed of the rig, by transport."""
        noticed = {
            name: one.remarks() for name, one in self._transports.items() if isinstance(one, Remarking)
        }
        return {name: remarks for name, remarks in noticed.items() if remarks}

    def write(self, values: Mapping[str, float]) -> None:
        refuse_absent(self, *values)
        self.begin()
        played = {name: value for name, value in values.items() if name in self._description.played}
        numbers = {name: self._number(name, value) for name, value in values.items() if name not in played}
        self._refuse_under_program(values)
        written = {name: number for name, number in numbers.items() if number is not None}
        before = self._before(written)
        try:
            self._write_points({self._setting(name).point: number for name, number in written.items()})
            if written:
                self._say(self._description.greetings.apply)
            for name in written:
                self._acknowledged(name, values[name])
        except (BenchError, ValueError):
            with contextlib.suppress(BenchError, ValueError):
                self._write_points(before)
                self._say(self._description.greetings.apply)
            raise
        self._known.update({name: values[name] for name in written})
        if played and self._player is not None:
            self._player.write(played)

    def read(self, names: Sequence[str]) -> dict[str, float]:
        refuse_absent(self, *names)
        told = self._player.told() if self._player is not None else {}
        sources = {name: self._points_of(name) for name in names if name not in told}
        numbers = self._read_points(point for points in sources.values() for point in points)
        found = {}
        for name in names:
            setting = self._description.settings.get(name)
            if name in told:
                found[name] = told[name]
            elif setting is None:
                found[name] = self._description.readings[name].si([numbers[p] for p in sources[name]])
            elif setting.fixed is not None:
                found[name] = setting.fixed
            else:
                found[name] = (
                    setting.conversion.si(numbers[setting.read]) if setting.read else self._known[name]
                )
        return found

    def act(self, name: str) -> None:
        refuse_absent(self, name)
        self.begin()
        if self._player is not None and name in self._description.played:
            self._play(name)
            return
        point, numbers = self._description.actions[name]
        for number in numbers:
            self._write_points({point: number})

    def _say(self, orders: Iterable[Order]) -> None:
        """Say what is said by the wiring itself: actions of the table and points."""
        for order in orders:
            for name in order.values:
                if name in self._description.actions:
                    self.act(name)
            actions = self._description.actions
            self._write_points({name: value for name, value in order.values.items() if name not in actions})

    def say(self, points: Mapping[str, float]) -> None:
        self.begin()
        self._write_points(points)

    # -- the player ----------------------------------------------------------------------------------------------

    def _play(self, name: str) -> None:
        assert self._player is not None
        if name == "action.program_hold":
            self._player.hold()
        elif name == "action.program_stop":
            self._player.stop()
        else:
            controls = [one for one in ("vertical.control", "lateral.control") if one not in self.absent]
            with self._lock:
                setpoints, active = self._setpoints, self._active
            self._player.run(self.read(controls), setpoints, active=active)

    def _refuse_under_program(self, values: Mapping[str, float]) -> None:
        if self._player is not None and self._player.busy:
            controls = [name for name in values if name.endswith(".control")]
            for name, mode in self.read(controls).items():
                if mode != values[name]:
                    raise Refused(f"{name} must not change while a program runs", DEVICE_FAILURE)

    # -- settings ------------------------------------------------------------------------------------------------

    def _setting(self, name: str) -> SettingTarget:
        return self._description.settings[name]

    def _number(self, name: str, value: float) -> float | None:
        """Return what a setting (SI) is on the wire, None for one that is fixed and stays so."""
        setting, signal = self._setting(name), self.table[name]
        if setting.fixed is not None:
            if abs(value - setting.fixed) > 0.5 * signal.step:
                raise NotAvailable(
                    f"{self.rig} has no {name} = {signal.show(value)}: it is always {signal.show(setting.fixed)}"
                )
            return None
        number = setting.conversion.number(value)
        if math.isnan(number):
            raise NotAvailable(
                f"{self.rig} has no {name} = {signal.show(value)}: its wiring gives this choice no number"
            )
        return number

    def _before(self, names: Iterable[str]) -> dict[str, float]:
        """Return the points of settings with what is on them now, as far as that is known."""
        numbers = {}
        for name, value in self.read(list(names)).items():
            setting = self._setting(name)
            numbers[setting.point] = setting.conversion.number(value)
        return {point: number for point, number in numbers.items() if not math.isnan(number)}

    def _acknowledged(self, name: str, value: float) -> None:
        """Wait until the rig tells that it has taken over a setting; Refused if it does not."""
        setting, signal, clock = self._setting(name), self.table[name], self._clock
        if not setting.read or clock is None:
            return
        deadline = clock.now() + round(setting.within * NS)
        while True:
            number = self._read_points([setting.read])[setting.read]
            found = setting.conversion.si(number)
            if abs(found - value) <= setting.tolerance:
                return
            if clock.now() >= deadline:
                says = (
                    f"{number:g}, which is none of its choices" if math.isnan(found) else signal.show(found)
                )
                raise Refused(
                    f"{self.rig} never acknowledged {name} = {signal.show(value)}: {setting.read} still says "
                    f"{says} after {setting.within:g} s",
                    DEVICE_FAILURE,
                )
            clock.sleep_until(min(deadline, clock.now() + _LOOK))

    # -- points --------------------------------------------------------------------------------------------------

    def _points_of(self, name: str) -> tuple[str, ...]:
        setting = self._description.settings.get(name)
        if setting is not None:
            return (setting.read,) if setting.read else ()
        return self._description.readings[name].points

    def _read_points(self, points: Iterable[str]) -> dict[str, float]:
        """Return points by their full names, with one question to each transport."""
        found = {}
        for transport, names in by_transport(points).items():
            numbers = self._transports[transport].read(names)
            found.update({f"{transport}.{name}": numbers[name] for name in names})
        return found

    def _write_points(self, points: Mapping[str, float]) -> None:
        """Write points by their full names, those of one transport at once, in the order given."""
        for transport, names in by_transport(points).items():
            self._transports[transport].write({name: points[f"{transport}.{name}"] for name in names})

    def _check_points(self) -> None:
        for key, point, written in self._description.points:
            transport, _, name = point.partition(".")
            try:
                self._transports[transport].require(name, writable=written)
            except WiringError as error:
                raise WiringError(f"{key} = {point!r}: {error}") from None

    def _check_state(self) -> None:
        """WiringError if the rig's state has to be asked for: the bench looks at it on every beat."""
        state = self._description.readings.get("rig.state")
        if state is not None and "rig.state" not in self._sources.limits:
            raise WiringError(
                f'{self._description.where}: signals."rig.state".from = {", ".join(state.points)} is read only when '
                "asked; right is a point that comes by itself, as those of a polled group do"
            )

    def _stale(self, point: str) -> float:
        transport, _, name = point.partition(".")
        return self._transports[transport].stale(name)

    def _freshness(self) -> Ints:
        limits = np.zeros(len(self.table.signals), np.int64)
        for name, limit in self._sources.limits.items():
            limits[self.table.index[name]] = limit
        if self._player is not None:
            for name in _PLAYER_READINGS:
                limits[self.table.index[name]] = _PLAYED_STALE
        return limits
