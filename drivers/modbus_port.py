"""Access to Modbus devices. Only this module and `modbus_line` use pymodbus, whose interface changes often.

A ``ModbusPort`` reads and writes numbers and raises errors with a plain text. It uses pymodbus' synchronous client on a
socket or a serial line (``open_modbus``, ``open_serial``), or on a function that answers requests (``InMemoryModbus``).
Both exchange the same bytes.
"""

import contextlib
import logging
import math
import struct
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerType
from pymodbus.pdu import ExceptionResponse, FileRecord, ModbusPDU
from pymodbus.pdu.mei_message import ReadDeviceInformationResponse

from bench_protocol.modbus import (
    BITS_READ_MAX,
    BITS_WRITE_MAX,
    FILE_READ_MAX,
    MEANING,
    REGISTERS_READ_MAX,
    REGISTERS_READ_WRITE_MAX,
    REGISTERS_WRITE_MAX,
)
from drivers.errors import LinkLost, Refused
from drivers.modbus_line import SharedClient
from drivers.modbus_words import SerialLine, in_registers, request_in_words

# Errors that pymodbus logs are raised here as exceptions; without this handler they are also printed.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())

_EXTENDED_ACCESS: Final = 3
_CHECK_UNIT: Final = "check the Modbus unit number of the device"


