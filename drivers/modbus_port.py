"""The one place that knows pymodbus, which renames its interface in nearly every release.

A ``ModbusPort`` reads and writes numbers and says in words what went wrong. Behind it is pymodbus' synchronous
client, on a socket (``open_modbus``) or on a function that answers requests (``InMemoryModbus``): the bytes are
the same.
"""

import logging
import math
import struct
import threading
from collections.abc import Callable, Sequence
from typing import Final

from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ConnectionException, ModbusException
from pymodbus.pdu import ExceptionResponse, FileRecord, ModbusPDU
from pymodbus.pdu.mei_message import ReadDeviceInformationResponse

from bench_protocol.modbus import (
    BITS_READ_MAX,
    BITS_WRITE_MAX,
    FILE_READ_MAX,
    MEANING,
    REGISTERS_READ_MAX,
    REGISTERS_WRITE_MAX,
)
from drivers.errors import LinkLost, Refused

# Whatever pymodbus logs as an error is raised here as an exception; without this it is also printed.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())

_EXTENDED_ACCESS: Final = 3


class ModbusPort:
    """One device behind a pymodbus client; thread-safe, one request at a time, no retries.

    Addresses are 0-based. Every method raises Refused, LinkLost, or ValueError for numbers that no request
    can carry.
    """

    def __init__(self, client: ModbusTcpClient, where: str, unit: int = 1) -> None:
        self._client = client
        self._where = where
        self._unit = unit
        self._lock = threading.Lock()
        self._asking = 0  # the thread that waits for an answer
        self._postponed: list[Callable[[], None]] = []

    def between_requests(self, call: Callable[[], None]) -> None:
        """Call ``call`` now, or right after the request that this very thread is waiting for.

        In virtual time whoever waits for an answer lets time pass, and does what falls due meanwhile.
        """
        if self._asking == threading.get_ident():
            self._postponed.append(call)
        else:
            call()

    def read_coils(self, address: int, count: int) -> list[bool]:
        """Return ``count`` coils from ``address`` on (FC 1)."""
        what = self._range("reading coils", address, count, BITS_READ_MAX)
        read = self._client.read_coils
        return self._bits(what, count, lambda: read(address, count=count, device_id=self._unit))

    def read_discrete(self, address: int, count: int) -> list[bool]:
        """Return ``count`` discrete inputs from ``address`` on (FC 2)."""
        what = self._range("reading discrete inputs", address, count, BITS_READ_MAX)
        read = self._client.read_discrete_inputs
        return self._bits(what, count, lambda: read(address, count=count, device_id=self._unit))

    def read_holding(self, address: int, count: int) -> list[int]:
        """Return ``count`` holding registers from ``address`` on (FC 3)."""
        what = self._range("reading holding registers", address, count, REGISTERS_READ_MAX)
        read = self._client.read_holding_registers
        return self._counted(what, count, lambda: read(address, count=count, device_id=self._unit))

    def read_input(self, address: int, count: int) -> list[int]:
        """Return ``count`` input registers from ``address`` on, one snapshot (FC 4)."""
        what = self._range("reading input registers", address, count, REGISTERS_READ_MAX)
        read = self._client.read_input_registers
        return self._counted(what, count, lambda: read(address, count=count, device_id=self._unit))

    def read_file(self, file: int, record: int, count: int) -> list[int]:
        """Return ``count`` registers of a file from ``record`` on (FC 20)."""
        what = self._range(f"reading file {file}, record", record, count, FILE_READ_MAX)
        wanted = [FileRecord(file_number=file, record_number=record, record_length=2 * count)]
        reply = self._ask(what, lambda: self._client.read_file_record(wanted, device_id=self._unit))
        data = b"".join(one.record_data for one in getattr(reply, "records", ()))
        if len(data) != 2 * count:
            raise LinkLost(f"{what} failed: the device answered {len(data)} bytes instead of {2 * count}")
        return list(struct.unpack(f">{count}H", data))

    def write_coil(self, address: int, value: bool) -> None:
        """Set one coil (FC 5)."""
        what = self._range("writing the coil", address, 1, 1)
        self._ask(what, lambda: self._client.write_coil(address, bool(value), device_id=self._unit))

    def write_coils(self, address: int, values: Sequence[bool]) -> None:
        """Set coils from ``address`` on (FC 15)."""
        what = self._range("writing coils", address, len(values), BITS_WRITE_MAX)
        bits = [bool(value) for value in values]
        self._ask(what, lambda: self._client.write_coils(address, bits, device_id=self._unit))

    def write_registers(self, address: int, values: Sequence[int]) -> None:
        """Write holding registers from ``address`` on, all or none (FC 16)."""
        what = self._range("writing holding registers", address, len(values), REGISTERS_WRITE_MAX)
        numbers = [int(value) for value in values]
        for value in numbers:
            if not 0 <= value <= 0xFFFF:
                raise ValueError(f"{what}: {value} does not fit in a register (0 to 65535)")
        self._ask(what, lambda: self._client.write_registers(address, numbers, device_id=self._unit))

    def identification(self) -> dict[int, bytes]:
        """Return all identification objects by number (FC 43/14): 0 vendor, 1 product, 2 revision, …"""
        what = f"reading the identification of {self._where}"
        found: dict[int, bytes] = {}
        start: int | None = 0
        while start is not None:
            objects, following = self._identification_from(start, what)
            found.update(objects)
            if following is not None and following <= start:
                raise LinkLost(f"{what} failed: the device never comes to an end")
            start = following
        return found

    def _identification_from(self, start: int, what: str) -> tuple[dict[int, bytes], int | None]:
        """Return the objects of one answer and the number of the object to go on with, None at the end."""
        ask = self._client.read_device_information
        reply = self._ask(
            what, lambda: ask(read_code=_EXTENDED_ACCESS, object_id=start, device_id=self._unit)
        )
        if not isinstance(reply, ReadDeviceInformationResponse):
            raise LinkLost(f"{what} failed: the device answered something else")
        return dict(reply.information), reply.next_object_id if reply.more_follows else None

    def close(self) -> None:
        """Close the connection; the next call would open it again."""
        with self._lock:
            self._client.close()

    def _range(self, verb: str, address: int, count: int, count_max: int) -> str:
        """Return what is asked for in words, after a check that a request can carry it."""
        what = (
            f"{verb} {address}" + (f" to {address + count - 1}" if count > 1 else "") + f" of {self._where}"
        )
        if not 1 <= count <= count_max:
            raise ValueError(f"{verb}: count = {count} does not fit in one request (1 to {count_max})")
        if not 0 <= address <= 0x1_0000 - count:
            raise ValueError(f"{verb}: address = {address} with count = {count} is outside 0 to 65535")
        return what

    def _ask(self, what: str, request: Callable[[], ModbusPDU]) -> ModbusPDU:
        with self._lock:
            self._asking = threading.get_ident()
            try:
                reply = request()
            except ConnectionException:
                self._client.close()
                raise LinkLost(f"{what} failed: no connection; is the rig running?") from None
            except (ModbusException, OSError) as error:
                # A late answer must not be taken for that to the next request.
                self._client.close()
                raise LinkLost(f"{what} failed: {_reason(error)}") from None
            finally:
                self._asking = 0
        while self._postponed:
            self._postponed.pop()()
        if isinstance(reply, ExceptionResponse):
            code = reply.exception_code
            meaning = MEANING.get(code, "for a reason the specification does not know")
            raise Refused(f"{what} was refused: {meaning} (Modbus exception {code})", code)
        if reply.isError():
            raise LinkLost(f"{what} failed: {reply}")
        return reply

    def _bits(self, what: str, count: int, request: Callable[[], ModbusPDU]) -> list[bool]:
        bits = self._ask(what, request).bits[:count]
        if len(bits) != count:
            raise LinkLost(f"{what} failed: the device sent {len(bits)} bits instead of {count}")
        return list(bits)

    def _counted(self, what: str, count: int, request: Callable[[], ModbusPDU]) -> list[int]:
        registers = self._ask(what, request).registers
        if len(registers) != count:
            raise LinkLost(f"{what} failed: the device sent {len(registers)} registers instead of {count}")
        return list(registers)


