"""A transport on Modbus: points in registers and bits, polled in groups, written in as few requests as possible.

::

    [transports.plc]
    kind = "modbus"               # Modbus/TCP; "modbus_rtu" for the frames of a serial line
    host = "127.0.0.1"
    port = 502                    # 1 to 65535
    unit = 1                      # 0 to 255
    word_order = "high"           # of 32 and 64 bits: "high" or "low" word first
    byte_order = "big"            # of each register; "little" for swapped bytes
    timeout = "500 ms"            # for the connection and for each answer
    patience = "1 s"              # silence or busy answers after which the connection counts as lost
    stream = "50 ms"              # period of set-points
    alive = { point = "heartbeat", every = "100 ms" }   # a counter, or a bit that toggles, while a user commands
    # For devices that support only a part of the specification:
    writes = "any"                # "single": functions 5 and 6 only; "multiple": 15 and 16 only; "any": detected
                              # "parts": 5 and 6, also one after the other for numbers of several registers
                              # "combined": registers by function 23
    request_max = 125             # most registers of a request; for bits 16 times as many
    connection = "kept"           # "each": one for each request; "shared": with other transports to this address
    echo = true                   # false: accept answers with another unit or transaction number

    [transports.drive]            # on a serial line; several transports may share it
    kind = "modbus_rtu"
    line = "/dev/ttyUSB0"         # or host and port: frames of a serial line over TCP
    baudrate = 19200
    parity = "none"               # even, odd
    stopbits = 1                  # or 2
    local_echo = false            # true: the adapter returns the sent bytes
    unit = 7

    [transports.plc.groups.fast]
    every = "50 ms"
    stale = "200 ms"              # default: three periods, at least 200 ms
    gap = 0                       # most unused registers between points that one request may read

    [transports.plc.points]
    # table: input, holding, coil, discrete; type: int16, uint16 (default), int32, uint32, int64, uint64, float32,
    # float64, string; number = scale · register value + offset; null: register value without a measurement
    left_height = { table = "input", address = 100, type = "int16", scale = 0.01, null = -32768, group = "fast" }
    mode        = { table = "holding", address = 0 }
    ready       = { table = "input", address = 5, bit = 3 }
    phase       = { table = "input", address = 5, bit = 4, bits = 3 }   # the number in bits 4 to 6
    valve_open  = { table = "coil", address = 3 }
    serial      = { table = "input", address = 900, type = "string", length = 8 }

Addresses are 0-based. All values of one request of a group have one time, the middle of the request. A point without a
group is read on request. While a device is busy, its readings keep their values until they are stale. A device that
continues to refuse set-points ends the run, with its reason.

Answers of Modbus/TCP are matched by their transaction number. Frames of a serial line have none, also over TCP. After a
request without an answer such a line is left silent for one more time-out and read empty. The next reading is then
requested twice, and the first answer is discarded. Discarded answers are counted.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from bench_protocol.clock import Clock
from bench_protocol.modbus import MEANING
from bench_protocol.suggestion import did_you_mean
from bench_protocol.units import NS, ms
from drivers.errors import BenchError, LinkLost, Refused, WiringError
from drivers.wiring.contract import OnLost, OnPoints, Refusal, Remark, Transport
from drivers.wiring.keys import AliveKeys, convert, duration
from drivers.wiring.listener import LIFE_SIGNS, Grant, Listener, WriteBuffer
from drivers.wiring.modbus.keys import IN_PARTS, GroupKeys, opener, place_of, read_keys
from drivers.wiring.modbus.registers import Span, explained, read_points, spans
from drivers.wiring.modbus.writing import Writer

if TYPE_CHECKING:
    from drivers.modbus_port import ModbusPort

_STALE_PERIODS: Final = 3
_STALE_MIN: Final = 200 * ms
_BUSY: Final = 6
#: Exception codes of a device or gateway that cannot answer now: it still works, is busy, or does not reach the device.
_NOT_NOW: Final = frozenset({5, _BUSY, 0x0A, 0x0B})
_AGAIN: Final = round(20 * ms * NS)
_COUNTED: Final = {"silent": "got no answer", "refused": "were refused", "busy": "met a busy device"}
#: Meaning of the exception codes for any device. Only our rig uses code 6 for "another client is the commander".
_MEANING: Final = {**MEANING, _BUSY: "the device is busy"}


class ModbusTransport(Transport):
    """A `Transport` to a Modbus device. The constructor raises WiringError for an invalid description.

    ``port`` opens the device instead of a socket at ``host``, for example in memory.
    """

    def __init__(
        self, name: str, table: Mapping[str, Any], *, port: Callable[[], ModbusPort] | None = None
    ) -> None:
        where = f"transports.{name}"
        keys = read_keys(where, table)
        self.name, self._keys = name, keys
        self._opener = port
        self._where = f"{name} at {place_of(keys)}"
        self._timeout = duration(f"{where}: timeout", keys.timeout)
        self._patience = duration(f"{where}: patience", keys.patience)
        self._stream_period = duration(f"{where}: stream", keys.stream)
        groups = {
            group: convert(f"{where}.groups.{group}", one, GroupKeys) for group, one in keys.groups.items()
        }
        self._points = read_points(f"{where}.points", keys.points, groups, keys.word_order, keys.byte_order)
        self._check_sizes(f"{where}.points")
        self._writer = Writer(keys.writes, keys.request_max)
        self._groups: list[tuple[str, float, list[Span]]] = []
        self._stale: dict[str, float] = {}
        self._gaps: dict[str, int] = {}
        for group, one in groups.items():
            self._add_group(f"{where}.groups.{group}", group, one)
        self._alive: tuple[str, float] | None = None
        if keys.alive is not None:
            alive = convert(f"{where}.alive", keys.alive, AliveKeys)
            self.require(alive.point, writable=True)
            if self._points[alive.point].type == "string":
                raise WiringError(f"{where}.alive: point = {alive.point!r} is a text; use a number or a bit")
            self._alive = alive.point, duration(f"{where}.alive: every", alive.every)
        #: Counts of requests (all, polls, without an answer, refused, device busy), and of late answers that were
        #: discarded.
        self.counts = {"requests": 0, "polls": 0, "silent": 0, "refused": 0, "busy": 0, "discarded": 0}
        self._rounds: dict[str, float] = {}  # s, time to read a group
        self._listener, self._grant, self._buffer = Listener(self._where), Grant(), WriteBuffer()
        self._writing = threading.RLock()
        self._port: ModbusPort | None = None
        self._clock: Clock | None = None
        self._cycles = 0

    def _check_sizes(self, where: str) -> None:
        most = self._keys.request_max
        for point in self._points.values():
            if point.size > most and point.type not in ("bit", "string"):
                raise WiringError(
                    f"{where}: {point.name} is a {point.type} in {point.size} registers, and "
                    f"request_max = {most}; increase request_max, because a number read in two parts "
                    "can be wrong"
                )

    def _add_group(self, place: str, group: str, keys: GroupKeys) -> None:
        every = duration(f"{place}: every", keys.every)
        stale = (
            max(_STALE_PERIODS * every, _STALE_MIN)
            if keys.stale is None
            else duration(f"{place}: stale", keys.stale)
        )
        members = [point for point in self._points.values() if point.group == group]
        if not members:
            raise WiringError(
                f"{place}: no point has group = {group!r}, so the group reads nothing; remove the "
                "group, or assign points to it"
            )
        if stale <= every:
            raise WiringError(
                f"{place}: stale = {keys.stale!r} is not longer than every = {keys.every!r}; use a "
                "longer time"
            )
        for point in members:
            if point.type == "string":
                raise WiringError(
                    f"{place}: {point.name} is a text; remove its group, because texts are read on "
                    "request only"
                )
            self._stale[point.name] = stale
        self._groups.append((group, every, spans(members, keys.gap, self._keys.request_max)))
        self._gaps[group] = keys.gap

    # -- points --------------------------------------------------------------------------------------------------

    @property
    def period(self) -> float:
        """The longest period (s) of the points in groups; 0 if all are polled on request."""
        return max((every for _, every, _ in self._groups), default=0.0)

    def require(self, name: str, *, writable: bool = False) -> None:
        """Raise WiringError unless the point exists and, if ``writable``, its table can be written."""
        point = self._points.get(name)
        if point is None:
            raise WiringError(
                f"transports.{self.name} has no point {name!r}; {did_you_mean(name, self._points)}"
            )
        if writable and (not point.writable or point.type == "string"):
            raise WiringError(
                f"transports.{self.name}: {name} is a {point.type} in the table {point.table!r}, which "
                "cannot be written; use a number or a bit in 'holding' or 'coil'"
            )
        if writable and self._keys.writes == "single" and point.size > 1:
            raise WiringError(
                f"transports.{self.name}: {name} is a {point.type} in {point.size} registers, and writes = 'single' "
                f"writes one at a time: {IN_PARTS}"
            )

    def stale(self, name: str) -> float:
        """Return the age (s) above which a point is stale; 0 if it is polled on request."""
        self.require(name)
        return self._stale.get(name, 0.0)

    # -- the connection ------------------------------------------------------------------------------------------

    def connect(self, clock: Clock, lost: OnLost, *, within: float) -> None:
        """Connect and read each group once. Raises LinkLost without a connection ``within`` s or without an answer,
        Refused if a group is outside the map.
        """
        self._clock = clock
        self._port = self._opener() if self._opener is not None else opener(self._keys, self._timeout)(within)
        self._port.meaning = _MEANING
        self._buffer, self._grant = WriteBuffer(), Grant()
        self._listener.open(clock, lost)
        try:
            for group, _, requests in self._groups:
                before = self._now()
                for span in requests:
                    self._poll_first_time(span, self._gaps[group])
                self._rounds[group] = (self._now() - before) / NS
        except BenchError:
            self.close()
            raise
        self._listener.touch()
        for group, every, requests in self._groups:
            self._recur(every, partial(self._poll_all, group, requests))
        self._recur(self._stream_period, self._send_stream)
        if self._alive is not None:
            self._recur(self._alive[1], self._count)

    def _poll_first_time(self, span: Span, gap: int) -> None:
        """Poll ``span`` for the first time; an error has a hint that smaller requests have found."""
        try:
            self._poll(span, patient=True)
        except BenchError as error:
            raise explained(
                span, error, lambda one: self._send_request(partial(_read, one), patient=True), gap
            ) from None

    def _recur(self, period: float, call: Callable[[], None]) -> None:
        """Call ``call`` periodically; in virtual time never during a request of the thread that advances the clock."""
        assert self._clock is not None and self._port is not None
        self._listener.every(period, call, self._port.between_requests)

    def subscribe(self, receive: OnPoints) -> None:
        """Call ``receive(time, points)`` with the points of each request of a group from now on."""
        self._listener.subscribe(receive)

    def alive(self) -> float:
        """Return the time (s) since the last answer of the device; infinite before the first one."""
        return self._listener.silence()

    def close(self) -> None:
        """Disconnect. No callback follows after this returns. Repeated calls are harmless."""
        self._listener.close()
        if self._port is not None:
            self._port.close()

    # -- reading and writing ---------------------------------------------------------------------------------------

    def read(self, names: Sequence[str]) -> dict[str, float]:
        """Poll points now: one request for all points in one block. NaN if the device reports no value."""
        for name in names:
            self.require(name)
            if self._points[name].type == "string":
                raise WiringError(f"transports.{self.name}: {name} is a text; read it with text({name!r})")
        found: dict[str, float] = {}
        for span in spans([self._points[name] for name in dict.fromkeys(names)], 0, self._keys.request_max):
            found.update(span.decode(self._send_request(partial(_read, span), patient=True)))
        return {name: found[name] for name in names}

    def text(self, name: str) -> str:
        """Read a text point from the device now."""
        self.require(name)
        point, most = self._points[name], self._keys.request_max
        words: list[int] = []
        for first in range(point.address, point.end, most):
            part = Span(point.table, first, min(most, point.end - first), ())
            words += self._send_request(partial(_read, part), patient=True)
        return point.text(words)

    def write(self, points: Mapping[str, float], *, patient: bool = True) -> None:
        """Write points in the given order, neighbours in one request. Raises ValueError before that if a value does not
        fit. ``patient`` is that of `_send_request`.
        """
        for name in points:
            self.require(name, writable=True)
        chosen = [(self._points[name], value) for name, value in points.items()]
        coded = [(point, point.encode(value)) for point, value in chosen]
        with self._writing:
            self._writer.write(coded, partial(self._send_request, patient=patient))

    def stream(self, points: Mapping[str, float], time: int) -> None:
        """Take values that are written with the next cycle of the stream; NaN keeps the previous value. ``time`` is the
        time of the cycle (ns).
        """
        self._listener.check()
        news = {}
        for name, value in points.items():
            if not math.isnan(value):
                self.require(name, writable=True)
                self._points[name].encode(value)
                news[name] = value
        self._grant.renew(time)
        self._buffer.put(news)

    def begin(self) -> float:
        """Start the heartbeat. Returns the time (s) until it has counted to three, 0 without a heartbeat."""
        self._grant.begin()
        return LIFE_SIGNS * self._alive[1] if self._alive is not None else 0.0

    # -- periodic tasks ------------------------------------------------------------------------------------------

    def _poll_all(self, group: str, requests: list[Span]) -> None:
        before = self._now()
        for span in requests:
            try:
                self._poll(span)
            except Refused as refused:
                if refused.code not in _NOT_NOW:  # keep a value that cannot be read now until it is stale
                    self.counts["refused"] += 1
                    names = [point.name for point in span.points]
                    self._listener.receive(self._now(), dict.fromkeys(names, math.nan))
            except LinkLost:
                return
        self._rounds[group] = (self._now() - before) / NS

    def _poll(self, span: Span, *, patient: bool = False) -> None:
        self.counts["polls"] += 1
        before = self._now()
        words = self._send_request(partial(_read, span), patient=patient)
        self._listener.receive((before + self._now()) // 2, span.decode(words))

    def _send_stream(self) -> None:
        if values := self._buffer.drain():
            # Neighbours go in one request.
            ordered = dict(sorted(values.items(), key=lambda one: self._points[one[0]].place))
            self._buffer.refusal = self._in_background(ordered, self._buffer.refusal)

    @property
    def refusal(self) -> Refusal | None:
        """The present rejection of set-points by the device; None while it accepts them."""
        return self._buffer.refusal

    def _count(self) -> None:
        assert self._alive is not None
        if not self._grant.given(self._now()):
            return
        name = self._alive[0]
        _, high = self._points[name].range()
        self._cycles += 1
        self._in_background({name: self._cycles % (min(high, 65535.0) + 1)})

    def _in_background(self, values: Mapping[str, float], before: Refusal | None = None) -> Refusal | None:
        """Write ``values`` once. Return None if the device accepts them, else its rejection. ``before`` is the present
        rejection, whose time ``since`` a further rejection keeps; it is returned if the device does not answer.
        """
        try:
            self.write(values, patient=False)
        except Refused as refused:
            busy = refused.code in _NOT_NOW
            self.counts["refused"] += not busy
            begins = self._now() + (round(self._patience * NS) if busy else 0)
            return Refusal(before.since if before else begins, refused)
        except LinkLost:
            return before
        return None

    def _now(self) -> int:
        assert self._clock is not None
        return self._clock.now()

    def _send_request(self, request: Callable[[ModbusPort], Any], *, patient: bool = False) -> Any:
        """Return the answer to ``request``. Raises LinkLost without one, and reports the loss after a silence of
        ``patience``.

        If ``patient``, the request to a busy device is repeated for the same time.
        """
        self._listener.check()
        assert self._port is not None
        deadline = self._now() + round(self._patience * NS)
        while True:
            self._listener.check()
            self.counts["requests"] += 1
            try:
                reply = request(self._port)
            except Refused as refused:
                self._listener.touch()
                self.counts["busy"] += refused.code in _NOT_NOW
                if not patient or refused.code not in _NOT_NOW or self._now() >= deadline:
                    raise
                assert self._clock is not None
                self._clock.sleep_until(min(deadline, self._now() + _AGAIN))
                continue
            except LinkLost as error:
                self.counts["silent"] += 1
                if self._listener.busy and self._listener.silence() >= self._patience:
                    self._listener.lose(str(error))
                raise
            finally:
                self.counts["discarded"] = self._port.discarded
            self._listener.touch()
            return reply

    def remarks(self) -> list[Remark]:
        """Return remarks on unexpected behaviour of the device, each with whether data are lost."""
        counts = self.counts
        sent = counts["requests"]
        found = [
            Remark(f"{counts[what]} of {sent} requests {words}", what != "busy")
            for what, words in _COUNTED.items()
            if counts[what]
        ]
        if self._port is not None and counts["discarded"]:
            late = self._port.line.latest
            hint = (
                f"; one came {late:.2g} s after its request, but timeout = {self._timeout:g} s"
                if late
                else ""
            )
            found.append(Remark(f"{counts['discarded']} late answers were discarded{hint}", True))
        if self._port is not None and self._port.line.closings and self._keys.connection != "each":
            found.append(
                Remark('the device closes the connection after an answer; set connection = "each"', False)
            )
        for group, every, _ in self._groups:
            took = self._rounds.get(group, 0.0)
            if took > every:
                text = f"group {group} takes {took:.2g} s to read, longer than every = {every:g} s"
                found.append(Remark(text, False))
        return found


def _read(span: Span, port: ModbusPort) -> Sequence[int]:
    ask: Mapping[str, Callable[[int, int], Sequence[int]]] = {
        "input": port.read_input,
        "holding": port.read_holding,
        "coil": port.read_coils,
        "discrete": port.read_discrete,
    }
    return ask[span.table](span.address, span.count)
