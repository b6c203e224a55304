"""The connections of the panel: slots for clients with the token, and few slots with time limits for all others.

    listening socket ── Gate ── Requests (HTTP) ── Pages (WebSocket)

A new connection counts as a stranger until a request on it carries the token's cookie. Strangers have few slots for
each address and in all. When these are full, the oldest stranger is disconnected, so that a newcomer can always show
the token. A client with the token has separate slots, and the gate accepts it first, so that strangers cannot block
STOP.
"""

import asyncio
import socket
from collections import Counter, deque
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import uvicorn
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import CloseCode

from astb.panel.access import Access
from bench_protocol.units import minutes, s

#: Maximum number of connections: in all, and for one address. All of them fit into 1024 file descriptors.
KNOWN: Final = 200, 200
STRANGERS: Final = 256, 64
WATCHING_PAGES: Final = 48, 16
#: A stranger's request must be complete within `REQUEST_WITHIN`, and its answer be read within `ANSWER_WITHIN`.
REQUEST_WITHIN: Final = 5 * s
ANSWER_WITHIN: Final = 1 * minutes
#: A page that does not answer gets a ping every `PING` s, and is closed after twice that time.
PING: Final = 5 * s
_CLOSE_WITHIN: Final = 1 * s
#: A connection with the token stays open for this time between requests. `stop.js` uses it every 20 s, because a stop
#: on an open connection does not wait behind new connections.
_KEPT_OPEN: Final = 1 * minutes
#: Number of new connections in one turn of the event loop: few, so that requests with the token are read soon.
_ACCEPTED_AT_ONCE: Final = 8
_QUEUED: Final = 4096  # connections that wait in the kernel until they are accepted
_FIRST_BYTES: Final = 8192  # in which the gate looks for the token


class Room:
    """Slots for connections: ``most`` in all, ``each`` for one address."""

    def __init__(self, most: int, each: int) -> None:
        self._most, self._each = most, each
        self._inside: dict[object, tuple[str, Callable[[], None]]] = {}  # the oldest first
        self._of: Counter[str] = Counter()

    def full(self, address: str) -> bool:
        """Whether there is no slot for another connection of this address."""
        return len(self._inside) >= self._most or self._of[address] >= self._each

    def enter(self, connection: object, address: str, drop: Callable[[], None]) -> None:
        """Give a slot to a connection, which can be closed by ``drop``.

        If there is no slot, the oldest connection is dropped.
        """
        while self.full(address):
            self.drop_oldest(address if self._of[address] >= self._each else "")
        self._inside[connection] = address, drop
        self._of[address] += 1

    def drop_oldest(self, address: str = "") -> None:
        """Drop the oldest connection, of this address or of any."""
        oldest = next((one for one, (of, _) in self._inside.items() if address in {"", of}), None)
        if oldest is not None:
            _, drop = self._inside[oldest]
            self.leave(oldest)
            drop()

    def leave(self, connection: object) -> None:
        """Free the slot of a connection, if it has one."""
        address, _ = self._inside.pop(connection, ("", None))
        if address:
            self._of[address] -= 1
            if not self._of[address]:
                del self._of[address]


class Rooms:
    """The rooms of a panel, and the assignment of connections to them. The rooms are for clients with the token, for
    clients without it (``strangers``), and for pages that watch.
    """

    def __init__(self, access: Access) -> None:
        self._access = access
        self.cookie = f"{access.cookie}={access.token}".encode()
        self.known, self.strangers, self.watching = Room(*KNOWN), Room(*STRANGERS), Room(*WATCHING_PAGES)

    def arrive(self, connection: "Requests | Pages") -> None:
        """Give a new connection a slot among the clients without the token."""
        self.strangers.enter(connection, _address(connection), connection.transport.abort)

    def admit(self, connection: "Requests | Pages") -> bool:
        """Move a connection to the clients with the token if its request shows it; return whether it does."""
        known = self._access.may_command(HTTPConnection(dict(connection.scope)))
        if known:
            self._move(connection, self.known)
        return known

    def watch(self, connection: "Pages") -> bool:
        """Move a page without the token to the pages that watch. Return whether there is a slot."""
        free = not self.watching.full(_address(connection))
        if free:
            self._move(connection, self.watching)
        return free

    def _move(self, connection: "Requests | Pages", room: Room) -> None:
        self.leave(connection)
        room.enter(connection, _address(connection), connection.transport.abort)

    def leave(self, connection: object) -> None:
        """Free the slot of a connection, in whichever room it is."""
        for room in (self.known, self.strangers, self.watching):
            room.leave(connection)