def open_modbus(
    host: str, port: int = 502, *, unit: int = 1, timeout: float = 0.5, within: float = math.inf
) -> ModbusPort:
    """Connect to a device; ``timeout`` (s) bounds the connection and every answer, ``within`` (s) the first connection.

    Raises LinkLost if nobody answers there.
    """
    where = f"{host}:{port}"
    client = ModbusTcpClient(host, port=port, timeout=min(timeout, within), retries=0)
    if not client.connect():
        raise LinkLost(f"no Modbus device answers at {where}; is the rig running?")
    for params in (client.comm_params, client.transaction.comm_params):
        params.timeout_connect = timeout
    return ModbusPort(client, where, unit)


class InMemoryModbus(ModbusPort):
    """A ``ModbusPort`` without a socket: ``answer(adu)`` is called for each request, in the calling thread.

    An empty answer is a device that stays silent.
    """

    def __init__(self, answer: Callable[[bytes], bytes], unit: int = 1) -> None:
        super().__init__(_FunctionClient(answer), "the device in memory", unit)


class _FunctionClient(ModbusTcpClient):
    """pymodbus' client with a function in the place of its socket."""

    def __init__(self, answer: Callable[[bytes], bytes]) -> None:
        super().__init__("in memory", retries=0)
        self._answer = answer
        self._reply = b""

    @property
    def connected(self) -> bool:
        return True

    def connect(self) -> bool:
        return True

    def close(self) -> None:
        self._reply = b""

    def send(self, request: bytes, addr: tuple[str, int] | None = None) -> int:
        del addr
        self._reply = self._answer(request)
        return len(request)

    def recv(self, size: int | None) -> bytes:
        del size
        reply, self._reply = self._reply, b""
        return reply

    def is_socket_open(self) -> bool:
        return True


def _reason(error: Exception) -> str:
    text = str(error).removeprefix("Modbus Error: ").removeprefix("[Input/Output] ")
    return "the device does not answer" if "No response received" in text else text
