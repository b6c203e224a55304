"""A transport on Modbus/TCP: points in registers and bits, polled in groups, written in as few requests as possible.

::

    [transports.plc]
    kind = "modbus"
    host = "127.0.0.1"
    port = 502                    # 1 to 65535
    unit = 1                      # 0 to 255
    word_order = "high"           # of 32 and 64 bits: the high word first, or the "low" one
    byte_order = "big"            # of each register; "little" for devices that have it the wrong way round
    timeout = "500 ms"            # for the connection and for each answer
    patience = "1 s"              # silence after which the connection counts as lost
    stream = "50 ms"              # how often points that are streamed are written
    alive = { point = "heartbeat", every = "100 ms" }   # counts up, or a bit goes on and off, while somebody commands

    [transports.plc.groups.fast]
    every = "50 ms"
    stale = "200 ms"              # three periods, and at least 200 ms, where nothing is said
    gap = 0                       # registers without a point that may be read along to save a request

    [transports.plc.points]
    # table: input, holding, coil, discrete; type: int16, uint16 (where nothing is said), int32, uint32, int64, uint64,
    # float32, float64, string; number = scale · what the registers hold + offset
    left_height = { table = "input", address = 100, type = "int16", scale = 0.01, null = -32768, group = "fast" }
    mode        = { table = "holding", address = 0 }
    ready       = { table = "input", address = 5, bit = 3 }
    valve_open  = { table = "coil", address = 3 }
    serial      = { table = "input", address = 900, type = "string", length = 8 }

Addresses are 0-based. A group is read in requests of up to 125 registers; all that one of them brings has one time, the
middle of the request. A point without a group is read when asked.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, Final

import msgspec
from msgspec import Meta

from bench_protocol.clock import Clock
from bench_protocol.modbus import BITS_WRITE_MAX, REGISTERS_WRITE_MAX
from bench_protocol.units import ms
from drivers.errors import BenchError, LinkLost, Refused, WiringError
from drivers.wiring.contract import OnLost, OnPoints
from drivers.wiring.ear import LIFE_SIGNS, Ear, Grant, Outbox
from drivers.wiring.keys import AliveKeys, convert, duration, meant
from drivers.wiring.registers import ByteOrder, RegisterPoint, Span, WordOrder, read_points, spans

if TYPE_CHECKING:
    from drivers.modbus_port import ModbusPort

_STALE_PERIODS: Final = 3
_STALE_MIN: Final = 200 * ms


class GroupKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Points that are read together, again and again."""

    every: str
    stale: str | None = None
    gap: Annotated[int, Meta(ge=0, le=124)] = 0


class ModbusKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """What stands under ``[transports.NAME]``."""

    kind: str
    host: str
    points: dict[str, Any]
    port: Annotated[int, Meta(ge=1, le=0xFFFF)] = 502
    unit: Annotated[int, Meta(ge=0, le=0xFF)] = 1
    word_order: WordOrder = "high"
    byte_order: ByteOrder = "big"
    timeout: str = "500 ms"
    patience: str = "1 s"
    stream: str = "50 ms"
    alive: dict[str, Any] | None = None
    groups: dict[str, Any] = {}


