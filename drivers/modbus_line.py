"""A pymodbus client that several ports share, and the assignment of answers to requests.

Answers of Modbus/TCP carry the number of their request. Frames of a serial line carry none: an answer that arrives
after its time-out looks like the answer to the next request. After a lost answer, nothing is sent on such a line for
some time, and its input is discarded. The first answer after that is also discarded.
"""

from __future__ import annotations

import select
import socket
import threading
from collections.abc import Callable
from typing import Final

from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ConnectionException, ModbusException
from pymodbus.framer import FramerSocket
from pymodbus.pdu import ModbusPDU

from bench_protocol.clock import RealClock
from bench_protocol.units import NS, ms
from drivers.modbus_words import HEADER, instead

Client = ModbusTcpClient | ModbusSerialClient

SEE_TO_IT: Final = "; check that the device runs and can be reached"
#: A device that closed so many connections in a row after an answer is assumed to close after each answer.
_HABIT: Final = 2
_PAUSE: Final = round(20 * ms * NS)
_LOOK: Final = round(1 * ms * NS)
#: Functions whose answers repeat the address of the request.
_WRITING: Final = frozenset({5, 6, 15, 16})
#: Time without requests after a lost answer, as a multiple of the time-out.
_SILENT: Final = 2.0
#: Time without requests after a late answer, as a multiple of the slowest answer so far, and at least this time.
_SLOWEST, _GAP_MIN = 2.0, 20 * ms


