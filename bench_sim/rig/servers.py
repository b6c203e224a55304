"""The rig's two doors to the network: a CAN hub that speaks socketcand and a Modbus/TCP server, on asyncio.

This is the only asynchronous module. It knows neither the rig nor the plant, only callables: frames and requests go
in, frames and answers come out. Everything runs on one loop in one background thread (``serve_in_thread``), and the
callables are called there, one at a time; they must return within a fraction of a millisecond.
"""

import asyncio
import contextlib
import ipaddress
import socket
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, Final, Self

from bench_protocol import modbus, socketcand
from bench_protocol.clock import hurry, wall_time_ns
from bench_protocol.frames import FRAME, Block

OnFrames = Callable[[Block, str], None]
OnPeerLost = Callable[[str], None]
Answer = Callable[[bytes, str], bytes | None]

#: Below the tick. A server that waits for a processor while it holds the interpreter would hold up the tick as well.
_PRIORITY: Final = 5
#: The port socketcand is known by.
CAN_PORT: Final = 29536
_BEACON_ADDRESS: Final = ("127.255.255.255", 42000)
_BEACON_PERIOD: Final = 3.0  # s, the longest the protocol allows
# Written at once to one client. Larger blocks are cut, so that "drop the oldest" never drops a whole burst.
_FRAMES_PER_WRITE: Final = 1024
# Some 0.5 ms of work for one client before the others have their turn.
_REQUESTS_AT_ONCE: Final = 64


def _nobody(_: str) -> None:
    pass


class _Peer(asyncio.Protocol):
    """What the clients of both servers have in common: a name, a socket that notices death, one end."""

    kind: str

    def __init__(self) -> None:
        self.name = ""
        self.transport: asyncio.Transport | None = None
        self.loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._deadline = 0.0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        # A client that is gone again already has no address any more.
        host, port = (transport.get_extra_info("peername") or ("unknown", 0))[:2]
        self.name = f"{self.kind}:{host}:{port}"
        sock = transport.get_extra_info("socket")
        with contextlib.suppress(OSError):
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            # A peer whose machine has lost its power says no good-bye: ask after 5 s, give up after 5 s more.
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            for option, value in (("TCP_KEEPIDLE", 5), ("TCP_KEEPINTVL", 1), ("TCP_KEEPCNT", 5)):
                if hasattr(socket, option):
                    sock.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)

    def drop_after(self, delay: float) -> None:
        """End the connection after ``delay`` s unless a new delay is set or the timer is stopped before."""
        # A timer that runs is left to run and looks at the deadline only then: setting a new one costs nothing.
        self._deadline = self.loop.time() + delay
        if self._timer is None or self._timer.when() > self._deadline:
            self.stop_timer()
            self._timer = self.loop.call_at(self._deadline, self._due)

    def _due(self) -> None:
        self._timer = None
        if self.loop.time() < self._deadline:
            self._timer = self.loop.call_at(self._deadline, self._due)
        else:
            self.drop()

    def stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    @property
    def waiting(self) -> bool:
        """Whether the timer runs."""
        return self._timer is not None

    def drop(self) -> None:
        """End the connection without waiting for the peer to take what is still to be sent."""
        if self.transport is not None:
            self.transport.abort()