class ModbusPort:
    """One device behind a pymodbus client; thread-safe, one request at a time.

    Addresses are 0-based. Every method raises Refused, LinkLost, or ValueError for numbers that no request
    can carry.
    """

    def __init__(self, line: SharedClient, unit: int = 1) -> None:
        self.line, self._unit = line, unit
        self._client: Any = line.client
        self._where = line.where
        self.meaning: Mapping[int, str] = MEANING  #: texts of the exception codes of the device
        self.discarded = 0  #: answers without a pending request, mostly late ones
        self._asking = 0  # the thread that waits for an answer
        self._postponed: list[Callable[[], None]] = []
        #: The local TCP ports from which requests were sent. Each new connection has another port.
        self.local_ports: set[int] = set()
        line.join(self)

    def between_requests(self, call: Callable[[], None]) -> None:
        """Call ``call`` now, or after the request for which this thread is waiting.

        In virtual time a thread that waits for an answer advances the clock, which runs other tasks.
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
        records = [FileRecord(file_number=file, record_number=record, record_length=2 * count)]
        reply = self._request(what, lambda: self._client.read_file_record(records, device_id=self._unit))
        data = b"".join(one.record_data for one in getattr(reply, "records", ()))
        if len(data) != 2 * count:
            raise LinkLost(
                f"{what} failed: the device answered {len(data)} bytes instead of {2 * count}; {_CHECK_UNIT}"
            )
        return list(struct.unpack(f">{count}H", data))

    def write_coil(self, address: int, value: bool) -> None:
        """Set one coil (FC 5)."""
        what = self._range("writing the coil", address, 1, 1)
        self._request(what, lambda: self._client.write_coil(address, bool(value), device_id=self._unit))

    def write_coils(self, address: int, values: Sequence[bool]) -> None:
        """Set coils from ``address`` on (FC 15)."""
        what = self._range("writing coils", address, len(values), BITS_WRITE_MAX)
        bits = [bool(value) for value in values]
        self._request(what, lambda: self._client.write_coils(address, bits, device_id=self._unit))

    def write_register(self, address: int, value: int) -> None:
        """Write one holding register (FC 6)."""
        what = self._range("writing the holding register", address, 1, 1)
        (number,) = in_registers(what, [value])
        self._request(what, lambda: self._client.write_register(address, number, device_id=self._unit))

    def write_registers(self, address: int, values: Sequence[int]) -> None:
        """Write holding registers from ``address`` on, all or none (FC 16)."""
        what = self._range("writing holding registers", address, len(values), REGISTERS_WRITE_MAX)
        numbers = in_registers(what, values)
        self._request(what, lambda: self._client.write_registers(address, numbers, device_id=self._unit))

    def exchange_registers(self, address: int, values: Sequence[int]) -> None:
        """Write holding registers from ``address`` on, all or none, and read the first of them (FC 23)."""
        what = self._range("writing holding registers", address, len(values), REGISTERS_READ_WRITE_MAX)
        numbers = in_registers(what, values)
        keys = {"read_address": address, "read_count": 1, "write_address": address, "device_id": self._unit}
        self._request(what, lambda: self._client.readwrite_registers(values=numbers, **keys))

    def identification(self) -> dict[int, bytes]:
        """Return all identification objects by number (FC 43/14): 0 vendor, 1 product, 2 revision, …"""
        what = f"reading the identification of {self._where}"
        found: dict[int, bytes] = {}
        start: int | None = 0
        while start is not None:
            objects, following = self._identification_from(start, what)
            found.update(objects)
            if following is not None and following <= start:
                raise LinkLost(
                    f"{what} failed: the object numbers do not rise from answer to answer, so the "
                    "answers do not end; update the device, or do not read its identification"
                )
            start = following
        return found

    def _identification_from(self, start: int, what: str) -> tuple[dict[int, bytes], int | None]:
        """Return the objects of one answer and the number of the next object, None at the end."""
        ask = self._client.read_device_information
        reply = self._request(
            what, lambda: ask(read_code=_EXTENDED_ACCESS, object_id=start, device_id=self._unit)
        )
        if not isinstance(reply, ReadDeviceInformationResponse):
            raise LinkLost(f"{what} failed: the device answered with another function code; {_CHECK_UNIT}")
        return dict(reply.information), reply.next_object_id if reply.more_follows else None

    def close(self) -> None:
        """Close the connection, unless another port uses it; the next request opens it again."""
        self.line.leave(self)

    def _range(self, verb: str, address: int, count: int, count_max: int) -> str:
        return request_in_words(verb, address, count, count_max, self._where)

    def _request(
        self,
        what: str,
        request: Callable[[], ModbusPDU],
        mismatch: Callable[[ModbusPDU], str] | None = None,
    ) -> ModbusPDU:
        """Send a request and return the reply. Raises Refused or LinkLost.

        ``mismatch`` is given for readings only, which may be repeated: it returns why a reply does not fit, "" if it
        does.
        """
        with self.line.lock:
            self.line.join(self)
            self._asking = threading.get_ident()
            discarded = self.line.discarded
            try:
                reply = self.line.execute(request, repeatable=mismatch is not None)
                if mismatch is not None and not reply.isError() and (reason := mismatch(reply)):
                    self.line.lose()
                    raise LinkLost(f"{what} failed: {reason}")
            except (ModbusException, OSError) as error:
                reason = self.line.reason(error)
                self.line.lose()
                raise LinkLost(f"{what} failed: {reason}") from None
            finally:
                self._asking = 0
                self.discarded += self.line.discarded - discarded
                self._note_port()
        while self._postponed:
            self._postponed.pop()()
        if isinstance(reply, ExceptionResponse):
            code = reply.exception_code
            meaning = self.meaning.get(code, "for a reason that is not in the specification")
            raise Refused(f"{what} was refused: {meaning} (Modbus exception {code})", code)
        if reply.isError():
            raise LinkLost(
                f"{what} failed: the answer does not belong to the request; check the address and unit of the device"
            )
        return reply

    def _note_port(self) -> None:
        sock = getattr(self._client, "socket", None)
        with contextlib.suppress(OSError):
            if sock is not None and hasattr(sock, "getsockname"):  # a serial line has no port
                self.local_ports.add(int(sock.getsockname()[1]))

    def _bits(self, what: str, count: int, request: Callable[[], ModbusPDU]) -> list[bool]:
        def mismatch(reply: ModbusPDU) -> str:
            sent = len(getattr(reply, "bits", []))
            fits = sent == -(-count // 8) * 8 if self.line.unnumbered else sent >= count
            return "" if fits else f"the device sent {sent} bits instead of {count}"

        return list(self._request(what, request, mismatch).bits[:count])

    def _counted(self, what: str, count: int, request: Callable[[], ModbusPDU]) -> list[int]:
        def mismatch(reply: ModbusPDU) -> str:
            sent = len(getattr(reply, "registers", []))
            return "" if sent == count else f"the device sent {sent} registers instead of {count}"

        return list(self._request(what, request, mismatch).registers)


_shared: dict[object, SharedClient] = {}
_sharing: Final = threading.Lock()


def open_modbus(
    host: str,
    port: int = 502,
    *,
    unit: int = 1,
    timeout: float = 0.5,
    within: float = math.inf,
    rtu: bool = False,
    each: bool = False,
    echo: bool = True,
    shared: bool = False,
) -> ModbusPort:
    """Connect to a device. ``timeout`` (s) limits the connection and each answer, ``within`` (s) the first connection.

    ``rtu``: frames are those of a serial line. ``each``: a connection for each request. ``echo``: only answers with the
    unit and number of the request are accepted. ``shared``: share the connection with other ports at the same address.
    Raises LinkLost if the device cannot be reached.
    """
    where = f"{host}:{port}"

    def connect() -> SharedClient:
        framer = FramerType.RTU if rtu else FramerType.SOCKET
        client = ModbusTcpClient(host, port=port, framer=framer, timeout=min(timeout, within), retries=0)
        if not client.connect():
            raise LinkLost(f"no Modbus device answers at {where}; check that the rig runs")
        return _timed(SharedClient(client, where, each=each, echo=echo), timeout)

    return ModbusPort(_one_line((host, port, rtu), connect) if shared else connect(), unit)


def open_serial(serial: SerialLine, *, unit: int = 1, timeout: float = 0.5) -> ModbusPort:
    """Open a serial line, shared by all ports on it. ``timeout`` (s) limits each answer. Raises LinkLost if the line is
    missing or used by another process.
    """

    def connect() -> SharedClient:
        client = ModbusSerialClient(
            serial.device,
            baudrate=serial.baudrate,
            parity=serial.parity[0].upper(),
            stopbits=serial.stopbits,
            handle_local_echo=serial.local_echo,
            timeout=timeout,
            retries=0,
        )
        if not client.connect():
            raise LinkLost(
                f"the serial line {serial.device} cannot be opened; check that it exists, that this "
                "user may read and write it, that no other program uses it, and that it supports "
                f"{serial.baudrate} Bd with parity {serial.parity}"
            )
        return SharedClient(client, serial.device)

    return ModbusPort(_one_line(serial.device, connect), unit)


def _timed(line: SharedClient, timeout: float) -> SharedClient:
    """Set the time limit of each answer to ``timeout`` s, independent of that of the first connection."""
    for params in (line.client.comm_params, line.client.transaction.comm_params):
        params.timeout_connect = timeout
    return line


def _one_line(address: object, connect: Callable[[], SharedClient]) -> SharedClient:
    """Return the line at ``address`` if it is open already, or a new one."""
    with _sharing:
        found = _shared.get(address)
        if found is None or not found.used:
            _shared[address] = found = connect()
        return found


class InMemoryModbus(ModbusPort):
    """A ``ModbusPort`` without a socket: ``answer(adu)`` is called for each request, in the calling thread.

    An empty answer represents a silent device.
    """

    def __init__(self, answer: Callable[[bytes], bytes], unit: int = 1) -> None:
        super().__init__(SharedClient(_FunctionClient(answer), "the simulated PLC"), unit)


class _FunctionClient(ModbusTcpClient):
    """pymodbus' client with a function instead of its socket."""

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