def _address(connection: "Requests | Pages") -> str:
    return connection.client[0] if connection.client else "?"


class Gate:
    """Accepts connections. Each waits as a bare socket, which needs few resources, until its first bytes arrive.

    A client that shows the token is served at once. Of the other clients, one is served in each turn of the event loop.
    """

    def __init__(self, listening: socket.socket, rooms: Rooms, protocol: Callable[[], "Requests"]) -> None:
        self._listening, self._rooms, self._protocol = listening, rooms, protocol
        self._loop = asyncio.get_running_loop()
        self._waiting: dict[socket.socket, asyncio.TimerHandle] = {}
        self._turns: deque[socket.socket] = deque()
        self._served: set[asyncio.Task[Any]] = set()
        listening.setblocking(False)
        listening.listen(_QUEUED)
        self._loop.add_reader(listening, self._accept)

    def close(self) -> None:
        """Accept no more connections, and drop those that wait."""
        self._loop.remove_reader(self._listening)
        for one in tuple(self._waiting):
            self._drop(one)

    def _accept(self) -> None:
        for _ in range(_ACCEPTED_AT_ONCE):
            try:
                one, address = self._listening.accept()
            except BlockingIOError:
                return
            except OSError:  # no descriptor is free
                return self._rooms.strangers.drop_oldest()
            one.setblocking(False)
            self._waiting[one] = self._loop.call_later(REQUEST_WITHIN, self._drop, one)
            self._rooms.strangers.enter(one, address[0], partial(self._drop, one))
            self._loop.add_reader(one.fileno(), self._check_request, one)
            self._check_request(one)

    def _check_request(self, one: socket.socket) -> None:
        if one not in self._waiting:
            return
        try:
            first = one.recv(_FIRST_BYTES, socket.MSG_PEEK)
        except BlockingIOError:
            return
        except OSError:
            first = b""
        self._loop.remove_reader(one.fileno())
        if not first:
            self._drop(one)
        elif self._rooms.cookie in first:
            self._serve(one)
        else:
            self._turns.append(one)
            if len(self._turns) == 1:
                self._loop.call_soon(self._serve_next)

    def _serve_next(self) -> None:
        self._serve(self._turns.popleft())
        if self._turns:
            self._loop.call_soon(self._serve_next)

    def _serve(self, one: socket.socket) -> None:
        if self._forget(one):
            task = self._loop.create_task(self._loop.connect_accepted_socket(self._protocol, one))
            self._served.add(task)
            task.add_done_callback(self._served.discard)

    def _drop(self, one: socket.socket) -> None:
        if self._forget(one):
            self._loop.remove_reader(one.fileno())
            one.close()

    def _forget(self, one: socket.socket) -> bool:
        """Remove a connection from the queue; return whether it was there."""
        if (timer := self._waiting.pop(one, None)) is None:
            return False
        timer.cancel()
        self._rooms.strangers.leave(one)
        return True