class _CanClient(_Peer):
    """One socketcand client of the hub."""

    kind = "can"

    def __init__(self, hub: "CanHub") -> None:
        super().__init__()
        self._hub = hub
        self._parser = socketcand.Parser(sender="the client")
        self._opened = False
        self._raw = False
        self._settling = False
        self._blocked = False
        self._queue: deque[tuple[int, bytes]] = deque()
        self._queued = 0
        self._bad_lines = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        if not self._hub.admit(self):
            self.drop()
            return
        self._write(socketcand.GREETING)

    def connection_lost(self, exc: Exception | None) -> None:
        del exc
        self.stop_timer()
        self._queue.clear()
        self._hub.forget(self)

    def data_received(self, data: bytes) -> None:
        for event in self._parser.feed(data):
            match event:
                case socketcand.Sent(block) if self._opened:
                    self._hub.take(block, self)
                case socketcand.Sent() | socketcand.Received():
                    self._refuse("frames are taken as < send … >, after < open … >")
                case socketcand.Command(word, arguments):
                    self._command(word, arguments)
                case socketcand.Malformed(reason):
                    self._refuse(reason)

    def _command(self, word: str, arguments: tuple[str, ...]) -> None:
        bus = self._hub.bus
        if word == "open" and arguments == (bus,):
            self._opened = True
            self._write(socketcand.OK)
        elif word == "open":
            self._refuse(f"this hub serves {bus}, not {' '.join(arguments) or 'a bus without name'}")
        elif word == "echo":
            self._write(socketcand.ECHO)
        elif word == "rawmode" and self._opened:
            self._write(socketcand.OK)
            if not self._raw:
                self._raw = True
                # python-can's own client reads this answer with one recv and fails if a frame comes along with it.
                self._settling = True
                self.loop.call_later(self._hub.first_frame_delay, self._settled)
        elif word == "bcmmode" and self._opened:
            self._raw = False
            self._write(socketcand.OK)
        else:
            self._refuse(f"'{word}' is not served here, this hub knows open, rawmode, bcmmode, send, echo")

    def _refuse(self, reason: str) -> None:
        self._bad_lines += 1
        if self._bad_lines > self._hub.bad_lines_max:
            self.drop()
        else:
            self._write(socketcand.error_bytes(reason))

    def _write(self, data: bytes) -> None:
        if self.transport is not None and not self.transport.is_closing():
            self.transport.write(data)

    def deliver(self, count: int, lines: bytes) -> None:
        """Send ``count`` frames now, or keep them, at the price of the oldest if the queue is full."""
        if not self._raw:
            return
        if not (self._blocked or self._settling):
            self._write(lines)
            return
        self._queue.append((count, lines))
        self._queued += count
        while self._queued > self._hub.queue_max:
            lost, _ = self._queue.popleft()
            self._queued -= lost
            self._hub.dropped += lost

    def pause_writing(self) -> None:
        self._blocked = True
        if not self.waiting:
            self.drop_after(self._hub.slow_limit)

    def resume_writing(self) -> None:
        self._blocked = False
        self._catch_up()

    def _settled(self) -> None:
        self._settling = False
        self._catch_up()

    def _catch_up(self) -> None:
        while self._queue and not (self._blocked or self._settling):
            count, lines = self._queue.popleft()
            self._queued -= count
            self._write(lines)
        if not self._blocked:
            self.stop_timer()


