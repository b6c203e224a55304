"""Shared by the tests of the wires: a bank of registers, open servers, and distinguishable blocks of frames."""

import socket
import struct
import time
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import pytest

from bench_protocol.frames import FRAME, Block
from bench_protocol.modbus import DEVICE_FAILURE, ILLEGAL_ADDRESS, ModbusError
from bench_protocol.modbus import answer as modbus_answer
from bench_sim.rig.modbus_server import ModbusTcpServer
from bench_sim.rig.servers import serve_in_thread


class Registers:
    """A bank with all of 0 to 999 in each of its four tables."""

    SIZE = 1000

    def __init__(self) -> None:
        self.coils = [False] * self.SIZE
        self.discrete = [address % 3 == 0 for address in range(self.SIZE)]
        self.input = [(7 * address + 1) & 0xFFFF for address in range(self.SIZE)]
        self.holding = [0] * self.SIZE
        self.objects: dict[int, bytes] = {0: b"ASTB", 1: b"test bank", 2: b"1.0", 0x80: b"0123abcd"}
        self.files: dict[int, list[int]] = {}
        self.broken = False

    def _part(self, table: list, address: int, count: int) -> list:
        if self.broken:
            raise ModbusError(DEVICE_FAILURE)
        if address + count > self.SIZE:
            raise ModbusError(ILLEGAL_ADDRESS)
        return table[address : address + count]

    def read_coils(self, address: int, count: int) -> Sequence[bool]:
        return self._part(self.coils, address, count)

    def read_discrete(self, address: int, count: int) -> Sequence[bool]:
        return self._part(self.discrete, address, count)

    def read_input(self, address: int, count: int) -> Sequence[int]:
        return self._part(self.input, address, count)

    def read_holding(self, address: int, count: int) -> Sequence[int]:
        return self._part(self.holding, address, count)

    def write_coils(self, address: int, values: Sequence[bool]) -> None:
        self._part(self.coils, address, len(values))
        self.coils[address : address + len(values)] = values

    def write_holding(self, address: int, values: Sequence[int]) -> None:
        self._part(self.holding, address, len(values))
        self.holding[address : address + len(values)] = values

    def read_file(self, file: int, record: int, count: int) -> Sequence[int]:
        words = self.files.get(file, [])
        if record + count > len(words):
            raise ModbusError(ILLEGAL_ADDRESS)
        return words[record : record + count]

    def identification(self) -> Mapping[int, bytes]:
        return self.objects


@pytest.fixture
def bank() -> Registers:
    return Registers()


@pytest.fixture
def modbus_port(bank: Registers) -> Iterator[int]:
    """The TCP port of a server in front of ``bank``."""
    server = ModbusTcpServer(lambda adu, peer: modbus_answer(adu, bank))
    with serve_in_thread(modbus_server=server) as servers:
        assert servers.modbus_port is not None
        yield servers.modbus_port


@pytest.fixture
def dead_port() -> Iterator[int]:
    """A port that is ours, without a server."""
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        yield unused.getsockname()[1]


@pytest.fixture(scope="session")
def numbered() -> Callable[..., Block]:
    """Make ``count`` full frames that carry their own number."""

    def make(count: int, start: int = 0) -> Block:
        block = np.zeros(count, FRAME)
        numbers = np.arange(start, start + count)
        block["id"] = numbers % 0x800
        block["length"] = 8
        block["data"] = np.frombuffer(struct.pack(f">{count}q", *numbers), np.uint8).reshape(count, 8)
        return block

    return make


@pytest.fixture(scope="session")
def numbers() -> Callable[[Block], list[int]]:
    """Read the numbers back that ``numbered`` has written."""
    return lambda block: block["data"].copy().view(">i8")[:, 0].tolist()


@pytest.fixture(scope="session")
def addresses() -> Callable[[Sequence[str]], list[str]]:
    """Return a function that takes the numbers off the names of connections."""
    return lambda names: [name.partition("#")[0] for name in names]


@pytest.fixture(scope="session")
def eventually() -> Callable[..., None]:
    """Wait until something is true; fail, with what it was, if that takes too long."""

    def wait(condition: Callable[[], object], within: float = 2.0, what: str = "the condition") -> None:
        deadline = time.monotonic() + within
        while not condition():
            assert time.monotonic() < deadline, f"{what} did not come true within {within} s"
            time.sleep(0.001)

    return wait