class Requests(H11Protocol):
    """A connection with HTTP requests in uvicorn. Without the token, the time for each request is short."""

    def __init__(self, *args: Any, rooms: Rooms, **more: Any) -> None:
        super().__init__(*args, **more)
        self._rooms = rooms
        self.known = False  #: whether a request on it has shown the token
        self._seen: object = None  # the headers that were looked at
        self._deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Register the connection as a stranger."""
        super().connection_made(transport)
        self._rooms.arrive(self)
        self._due(REQUEST_WITHIN)

    def connection_lost(self, exc: Exception | None) -> None:
        """Free the slot of the connection."""
        self._rooms.leave(self)
        self._due(None)
        super().connection_lost(exc)

    def handle_events(self) -> None:
        """Check the headers of each request, and limit the time of a stranger."""
        super().handle_events()
        if self not in self.connections:
            return  # it has become a page
        if self.headers is not self._seen:
            self._seen = self.headers
            self.known = self.known or self._rooms.admit(self)
        if self.known:
            self._due(None)
        elif self.headers and not (self.cycle.more_body or self.cycle.response_complete):
            self._due(ANSWER_WITHIN)

    def on_response_complete(self) -> None:
        """Start the time limit for the next request."""
        if self.known:
            self.timeout_keep_alive = round(_KEPT_OPEN)
        else:
            self._due(REQUEST_WITHIN)
        super().on_response_complete()

    def handle_websocket_upgrade(self, event: Any) -> None:
        """Pass the connection to the protocol of pages, which registers its own slot."""
        self._rooms.leave(self)
        self._due(None)
        super().handle_websocket_upgrade(event)

    def _due(self, within: float | None) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
        self._deadline = None if within is None else self.loop.call_later(within, self.transport.abort)


class Pages(WebSocketsSansIOProtocol):
    """The WebSocket of a page in uvicorn.

    Text that is not UTF-8 closes it with 1007, without a traceback. A stranger's page without a slot is accepted and
    closed at once, so that it can show the reason (``no_place`` in the state of its scope).
    """

    def __init__(self, *args: Any, rooms: Rooms, **more: Any) -> None:
        super().__init__(*args, **more)
        self._rooms = rooms
        self.close_timeout = _CLOSE_WITHIN

    def connection_made(self, transport: Any) -> None:
        """Register the connection as a stranger."""
        super().connection_made(transport)
        self._rooms.arrive(self)

    def connection_lost(self, exc: Exception | None) -> None:
        """Free the slot of the connection."""
        self._rooms.leave(self)
        super().connection_lost(exc)

    def handle_connect(self, event: Any) -> None:
        """Get a slot that later strangers cannot take."""
        super().handle_connect(event)
        if self.close_sent or self._rooms.admit(self):
            return
        if not self._rooms.watch(self):
            self.scope["state"]["no_place"] = "too many pages without the token are open"

    def keepalive_timeout(self) -> None:
        """Close a page that does not answer a ping, even if it reads earlier messages."""
        super().keepalive_timeout()
        self.loop.call_later(_CLOSE_WITHIN, self.transport.abort)

    def send_receive_event_to_app(self) -> None:
        """Pass a message to the application; text that is not UTF-8 ends the connection."""
        if self.curr_msg_data_type == "text" and not self.close_sent:
            try:
                b"".join(self.frames).decode()
            except UnicodeDecodeError:
                self.frames = []
                self.conn.fail(CloseCode.INVALID_DATA, "not UTF-8")  # whether or not it is closing already
                self.transport.write(b"".join(self.conn.data_to_send()))
                self.queue.put_nowait({"type": "websocket.disconnect", "code": int(CloseCode.INVALID_DATA)})
                self.close_sent = True
                self.transport.close()
                return
        super().send_receive_event_to_app()


class Server(uvicorn.Server):
    """uvicorn's server for the panel. A `Gate` accepts its connections."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._rooms = Rooms(access)
        self._gates: list[Gate] = []
        super().__init__(
            uvicorn.Config(
                app,
                ws=partial(Pages, rooms=self._rooms),  # type: ignore[arg-type]
                lifespan="off",
                log_level="error",  # no line on the terminal for each bad request
                access_log=False,
                ws_per_message_deflate=False,
                ws_max_size=64 * 1024,
                ws_ping_interval=PING,
                ws_ping_timeout=PING,
                timeout_graceful_shutdown=1,
            )
        )

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begin to serve."""
        await super().startup([])  # without sockets it accepts no client
        protocol = partial(
            Requests,
            config=self.config,
            server_state=self.server_state,
            app_state=self.lifespan.state,
            rooms=self._rooms,
        )
        self._gates = [Gate(one, self._rooms, protocol) for one in sockets or []]

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Accept no further connections, and end."""
        for gate in self._gates:
            gate.close()
        await super().shutdown(sockets)
