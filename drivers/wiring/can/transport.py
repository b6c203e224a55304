"""A transport on CAN: points are signals of messages, received, streamed at the rig's rate or written once.

::

    [transports.bus]
    kind = "can"
    bus = "can0"                  # auto | tcp (a socketcand server at host, port) | an interface
    # or a bus of python-can: interface = "slcan", channel = "/dev/ttyACM0", options = { bitrate = 500000 }
    dbc = "plant_b.dbc"           # or another file that cantools reads; without it, ids and bits as below
    charset = "cp1250"            # of the DBC; default: UTF-8 if the whole file is, or else cp1252
    fd = false                    # true: CAN FD, messages of up to 64 bytes
    bitrate_switch = false        # true: we send the data of CAN FD frames at the fast rate
    j1939 = true                  # identify messages with 29 bits by their group; default: as in the DBC
    node = "BENCH"                # our node in the DBC: only its messages can be written; optional
    stale = "100 ms"              # per page; default: three times the cycle time in the DBC, at least 100 ms
    burst = "5 ms"                # frames within this time after the first one get its time stamp; optional
    burst_begins = "Heights"      # first message of a burst; default: the next frame after a burst
    answers = true                # false for a rig that sends nothing by itself

    [transports.bus.messages.Setpoints]
    every = "10 ms"               # period, once all its signals have a value; default: sent when written
    counter = "Alive"             # from 0 to the maximum of its bits, or to counter_period
    checksum = { signal = "Crc", scheme = "xor8", start = 0xA5, identifier = true }  # | sum8 | e2e_p1 | function:NAME
    values = { Reserved = 0 }     # of signals that nothing else writes
    source = 0x27                 # J1939: address of the sender, or ours if we send

    [transports.bus.messages."*"] # default for all messages with such signals
    counter = "Alive"
    checksum = { signal = "Crc", scheme = "sum8" }

    [transports.bus.messages.Cells]                     # without a DBC
    id = 0x18FF1004
    length = 8

    [transports.bus.points]
    "Cells.Cell1" = { start = 7, length = 16, byte_order = "big", signed = true, scale = 0.5, null = -32768 }
    "Heights.Left" = { null = [65534, 65535] }     # with a DBC: raw values without a measurement; default: values
                                                   # that the DBC names so ("SNA", "Fehler")

Counters and checksums are filled in when a message is sent and checked when it is received. Frames with errors are
counted (``counts``) and discarded. If a frame is shorter than described, the signals that fit are read. With J1939,
priority and addresses are ignored, and the codes FE and FF mean "no value". If two nodes send one group, only the first
is received. Stamps of the interface's own clock are used where it has one. A multiplexed message is sent page by page.
Nothing is sent before a user commands; then signals without a written value use the start values in the DBC, except
set-points. Periodic messages pause when a stream of set-points has stopped, so that the rig detects a failed bench.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench_protocol import j1939
from bench_protocol.clock import Clock, VirtualClock
from bench_protocol.frames import LENGTH_MAX, frame, join, payload
from bench_protocol.suggestion import did_you_mean
from bench_protocol.units import NS, ms
from drivers.can_fd import FD_LENGTH_MAX, Fd, fd_frame
from drivers.can_port import open_bus, open_can
from drivers.errors import LinkLost, WiringError
from drivers.stamps import UNCERTAINTY, StampClock
from drivers.wiring.can.keys import CanKeys
from drivers.wiring.can.message import Message
from drivers.wiring.can.messages import read_messages
from drivers.wiring.can.reception import Reception
from drivers.wiring.contract import OnLost, OnPoints, Remark, Stamp, Transport
from drivers.wiring.keys import convert, duration
from drivers.wiring.listener import LIFE_SIGNS, Grant, Listener

if TYPE_CHECKING:
    from bench_protocol.frames import Block
    from drivers.can_port import CanPort

_LOOK: Final = round(5 * ms * NS)


class CanTransport(Transport):
    """A `Transport` on a CAN bus. The constructor raises WiringError for an invalid description.

    ``functions`` is the Python file of the description. ``port`` opens a bus that replaces the described one. Start
    values of the DBC are not sent for the points ``streamed``: a set-point has no value until a command sets it.
    """

    def __init__(
        self,
        name: str,
        table: Mapping[str, Any],
        where: Path,
        *,
        functions: Path | None = None,
        port: Callable[[], CanPort] | None = None,
        streamed: Collection[str] = (),
    ) -> None:
        place = f"transports.{name}"
        self.name, self._keys, self._opener = name, convert(place, table, CanKeys), port
        keys = self._keys
        stale = None if keys.stale is None else duration(f"{place}: stale", keys.stale)
        self._burst = 0 if keys.burst is None else round(duration(f"{place}: burst", keys.burst) * NS)
        self._burst_began = 0
        self._messages = read_messages(place, table, where, functions, stale)
        if not self._messages:
            raise WiringError(
                f"{place}: there are no messages; set dbc to a file with messages, or state the id of "
                "each message"
            )
        for point in streamed:
            message, signal = self._find(point)
            if signal not in message.keys.values:
                message.given.pop(signal, None)
        self._reception = Reception(self._messages, lambda message: message in self._ours)
        self._ours = {one.name for one in self._messages.values() if one.every}
        if keys.node is not None:
            self._check_node(place, keys.node)
        if keys.burst_begins is not None:
            self._check_burst(place, keys.burst_begins)
        self._where = f"{name} on {keys.channel or keys.bus}"
        self._listener, self._grant = Listener(self._where), Grant()
        self._latest: dict[str, float] = {}
        self._times: dict[str, int] = {}
        self._lock = threading.RLock()
        self._port: CanPort | None = None
        self._clock: Clock | None = None
        self._stamps: StampClock | None = None  # None in virtual time: stamps use the clock of the bench
        self._turns: dict[str, int] = {}

    def _check_burst(self, place: str, first: str) -> None:
        if not self._burst:
            raise WiringError(
                f'{place}: burst_begins needs burst, the longest duration of a burst; add burst = "5 ms"'
            )
        if first not in self._messages:
            raise WiringError(
                f"{place}: burst_begins = {first!r} is not a message; {did_you_mean(first, self._messages)}"
            )
        if first in self._ours:
            raise WiringError(
                f"{place}: burst_begins = {first!r} is sent by this computer; use a message that the "
                "rig sends"
            )

    def _check_node(self, place: str, node: str) -> None:
        nodes = {sender for one in self._messages.values() for sender in one.coding.senders}
        if node not in nodes:
            raise WiringError(
                f"{place}: node = {node!r} sends nothing in the DBC; {did_you_mean(node, nodes)}"
            )
        for name in sorted(self._ours):
            if node not in self._messages[name].coding.senders:
                senders = ", ".join(self._messages[name].coding.senders)
                raise WiringError(
                    f"{place}.messages.{name}: the key every is only for messages that {node} sends, but "
                    f"{senders} sends this one; remove the key"
                )
        self._ours = {one.name for one in self._messages.values() if node in one.coding.senders}

    @property
    def counts(self) -> dict[str, dict[str, int]]:
        """Frames that were lost, repeated, corrupt, short, of an unknown page or another source, by message."""
        return self._reception.counts

    def remarks(self) -> list[Remark]:
        """Return remarks on frames that were dropped or read in part, and on other frames on the bus."""
        return self._reception.remarks()

    def stamp(self, name: str) -> Stamp | None:
        """Return the clock that stamps the message of a point; None for a bus in memory, which uses the clock of the
        bench.
        """
        clock = getattr(self._port, "stamped_by", None)
        if clock is None:
            return None
        shared = self.name if self._burst else f"{self.name}.{self._find(name)[0].name}"
        return Stamp(clock, UNCERTAINTY[clock], shared)

    # -- points --------------------------------------------------------------------------------------------------

    @property
    def period(self) -> float:
        """The longest period (s) of the received messages, taken as a third of the time after which they are stale; 0
        without any.
        """
        return max(
            (one.stale / 3 for one in self._messages.values() if one.name not in self._ours), default=0.0
        )

    def require(self, name: str, *, writable: bool = False) -> None:
        """Raise WiringError unless the point ``Message.Signal`` exists, in one of our messages if ``writable``."""
        message, signal = self._find(name)
        place = f"transports.{self.name}: {name}"
        if message.refused:
            raise WiringError(
                f"{place} cannot be used: {message.refused}; use another DBC, or state id and points"
            )
        if message.coding.length > (FD_LENGTH_MAX if self._keys.fd else LENGTH_MAX):
            raise WiringError(
                f"{place}: {message.name} has {message.coding.length} bytes, but a CAN frame carries "
                "8; set fd = true for CAN FD, which carries 64"
            )
        if reason := message.unreadable(signal):
            raise WiringError(f"{place} cannot be read: {reason}; use another DBC, or state id and points")
        if not writable:
            return
        if reason := message.decoding.message.unsound:
            raise WiringError(f"{place} cannot be sent: {reason}; use another DBC, or state id and points")
        if signal in message.guards:
            raise WiringError(f"{place} is written by the transport; remove it from the orders")
        if not message.sendable:
            raise WiringError(
                f"{place}: {message.name} has pages within pages (nested multiplexing), so it can be "
                "read but not written; use a point in another message"
            )
        if self._keys.node is not None and message.name not in self._ours:
            raise WiringError(
                f"{place} is sent by {', '.join(message.coding.senders)}, not by {self._keys.node}; "
                "correct node, or use another message"
            )
        if message.j1939 and j1939.source_of(message.identifier) == j1939.NOBODY:
            raise WiringError(
                f"{place}: in the DBC {message.name} has the null address 0xFE as its source; state "
                f"the address of this computer, such as source = 0x27, in messages.{message.name}"
            )

    def _find(self, name: str) -> tuple[Message, str]:
        head, _, signal = name.partition(".")
        message = self._messages.get(head)
        if message is None:
            raise WiringError(
                f"transports.{self.name} has no message for {name!r}; {did_you_mean(head, self._messages)}"
            )
        if signal not in message.limits:
            raise WiringError(
                f"transports.{self.name}: {head} has no signal {signal!r}; {did_you_mean(signal, message.limits)}"
            )
        return message, signal

    def stale(self, name: str) -> float:
        """Return the time (s) without its message after which a point is stale."""
        return self._find(name)[0].stale

    @property
    def waiting(self) -> dict[str, list[str]]:
        """Cyclic messages that cannot be sent yet, each with the signals that have no value."""
        with self._lock:
            lacking = {
                name: one.missing(None)
                for name, one in self._messages.items()
                if one.every and not one.selector
            }
        return {name: missing for name, missing in lacking.items() if missing}

    # -- the connection ------------------------------------------------------------------------------------------

    def connect(self, clock: Clock, lost: OnLost, *, within: float) -> None:
        """Join the bus and wait for the rig's first message, unless the rig sends nothing by itself (``answers =
        false``). Raises LinkLost if none arrives ``within`` s.
        """
        self._clock, self._grant = clock, Grant()
        self._stamps = None if isinstance(clock, VirtualClock) else StampClock()
        self._latest, self._times = {}, {}
        self._reception.begin()
        for message in self._messages.values():
            message.begin()
        port = self._opener() if self._opener is not None else self._join()
        self._port = port
        losses: list[str] = []
        self._listener.open(clock, losses.append)
        port.subscribe(self._receive)
        port.on_lost(self._listener.lose)
        periods = {one.every for one in self._messages.values() if one.every}
        for period in sorted(periods):
            self._listener.every(period, partial(self._send_cyclic, period))
        deadline = clock.now() + round(within * NS)
        while self._keys.answers and not self._latest and not losses and clock.now() < deadline:
            clock.sleep_until(min(deadline, clock.now() + _LOOK))
        if losses or (self._keys.answers and not self._latest):
            self.close()
            silent = f"{self._where}: none of its {len(self._messages)} messages came in {within:g} s"
            came = self._reception.instead()
            raise LinkLost(losses[0] if losses else f"{silent}; " + (came or "check that the rig runs"))
        self._listener.when_lost(lost)

    def _join(self) -> CanPort:
        keys = self._keys
        fd = Fd(keys.bitrate_switch) if keys.fd else None
        if keys.interface is not None:
            return open_bus(keys.interface, keys.channel, keys.options, fd=fd)
        return open_can(keys.bus, host=keys.host, port=keys.port, fd=fd)

    def subscribe(self, receive: OnPoints) -> None:
        """Call ``receive(time, points)`` with each valid message from now on."""
        self._listener.subscribe(receive)

    def alive(self) -> float:
        """Return the time (s) since the last valid message; infinite before the first."""
        return self._listener.silence()

    def close(self) -> None:
        """Leave the bus. No callback follows after this returns. Repeated calls are harmless."""
        self._listener.close()
        if self._port is not None:
            self._port.close()

    # -- receiving -------------------------------------------------------------------------------------------------

    def _receive(self, block: Block) -> None:
        if self._stamps is not None:
            assert self._clock is not None
            block = self._stamps.times(block, self._clock)
            block["time"] = np.minimum(block["time"], self._clock.now())
        for record in block:
            time = int(record["time"])
            message = self._reception.message(int(record["id"]), bool(record["extended"]), time)
            if message is not None:
                self._decode(message, payload(record), self._sampled(message, time))

    def _sampled(self, message: Message, time: int) -> int:
        """Return the sampling time (ns) of a message received at ``time``: the time of the first message of its burst.
        A rig samples all signals together, then sends their frames. If the first message of a burst is known, a long
        burst is not split in two.
        """
        if 0 <= time - self._burst_began < self._burst and message.name != self._keys.burst_begins:
            return self._burst_began
        if self._keys.burst_begins in (None, message.name):
            self._burst_began = time
        return time

    def _decode(self, message: Message, data: bytes, time: int) -> None:
        note = partial(self._reception.note, message)
        sound = message.sound(data)
        values = message.decode(data) if sound else {}
        if (
            not values
        ):  # wrong checksum or too short for any value; else an unknown page of a multiplexed message
            note("unknown" if sound and len(data) >= message.coding.length else "corrupt")
            return
        if message.keys.counter:
            counter = message.points[message.keys.counter]
            if counter not in values:
                note("corrupt")
                return
            count = int(values[counter])
            step = (count - message.last_counter) % message.counter_period
            if message.when >= 0 and time - message.when < message.stale * NS:
                if step == 0:
                    message.when = (
                        time  # the message still arrives: with a constant counter it never has new data
                    )
                    note("repeated")
                    return
                note("lost", step - 1)
            message.last_counter, message.when = count, time
        self._reception.received[message.name] += 1
        note("short", int(len(data) < message.coding.length))
        with self._lock:
            self._latest.update(values)
            self._times.update(dict.fromkeys(values, time))
        self._listener.receive(time, values)

    def read(self, names: Sequence[str]) -> dict[str, float]:
        """Return the latest values; NaN for stale or missing values. A bus cannot be polled."""
        for name in names:
            self.require(name)
        self._listener.check()
        assert self._clock is not None
        now = self._clock.now()
        with self._lock:
            found = {name: (self._latest.get(name, math.nan), self._times.get(name, -1)) for name in names}
        return {
            name: value if time >= 0 and now - time <= self.stale(name) * NS else math.nan
            for name, (value, time) in found.items()
        }

    # -- sending ---------------------------------------------------------------------------------------------------

    def begin(self) -> float:
        """Start the cyclic messages. Returns the time (s) until the slowest of them was sent three times."""
        self._grant.begin()
        return LIFE_SIGNS * max((one.every for one in self._messages.values()), default=0.0)

    def write(self, points: Mapping[str, float]) -> None:
        """Send points in the given order, neighbours of one message in one frame. Raises ValueError if one does not
        fit, or if its message has a signal without a value.
        """
        taken = self._taken(points)
        self._listener.check()
        self._grant.begin()
        with self._lock:
            for (name, of_point), group in groupby(taken, lambda one: (one[0].name, one[0].page_of(one[1]))):
                message = self._messages[name]
                self._ours.add(name)
                message.values.update({signal: value for _, signal, value in group})
                page = of_point
                if page is None and message.selector:
                    page = int(message.values.get(message.selector, message.pages()[0]))
                if missing := message.missing(page):
                    raise ValueError(
                        f"{message.name} cannot be sent: {', '.join(missing)} has no value yet; send a "
                        f"value too, or set a fixed one with values = {{ {missing[0]} = … }} in "
                        f"messages.{message.name}"
                    )
                self._send([message.encode(page)], [message])

    def stream(self, points: Mapping[str, float], time: int) -> None:
        """Store values of points for the next frames of their messages; NaN keeps the previous value. ``time`` is the
        time of the cycle (ns).
        """
        taken = self._taken({name: value for name, value in points.items() if not math.isnan(value)})
        self._listener.check()
        with self._lock:
            self._grant.renew(time)
            for message, signal, value in taken:
                if not message.every:
                    raise WiringError(
                        f"transports.{self.name}: {message.name}.{signal} is streamed, so messages.{message.name} "
                        'needs its period; add every = "10 ms"'
                    )
                message.values[signal] = value

    def _taken(self, points: Mapping[str, float]) -> list[tuple[Message, str, float]]:
        taken = []
        for name, value in points.items():
            self.require(name, writable=True)
            message, signal = self._find(name)
            low, high = message.limits[signal]
            if not low <= value <= high:
                raise ValueError(f"{name} = {value:g} does not fit in the signal; use {low:g} to {high:g}")
            taken.append((message, signal, float(value)))
        return taken

    def _send_cyclic(self, period: float) -> None:
        assert self._clock is not None
        if not self._grant.given(self._clock.now()):
            return
        with self._lock:
            due = []
            for message in self._messages.values():
                if message.every == period:
                    every_page: list[int | None] = [*message.pages()] or [None]
                    pages = [page for page in every_page if not message.missing(page)]
                    if pages:
                        turn = self._turns.get(message.name, 0)
                        self._turns[message.name] = turn + 1
                        due.append((message, message.encode(pages[turn % len(pages)])))
            try:
                self._send([data for _, data in due], [message for message, _ in due])
            except LinkLost as error:
                self._listener.lose(str(error))

    def _send(self, data: Sequence[bytes], messages: Sequence[Message]) -> None:
        assert self._clock is not None and self._port is not None
        now = self._clock.now()
        block = join(self._frame(message, one, now) for message, one in zip(messages, data, strict=True))
        if block.size:
            self._port.send(block)

    def _frame(self, message: Message, data: bytes, now: int) -> Block:
        extended = bool(message.coding.is_extended_frame)
        if self._keys.fd:
            return fd_frame(message.identifier, data, now, extended=extended, classic=not message.fd)
        return frame(message.identifier, data, now, extended=extended)
