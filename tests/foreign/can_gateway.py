"""How frames of a stranger's rig reach a bus: a SocketCAN interface, or a socketcand gateway of a few lines."""

import re
import select
import socket
import struct
import sys
import time
from collections.abc import Iterable
from typing import Final, Protocol

_FRAME: Final = struct.Struct("=IB3x8s")
_EXTENDED: Final = 0x8000_0000
_LINE: Final = re.compile(rb"<([^>]*)>")


class Rig(Protocol):
    """Frames on the bus."""

    def receive(self, identifier: int, data: bytes) -> None: ...

    def cycle(self) -> list[tuple[int, bytes]]: ...


class SocketCan:
    """A raw socket on an interface of the kernel."""

    def __init__(self, interface: str) -> None:
        self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self._socket.bind((interface,))
        self.address = interface

    def wait(self, seconds: float) -> Iterable[tuple[int, bytes]]:
        """Return a frame with a 29-bit identifier, if one comes in time."""
        if select.select([self._socket], [], [], seconds)[0]:
            word, length, data = _FRAME.unpack(self._socket.recv(_FRAME.size))
            if word & _EXTENDED:
                yield word & 0x1FFF_FFFF, data[:length]

    def send(self, frames: list[tuple[int, bytes]]) -> None:
        """Put frames on the bus."""
        for identifier, data in frames:
            self._socket.send(_FRAME.pack(identifier | _EXTENDED, len(data), data))


class Gateway:
    """A socketcand gateway (github.com/linux-can/socketcand, raw mode) for one client after the other."""

    def __init__(self) -> None:
        self._door = socket.create_server(("127.0.0.1", 0))
        self.address = f"socketcand://127.0.0.1:{self._door.getsockname()[1]}"
        self._client: socket.socket | None = None
        self._raw = False
        self._rest = b""

    def wait(self, seconds: float) -> Iterable[tuple[int, bytes]]:
        """Return the frames that come, and see to who comes and goes."""
        received = select.select([self._door] + ([self._client] if self._client else []), [], [], seconds)[0]
        if self._door in received:
            self._leave()
            self._client, _ = self._door.accept()
            self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._say("< hi >")
        elif self._client in received:
            yield from self._receive()

    def send(self, frames: list[tuple[int, bytes]]) -> None:
        """Send frames to the client."""
        if self._raw:
            now = f"{time.time():.6f}"
            self._say("".join(f"< frame {one:08X} {now} {data.hex().upper()} >" for one, data in frames))

    def _receive(self) -> Iterable[tuple[int, bytes]]:
        assert self._client
        try:
            received = self._client.recv(65536)
        except OSError:
            received = b""
        if not received:
            self._leave()
            return
        lines = _LINE.findall(self._rest + received)
        self._rest = (self._rest + received).rpartition(b">")[2]
        for line in lines:
            match line.decode().split():
                case ["open", _]:
                    self._say("< ok >")
                case ["rawmode"]:
                    self._raw = True
                    self._say("< ok >")
                case ["send", identifier, _, *data] if len(identifier) == 8:
                    yield int(identifier, 16), bytes(int(byte, 16) for byte in data)

    def _say(self, text: str) -> None:
        assert self._client
        try:
            self._client.sendall(text.encode())
        except OSError:
            self._leave()

    def _leave(self) -> None:
        if self._client:
            self._client.close()
        self._client, self._raw, self._rest = None, False, b""


def serve(rig: Rig, cycle: int, interface: str) -> None:
    """Let ``rig`` run in real time, every ``cycle`` ms, until the input ends."""
    rig.cycle()
    bus = SocketCan(interface) if interface else Gateway()
    print(f"ready can={bus.address}", flush=True)
    due = time.monotonic()
    while not select.select([sys.stdin], [], [], 0)[0]:
        due += cycle * 1e-3
        left, received = 1.0, True
        while left > 0 or received:  # a late rig still receives the frames
            left = due - time.monotonic()
            received = False
            for identifier, data in bus.wait(max(left, 0.0)):
                rig.receive(identifier, data)
                received = True
        bus.send(rig.cycle())
