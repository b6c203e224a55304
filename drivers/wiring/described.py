"""A wiring that a file describes: signals of the bench from and to points of transports."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench_protocol.arrays import Floats, Ints
from bench_protocol.clock import Clock
from bench_protocol.modbus import DEVICE_FAILURE
from bench_protocol.signals import Kind
from bench_protocol.units import NS, ms
from bench_protocol.words import STATES
from drivers.errors import BenchError, LinkLost, MapMismatch, Misuse, NotAvailable, Refused, WiringError
from drivers.wiring.astb.transport import AstbTransport
from drivers.wiring.contract import (
    NO_WATCHDOG,
    Capabilities,
    OnLost,
    OnSamples,
    Order,
    Outlet,
    Remark,
    Sequences,
    Stamp,
    Transport,
    refuse_absent,
)
from drivers.wiring.lines import Description, Source, listening
from drivers.wiring.player import Player
from drivers.wiring.points import Points
from drivers.wiring.settings import PointSettings
from drivers.wiring.streaming import Streaming, by_transport
from drivers.wiring.transports import open_all

if TYPE_CHECKING:
    from drivers.can_port import CanPort
    from drivers.modbus_port import ModbusPort

    Ports = Mapping[str, Callable[[], CanPort | ModbusPort | tuple[CanPort, ModbusPort]]]

#: The state of the player is updated with every cycle of the set-points; ten cycles may be late.
_PLAYED_STALE: Final = round(200 * ms * NS)
_PLAYER_READINGS: Final = ("rig.program", "rig.generator_cycle")
_ACTIVE: Final = float(STATES.index("ACTIVE"))


def open_described(rig: str, description: Description, ports: Ports | None = None) -> DescribedWiring:
    """Return the wiring of ``rig`` with the transports of its description, not yet connected.

    ``ports``, by transport, open a CAN or Modbus port that replaces the described one, for example in memory. Raises
    WiringError for an invalid transport or a missing point.
    """
    transports = open_all(
        description.where,
        description.transports,
        description.points,
        functions=description.functions,
        ports=ports,
        streamed=by_transport(one.point for one in description.setpoints.values()),
    )
    carrier: AstbTransport | None = None
    if name := description.carrier:
        opener: Any = (ports or {}).get(name)
        carrier = AstbTransport(name, description.transports[name], description.table, opener)
    return DescribedWiring(rig, description, transports, carrier, ports)


class DescribedWiring(Outlet):
    """The wiring of ``rig`` that ``description`` states. It uses ``transports`` (by name), and closes them.

    ``carrier`` is the transport for signals without a line in the description, if there is one. ``ports`` replace the
    described ports of its transports. Raises WiringError for a point that a transport lacks or that cannot be written.
    """

    def __init__(
        self,
        rig: str,
        description: Description,
        transports: Mapping[str, Transport],
        carrier: AstbTransport | None = None,
        ports: Ports | None = None,
    ) -> None:
        self.rig, self.table = rig, description.table
        self.carrier = carrier
        self._carried, self._ports = description.carried, ports
        self._description, self._transports = description, dict(transports)
        self._points = Points(self._transports)
        for key, point, written in description.points:
            self._points.require(key, point, writable=written)
        self.absent: Mapping[str, str] = description.absent
        can = description.capabilities
        own = Capabilities() if carrier is None else carrier.capabilities
        self.capabilities: Capabilities = replace(
            own, generator=can.generator, pace={**own.pace, **can.pace}, latency=can.latency, notes=can.notes
        )
        self.sequences: Sequences = description.sequences
        self.played: Collection[str] = description.played
        self.remembered: Collection[str] = description.remembered
        self.given: Mapping[str, float] = {}
        self._failure: BenchError | None = None
        limits = description.player
        self._player = Player(rig, self.table, limits, self.absent) if limits else None
        self._sources = Sources(description, self._points.stale)
        self._settings = PointSettings(
            rig, description, self._points, lambda: self._send_orders(description.greetings.apply)
        )
        self._check_state()
        self.freshness: Ints = self._freshness()
        self._lock = threading.Lock()
        self._receive: OnSamples | None = None
        self._clock: Clock | None = None
        self._streaming = Streaming(rig, description, self._transports)
        self._active = self._greeted = False
        self._setpoints: Floats = np.full(len(self.table.signals), np.nan)

    @cached_property
    def outlet(self) -> Outlet:
        """The receiver of set-points: that of the carrier if the carrier takes all set-points, else this wiring."""
        alone = not self._description.setpoints and self._player is None
        return self.carrier.outlet if alone and self.carrier else self

    @property
    def failure(self) -> BenchError | None:
        """The error that makes commands ineffective; None without one."""
        return self._failure or (self.carrier.failure if self.carrier else None)

    @property
    def _carrier(self) -> AstbTransport:
        assert self.carrier is not None, "no signal is carried without it"
        return self.carrier

    # -- connection ----------------------------------------------------------------------------------------------

    def open(self, clock: Clock, receive: OnSamples, lost: OnLost, *, within: float) -> None:
        self._clock, self._receive, self._failure = clock, receive, None
        self._streaming.open()
        deadline = clock.now() + round(within * NS)
        reported_once = threading.Lock()  # locked by the first connection that is lost, and never released

        def on_lost(name: str, reason: str) -> None:
            if reported_once.acquire(blocking=False):
                lost(f"{name}: {reason}" if name else reason)

        try:
            if self.carrier is not None:
                self.carrier.connect(clock, partial(on_lost, ""))
                self._agree(self.carrier)
            for name, transport in self._transports.items():
                left = max(deadline - clock.now(), 0) / NS
                transport.connect(clock, partial(on_lost, name), within=left)
            self._check_identity(clock, deadline)
            self._greeted = True
            if self._description.greetings.open:
                self.begin()
            self._send_orders(self._description.greetings.open)
            self.given = {**self.given, **self._read_given(clock, deadline)}
            if self.carrier is not None:
                self.carrier.subscribe(self._watching(receive), self.table.index.keys() - self._carried)
            for name, transport in self._transports.items():
                transport.subscribe(partial(self._receive_points, f"{name}."))
            self._points.await_news(self.rig, clock, deadline, within)
            self._settings.await_reported(clock, deadline)
            self._publish_player(clock.now())
        except BaseException:
            self.close()
            raise

    def _agree(self, carrier: AstbTransport) -> None:
        """Mark signals that the rig's own table lacks as missing, with the reason."""
        self.given = carrier.given
        lacking = {name: reason for name, reason in carrier.absent.items() if name in self._carried}
        if lacking:
            self._carried -= lacking.keys()
            self.absent = {**self.absent, **lacking}
            self.freshness[[self.table.index[name] for name in lacking]] = 0
        if carrier.differs:
            notes = {**self.capabilities.notes, "identity": carrier.differs}
            self.capabilities = replace(self.capabilities, notes=notes)

    def _watching(self, receive: OnSamples) -> OnSamples:
        """Return ``receive``, or a function that also stores whether the rig is ACTIVE, if this is needed."""
        if self._player is None and not self._description.setpoints:
            return receive
        state = self.table.index["rig.state"]

        def received(times: Ints, rows: Ints, values: Floats, fresh: Ints | int) -> None:
            states = values[rows == state]
            if states.size:
                self._active = bool(states[-1] == _ACTIVE)
            receive(times, rows, values, fresh)

        return received

    def listening(self) -> DescribedWiring:
        """Return a wiring that only listens, over its own transports."""
        return open_described(self.rig, listening(self._description), self._ports)

    def close(self) -> None:
        self._receive = None
        if self._greeted:
            self._greeted = False
            with contextlib.suppress(BenchError, ValueError):
                self._send_orders(self._description.greetings.close)
        for transport in reversed(self._transports.values()):
            transport.close()
        if self.carrier is not None:
            self.carrier.close()

    def _read_given(self, clock: Clock, deadline: int) -> dict[str, float]:
        targets = {name: one for name, one in self._description.setpoints.items() if one.given}
        numbers = self._points.await_values([one.given for one in targets.values()], clock, deadline)
        given = {name: one.conversion.si(numbers[one.given]) for name, one in targets.items()}
        for name, value in given.items():
            if math.isnan(value):
                raise LinkLost(
                    f"{self.rig} does not report {name}: {targets[name].given} has no value; correct its key from"
                )
        return given

    def _check_identity(self, clock: Clock, deadline: int) -> None:
        identity = self._description.identity
        for point, found in self._points.await_values(list(identity), clock, deadline).items():
            if found != identity[point]:
                raise MapMismatch(
                    f"this is not the rig that the wiring of {self.rig} describes: {point} reads "
                    f"{found:g}, but identity in {self._description.where.name} states "
                    f"{identity[point]:g}; connect to the right rig, or correct identity"
                )

    # -- receiving -----------------------------------------------------------------------------------------------

    def _receive_points(self, prefix: str, time: int, points: Mapping[str, float]) -> None:
        """Convert points received from one transport at ``time`` (ns) to samples, and publish them."""
        with self._lock:
            try:
                samples = self._sources.samples(prefix, time, points)
            except Exception as error:  # the receiving thread must survive errors of a user's function
                self._failure = self._failure or Misuse(
                    f"the functions of {self._description.functions} could not convert the readings of "
                    f"{self.rig} to signals: {error!r}; correct the functions"
                )
                return
            state = samples.get(self.table.index["rig.state"], math.nan)
            if not math.isnan(state):
                self._active = state == _ACTIVE
            self._publish(time, samples)

    def _publish(self, time: int, samples: Mapping[int, float]) -> None:
        receive = self._receive
        if receive is not None and samples:
            rows = np.fromiter(samples.keys(), np.int64, len(samples))
            values = np.fromiter(samples.values(), np.float64, len(samples))
            receive(np.full(len(samples), time, np.int64), rows, values, time)

    def _publish_player(self, time: int) -> None:
        if self._player is not None:
            values = self._player.state()
            self._publish(time, {self.table.index[name]: values[name] for name in _PLAYER_READINGS})

    # -- sending -------------------------------------------------------------------------------------------------

    @property
    def commanded(self) -> bool:
        return self._streaming.commanded or (self.carrier is not None and self.carrier.commands)

    def begin(self) -> None:
        if self._clock is not None:
            self._streaming.begin(self._clock)

    def send(self, values: Floats, time: int) -> None:
        """Stream set-points (SI, by table row, NaN if not set) with the offsets of the player. ``time`` is the time of
        the cycle (ns).
        """
        offsets: Mapping[int, float] = {}
        with self._lock:
            self._setpoints = values.copy()
            if self._player is not None:
                offsets = self._player.advance(time, active=self._active)
                self._publish_player(time)
        active = self._active or "rig.state" not in {*self._description.sources, *self._carried}
        self._failure = self._failure or self._streaming.send(values, offsets, time, active=active)
        if self.carrier is not None:
            for row, offset in offsets.items():
                signal = self.table.signals[row]
                values[row] = min(max(values[row] + offset, signal.low), signal.high)
            self.carrier.outlet.send(values, time)

    def is_own(self, port: int, token: float) -> bool:
        return self.carrier is not None and self.carrier.is_own(port, token)

    def silent(self) -> AbstractContextManager[None]:
        if self.carrier is None:
            raise NotAvailable(NO_WATCHDOG.format(self.rig))
        return self.carrier.silent()

    def read_file(self, file: int, record: int, count: int) -> list[int]:
        if self.carrier is None:
            raise NotAvailable(
                f"{self.rig}: its wiring has no access to files of the rig; read them with the rig's own tools"
            )
        return self.carrier.read_file(file, record, count)

    def identity(self) -> str:
        """Return the points, or the table of signals, by which the rig was identified."""
        points = [f"{point} = {value:g}" for point, value in self._description.identity.items()]
        table = self.carrier.identity() if self.carrier else ""
        text = "; ".join(filter(None, (", ".join(points), table)))
        return text or "unknown: the wiring has no [identity], so any rig with these points is accepted"

    def source(self, name: str) -> str:
        """Return as text the points of a signal, or its CAN message or register."""
        description = self._description
        if name in self._carried:
            return self._carrier.source(name)
        if name in description.sources:
            return ", ".join(description.sources[name].points)
        if name in description.settings:
            one = description.settings[name]
            return one.read or one.point or "fixed"
        return description.setpoints[name].point if name in description.setpoints else ""

    def stamp(self, name: str) -> Stamp | None:
        """Return the stamp of a signal: that of the first of its points."""
        if name not in self._sources.limits:
            return None
        transport, _, point = self._description.sources[name].points[0].partition(".")
        return self._transports[transport].stamp(point)

    def remarks(self) -> dict[str, list[Remark]]:
        """Return the remarks of the transports on the rig, by transport."""
        noticed = {name: one.remarks() for name, one in self._transports.items()}
        return {name: remarks for name, remarks in noticed.items() if remarks}

    def write(self, values: Mapping[str, float]) -> None:
        alone = not self._transports and self._player is None
        if self.carrier is not None and alone and self._carried.issuperset(values):
            self.carrier.write(values)
            return
        refuse_absent(self, *values)
        self.begin()
        played = {name: value for name, value in values.items() if name in self._description.played}
        self._refuse_under_program(values)
        carried = {name: value for name, value in values.items() if name in self._carried}
        others = {name: value for name, value in values.items() if name not in {*played, *carried}}
        before = self._carrier.read(list(carried)) if carried and others else {}
        if carried:
            self._carrier.write(carried)
        try:
            self._settings.write(others, self._clock)
        except (BenchError, ValueError):
            if before:
                self._carrier.write(before)
            raise
        if played and self._player is not None:
            self._player.write(played)

    def read(self, names: Sequence[str]) -> dict[str, float]:
        if self.carrier is not None and self._carried.issuperset(names):
            return self.carrier.read(names)
        refuse_absent(self, *names)
        content = self._player.state() if self._player is not None else {}
        if carried := [name for name in names if name in self._carried]:
            content = {**content, **self._carrier.read(carried)}
        sources = {name: self._points_of(name) for name in names if name not in content}
        numbers = self._points.read(point for points in sources.values() for point in points)
        found = {}
        for name in names:
            if name in content:
                found[name] = content[name]
            elif name in self._description.settings:
                found[name] = self._settings.si(name, numbers)
            else:
                found[name] = self._description.sources[name].si([numbers[p] for p in sources[name]])
        return found

    def act(self, name: str) -> None:
        refuse_absent(self, name)
        self.begin()
        if self._player is not None and name in self._description.played:
            self._play(name)
            return
        if name in self._carried:
            self._carrier.act(name)
            return
        point, numbers = self._description.actions[name]
        for number in numbers:
            self._points.write({point: number})

    def _send_orders(self, orders: Iterable[Order]) -> None:
        """Trigger the actions and write the points of ``orders``, such as the orders after connecting."""
        for order in orders:
            for name in order.values:
                if name in self._description.actions:
                    self.act(name)
            actions = self._description.actions
            self._points.write({name: value for name, value in order.values.items() if name not in actions})

    def write_points(self, points: Mapping[str, float]) -> None:
        self.begin()
        self._points.write(points)

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
            play = self._player.add if name == "action.program_add" else self._player.run
            play(self.read(controls), setpoints, active=active)

    def _refuse_under_program(self, values: Mapping[str, float]) -> None:
        if self._player is not None and self._player.busy:
            controls = [name for name in values if name.endswith(".control")]
            for name, mode in self.read(controls).items():
                if mode != values[name]:
                    raise Refused(
                        f"{name} cannot change while a program runs; stop the program first", DEVICE_FAILURE
                    )

    # -- points --------------------------------------------------------------------------------------------------

    def _points_of(self, name: str) -> tuple[str, ...]:
        if name in self._description.settings:
            return self._settings.source(name)
        return self._description.sources[name].points

    def _check_state(self) -> None:
        """Raise WiringError if the rig's state is polled on request, because the bench reads it on every cycle."""
        state = self._description.sources.get("rig.state")
        if state is not None and "rig.state" not in self._sources.limits:
            raise WiringError(
                f'{self._description.where}: signals."rig.state".from = {", ".join(state.points)} is '
                "read only on request; use a point that is read by itself, such as one of a polled "
                "group"
            )

    def _freshness(self) -> Ints:
        limits = np.zeros(len(self.table.signals), np.int64)
        if self.carrier is not None:
            rows = [self.table.index[name] for name in self._carried]
            limits[rows] = self.carrier.freshness[rows]
        for name, limit in self._sources.limits.items():
            limits[self.table.index[name]] = limit
        if self._player is not None:
            for name in _PLAYER_READINGS:
                limits[self.table.index[name]] = _PLAYED_STALE
        return limits


