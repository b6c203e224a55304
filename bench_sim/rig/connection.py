"""One TCP connection of a client to a server of the rig, the common base of CAN hub and Modbus server."""

import asyncio
import contextlib
import gc
import itertools
import socket
from collections.abc import Callable
from typing import Final

from bench_sim.rig.peers import peer_name

OnPeerLost = Callable[[str], None]

#: Time (s) after which a spared connection is checked again.
_RESPITE: Final = 1.0
#: asyncio leaves a reference cycle behind with every connection, and the garbage collector of the rig's process is off.
#: Number of connections after which the youngest generation is collected, in about 0.2 ms.
_COLLECT_EVERY: Final = 100
_connections: Final = itertools.count(1)


def ignore(_: str) -> None:
    """Do nothing when a peer has left."""


class Connection(asyncio.Protocol):
    """One TCP connection to a client. It has a name, TCP keep-alive to detect a dead peer, and a timer that ends it."""

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
        number = next(_connections)
        if number % _COLLECT_EVERY == 0 and not gc.isenabled():
            gc.collect(0)
        # A client that is gone again already has no address any more.
        host, port = (transport.get_extra_info("peername") or ("unknown", 0))[:2]
        self.name = peer_name(self.kind, host, port, number)
        sock = transport.get_extra_info("socket")
        with contextlib.suppress(OSError):
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            # A peer that has lost its power does not close the connection: probe after 5 s, give up after 5 s more.
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            for option, value in (("TCP_KEEPIDLE", 5), ("TCP_KEEPINTVL", 1), ("TCP_KEEPCNT", 5)):
                if hasattr(socket, option):
                    sock.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)

    def drop_after(self, delay: float) -> None:
        """End the connection after ``delay`` s, unless a new delay is set or the timer is stopped before that."""
        # A timer that runs is left to run and looks at the deadline only then: setting a new one costs nothing.
        self._deadline = self.loop.time() + delay
        if self._timer is None or self._timer.when() > self._deadline:
            self.stop_timer()
            self._timer = self.loop.call_at(self._deadline, self._due)

    def _due(self) -> None:
        self._timer = None
        if self.loop.time() < self._deadline:
            self._timer = self.loop.call_at(self._deadline, self._due)
        elif self.spared():
            self.drop_after(_RESPITE)
        else:
            self.drop()

    def spared(self) -> bool:
        """Return whether the connection stays open although its time limit has passed."""
        return False

    def stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    @property
    def waiting(self) -> bool:
        """Whether the timer that ends the connection is running."""
        return self._timer is not None

    def drop(self) -> None:
        """End the connection at once. Bytes that the peer has not read are lost."""
        if self.transport is not None:
            self.transport.abort()
