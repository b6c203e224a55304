"""A transport on OPC UA, through asyncua: points are variables of a server, subscribed or read, and written by node id.

::

    [transports.cell]
    kind = "opcua"                                  # needs asyncua: pip install "asyncua>=2.1,<3"
    url = "opc.tcp://127.0.0.1:4840/rig"
    every = "50 ms"                                 # period of sampling and of notifications
    stale = "300 ms"                                # default: three periods, at least 300 ms
    timeout = "1 s"                                 # for each answer
    patience = "2 s"                                # silence after which the connection counts as lost
    user = "bench"                                  # and password; optional
    alive = { point = "heartbeat", every = "100 ms" }   # a counter, or a bit that toggles, while a user commands

    [transports.cell.points]
    height = { node = "ns=2;s=Left.Height", scale = 0.001 }     # number = scale · server value + offset
    target = { node = "ns=2;i=1012" }
    cell_3 = { node = "nsu=urn:plant:cells;s=Loads", index = 2 }    # element of an array; namespace by name
    serial = { node = "ns=2;s=Serial", subscribe = false }      # read on request; text(name) reads a text

Errors in the description (no such node, a text, an array without its index) are reported on connecting. To write an
element, the whole array is written, with the present values of its other elements. A server reports only what changes.
Each notification or keep-alive also confirms the unchanged values, which then get its time. Without them the values
become stale, and the transport subscribes again. A value whose status is not good is NaN. Times are those of arrival.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import threading
from collections.abc import Coroutine, Mapping, Sequence
from concurrent.futures import CancelledError
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import msgspec

from bench_protocol.clock import Clock
from bench_protocol.extras import installed, lacking
from bench_protocol.suggestion import did_you_mean
from bench_protocol.units import ms, s
from drivers.errors import BenchError, LinkLost, MapMismatch, Misuse, Refused, WiringError
from drivers.wiring.contract import OnLost, OnPoints, Refusal, Remark, Transport
from drivers.wiring.event_loop import EventLoop
from drivers.wiring.keys import AliveKeys, convert, duration
from drivers.wiring.listener import LIFE_SIGNS, Grant, Listener, WriteBuffer
from drivers.wiring.opcua.reports import Reports
from drivers.wiring.opcua.values import NEVER, NodeKeys, error_text

if TYPE_CHECKING:
    from asyncua import Client, ua

T = TypeVar("T")
_STALE_PERIODS: Final = 3
_STALE_MIN: Final = 300 * ms
_COUNT_MAX: Final = 0x7FFF
_SMALLER_COUNTS: Final = {"Boolean": 1, "SByte": 0x7F, "Byte": 0xFF}
_CLOSING: Final = 2 * s
# What asyncua logs as an error is raised here as an exception; without this it is also printed.
logging.getLogger("asyncua").addHandler(logging.NullHandler())


class OpcUaKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The keys under ``[transports.NAME]``."""

    kind: str
    url: str
    points: dict[str, Any]
    every: str = "50 ms"
    stale: str | None = None
    timeout: str = "1 s"
    patience: str = "2 s"
    user: str | None = None
    password: str | None = None
    alive: dict[str, Any] | None = None


def opcua(name: str, table: Mapping[str, Any], where: Path) -> OpcUaTransport:
    """Return the transport that ``table`` describes; ``where`` is not used."""
    del where
    return OpcUaTransport(name, table)


