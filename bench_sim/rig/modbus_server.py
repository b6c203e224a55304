"""The rig's Modbus/TCP server. It reads requests from each client and writes the answers."""

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Final

from bench_protocol import modbus
from bench_sim.rig.connection import Connection, OnPeerLost, ignore
from bench_sim.rig.peers import MODBUS
from bench_sim.rig.places import Holds, Places

Answer = Callable[[bytes, str], bytes | None]
Pieces = Callable[[bytes], Sequence[tuple[float, bytes]]]

# Some 0.5 ms of work for one client before the others have their turn.
_REQUESTS_AT_ONCE: Final = 64


def _at_once(response: bytes) -> Sequence[tuple[float, bytes]]:
    """Return an answer as a single piece without delay."""
    return ((0.0, response),)


class _ModbusClient(Connection):
    """One Modbus connection."""

    kind = MODBUS

    def __init__(self, server: "ModbusTcpServer") -> None:
        super().__init__()
        self._server = server
        self._stream = modbus.AduStream()
        self._requests: deque[bytes] = deque()
        self._pieces: deque[tuple[float, bytes]] = deque()  # of answers that take their time: when, what
        self._blocked = False
        self._closing = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        if not self._server.admit(self):
            self.drop()
            return
        self._expect()

    def connection_lost(self, exc: Exception | None) -> None:
        del exc
        self.stop_timer()
        self._requests.clear()
        self._pieces.clear()
        self._server.forget(self)

    def data_received(self, data: bytes) -> None:
        try:
            adus = self._stream.feed(data)
            while adus:
                self._requests.extend(adus)
                adus = self._stream.feed(b"")
        except modbus.FramingError:
            # Whatever was understood is answered; behind a wrong header nothing can be.
            self._closing = True
        self._respond()

    def _respond(self) -> None:
        """Answer received requests in portions, so that no client blocks the others."""
        assert self.transport is not None
        if self._blocked or self._pieces or self.transport.is_closing():
            return
        portion = [self._requests.popleft() for _ in range(min(_REQUESTS_AT_ONCE, len(self._requests)))]
        responses = [self._server.respond(request, self.name) for request in portion]
        self._send(response for response in responses if response)
        if self._pieces:
            self.transport.pause_reading()
            return
        if self._blocked:
            return
        if self._requests:
            self.transport.pause_reading()
            self.loop.call_soon(self._respond)
        elif self._closing:
            self.transport.close()
            self.drop_after(self._server.split_limit)
        else:
            self.transport.resume_reading()
            self._expect()

    def _send(self, responses: Iterable[bytes]) -> None:
        """Send the pieces of answers that are due now, and keep the others until their time."""
        now = when = self.loop.time()
        for response in responses:
            for gap, piece in self._server.pieces(response):
                when += gap
                self._pieces.append((when, piece))
        self._send_due(now)

    def _send_due(self, now: float) -> None:
        assert self.transport is not None
        due = []
        while self._pieces and self._pieces[0][0] <= now:
            due.append(self._pieces.popleft()[1])
        self.transport.write(b"".join(due))
        if self._pieces:
            self.loop.call_at(self._pieces[0][0], self._send_next_piece)

    def _send_next_piece(self) -> None:
        """Send the next piece. After the last one, answer the requests that have arrived meanwhile."""
        if self.transport is None or self.transport.is_closing() or not self._pieces:
            return
        self._send_due(self._pieces[0][0])
        if not self._pieces:
            self._respond()

    def _expect(self) -> None:
        """Start the time limit for the next request. It is short if a part of the request has arrived."""
        server = self._server
        self.drop_after(server.split_limit if self._stream.partial else server.idle_limit)

    def spared(self) -> bool:
        idle = not (self._stream.partial or self._blocked or self._closing)
        return idle and self._server.commands(self.name)

    def pause_writing(self) -> None:
        """Stop reading from a client that does not read its answers. It is disconnected unless it reads within
        ``split_limit`` s.
        """
        self._blocked = True
        assert self.transport is not None
        self.transport.pause_reading()
        self.drop_after(self._server.split_limit)

    def resume_writing(self) -> None:
        self._blocked = False
        self._respond()


class ModbusTcpServer:
    """A Modbus/TCP server. ``answer(adu, peer)`` returns the response ADU, or None for no response.

    Pipelined and split requests are allowed. A connection ends after a wrong header, after ``idle_limit`` s of
    silence, and after ``split_limit`` s with an incomplete request or unread answers. If ``answer`` raises an error,
    the client receives exception 4, and the loop's exception handler receives the error. ``pieces(response)`` returns
    the pieces of an answer, each with the time (s) since the previous one.

    One connection beyond ``clients_max`` is reserved for the holder of the lease (``holds(peer)``). The holder has no
    time limit for silence while it sends commands on CAN (``commands(peer)``).
    """

    def __init__(
        self,
        answer: Answer,
        on_peer_lost: OnPeerLost = ignore,
        *,
        pieces: Pieces = _at_once,
        idle_limit: float = 60.0,
        split_limit: float = 5.0,
        clients_max: int = 64,
        holds: Holds | None = None,
        commands: Holds = lambda peer: False,
    ) -> None:
        self.idle_limit = idle_limit
        self.split_limit = split_limit
        self.pieces = pieces
        self._answer = answer
        self._on_peer_lost = on_peer_lost
        self.commands = commands
        self._clients: Places[_ModbusClient] = Places(clients_max, holds)
        self._closed = False
        self._loop: asyncio.AbstractEventLoop | None = None

    @property
    def clients(self) -> tuple[str, ...]:
        """Return the names of the connected clients."""
        return tuple(client.name for client in self._clients)

    def open(self) -> None:
        self._closed, self._loop = False, asyncio.get_running_loop()

    def close(self) -> None:
        self._closed = True
        for client in self._clients:
            client.drop()

    def cut(self) -> None:
        """Close all connections and refuse new ones until `restore`. Callable from any thread."""
        self._soon(self.close)

    def restore(self) -> None:
        """Accept clients again. Callable from any thread."""
        self._soon(self.open)

    def _soon(self, do: Callable[[], None]) -> None:
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # the loop has been closed in the meantime
                self._loop.call_soon_threadsafe(do)

    def client(self) -> asyncio.Protocol:
        """Return the protocol object of a new connection."""
        return _ModbusClient(self)

    def admit(self, client: _ModbusClient) -> bool:
        return not self._closed and self._clients.admit(client)

    def forget(self, client: _ModbusClient) -> None:
        if self._clients.leave(client):
            self._on_peer_lost(client.name)

    def respond(self, request: bytes, peer: str) -> bytes | None:
        try:
            return self._answer(request, peer)
        except Exception as error:
            asyncio.get_running_loop().call_exception_handler(
                {"message": f"a Modbus request of {peer} failed: {request.hex(' ')}", "exception": error}
            )
            return modbus.refuse(request, modbus.DEVICE_FAILURE)
