"""Faults of Modbus/TCP: they change requests before the rig receives them, and the bytes of its answers."""

from collections.abc import Callable
from typing import Final

import numpy as np

from bench_protocol import modbus

#: Functions that change something.
_WRITES: Final = frozenset({5, 6, 15, 16, 22, 23})
READS, WRITES, ALL = "reads", "writes", "all"
_JUNK_MAX: Final = 64

#: Answers a request (ADU) of a peer; no bytes are silence.
Answer = Callable[[bytes, str], bytes]
#: A piece of an answer, and its delay (s) after the previous one.
Piece = tuple[float, bytes]


class RequestFault:
    """A change of requests or their answers. It affects each request with the probability ``chance``."""

    def __init__(self, chance: float = 1.0, requests: str = ALL, seed: int = 0) -> None:
        self._chance, self._requests = chance, requests
        self.random = np.random.default_rng(seed)

    def hits(self, request: bytes) -> bool:
        """Return whether the fault affects this ``request``. Each call draws a random number."""
        drawn = self.random.random() < self._chance
        return drawn and (self._requests == ALL or (request[7] in _WRITES) is (self._requests == WRITES))

    def instead(self, request: bytes) -> bytes | None:
        """Return an answer for the client without passing the request to the rig, or None to pass it."""
        del request
        return None

    def altered(self, request: bytes, response: bytes) -> bytes:
        """Return the answer of the rig as the client receives it."""
        del request
        return response

    def pieces(self, pieces: list[Piece]) -> list[Piece]:
        """Return the pieces in which an answer is sent, changed from ``pieces``."""
        return pieces


class Refusal(RequestFault):
    """Requests are refused with an exception ``code``."""

    def __init__(self, code: int, chance: float, requests: str, seed: int) -> None:
        super().__init__(chance, requests, seed)
        self._code = code

    def instead(self, request: bytes) -> bytes | None:
        return modbus.refuse(request, self._code) if self.hits(request) else None


class Mute(RequestFault):
    """Requests are lost: they are neither executed nor answered."""

    def instead(self, request: bytes) -> bytes | None:
        return b"" if self.hits(request) else None


class Junk(RequestFault):
    """Invalid answers: another transaction, another unit, or random bytes."""

    TRANSACTION, UNIT, NOISE = "transaction", "unit", "noise"

    def __init__(self, what: str, chance: float, requests: str, seed: int) -> None:
        super().__init__(chance, requests, seed)
        self._what = what

    def altered(self, request: bytes, response: bytes) -> bytes:
        if not response or not self.hits(request):
            return response
        if self._what == self.TRANSACTION:
            return bytes((response[0] ^ 0x55, response[1] ^ 0xAA)) + response[2:]
        if self._what == self.UNIT:
            return response[:6] + bytes((response[6] ^ 0x7F,)) + response[7:]
        return self.random.bytes(int(self.random.integers(1, _JUNK_MAX)))


class Slow(RequestFault):
    """Answers are ``by`` s late."""

    def __init__(self, by: float) -> None:
        super().__init__()
        self._by = by

    def pieces(self, pieces: list[Piece]) -> list[Piece]:
        (gap, first), *rest = pieces
        return [(gap + self._by, first), *rest]


class Split(RequestFault):
    """Answers arrive in pieces of ``size`` bytes, with ``gap`` s between them."""

    def __init__(self, size: int, gap: float) -> None:
        super().__init__()
        self._size, self._gap = size, gap

    def pieces(self, pieces: list[Piece]) -> list[Piece]:
        cut: list[Piece] = []
        for wait, data in pieces:
            parts = [data[start : start + self._size] for start in range(0, len(data), self._size)]
            cut += [(wait if place == 0 else self._gap, part) for place, part in enumerate(parts)]
        return cut


class ModbusFilter:
    """All active faults of Modbus, applied in the order in which they were switched on."""

    def __init__(self) -> None:
        self._faults: tuple[RequestFault, ...] = ()

    def add(self, fault: RequestFault) -> Callable[[], None]:
        """Apply ``fault`` to requests from now on. Return a function that ends the fault."""
        self._faults = (*self._faults, fault)

        def end() -> None:
            self._faults = tuple(one for one in self._faults if one is not fault)

        return end

    def before(self, answer: Answer) -> Answer:
        """Return a function like ``answer`` that applies the faults to requests and answers."""

        def faulty(request: bytes, peer: str) -> bytes:
            faults = self._faults
            for fault in faults:
                if (replacement := fault.instead(request)) is not None:
                    return replacement
            response = answer(request, peer)
            for fault in faults:
                response = fault.altered(request, response)
            return response

        return faulty

    def pieces(self, response: bytes) -> list[Piece]:
        """Return the pieces in which ``response`` is sent, after all faults."""
        pieces: list[Piece] = [(0.0, response)]
        for fault in self._faults:
            pieces = fault.pieces(pieces)
        return pieces