class _SignalNews:
    """One signal: its points, their latest values, and which of them are new."""

    def __init__(self, row: int, source: Source, stale: Mapping[str, int]) -> None:
        self.row, self._source, self._stale = row, source, stale
        self._last: dict[str, tuple[int, float]] = {}
        self._news: set[str] = set()

    def receive(self, point: str, time: int, number: float) -> None:
        """Store a new value of one of the points, received at ``time`` (ns)."""
        self._last[point] = time, number
        self._news.add(point)

    def value(self, time: int) -> float | None:
        """Return None until all points have a new value. Then return the SI value, or NaN if one of the values is stale
        at ``time`` (ns).
        """
        if len(self._news) < len(self._source.points):
            return None
        self._news.clear()
        last = [(point, *self._last[point]) for point in self._source.points]
        if any(time - came > self._stale[point] for point, came, _ in last):
            return math.nan
        return self._source.si([number for _, _, number in last])


class Sources:
    """Converts received points to samples of those measurements and statuses whose points all arrive without request.

    ``stale`` returns for a point the age (s) above which it is stale, 0 if it is polled on request.
    """

    def __init__(self, description: Description, stale: Callable[[str], float]) -> None:
        #: Age (ns) above which a signal is stale.
        self.limits: dict[str, int] = {}
        self._by_point: dict[str, list[_SignalNews]] = {}
        for name, source in description.sources.items():
            limits = {point: round(stale(point) * NS) for point in source.points}
            if description.table[name].kind is Kind.INTERLOCK or not all(limits.values()):
                continue
            self.limits[name] = max(limits.values())
            news = _SignalNews(description.table.index[name], source, limits)
            for point in limits:
                self._by_point.setdefault(point, []).append(news)

    def samples(self, prefix: str, time: int, points: Mapping[str, float]) -> dict[int, float]:
        """Store ``points``, named without their ``prefix`` and received at ``time`` (ns). Return the new values (SI) by
        table row.

        A signal of several points is new when the last of them has arrived.
        """
        touched: dict[int, _SignalNews] = {}
        for point, number in points.items():
            for news in self._by_point.get(prefix + point, ()):
                news.receive(prefix + point, time, number)
                touched[news.row] = news
        values = {row: news.value(time) for row, news in touched.items()}
        return {row: value for row, value in values.items() if value is not None}
