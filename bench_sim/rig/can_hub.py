"""The rig's CAN bus on TCP: a hub with the socketcand protocol, whose clients receive every frame except their own."""

import asyncio
import contextlib
import threading
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Final

from bench_protocol import socketcand
from bench_protocol.clock import wall_time_ns
from bench_protocol.frames import FRAME, Block
from bench_sim.rig.connection import Connection, OnPeerLost, ignore
from bench_sim.rig.peers import CAN
from bench_sim.rig.places import Holds, Places

OnFrames = Callable[[Block, str], None]
Carry = Callable[[Block, str], Block]

# Written at once to one client. Larger blocks are cut, so that "drop the oldest" never drops a whole burst.
_FRAMES_PER_WRITE: Final = 1024
# Bytes of one client that are parsed at once: some 0.5 ms of work before the other clients have their turn.
_BYTES_AT_ONCE: Final = 8192
# A line counts as one frame, and so do as many bytes without one.
_BYTES_PER_FRAME: Final = 64
# A client may be ahead of its share by so long, s: commands of one cycle come together.
_AHEAD: Final = 0.05


def _pass_unchanged(block: Block, peer: str) -> Block:
    """Return the frames unchanged."""
    del peer
    return block


class _CanClient(Connection):
    """One socketcand client of the hub."""

    kind = CAN

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
        self._unread = b""
        self._paid_until = 0.0
        self._waking: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        if not self._hub.admit(self):
            self.drop()
            return
        self._write(socketcand.GREETING)

    def connection_lost(self, exc: Exception | None) -> None:
        del exc
        self.stop_timer()
        if self._waking is not None:
            self._waking.cancel()
        self._unread = b""
        self._queue.clear()
        self._hub.forget(self)

    @property
    def throttled(self) -> bool:
        """Whether the hub reads nothing from this client at present, because it has sent more than its share."""
        return self._waking is not None

    def data_received(self, data: bytes) -> None:
        self._unread += data
        if not self.throttled:
            self._read()

    def _read(self) -> None:
        """Process the received bytes in portions. Pause if the client has sent more than its share."""
        self._waking = None
        assert self.transport is not None
        while self._unread and not self.transport.is_closing():
            now = self.loop.time()
            if (wait := self._paid_until - now - _AHEAD) > 0:
                self.transport.pause_reading()
                self._waking = self.loop.call_later(wait, self._read)
                return
            portion, self._unread = self._unread[:_BYTES_AT_ONCE], self._unread[_BYTES_AT_ONCE:]
            frames = max(self._process_lines(portion), len(portion) // _BYTES_PER_FRAME)
            self._paid_until = max(now, self._paid_until) + frames * self._hub.time_per_frame(self)
        self.transport.resume_reading()

    def _process_lines(self, data: bytes) -> int:
        """Process the lines in ``data``. Return the number of frames and other lines."""
        lines = 0
        for event in self._parser.feed(data):
            lines += event.block.size if isinstance(event, socketcand.Sent | socketcand.Received) else 1
            match event:
                case socketcand.Sent(block) if self._opened:
                    self._hub.take(block, self)
                case socketcand.Sent() | socketcand.Received():
                    self._refuse("this hub accepts frames as < send … > only, after < open … >")
                case socketcand.Command(word, arguments):
                    self._command(word, arguments)
                case socketcand.Malformed(reason):
                    self._refuse(reason)
        return lines

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
                # python-can's own client reads this answer with one recv and fails if it also contains a frame.
                self._settling = True
                self.loop.call_later(self._hub.first_frame_delay, self._settled)
        elif word == "bcmmode" and self._opened:
            self._raw = False
            self._write(socketcand.OK)
        else:
            self._refuse(f"'{word}' is not supported; this hub knows open, rawmode, bcmmode, send, echo")

    def _refuse(self, reason: str) -> None:
        self._bad_lines += 1
        if self._bad_lines > self._hub.bad_lines_max:
            self.drop()
        else:
            self._write(socketcand.error_bytes(reason))

    def _write(self, data: bytes) -> None:
        if self.transport is not None and not self.transport.is_closing():
            self.transport.write(data)

    def send(self, count: int, lines: bytes) -> None:
        """Send ``count`` frames now or queue them. If the queue is full, the oldest frames are dropped."""
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
    """A CAN bus on TCP, compatible with socketcand. Every client receives every frame except its own, all in the same
    order.

    ``on_frames(block, peer)`` receives the frames of clients, with the time of arrival by ``now()`` (ns).
    ``on_peer_lost(peer)`` is called for every client that leaves. ``carry(block, peer)`` returns the frames of a
    client as the bus passes them on, before any client receives them. ``publish`` and ``relay`` may be called from any
    thread.

    Each client has a queue of ``queue_max`` frames in addition to the socket's own buffers. When it is full, the
    oldest frames are dropped and counted in ``dropped``. A client that is too slow for ``slow_limit`` s is
    disconnected.

    All clients together may send ``frames_per_second``, which is more than a bus of 1 Mbit/s carries. Each client has
    the same share. If a client sends more, the hub reads from it later. So a flood of frames delays only its sender,
    and no frame is lost. The commander has a separate share.

    One connection beyond ``clients_max`` is reserved for the holder of the lease (``holds(peer)``).
    """

    def __init__(
        self,
        on_frames: OnFrames,
        on_peer_lost: OnPeerLost = ignore,
        *,
        carry: Carry = _pass_unchanged,
        bus: str = "vcan0",
        now: Callable[[], int] = wall_time_ns,
        queue_max: int = 65_536,
        slow_limit: float = 2.0,
        first_frame_delay: float = 0.02,
        clients_max: int = 32,
        holds: Holds | None = None,
        bad_lines_max: int = 100,
        frames_per_second: float = 10_000.0,
    ) -> None:
        self.bus = bus
        self.queue_max = queue_max
        self.slow_limit = slow_limit
        self.first_frame_delay = first_frame_delay
        self.bad_lines_max = bad_lines_max
        #: Frames that slow clients have lost since the start.
        self.dropped = 0
        self._carry = carry
        self._on_frames = on_frames
        self._on_peer_lost = on_peer_lost
        self._now = now
        self._clients: Places[_CanClient] = Places(clients_max, holds)
        self._published: deque[tuple[Block, str]] = deque()
        self._woken = False
        self._closed = False
        self._thread = 0
        self._loop: asyncio.AbstractEventLoop | None = None
        self._frames_per_second, self._holds = frames_per_second, holds
        self._home: asyncio.AbstractEventLoop | None = None  # also while the hub is cut off

    @property
    def clients(self) -> tuple[str, ...]:
        """The names of the connected clients."""
        return tuple(client.name for client in self._clients)

    def publish(self, block: Block) -> None:
        """Send ``block`` to every client, in the order of the calls. Thread-safe: the thread of the hub formats and
        sends it.

        The call wakes that thread, which then needs the interpreter lock, so call it at the end of a tick. The hub
        keeps a reference to ``block`` until it is sent: do not write to the array afterwards. Before the hub is open
        and after it has been closed, frames are discarded, as on a bus without nodes.
        """
        self.relay(block, "")

    def relay(self, block: Block, peer: str) -> None:
        """Send ``block`` like `publish` to every client except its sender ``peer``."""
        if block.dtype != FRAME:
            raise TypeError(
                f"block = array of {block.dtype} is not a frame block (bench_protocol.frames.FRAME)"
            )
        loop = self._loop
        if loop is None or not len(block):
            return
        self._published.append((block, peer))
        if threading.get_ident() == self._thread:
            self._flush()
        # One wake-up serves all blocks that have been appended by the time it is served.
        elif not self._woken:
            self._woken = True
            with contextlib.suppress(RuntimeError):  # the loop has been closed in the meantime
                loop.call_soon_threadsafe(self._flush)

    def cut(self) -> None:
        """Close all connections and refuse new ones until `restore`. Callable from any thread."""
        self._soon(self.close)

    def restore(self) -> None:
        """Accept clients again. Callable from any thread."""
        if self._home is not None:
            self._soon(partial(self.open, self._home))

    def _soon(self, do: Callable[[], None]) -> None:
        if self._home is not None:
            with contextlib.suppress(RuntimeError):  # the loop has been closed in the meantime
                self._home.call_soon_threadsafe(do)

    def open(self, loop: asyncio.AbstractEventLoop) -> None:
        self._home = loop
        self._loop, self._closed, self._thread = loop, False, threading.get_ident()

    def close(self) -> None:
        self._loop, self._closed = None, True
        self._published.clear()
        for client in self._clients:
            client.drop()

    def client(self) -> asyncio.Protocol:
        """Return the protocol object of a new connection."""
        return _CanClient(self)

    def admit(self, client: _CanClient) -> bool:
        return not self._closed and self._clients.admit(client)

    def forget(self, client: _CanClient) -> None:
        if self._clients.leave(client):
            self._on_peer_lost(client.name)

    def time_per_frame(self, client: _CanClient) -> float:
        """Return the time (s) that one frame of ``client`` uses of its share."""
        if self._holds is not None and self._holds(client.name):
            return 1.0 / self._frames_per_second
        sharing = 1 + sum(other.throttled for other in self._clients if other is not client)
        return sharing / self._frames_per_second

    def take(self, block: Block, sender: _CanClient) -> None:
        """Set the time stamps of the frames from ``sender``, and pass the frames on."""
        self._flush()  # frames that were published earlier are sent first
        block["time"] = self._now()
        block = self._carry(block, sender.name)
        if block.size:
            self._spread(block, sender.name)
            self._on_frames(block, sender.name)

    def _flush(self) -> None:
        self._woken = False  # first: a frame appended after this is either sent below or wakes the loop again
        while self._published:
            self._spread(*self._published.popleft())

    def _spread(self, block: Block, sender: str) -> None:
        receivers = [client for client in self._clients if client.name != sender]
        if not receivers:
            return
        for start in range(0, len(block), _FRAMES_PER_WRITE):
            part = block[start : start + _FRAMES_PER_WRITE]
            lines = socketcand.frame_bytes(part)
            for client in receivers:
                client.send(len(part), lines)