class OpcUaTransport(Transport):
    """A `Transport` to an OPC UA server. The constructor raises WiringError for an invalid description."""

    def __init__(self, name: str, table: Mapping[str, Any]) -> None:
        place = f"transports.{name}"
        if not installed("opcua"):
            raise WiringError(f"{place}: {lacking('opcua', 'transports on OPC UA')}")
        self.name, self._keys = name, convert(place, table, OpcUaKeys)
        keys = self._keys
        if not keys.url.startswith("opc.tcp://"):
            raise WiringError(
                f'{place}: url = {keys.url!r} is not an address; write it like "opc.tcp://127.0.0.1:4840"'
            )
        self._every = duration(f"{place}: every", keys.every)
        self._timeout = duration(f"{place}: timeout", keys.timeout)
        self._patience = duration(f"{place}: patience", keys.patience)
        self._stale = (
            max(_STALE_PERIODS * self._every, _STALE_MIN)
            if keys.stale is None
            else duration(f"{place}: stale", keys.stale)
        )
        if not keys.points:
            raise WiringError(
                f"{place}.points: there are none; add a line for each, like height = {{ node = "
                f'"ns=2;s=Height" }}'
            )
        self._points = {
            one: convert(f"{place}.points: {one}", node, NodeKeys) for one, node in keys.points.items()
        }
        self._ids = {one: _node_id(f"{place}.points: {one}", node) for one, node in self._points.items()}
        seen: dict[tuple[ua.NodeId, int | None], str] = {}
        for one, node in self._points.items():
            first = seen.setdefault((self._ids[one], node.index), one)
            if first != one:
                raise WiringError(
                    f"{place}.points: {first} and {one} are the same node, {node.shown}; remove one of "
                    "them (several signals may use the same point)"
                )
        self._alive: tuple[str, float] | None = None
        if keys.alive is not None:
            alive = convert(f"{place}.alive", keys.alive, AliveKeys)
            self.require(alive.point, writable=True)
            self._alive = alive.point, duration(f"{place}.alive: every", alive.every)
        self._where = f"{name} at {keys.url}"
        self._listener, self._grant, self._buffer = Listener(self._where), Grant(), WriteBuffer()
        self._found = dict(self._ids)  # with the namespace numbers of the server
        self._types: dict[str, ua.VariantType] = {}
        self._loop: EventLoop | None = None
        self._client: Client | None = None
        self._clock: Clock | None = None
        self._closing = threading.Lock()
        self._writing = threading.RLock()
        self._cycles = 0
        self._reports: Reports | None = None

    # -- points --------------------------------------------------------------------------------------------------

    @property
    def period(self) -> float:
        """The longest period (s) of the subscribed points; 0 if all are polled on request."""
        if not any(point.subscribe for point in self._points.values()):
            return 0.0
        return self._every if self._reports is None else self._reports.period

    def require(self, name: str, *, writable: bool = False) -> None:
        """Raise WiringError unless the point exists; only the server knows whether it can be written."""
        del writable
        if name not in self._points:
            raise WiringError(
                f"transports.{self.name} has no point {name!r}; {did_you_mean(name, self._points)}"
            )

    def stale(self, name: str) -> float:
        """Return the age (s) above which a point is stale; 0 if it is polled on request."""
        self.require(name)
        return self._stale if self._points[name].subscribe else 0.0

    # -- the connection ------------------------------------------------------------------------------------------

    def connect(self, clock: Clock, lost: OnLost, *, within: float) -> None:
        """Connect and subscribe. Raises LinkLost without an answer ``within`` s, MapMismatch if the server lacks a node
        or a point can never have a value.
        """
        from asyncua import Client

        self._clock, self._reports = clock, None
        self._found = dict(self._ids)
        self._buffer, self._grant = WriteBuffer(), Grant()
        self._loop = EventLoop(self._where)
        self._client = Client(self._keys.url, timeout=self._timeout)
        if self._keys.user is not None:
            self._client.set_user(self._keys.user)
            self._client.set_password(self._keys.password or "")
        try:
            self._run(self._client.connect(), "connecting", within)
            self._listener.open(clock, lost)
            self._resolve(self._client)
            self._look_for_all()
            if self.period:
                self._reports = self._new_reports(clock)
                self._run(self._reports.begin(self._client), "subscribing", within)
        except BenchError:
            self.close()
            raise
        self._listener.every(self._every, self._cycle)
        if self._alive is not None:
            self._listener.every(self._alive[1], self._count)

    def _resolve(self, client: Client) -> None:
        """Find the namespaces given by name. Raises MapMismatch for one that the server does not have."""
        from asyncua import ua

        named = {one: node for one, node in self._ids.items() if isinstance(node, ua.ExpandedNodeId)}
        ask = "reading the namespaces"
        known = self._run(client.get_namespace_array(), ask, self._timeout) if named else []
        for one, node in named.items():
            if node.NamespaceUri not in known:
                raise MapMismatch(
                    f"{self._where} has no namespace {node.NamespaceUri!r}, for {one}; use one of "
                    f"{', '.join(known)}"
                )
            self._found[one] = ua.NodeId(node.Identifier, known.index(node.NamespaceUri), node.NodeIdType)

    def _look_for_all(self) -> None:
        """Raise MapMismatch for points that can never have a value."""
        never = []
        for name, value in zip(self._points, self._values(list(self._points)), strict=True):
            point = self._points[name]
            code = "" if value.StatusCode is None else value.StatusCode.name
            raw = value.Value.Value if value.Value is not None else None
            if reason := NEVER.get(code, "") or point.never(raw):
                never.append(f"{name} ({point.shown}): {reason}")
        if never:
            raise MapMismatch(
                f"{self._where} can never give a value for {'; '.join(never)}; correct or remove these points"
            )

    def _new_reports(self, clock: Clock) -> Reports:
        names: dict[ua.NodeId, list[str]] = {}
        for name, point in self._points.items():
            if point.subscribe:
                names.setdefault(self._found[name], []).append(name)
        return Reports(self._where, names, self._every, self._stale, clock.now, self._number)

    def subscribe(self, receive: OnPoints) -> None:
        """Call ``receive(time, points)`` with the reports of the server from now on, every period."""
        self._listener.subscribe(receive)

    def alive(self) -> float:
        """Return the time (s) since the last answer of the server; infinite before the first one."""
        return self._listener.silence()

    def close(self) -> None:
        """Disconnect. No callback follows after this returns. Repeated calls are harmless."""
        self._listener.close()
        with self._closing:
            loop, self._loop = self._loop, None
            client, self._client = self._client, None
        if loop is not None and client is not None:
            try:
                loop.run(client.disconnect(), _CLOSING)
            except Exception as error:  # an unsubscription may fail, as the server may be gone
                logging.getLogger("asyncua").debug("disconnecting from %s: %s", self._where, error)
            loop.stop()

    # -- reading and writing ---------------------------------------------------------------------------------------

    def read(self, names: Sequence[str]) -> dict[str, float]:
        """Poll points now, in one request. NaN if the status is not good, or the value is not a number."""
        for name in names:
            self.require(name)
        self._listener.check()
        values = self._values(list(names))
        return {name: self._number(name, value) for name, value in zip(names, values, strict=True)}

    def text(self, name: str) -> str:
        """Read a text point from the server now; "" if it has no value."""
        self.require(name)
        self._listener.check()
        (value,) = self._values([name])
        return str(value.Value.Value) if value.Value is not None else ""

    def write(self, points: Mapping[str, float]) -> None:
        """Write points in one request. Raises ValueError before that if one does not fit, Refused if the server rejects
        them.
        """
        from asyncua import ua

        for name in points:
            self.require(name, writable=True)
        self._listener.check()
        if not points:
            return
        client = self._connected()
        raws = {name: self._raw(name, value) for name, value in points.items()}
        with self._writing:
            whole = self._with_the_others(raws)
            values = [ua.DataValue(ua.Variant(raw, self._type(names[0]))) for names, raw in whole.values()]
            what = f"writing {', '.join(points)}"
            ask = client.uaclient.write_attributes(list(whole), values)
            codes = self._run(ask, what, self._timeout)
        for (names, _), code in zip(whole.values(), codes, strict=True):
            if not code.is_good():
                raise Refused(
                    f"writing {', '.join(names)} to {self._where} was refused: {code.name} ({code.doc}); check the "
                    "value and the rights of the user",
                    code.value,
                )

    def _with_the_others(self, raws: Mapping[str, float | bool]) -> dict[ua.NodeId, tuple[list[str], Any]]:
        """Return the points and the value to write by node. Arrays are completed with the present values."""
        elements = [name for name in raws if self._points[name].index is not None]
        first = {self._found[name]: name for name in elements}
        present = self._values(list(first.values())) if first else []
        arrays = {
            node: list(value.Value.Value) if value.Value is not None else []
            for node, value in zip(first, present, strict=True)
        }
        whole: dict[ua.NodeId, tuple[list[str], Any]] = {}
        for name, raw in raws.items():
            node, index = self._found[name], self._points[name].index
            names = whole[node][0] if node in whole else []
            if index is not None:
                if index >= len(arrays[node]):
                    raise Refused(
                        f"{self._where} has no {self._points[name].shown} now, so {name} cannot be "
                        "written; check the length of the array on the server",
                        0,
                    )
                arrays[node][index] = raw
            whole[node] = ([*names, name], raw if index is None else arrays[node])
        return whole

    def stream(self, points: Mapping[str, float], time: int) -> None:
        """Take values that are written with the next period; NaN keeps the previous value. ``time`` is the time of the
        cycle (ns).

        Raises ValueError for a value that does not fit. The first value of a point is not checked here, because its
        type is not yet known.
        """
        self._listener.check()
        news = {name: value for name, value in points.items() if not math.isnan(value)}
        for name, value in news.items():
            self.require(name, writable=True)
            if name in self._types:
                self._raw(name, value)
        self._grant.renew(time)
        self._buffer.put(news)

    def _values(self, names: list[str]) -> list[ua.DataValue]:
        from asyncua import ua

        ask = self._connected().uaclient.read_attributes
        nodes = [self._found[name] for name in names]
        return self._run(ask(nodes, ua.AttributeIds.Value), f"reading {', '.join(names)}", self._timeout)

    def _number(self, name: str, value: ua.DataValue) -> float:
        raw = value.Value.Value if value.Value is not None else None
        good = value.StatusCode is None or value.StatusCode.is_good()
        return self._points[name].number(raw) if good else math.nan

    def _raw(self, name: str, value: float) -> float | bool:
        """Return ``value`` in the type of the variable on the server. Raises ValueError if it does not fit."""
        return self._points[name].raw(name, value, self._type(name).name)

    def _type(self, name: str) -> ua.VariantType:
        """Return the type of a variable, which is read once."""
        if name not in self._types:
            node = self._connected().get_node(self._found[name])
            kind = self._run(
                node.read_data_type_as_variant_type(), f"reading the type of {name}", self._timeout
            )
            self._types[name] = kind
        return self._types[name]

    def begin(self) -> float:
        """Start the heartbeat. Returns the time (s) until it has counted to three, 0 without a heartbeat."""
        self._grant.begin()
        return LIFE_SIGNS * self._alive[1] if self._alive is not None else 0.0

    # -- periodic tasks ------------------------------------------------------------------------------------------

    def _cycle(self) -> None:
        """Write streamed values, and deliver values that the server has changed or confirmed."""
        assert self._clock is not None
        try:
            if values := self._buffer.drain():
                self._buffer.refusal = self._in_background(values, self._buffer.refusal)
            if self._reports is not None:
                for time, points in self._reports.drain():
                    self._listener.receive(time, points)
            self._ask_state()
            if self._reports is not None and self._reports.dropped:
                self._renew(self._reports)
        except LinkLost:
            pass

    def _renew(self, reports: Reports) -> None:
        """Subscribe again. The connection counts as lost if the server answers but does not report for too long."""
        try:
            self._run(reports.renew(self._connected()), "subscribing again", self._timeout)
        except BenchError as error:
            if reports.silence > reports.allowed + self._patience:
                self._listener.lose(f"{self._where} no longer reports values: {error}")

    def _ask_state(self) -> None:
        state = self._connected().nodes.server_state
        self._run(state.read_value(), "reading the server's state", self._timeout)

    def _count(self) -> None:
        assert self._alive is not None and self._clock is not None
        if self._grant.given(self._clock.now()):
            self._cycles += 1
            with contextlib.suppress(LinkLost, Refused):
                highest = _SMALLER_COUNTS.get(self._type(self._alive[0]).name, _COUNT_MAX)
                self._in_background({self._alive[0]: float(self._cycles % (highest + 1))})

    @property
    def refusal(self) -> Refusal | None:
        """The present rejection of set-points by the server; None while it accepts them."""
        return self._buffer.refusal

    def remarks(self) -> list[Remark]:
        """Return remarks on unexpected behaviour of the server, each with whether data are lost."""
        return [] if self._reports is None else self._reports.remarks()

    def _in_background(self, values: Mapping[str, float], before: Refusal | None = None) -> Refusal | None:
        """Write ``values``. Return the rejection by the server, None if it accepts them. ``before`` is the present
        rejection, whose time ``since`` a further rejection keeps.
        """
        assert self._clock is not None
        try:
            self.write(values)
        except (Refused, ValueError) as error:
            refusal = error if isinstance(error, Refused) else Misuse(str(error))
            return Refusal(before.since if before else self._clock.now(), refusal)
        return None

    def _connected(self) -> Client:
        if self._client is None:
            raise LinkLost(f"{self._where} is not connected; connect it first")
        return self._client

    def _run(self, work: Coroutine[Any, Any, T], what: str, within: float) -> T:
        """Return the result of ``work``. Raises LinkLost if the server does not answer ``within`` s."""
        from asyncua import ua

        loop = self._loop
        if loop is None:
            work.close()
            raise LinkLost(f"{self._where} is not connected; connect it first")
        try:
            result = loop.run(work, within)
        except (TimeoutError, CancelledError, asyncio.CancelledError, OSError, ua.UaError) as error:
            cause = error_text(error, within)
            reason = f"{what}: {self._where} failed: {cause}; check that the server runs"
            if self._listener.busy and self._listener.silence() >= self._patience:
                self._listener.lose(reason)
            raise LinkLost(reason) from None
        self._listener.touch()
        return result


def _node_id(place: str, keys: NodeKeys) -> ua.NodeId:
    from asyncua import ua

    if not (keys.scale and math.isfinite(keys.scale) and math.isfinite(keys.offset)):
        raise WiringError(
            f"{place}: scale = {keys.scale:g}, offset = {keys.offset:g} map all values to one number; "
            "use another scale"
        )
    try:
        return ua.NodeId.from_string(keys.node)
    except (ua.UaError, ValueError, TypeError):
        raise WiringError(
            f'{place}: node = {keys.node!r} is not a node id; write it like "ns=2;s=Height", '
            '"ns=2;i=7" or "nsu=urn:cell;s=Height"'
        ) from None