class SharedClient:
    """A pymodbus client and its connection, used by one port or by several in turn.

    ``each``: open the connection for each request. This is set automatically if the device closes it after each answer.
    ``echo``: only a reply with the unit and transaction number of the request is an answer. Callers of `execute`,
    `lose` or `hang_up` must hold ``lock``.
    """

    def __init__(self, client: Client, where: str, *, each: bool = False, echo: bool = True) -> None:
        self.client, self.where, self.each = client, where, each
        self._clock = RealClock()
        self.lock = threading.Lock()
        self.closings = 0  #: number of connections that the device closed after an answer
        self.discarded = 0  #: answers without a pending request
        self.latest = 0.0  #: s from the request to the answer, of the latest discarded answer
        self._framed = isinstance(client.framer, FramerSocket)
        self._echo = echo or not self._framed
        self._request = self._came = b""
        self._sent = 0  # ns, time of the last request
        self._lost = 0  # ns, when the first request that got no answer was sent; 0 for none
        self._silent_until = 0  # ns
        self._slowest = 0.0  # s, slowest answer within the time-out
        self._answers = 0  # on this connection
        self._in_a_row = 0
        self._there = False
        self._users: set[int] = set()
        client.transaction.trace_packet = self._packet

    def join(self, port: object) -> None:
        """Add ``port`` to those that keep the connection open."""
        self._users.add(id(port))

    def leave(self, port: object) -> None:
        """Remove ``port``, and close the connection if it was the last one."""
        self._users.discard(id(port))
        if not self._users:
            with self.lock:
                self.hang_up()

    @property
    def used(self) -> bool:
        """Whether a port uses the connection."""
        return bool(self._users)

    @property
    def unnumbered(self) -> bool:
        """Whether answers have no number that assigns them to a request."""
        return not self._framed

    def execute(self, request: Callable[[], ModbusPDU], *, repeatable: bool) -> ModbusPDU:
        """Send a request and return the reply.

        A ``repeatable`` request is sent again if the device had closed the connection, or if an earlier answer was
        lost. Other requests are sent again only if this device has closed connections after answers before.
        """
        doubtful = self._settle()
        self._came = b""
        self._detect_closed()
        fresh = not self._answers
        self._connect()
        try:
            reply = request()
            if doubtful and repeatable:
                self._read_empty(self._gap())
                reply = request()
        except (ConnectionException, ConnectionError):  # the device has closed or reset the connection
            if fresh or not (repeatable or self.closings):
                raise
            self._note_closing()
            self.hang_up()
            self._connect()
            reply = request()
        self._check(reply)
        self._lost = 0
        self._slowest = max(self._slowest, (self._clock.now() - self._sent) / NS)
        self._answers += 1
        if self.each:
            self.hang_up()
        return reply

    def _check(self, reply: ModbusPDU) -> None:
        """Raise ModbusException for a reply to another request."""
        pdu = self._request[7 if self._framed else 1 :]
        function = pdu[0]
        if reply.function_code & 0x7F != function:
            raise ModbusException("another function")
        echoes = self.unnumbered and function in _WRITING and not reply.isError()
        if echoes and getattr(reply, "address", None) != int.from_bytes(pdu[1:3], "big"):
            raise ModbusException("another address")

    def lose(self) -> None:
        """Prevent that a late answer to the last request is assigned to the next one. A Modbus/TCP connection is
        closed; on other lines the next request waits for silence.
        """
        if self._framed:
            self.hang_up()
            return
        self._lost = self._lost or self._sent
        # Received bytes were probably a damaged answer.
        wait = self._gap() if self._came else _SILENT * self._timeout()
        start = self._clock.now() if self._came else self._sent
        self._silent_until = start + round(wait * NS)

    def _settle(self) -> bool:
        """Wait until a line is silent after a lost answer, and discard its input; return whether an answer was lost."""
        if not self._lost:
            return False
        left = (self._silent_until - self._clock.now()) / NS
        self._read_empty(max(left, 0.0))
        self.hang_up()
        return True

    def _read_empty(self, within: float) -> None:
        """Discard input for ``within`` s, then until the line is silent, for at most another ``within`` s."""
        came = False
        until = self._clock.now() + round(within * NS)
        end = until + round((within + self._gap()) * NS)
        try:
            while self._receive(min(until, end)):
                came, until = True, self._clock.now() + round(self._gap() * NS)
                self.latest = max(self.latest, (self._clock.now() - (self._lost or self._sent)) / NS)
        except OSError:  # a gateway that closed may deliver the answer to the next client
            self.client.close()
            self._clock.sleep_until(min(until, end))
        self.discarded += came

    def _receive(self, until: int) -> bytes:
        """Return the bytes received until a time (ns), b"" for none. Raises OSError if the connection has ended."""
        found = self.client.socket
        if found is None:
            self._clock.sleep_until(until)
            return b""
        if isinstance(found, socket.socket):
            left = max(0.0, (until - self._clock.now()) / NS)
            if not select.select([found], [], [], left)[0]:
                return b""
            if data := found.recv(4096):
                return data
            raise ConnectionResetError
        while not found.in_waiting:
            if self._clock.now() >= until:
                return b""
            self._clock.sleep_until(min(until, self._clock.now() + _LOOK))
        return bytes(found.read(found.in_waiting))

    def _gap(self) -> float:
        return max(_SLOWEST * self._slowest, _GAP_MIN)

    def _timeout(self) -> float:
        return self.client.comm_params.timeout_connect or 0.0

    def reason(self, error: Exception) -> str:
        """Return as text why there was no reply."""
        if isinstance(error, ConnectionException | ConnectionError):
            if not self._there:
                return "no connection; check that the rig runs"
            if self._answers:
                return 'the device closed the connection; if it does so after each answer, set connection = "each"'
            return (
                "the device closes the connection before it answers; it may accept only one client at "
                "a time, and another client is connected"
            )
        if isinstance(error, OSError):
            return error.strerror or "the connection broke"
        came = instead(self._request, self._came, framed=self._framed)
        if isinstance(error, ModbusException) and "No response received" not in str(error):
            return f"the device sent bytes that are not an answer to the request{came}"
        return f"the device does not answer in {self._timeout():g} s{came or SEE_TO_IT}"

    def hang_up(self) -> None:
        """Close the connection; the next request opens it again."""
        self.client.close()
        self._answers = 0

    def _packet(self, sending: bool, data: bytes) -> bytes:
        """Record sent or received bytes and return them. Without ``echo``, answers get the numbers of the request."""
        if sending:
            self._request, self._sent = data, self._clock.now()
        else:
            self._came = data
            self._count_others(data)
            if not self._echo and len(data) >= HEADER.size:
                return self._request[:2] + data[2:6] + self._request[6:7] + data[7:]
        return data

    def _count_others(self, data: bytes) -> None:
        """Count complete Modbus/TCP answers to earlier requests, which a gateway may deliver after the time-out."""
        at = 0
        while self._framed and self._echo and len(data) >= at + HEADER.size:
            number, _, length, _ = HEADER.unpack_from(data, at)
            at += HEADER.size - 1 + length
            self.discarded += at <= len(data) and self._request[:2] != number.to_bytes(2, "big")

    def _detect_closed(self) -> None:
        """Close the connection if the device has closed it, or has sent more bytes, since its last answer. If answers
        have no number, only discard the bytes.
        """
        found = self.client.socket
        if not isinstance(found, socket.socket):
            if found is not None and found.in_waiting:
                self._read_empty(0.0)
            return
        if not select.select([found], [], [], 0)[0]:
            self._in_a_row = self._in_a_row if self._answers < _HABIT else 0
            return
        try:
            ended = found.recv(1, socket.MSG_PEEK) == b""
        except OSError:
            ended = True
        if ended:
            self._note_closing()
        elif self.unnumbered:
            self._read_empty(0.0)
            return
        else:
            self.discarded += 1
        self.hang_up()

    def _note_closing(self) -> None:
        self.closings += 1 if self._answers else 0
        self._in_a_row = self._in_a_row + 1 if self._answers == 1 else 0
        self.each = self.each or self._in_a_row >= _HABIT

    def _connect(self) -> None:
        """Connect if necessary. If a device closes connections, try again until the time-out."""
        self._there = False
        deadline = self._clock.now() + round(self._timeout() * NS)
        while not self.client.connect():
            if not (self.each or self.closings) or self._clock.now() >= deadline:
                raise ConnectionException("nobody there")
            self._clock.sleep_until(self._clock.now() + _PAUSE)
        self._there = True
