"""The far ends of the round trips, in their own process: hub, Modbus server, and raw sockets for comparison.

python -m astb_studies.benchmarks.peers
    prints the ports of hub, Modbus server, raw peers and echo; ends with its input
"""

import asyncio
import contextlib
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from bench_protocol.frames import Block, frame
from bench_protocol.socketcand import frame_bytes, send_bytes
from bench_protocol.table import TABLE
from bench_sim.parameters import load
from bench_sim.rig.can_hub import CanHub
from bench_sim.rig.modbus_server import ModbusTcpServer
from bench_sim.rig.rig import Rig
from bench_sim.rig.servers import serve_in_thread

#: The frame of the round trip, and the hub's lines for it in both directions.
FRAME_BLOCK: Final = frame(0x123, bytes(range(8)), time=1_700_000_000_123_456_000)
CAN_REQUEST: Final = send_bytes(FRAME_BLOCK)
CAN_REPLY: Final = frame_bytes(FRAME_BLOCK)
#: Reading sixteen measurements, input registers of two words each (FC 4), and an answer of that length.
REGISTERS: Final = 32
ADDRESS: Final = next(r.address for r in TABLE.registers if r.space == "input" and r.signal == "left.height")
MODBUS_REQUEST: Final = struct.pack(">HHHBBHH", 1, 0, 6, 1, 4, ADDRESS, REGISTERS)
MODBUS_REPLY: Final = bytes(9 + 2 * REGISTERS)


@dataclass(frozen=True)
class Ports:
    """Where the peers listen."""

    hub: int
    modbus: int
    raw_can: int
    raw_modbus: int
    echo: int  #: a server on asyncio that answers at once


@contextlib.contextmanager
def peers() -> Iterator[Ports]:
    """Run the peers while the block lasts."""
    command = [sys.executable, "-m", "astb_studies.benchmarks.peers"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout and process.stdin
        try:
            yield Ports(*(int(word) for word in process.stdout.readline().split()))
        finally:
            process.kill()


@contextlib.contextmanager
def connected(port: int) -> Iterator[socket.socket]:
    """Yield a raw connection that does not wait before it sends."""
    with socket.create_connection(("127.0.0.1", port), timeout=5.0) as sock:
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        yield sock


def raw_peer(reply: bytes) -> int:
    """Answer every request with ``reply``, for one connection at a time; return the port."""
    listening = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        while True:
            sock, _ = listening.accept()
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with sock, contextlib.suppress(OSError):
                while sock.recv(4096):
                    sock.sendall(reply)

    threading.Thread(target=serve, daemon=True).start()
    port: int = listening.getsockname()[1]
    return port


class _Echo(asyncio.Protocol):
    """Answers every request with ``reply``, to measure the cost of the event loop alone."""

    def __init__(self, reply: bytes) -> None:
        self._reply = reply

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        del data
        self._transport.write(self._reply)


def echo_peer(reply: bytes) -> int:
    """Answer every request with ``reply``, on a separate event loop; return the port."""
    opened: list[int] = []
    ready = threading.Event()

    async def serve() -> None:
        server = await asyncio.get_running_loop().create_server(lambda: _Echo(reply), "127.0.0.1", 0)
        opened.append(server.sockets[0].getsockname()[1])
        ready.set()
        await server.serve_forever()

    threading.Thread(target=lambda: asyncio.run(serve()), daemon=True).start()
    ready.wait()
    return opened[0]


def main() -> None:
    """Open all servers, print their ports, and wait for the end of the input."""
    rig = Rig(load("astb"))

    def send_back(block: Block, peer: str) -> None:
        del peer
        hub.publish(block)

    hub = CanHub(send_back)
    with serve_in_thread(hub, ModbusTcpServer(rig.answer)) as servers:
        others = raw_peer(CAN_REPLY), raw_peer(MODBUS_REPLY), echo_peer(CAN_REPLY)
        print(servers.can_port, servers.modbus_port, *others, flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main()
