"""A Modbus device with quirks: bytes in, bytes out, each quirk with a switch, and a server for it on any line."""

import contextlib
import os
import select
import socket
import struct
import threading
import time
import tty
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, BUSY = 1, 2, 3, 6


def crc16(data: bytes) -> bytes:
    """The checksum of a serial line's frame, bit by bit as the specification has it."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xA001 if crc & 1 else crc >> 1
    return crc.to_bytes(2, "little")


@dataclass
class Device:
    """Four tables of 1000 places and their quirks; ``log`` has (function, address, count) of each request."""

    functions: tuple[int, ...] = (1, 2, 3, 4, 5, 6, 15, 16)
    request_max: int = 125  #: registers a request
    too_many: int = ILLEGAL_VALUE  #: the exception for more; 0 is silence
    holes: frozenset[int] = frozenset()  #: addresses without access
    unit: int = 1
    answers_as: int | None = None  #: the unit that it gives back, if another one
    number: Callable[[int], int] = lambda asked: asked  #: the transaction that it gives back
    busy: Callable[[int], bool] = lambda count: False  #: whether it is busy at its so-manieth request
    refuses: Callable[[int, int], int] = lambda function, address: (
        0
    )  #: an exception for a request, by its place
    delay: float = 0.0  #: s, how long an answer takes
    late: Callable[[int], float] = lambda count: 0.0  #: s, how much longer its so-manieth answer takes
    words: dict[str, list[int]] = field(
        default_factory=lambda: {table: [0] * 1000 for table in ("input", "holding")}
    )
    bits: dict[str, list[bool]] = field(
        default_factory=lambda: {table: [False] * 1000 for table in ("coil", "discrete")}
    )
    log: list[tuple[int, int, int]] = field(default_factory=list)

    def tcp(self, adu: bytes) -> bytes:
        """Return the answer to a request of Modbus/TCP; empty for silence."""
        number, _, _, unit = struct.unpack_from(">HHHB", adu)
        if unit != self.unit:
            return b""
        pdu = self._answer(adu[7:])
        if not pdu:
            return b""
        back = unit if self.answers_as is None else self.answers_as
        return struct.pack(">HHHB", self.number(number) & 0xFFFF, 0, len(pdu) + 1, back) + pdu

    def rtu(self, frame: bytes) -> bytes:
        """Return the answer to a frame of a serial line; empty for one that is not sound or not for this unit."""
        if len(frame) < 4 or crc16(frame[:-2]) != frame[-2:] or frame[0] != self.unit:
            return b""
        pdu = self._answer(frame[1:-2])
        if not pdu:
            return b""
        bare = bytes([self.unit if self.answers_as is None else self.answers_as]) + pdu
        return bare + crc16(bare)

    def _answer(self, pdu: bytes) -> bytes:
        function, (address, count) = pdu[0], struct.unpack_from(">HH", pdu, 1)
        self.log.append((function, address, 1 if function in (5, 6) else count))
        time.sleep(self.delay + self.late(len(self.log)))
        code = self._refusal(function, address, 1 if function in (5, 6) else count)
        if code is not None:
            return bytes([function | 0x80, code]) if code else b""
        return bytes([function]) + self._serve(function, address, count, pdu[5:])

    def _refusal(self, function: int, address: int, count: int) -> int | None:
        most = self.request_max * (16 if function in (1, 2, 15) else 1)
        if function not in self.functions:
            return ILLEGAL_FUNCTION
        if self.busy(len(self.log)):
            return BUSY
        if count > most:
            return self.too_many
        if address + count > 1000 or not self.holes.isdisjoint(range(address, address + count)):
            return ILLEGAL_ADDRESS
        return self.refuses(function, address) or None

    def _serve(self, function: int, address: int, count: int, rest: bytes) -> bytes:
        if function == 23:
            at, many = struct.unpack_from(">HH", rest)
            self.words["holding"][at : at + many] = struct.unpack_from(f">{many}H", rest, 5)
            return struct.pack(f">B{count}H", 2 * count, *self.words["holding"][address : address + count])
        if function in (1, 2):
            bits = self.bits["coil" if function == 1 else "discrete"][address : address + count]
            number = sum(bit << k for k, bit in enumerate(bits))
            size = (count + 7) // 8
            return bytes([size]) + number.to_bytes(size, "little")
        if function in (3, 4):
            words = self.words["holding" if function == 3 else "input"][address : address + count]
            return struct.pack(f">B{count}H", 2 * count, *words)
        if function == 5:
            self.bits["coil"][address] = count == 0xFF00
        elif function == 6:
            self.words["holding"][address] = count
        elif function == 15:
            number = int.from_bytes(rest[1:], "little")
            self.bits["coil"][address : address + count] = [bool(number >> k & 1) for k in range(count)]
        else:
            self.words["holding"][address : address + count] = struct.unpack_from(f">{count}H", rest, 1)
        return struct.pack(">HH", address, count)


class Server:
    """Serves a device on 127.0.0.1: Modbus/TCP, or with ``rtu`` the frames of a serial line over TCP.

    ``hangs_up``: the connection ends after each answer. ``one``: a second connection is closed at once.
    ``gateway``: answers of the device go to each client connected then, also without a request.
    """

    def __init__(
        self,
        device: Device,
        *,
        rtu: bool = False,
        hangs_up: bool = False,
        one: bool = False,
        gateway: bool = False,
    ) -> None:
        self._device, self._rtu, self._hangs_up, self._one = device, rtu, hangs_up, one
        self._gateway = gateway
        self._latest: socket.socket | None = None
        self._door = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._door.getsockname()[1])
        self.connections = self.open = 0
        self._over = threading.Event()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._accept, daemon=True)
        self._thread.start()

    def _accept(self) -> None:
        while not self._over.is_set():
            if not select.select([self._door], [], [], 0.05)[0]:
                continue
            client, _ = self._door.accept()
            self._latest = client
            self.connections += 1
            if self._one and self.open:
                client.close()
                continue
            self.open += 1
            threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with client, contextlib.suppress(OSError):
            while not self._over.is_set():
                if not select.select([client], [], [], 0.05)[0]:
                    continue
                request = client.recv(300)
                if not request:
                    break
                with self._lock:
                    reply = self._device.rtu(request) if self._rtu else self._device.tcp(request)
                with contextlib.suppress(OSError):
                    (self._latest if self._gateway and self._latest else client).sendall(reply)
                if self._hangs_up and reply:
                    break
        self.open -= 1

    def stop(self) -> None:
        """End, connections included."""
        self._over.set()
        self._thread.join(5)
        self._door.close()


@contextlib.contextmanager
def served(device: Device, **quirks: bool) -> Iterator[Server]:
    """A server for ``device`` while the block lasts."""
    server = Server(device, **quirks)
    try:
        yield server
    finally:
        server.stop()


@contextlib.contextmanager
def on_a_line(*devices: Device, echo: bool = False) -> Iterator[str]:
    """Put devices on a serial line, a pair of pseudo terminals, while the block lasts; the name of our end."""
    far, near = os.openpty()
    tty.setraw(far)
    tty.setraw(near)
    over = threading.Event()

    def run() -> None:
        frame = b""
        while not over.is_set():
            if select.select([far], [], [], 0.004)[0]:
                frame += os.read(far, 300)
            elif frame:  # silence ends a frame
                replies = [device.rtu(frame) for device in devices]
                os.write(far, (frame if echo else b"") + b"".join(replies))
                frame = b""

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield os.ttyname(near)
    finally:
        over.set()
        thread.join(5)
        os.close(far)
        os.close(near)