class CanHub:
    """A CAN bus on TCP, compatible with socketcand: every client hears every frame but its own, all in one order.

    ``on_frames(block, peer)`` receives what clients send, stamped at ingress with ``now()`` (ns);
    ``on_peer_lost(peer)`` hears of every client that leaves. ``publish(block)`` may be called from any thread.

    Each client has a queue of ``queue_max`` frames behind the socket's own buffers; when it is full the oldest frames
    are dropped and counted in ``dropped``. A client that has not caught up for ``slow_limit`` s is disconnected.
    """

    def __init__(
        self,
        on_frames: OnFrames,
        on_peer_lost: OnPeerLost = _nobody,
        *,
        bus: str = "vcan0",
        now: Callable[[], int] = wall_time_ns,
        queue_max: int = 65_536,
        slow_limit: float = 2.0,
        first_frame_delay: float = 0.02,
        clients_max: int = 32,
        bad_lines_max: int = 100,
    ) -> None:
        self.bus = bus
        self.queue_max = queue_max
        self.slow_limit = slow_limit
        self.first_frame_delay = first_frame_delay
        self.bad_lines_max = bad_lines_max
        #: Frames that slow clients have lost since the start.
        self.dropped = 0
        self._clients_max = clients_max
        self._on_frames = on_frames
        self._on_peer_lost = on_peer_lost
        self._now = now
        self._clients: dict[_CanClient, None] = {}
        self._published: deque[Block] = deque()
        self._woken = False
        self._closed = False
        self._thread = 0
        self._loop: asyncio.AbstractEventLoop | None = None

    @property
    def clients(self) -> tuple[str, ...]:
        """Return the names of the connected clients."""
        return tuple(client.name for client in list(self._clients))

    def publish(self, block: Block) -> None:
        """Send ``block`` to every client, in the order of the calls; thread-safe, formats and sends elsewhere.

        It wakes the loop's thread, which then wants the interpreter: let it be the last thing a tick does.
        The hub keeps a reference until it is sent: do not write into the array afterwards.
        Before the hub is open and after it has been closed, frames go nowhere, as on a bus without nodes.
        """
        if block.dtype != FRAME:
            raise TypeError(
                f"block = array of {block.dtype} is not a frame block (bench_protocol.frames.FRAME)"
            )
        loop = self._loop
        if loop is None or not len(block):
            return
        self._published.append(block)
        # One wake-up serves all blocks that have been appended by the time it is served.
        if not self._woken:
            self._woken = True
            if threading.get_ident() == self._thread:
                loop.call_soon(self._flush)
                return
            with contextlib.suppress(RuntimeError):  # the loop has been closed in the meantime
                loop.call_soon_threadsafe(self._flush)

    def open(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop, self._closed, self._thread = loop, False, threading.get_ident()

    def close(self) -> None:
        self._loop, self._closed = None, True
        self._published.clear()
        for client in list(self._clients):
            client.drop()

    def client(self) -> asyncio.Protocol:
        """Return the protocol of a new connection."""
        return _CanClient(self)

    def admit(self, client: _CanClient) -> bool:
        if self._closed or len(self._clients) >= self._clients_max:
            return False
        self._clients[client] = None
        return True

    def forget(self, client: _CanClient) -> None:
        if client in self._clients:
            del self._clients[client]
            self._on_peer_lost(client.name)

    def take(self, block: Block, sender: _CanClient) -> None:
        """Stamp what ``sender`` has sent and pass it on."""
        self._flush()  # what was published before comes before
        block["time"] = self._now()
        self._spread(block, sender)
        self._on_frames(block, sender.name)

    def _flush(self) -> None:
        self._woken = (
            False  # first: what is appended from now on either is seen below or wakes the loop again
        )
        while self._published:
            self._spread(self._published.popleft(), None)

    def _spread(self, block: Block, sender: _CanClient | None) -> None:
        receivers = [client for client in self._clients if client is not sender]
        if not receivers:
            return
        for start in range(0, len(block), _FRAMES_PER_WRITE):
            part = block[start : start + _FRAMES_PER_WRITE]
            lines = socketcand.frame_bytes(part)
            for client in receivers:
                client.deliver(len(part), lines)


class _ModbusClient(_Peer):
    """One Modbus connection."""

    kind = "modbus"

    def __init__(self, server: "ModbusTcpServer") -> None:
        super().__init__()
        self._server = server
        self._stream = modbus.AduStream()
        self._requests: deque[bytes] = deque()
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
        """Answer what has come, but only a portion at a time: no client may keep the loop from the others."""
        assert self.transport is not None
        if self._blocked or self.transport.is_closing():
            return
        portion = [self._requests.popleft() for _ in range(min(_REQUESTS_AT_ONCE, len(self._requests)))]
        responses = [self._server.respond(request, self.name) for request in portion]
        self.transport.write(b"".join(response for response in responses if response))
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

    def _expect(self) -> None:
        """Wait for the next request: long if nothing has come of it yet, briefly if it has begun."""
        server = self._server
        self.drop_after(server.split_limit if self._stream.partial else server.idle_limit)

    def pause_writing(self) -> None:
        """Stop reading from a client that does not fetch its answers; it has ``split_limit`` s to begin."""
        self._blocked = True
        assert self.transport is not None
        self.transport.pause_reading()
        self.drop_after(self._server.split_limit)

    def resume_writing(self) -> None:
        self._blocked = False
        self._respond()


class ModbusTcpServer:
    """A Modbus/TCP server around ``answer(adu, peer)``, which returns the response ADU or None for silence.

    Pipelined and split requests are fine; a wrong header ends the connection. So does silence for ``idle_limit`` s, a
    request that stays incomplete or answers that stay unfetched for ``split_limit`` s. What goes wrong inside
    ``answer`` is exception 4 to the client and is reported to the loop's exception handler.
    """

    def __init__(
        self,
        answer: Answer,
        on_peer_lost: OnPeerLost = _nobody,
        *,
        idle_limit: float = 60.0,
        split_limit: float = 5.0,
        clients_max: int = 64,
    ) -> None:
        self.idle_limit = idle_limit
        self.split_limit = split_limit
        self._answer = answer
        self._on_peer_lost = on_peer_lost
        self._clients_max = clients_max
        self._clients: dict[_ModbusClient, None] = {}
        self._closed = False

    @property
    def clients(self) -> tuple[str, ...]:
        """Return the names of the connected clients."""
        return tuple(client.name for client in list(self._clients))

    def open(self) -> None:
        self._closed = False

    def close(self) -> None:
        self._closed = True
        for client in list(self._clients):
            client.drop()

    def client(self) -> asyncio.Protocol:
        """Return the protocol of a new connection."""
        return _ModbusClient(self)

    def admit(self, client: _ModbusClient) -> bool:
        if self._closed or len(self._clients) >= self._clients_max:
            return False
        self._clients[client] = None
        return True

    def forget(self, client: _ModbusClient) -> None:
        if client in self._clients:
            del self._clients[client]
            self._on_peer_lost(client.name)

    def respond(self, request: bytes, peer: str) -> bytes | None:
        try:
            return self._answer(request, peer)
        except Exception as error:
            asyncio.get_running_loop().call_exception_handler(
                {"message": f"a Modbus request of {peer} failed: {request.hex(' ')}", "exception": error}
            )
            return modbus.refuse(request, modbus.DEVICE_FAILURE)


class Servers:
    """Both servers, open, in a thread of their own; ``stop()`` or leaving the ``with`` block closes everything."""

    def __init__(
        self, thread: threading.Thread, loop: asyncio.AbstractEventLoop, stop: asyncio.Event
    ) -> None:
        self._thread, self._loop, self._stop = thread, loop, stop
        #: The real ports; None for a server that was not asked for.
        self.can_port: int | None = None
        self.modbus_port: int | None = None

    def stop(self) -> None:
        """Close the ports and all connections and end the thread, within 1 s; harmless when repeated."""
        with contextlib.suppress(RuntimeError):  # already closed
            self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(timeout=1.0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


def serve_in_thread(
    hub: CanHub | None = None,
    modbus_server: ModbusTcpServer | None = None,
    *,
    host: str = "127.0.0.1",
    can_port: int = 0,
    modbus_port: int = 0,
    allow_remote: bool = False,
    beacon: bool = False,
) -> Servers:
    """Open the given servers and return when their ports accept connections; port 0 takes a free one.

    Neither protocol knows who is allowed to do what, so that any ``host`` but the loopback needs ``allow_remote``.
    ``beacon`` announces the hub by UDP on the loopback every 3 s (SavvyCAN finds it so).

    Raises ValueError for a ``host`` that is not allowed and OSError, in words, for a port that cannot be had.
    """
    if not allow_remote and not _is_loopback(host):
        raise ValueError(
            f"host = {host} would open the bench to the network, without any password; "
            "use 127.0.0.1 or allow it explicitly"
        )
    opened: list[Servers] = []
    failed: list[BaseException] = []
    ready = threading.Event()

    async def serve() -> None:
        loop = asyncio.get_running_loop()
        servers = Servers(thread, loop, asyncio.Event())
        async with contextlib.AsyncExitStack() as stack:
            if hub is not None:
                hub.open(loop)
                stack.callback(hub.close)
                servers.can_port = await _listen(stack, hub.client, host, can_port, "CAN")
                if beacon:
                    await _announce(stack, hub.bus, host, servers.can_port)
            if modbus_server is not None:
                modbus_server.open()
                stack.callback(modbus_server.close)
                servers.modbus_port = await _listen(stack, modbus_server.client, host, modbus_port, "Modbus")
            opened.append(servers)
            ready.set()
            await servers._stop.wait()
        await _turns()  # the connections just dropped say that they are lost

    def run() -> None:
        hurry(_PRIORITY)
        try:
            asyncio.run(serve())
        except BaseException as error:
            if ready.is_set():
                raise
            failed.append(error)
        finally:
            ready.set()

    thread = threading.Thread(target=run, name="bench servers", daemon=True)
    thread.start()
    ready.wait()
    if failed:
        thread.join()
        raise failed[0]
    return opened[0]


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


async def _listen(
    stack: contextlib.AsyncExitStack, factory: Callable[[], asyncio.Protocol], host: str, port: int, what: str
) -> int:
    """Open a listening socket that closes with ``stack`` and return its port."""
    loop = asyncio.get_running_loop()
    try:
        server = await loop.create_server(factory, host, port, family=_family(host))
    except OSError as error:
        reason = error.strerror or str(error)
        raise OSError(error.errno, f"{what} port {port} on {host} cannot be opened: {reason}") from None
    stack.push_async_callback(_close, server)
    found: int = server.sockets[0].getsockname()[1]
    return found


async def _close(server: asyncio.Server) -> None:
    """Close the listening socket, but not under a connection that is just being accepted: asyncio would leak it."""
    loop = asyncio.get_running_loop()
    for sock in server.sockets:
        with contextlib.suppress(NotImplementedError):
            loop.remove_reader(sock.fileno())
    await _turns()
    server.close()


async def _turns() -> None:
    """Let the loop finish what it has begun: accepting and losing a connection take it up to three turns."""
    for _ in range(5):
        await asyncio.sleep(0)


def _family(host: str) -> int:
    # "localhost" means two addresses on most machines, and an ephemeral port can only be one of them.
    return socket.AF_INET6 if ":" in host else socket.AF_INET


async def _announce(stack: contextlib.AsyncExitStack, bus: str, host: str, port: int) -> None:
    """Send the beacon now and every 3 s until ``stack`` closes."""
    datagram = socketcand.beacon_bytes("astb", host, port, (bus,), "ASTB virtual test bench")
    loop = asyncio.get_running_loop()
    transport: Any
    transport, _ = await loop.create_datagram_endpoint(
        asyncio.DatagramProtocol, local_addr=("127.0.0.1", 0), allow_broadcast=True
    )
    stack.callback(transport.close)

    async def repeat() -> None:
        while True:
            transport.sendto(datagram, _BEACON_ADDRESS)
            await asyncio.sleep(_BEACON_PERIOD)

    task = loop.create_task(repeat())
    stack.callback(task.cancel)