class ModbusTransport:
    """A `Transport` to a Modbus device; what is wrong in its description is a WiringError of the constructor.

    ``port`` opens the device instead of a socket at ``host``: in memory, say.
    """

    def __init__(
        self, name: str, table: Mapping[str, Any], *, port: Callable[[], ModbusPort] | None = None
    ) -> None:
        where = f"transports.{name}"
        keys = convert(where, table, ModbusKeys)
        self.name, self._keys = name, keys
        self._opener = port
        self._where = f"{name} at {keys.host}:{keys.port}"
        self._timeout = duration(f"{where}: timeout", keys.timeout)
        self._patience = duration(f"{where}: patience", keys.patience)
        self._stream_period = duration(f"{where}: stream", keys.stream)
        groups = {
            group: convert(f"{where}.groups.{group}", one, GroupKeys) for group, one in keys.groups.items()
        }
        self._points = read_points(f"{where}.points", keys.points, groups, keys.word_order, keys.byte_order)
        self._groups: list[tuple[float, list[Span]]] = []
        self._stale: dict[str, float] = {}
        for group, one in groups.items():
            self._add_group(f"{where}.groups.{group}", group, one)
        self._alive: tuple[str, float] | None = None
        if keys.alive is not None:
            alive = convert(f"{where}.alive", keys.alive, AliveKeys)
            self.require(alive.point, writable=True)
            if self._points[alive.point].type == "string":
                raise WiringError(
                    f"{where}.alive: point = {alive.point!r} is a text; right would be a number or a bit"
                )
            self._alive = alive.point, duration(f"{where}.alive: every", alive.every)
        self.counts = {
            "polls": 0,
            "silent": 0,
            "refused": 0,
        }  #: requests of the background, those without an answer…
        self._ear, self._grant, self._outbox = Ear(self._where), Grant(), Outbox()
        self._writing = threading.RLock()
        self._port: ModbusPort | None = None
        self._clock: Clock | None = None
        self._beats = 0

    def _add_group(self, place: str, group: str, keys: GroupKeys) -> None:
        every = duration(f"{place}: every", keys.every)
        stale = (
            max(_STALE_PERIODS * every, _STALE_MIN)
            if keys.stale is None
            else duration(f"{place}: stale", keys.stale)
        )
        members = [point for point in self._points.values() if point.group == group]
        if not members:
            raise WiringError(f"{place}: no point has group = {group!r}, so there is nothing to read")
        if stale <= every:
            raise WiringError(f"{place}: stale = {keys.stale!r} is not longer than every = {keys.every!r}")
        for point in members:
            if point.type == "string":
                raise WiringError(
                    f"{place}: {point.name} is a text; texts are read when asked, without a group"
                )
            self._stale[point.name] = stale
        self._groups.append((every, spans(members, keys.gap)))

    # -- what there is -------------------------------------------------------------------------------------------

    @property
    def period(self) -> float:
        """How often points come by themselves (s) at the slowest; 0 if all are read when asked."""
        return max((every for every, _ in self._groups), default=0.0)

    def require(self, name: str, *, writable: bool = False) -> None:
        """WiringError unless there is a point of that name, and it is in a table that can be written if it is to be."""
        point = self._points.get(name)
        if point is None:
            raise WiringError(f"transports.{self.name} has no point {name!r}; {meant(name, self._points)}")
        if writable and (not point.writable or point.type == "string"):
            raise WiringError(
                f"transports.{self.name}: {name} is a {point.type} in the table {point.table!r}, which cannot be "
                "written; numbers and bits in 'holding' and 'coil' can"
            )

    def stale(self, name: str) -> float:
        """Return after how long without news (s) a point is stale; 0 if it is read when asked."""
        self.require(name)
        return self._stale.get(name, 0.0)

    # -- the connection ------------------------------------------------------------------------------------------

    def connect(self, clock: Clock, lost: OnLost, *, within: float) -> None:
        """Connect and read each group once. LinkLost if nobody answers, Refused if a group is outside the map."""
        self._clock = clock
        self._port = self._open(within)
        self._outbox, self._grant = Outbox(), Grant()
        self._ear.open(clock, lost)
        try:
            for _, requests in self._groups:
                for span in requests:
                    self._poll(span)
        except BenchError:
            self.close()
            raise
        self._ear.sign()
        for every, requests in self._groups:
            self._recur(every, partial(self._poll_all, requests))
        self._recur(self._stream_period, self._send_stream)
        if self._alive is not None:
            self._recur(self._alive[1], self._count)

    def _open(self, within: float) -> ModbusPort:
        if self._opener is not None:
            return self._opener()
        from drivers.modbus_port import open_modbus

        host, port, unit = self._keys.host, self._keys.port, self._keys.unit
        return open_modbus(host, port, unit=unit, timeout=self._timeout, within=within)

    def _recur(self, period: float, call: Callable[[], None]) -> None:
        """Let ``call`` recur; in virtual time never in the middle of a request of the thread that lets time pass."""
        assert self._clock is not None and self._port is not None
        self._ear.recur(period, call, self._port.between_requests)

    def subscribe(self, hear: OnPoints) -> None:
        """Call ``hear(time, points)`` with what each request of a group brings from now on."""
        self._ear.subscribe(hear)

    def alive(self) -> float:
        """Return how long ago the device answered (s); infinite before the first time."""
        return self._ear.silence()

    def close(self) -> None:
        """Disconnect; no callback comes after this has returned. Harmless when repeated."""
        self._ear.close()
        if self._port is not None:
            self._port.close()

    # -- reading and writing ---------------------------------------------------------------------------------------

    def read(self, names: Sequence[str]) -> dict[str, float]:
        """Ask for points now: one request for all that lie in one block. NaN where the device says there is none."""
        for name in names:
            self.require(name)
            if self._points[name].type == "string":
                raise WiringError(f"transports.{self.name}: {name} is a text; ask text({name!r}) for it")
        found: dict[str, float] = {}
        for span in spans([self._points[name] for name in dict.fromkeys(names)], 0):
            found.update(span.decode(self._ask(partial(_read, span))))
        return {name: found[name] for name in names}

    def text(self, name: str) -> str:
        """Ask for a text."""
        self.require(name)
        point = self._points[name]
        span = Span(point.table, point.address, point.size, (point,))
        return point.text(self._ask(partial(_read, span)))

    def write(self, points: Mapping[str, float]) -> None:
        """Write points in the order given, neighbours in one request; ValueError, before it, if one does not fit."""
        for name in points:
            self.require(name, writable=True)
        chosen = [(self._points[name], value) for name, value in points.items()]
        coded = [(point, point.encode(value)) for point, value in chosen]
        with self._writing:
            for run in _runs(coded):
                self._write_run(run)

    def _write_run(self, run: list[tuple[RegisterPoint, list[int]]]) -> None:
        first = run[0][0]
        words = [word for _, part in run for word in part]
        if first.table == "coil":
            if len(words) == 1:
                self._ask(lambda port: port.write_coil(first.address, bool(words[0])))
            else:
                self._ask(lambda port: port.write_coils(first.address, [bool(word) for word in words]))
        elif first.in_word:
            (word,) = self._ask(lambda port: port.read_holding(first.address, 1))
            for point, (bit,) in run:
                word = point.with_bit(word, bit)
            self._ask(lambda port: port.write_registers(first.address, [word]))
        else:
            self._ask(lambda port: port.write_registers(first.address, words))

    def stream(self, points: Mapping[str, float], time: int) -> None:
        """Take values that are written with the next beat of the stream; NaN leaves what was there."""
        self._ear.check()
        news = {}
        for name, value in points.items():
            if not math.isnan(value):
                self.require(name, writable=True)
                self._points[name].encode(value)
                news[name] = value
        self._grant.renew(time)
        self._outbox.put(news)

    def begin(self) -> float:
        """Count the sign of life from now on; return after how long (s) it has counted to three, 0 without one."""
        self._grant.begin()
        return LIFE_SIGNS * self._alive[1] if self._alive is not None else 0.0

    # -- what recurs -----------------------------------------------------------------------------------------------

    def _poll_all(self, requests: list[Span]) -> None:
        for span in requests:
            try:
                self._poll(span)
            except Refused:
                self.counts["refused"] += 1
                self._ear.tell(self._now(), dict.fromkeys((point.name for point in span.points), math.nan))
            except LinkLost:
                return

    def _poll(self, span: Span) -> None:
        self.counts["polls"] += 1
        before = self._now()
        words = self._ask(partial(_read, span))
        self._ear.tell((before + self._now()) // 2, span.decode(words))

    def _send_stream(self) -> None:
        self._in_background(self._outbox.take())

    def _count(self) -> None:
        assert self._alive is not None
        if not self._grant.given(self._now()):
            return
        name = self._alive[0]
        _, high = self._points[name].range()
        self._beats += 1
        self._in_background({name: self._beats % (min(high, 65535.0) + 1)})

    def _in_background(self, values: Mapping[str, float]) -> None:
        """Write ``values``; a device that refuses set-points in its present state is asked again with the next ones."""
        try:
            self.write(values)
        except Refused:
            self.counts["refused"] += 1
        except LinkLost:
            pass

    def _now(self) -> int:
        assert self._clock is not None
        return self._clock.now()

    def _ask(self, request: Callable[[ModbusPort], Any]) -> Any:
        """Return the answer to ``request``; LinkLost, told to whoever waits for it, once patience is at its end."""
        self._ear.check()
        assert self._port is not None
        try:
            reply = request(self._port)
        except Refused:
            self._ear.sign()
            raise
        except LinkLost as error:
            self.counts["silent"] += 1
            if self._ear.busy and self._ear.silence() >= self._patience:
                self._ear.lose(str(error))
            raise
        self._ear.sign()
        return reply


def _read(span: Span, port: ModbusPort) -> Sequence[int]:
    ask: Mapping[str, Callable[[int, int], Sequence[int]]] = {
        "input": port.read_input,
        "holding": port.read_holding,
        "coil": port.read_coils,
        "discrete": port.read_discrete,
    }
    return ask[span.table](span.address, span.count)


def _runs(coded: list[tuple[RegisterPoint, list[int]]]) -> list[list[tuple[RegisterPoint, list[int]]]]:
    """Return what one request each can write: neighbours in one table, or bits of one word."""
    runs: list[list[tuple[RegisterPoint, list[int]]]] = []
    for point, words in coded:
        last = runs[-1] if runs else None
        if last is not None and _follows(last, point):
            last.append((point, words))
        else:
            runs.append([(point, words)])
    return runs


def _follows(run: list[tuple[RegisterPoint, list[int]]], point: RegisterPoint) -> bool:
    first, last = run[0][0], run[-1][0]
    if point.table != last.table:
        return False
    if point.in_word or last.in_word:
        return point.in_word and last.in_word and point.address == last.address
    limit = BITS_WRITE_MAX if point.table == "coil" else REGISTERS_WRITE_MAX
    return point.address == last.end and point.end - first.address <= limit
