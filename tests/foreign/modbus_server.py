"""The part of Modbus/TCP that a third-party PLC uses: bytes in, bytes out, and a small server."""

import socketserver
import struct
import threading
from collections.abc import Callable
from typing import Protocol

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3


class Refusal(Exception):
    """Why a request is refused: the code of the exception that answers it."""

    def __init__(self, code: int) -> None:
        super().__init__(f"Modbus exception {code}")
        self.code = code


class Memory(Protocol):
    """What can be read and written, by address from 0 on; `Refusal` where something cannot."""

    def read_words(self, holding: bool, address: int, count: int) -> list[int]: ...

    def read_bits(self, coils: bool, address: int, count: int) -> list[bool]: ...

    def write_words(self, address: int, words: list[int]) -> None: ...


def answer(memory: Memory, request: bytes) -> bytes:
    """Return the answer to one request (ADU: transaction, protocol, length, unit, then the PDU)."""
    transaction, _, _, unit = struct.unpack_from(">HHHB", request)
    function, data = request[7], request[8:]
    try:
        reply = bytes([function]) + _serve(memory, function, data)
    except Refusal as refusal:
        reply = bytes([function | 0x80, refusal.code])
    return struct.pack(">HHHB", transaction, 0, len(reply) + 1, unit) + reply


def _serve(memory: Memory, function: int, data: bytes) -> bytes:
    address, count = struct.unpack_from(">HH", data)
    if function in (1, 2):
        bits = memory.read_bits(function == 1, address, count)
        packed = bytes(
            sum(bit << k for k, bit in enumerate(bits[first : first + 8])) for first in range(0, count, 8)
        )
        return bytes([len(packed)]) + packed
    if function in (3, 4):
        words = memory.read_words(function == 3, address, count)
        return struct.pack(f">B{count}H", 2 * count, *words)
    if function == 6:
        memory.write_words(address, [count])
        return data[:4]
    if function == 16:
        memory.write_words(address, list(struct.unpack_from(f">{count}H", data, 5)))
        return data[:4]
    raise Refusal(ILLEGAL_FUNCTION)


class Server(socketserver.ThreadingTCPServer):
    """Serves a PLC on 127.0.0.1; ``serve(request)`` is called by one thread at a time."""

    allow_reuse_address = True
    daemon_threads = True

    def __init__(self, port: int, serve: Callable[[bytes], bytes]) -> None:
        super().__init__(("127.0.0.1", port), _Connection)
        self.serve, self.lock = serve, threading.Lock()

    @property
    def port(self) -> int:
        """The port that was given or found."""
        return int(self.server_address[1])


class _Connection(socketserver.StreamRequestHandler):
    server: Server
    disable_nagle_algorithm = True

    def handle(self) -> None:
        while len(head := self.rfile.read(6)) == 6:
            body = self.rfile.read(struct.unpack(">H", head[4:])[0])
            with self.server.lock:
                reply = self.server.serve(head + body)
            self.wfile.write(reply)
