"""The rig's network servers in a separate thread. They open the ports of CAN hub, Modbus, and capture.

The servers do not import the rig or the plant. They receive callables for frames, requests and answers. All servers
run on one asyncio loop in one background thread, which calls the callables one at a time. The callables must return
within a fraction of a millisecond.
"""

import asyncio
import contextlib
import ipaddress
import socket
import threading
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any, Final, Self

from bench_protocol import socketcand
from bench_protocol.clock import hurry
from bench_protocol.os_errors import reason
from bench_protocol.runtime.eventfd import clear
from bench_sim.rig.can_hub import CanHub
from bench_sim.rig.capture_server import CaptureServer
from bench_sim.rig.control_socket import ControlSocket
from bench_sim.rig.modbus_server import ModbusTcpServer

#: Below the tick. A server that waits for a processor while it holds the interpreter would hold up the tick as well.
_PRIORITY: Final = 5
#: The port socketcand is known by.
CAN_PORT: Final = 29536
_BEACON_ADDRESS: Final = ("127.255.255.255", 42000)
_BEACON_PERIOD: Final = 3.0  # s, the longest the protocol allows


class Servers:
    """The running servers and their thread. ``stop()`` or the end of the ``with`` block closes everything."""

    def __init__(
        self, thread: threading.Thread, loop: asyncio.AbstractEventLoop, stop: asyncio.Event
    ) -> None:
        self._thread, self._loop, self._stop = thread, loop, stop
        #: The real ports; None for a server that was not asked for.
        self.can_port: int | None = None
        self.modbus_port: int | None = None
        self.capture_port: int | None = None
        self.control: Path | None = None

    def stop(self) -> None:
        """Close the ports and all connections, and end the thread, within 1 s. Repeated calls are harmless."""
        with contextlib.suppress(RuntimeError):  # already closed
            self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(timeout=1.0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


def _ignore_wake() -> None:
    pass


def serve_in_thread(
    hub: CanHub | None = None,
    modbus_server: ModbusTcpServer | None = None,
    capture_server: CaptureServer | None = None,
    control: ControlSocket | None = None,
    *,
    host: str = "127.0.0.1",
    can_port: int = 0,
    modbus_port: int = 0,
    capture_port: int = 0,
    allow_remote: bool = False,
    beacon: bool = False,
    eventfd: int | None = None,
    on_wake: Callable[[], None] = _ignore_wake,
) -> Servers:
    """Open the given servers. Return when their ports accept connections. Port 0 selects a free port.

    The protocols have no access control, so any ``host`` except the loopback needs ``allow_remote``. ``beacon``
    announces the hub by UDP on the loopback every 3 s (for SavvyCAN). ``on_wake`` is called in the servers' thread
    after each write to ``eventfd``. Raises ValueError for a ``host`` that is not allowed, and OSError with a reason
    for a port that cannot be opened.
    """
    if not allow_remote:
        _require_loopback(host)
    opened: list[Servers] = []
    ready = threading.Event()

    async def serve() -> None:
        loop = asyncio.get_running_loop()
        servers = Servers(threading.current_thread(), loop, asyncio.Event())
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
            if capture_server is not None:
                stack.callback(capture_server.close)
                servers.capture_port = await _listen(
                    stack, capture_server.client, host, capture_port, "Capture"
                )
            if eventfd is not None:
                loop.add_reader(eventfd, _wake, eventfd, on_wake)
                stack.callback(loop.remove_reader, eventfd)
            if control is not None and servers.modbus_port is not None:
                stack.callback(control.close)
                servers.control = await control.open(host, servers.modbus_port)
            opened.append(servers)
            ready.set()
            await servers._stop.wait()
        await _turns()  # the connections that were just closed report their loss

    _start(serve, ready)
    return opened[0]


def _start(serve: Callable[[], Coroutine[Any, Any, None]], ready: threading.Event) -> None:
    """Run ``serve`` on an asyncio loop in a separate thread. Return when it is ``ready``, or raise its error."""
    failed: list[BaseException] = []

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


def _wake(eventfd: int, on_wake: Callable[[], None]) -> None:
    clear(eventfd)
    on_wake()


def _require_loopback(host: str) -> None:
    """Raise ValueError unless ``host`` is localhost or a loopback address."""
    with contextlib.suppress(ValueError):  # a name, not an address
        if host == "localhost" or ipaddress.ip_address(host).is_loopback:
            return
    raise ValueError(
        f"host = {host} would open the bench to the network without a password; use 127.0.0.1, or "
        "allow it explicitly"
    )


async def _listen(
    stack: contextlib.AsyncExitStack, factory: Callable[[], asyncio.Protocol], host: str, port: int, what: str
) -> int:
    """Open a listening socket and return its port. The socket closes with ``stack``."""
    loop = asyncio.get_running_loop()
    try:
        server = await loop.create_server(factory, host, port, family=_family(host))
    except OSError as error:
        text = f"{what} port {port} on {host} cannot be opened: {reason(error)}"
        raise OSError(error.errno, text) from None
    stack.push_async_callback(_close, server)
    found: int = server.sockets[0].getsockname()[1]
    return found


async def _close(server: asyncio.Server) -> None:
    """Close the listening socket at a moment at which no connection is being accepted. Otherwise asyncio would leak
    it.
    """
    loop = asyncio.get_running_loop()
    for sock in server.sockets:
        with contextlib.suppress(NotImplementedError):
            loop.remove_reader(sock.fileno())
    await _turns()
    server.close()


async def _turns() -> None:
    """Let the loop run five times, because accepting or closing a connection needs up to three."""
    for _ in range(5):
        await asyncio.sleep(0)


def _family(host: str) -> int:
    # "localhost" means two addresses on most machines, and an ephemeral port can only be one of them.
    return socket.AF_INET6 if ":" in host else socket.AF_INET


async def _announce(stack: contextlib.AsyncExitStack, bus: str, host: str, port: int) -> None:
    """Send the beacon now and then every 3 s until ``stack`` closes."""
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
