"""Modbus/TCP without sockets: requests from a byte stream, and the answer of a bank of registers to each.

Source: *MODBUS Application Protocol Specification V1.1b3* (section numbers below) and *MODBUS Messaging on TCP/IP
Implementation Guide V1.0b*. An ADU is the MBAP header (transaction, protocol 0, length, unit) and the PDU (function
code, data); all numbers are big-endian.
"""

import struct
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Final, Protocol

# Exception codes, section 7.
ILLEGAL_FUNCTION: Final = 1
ILLEGAL_ADDRESS: Final = 2
ILLEGAL_VALUE: Final = 3
DEVICE_FAILURE: Final = 4
#: "Device busy" in the specification; this bench sends it to every client but its commander.
NO_AUTHORITY: Final = 6
NO_SUCH_UNIT: Final = 0x0B

#: The meaning of each exception code, for messages to users.
MEANING: Final[Mapping[int, str]] = {
    ILLEGAL_FUNCTION: "the device does not know the function; use another one",
    ILLEGAL_ADDRESS: "the address is outside the device's map; correct address and count",
    ILLEGAL_VALUE: "the device refuses the value or the count; correct it",
    DEVICE_FAILURE: "the device cannot carry out the request now: its state does not allow it, or an error "
    "occurred; check its state",
    5: "the device has accepted the request and still works on it; wait",
    NO_AUTHORITY: "another client commands the device; end that client, or wait",
    8: "the device's memory fails its parity check; repair the device",
    0x0A: "the gateway has no path to the device; check its configuration",
    NO_SUCH_UNIT: "no device answers to this unit identifier; correct the unit",
}

REGISTERS_READ_MAX: Final = 125
REGISTERS_WRITE_MAX: Final = 123
REGISTERS_READ_WRITE_MAX: Final = 121
#: Registers of one part of a file: 245 bytes of an answer, less its length and its reference type.
FILE_READ_MAX: Final = 121
BITS_READ_MAX: Final = 2000
BITS_WRITE_MAX: Final = 1968
PDU_MAX: Final = 253
ADU_MAX: Final = 260

#: On TCP 0 and 255 mean "the device at this address itself"; most clients send 1 by default.
OWN_UNITS: Final = frozenset({0, 1, 255})

_HEADER: Final = struct.Struct(">HHHB")
_TWO: Final = struct.Struct(">HH")
_ADDRESSES: Final = 0x1_0000
_FILE_REFERENCE: Final = 6
_FILE_RECORDS: Final = 10_000
_FILE_BYTES_MAX: Final = 0xF5
_COIL_ON, _COIL_OFF = 0xFF00, 0x0000
_WRITING: Final = frozenset({5, 6, 15, 16, 22, 23})
_MEI_IDENTIFICATION: Final = 0x0E
# Stream and individual access to basic, regular and extended objects (section 6.21).
_CONFORMITY: Final = 0x83
_LAST_OBJECT: Final = {1: 0x02, 2: 0x7F, 3: 0xFF}
_INDIVIDUAL: Final = 4


class ModbusError(Exception):
    """The request is refused with this exception code."""

    def __init__(self, code: int) -> None:
        super().__init__(
            f"{MEANING.get(code, 'reason unknown to the specification')} (Modbus exception {code})"
        )
        self.code = code


class FramingError(ValueError):
    """The stream is not Modbus/TCP, and the start of the next request is unknown: close the connection."""


class Bank(Protocol):
    """The data of a Modbus device. A method that raises ``ModbusError`` must not have changed anything.

    Addresses are 0-based; counts and values are within the limits of the protocol, ``address + count`` <= 65536.
    """

    def read_coils(self, address: int, count: int) -> Sequence[bool]: ...

    def read_discrete(self, address: int, count: int) -> Sequence[bool]: ...

    def read_input(self, address: int, count: int) -> Sequence[int]: ...

    def read_holding(self, address: int, count: int) -> Sequence[int]: ...

    def write_coils(self, address: int, values: Sequence[bool]) -> None: ...

    def write_holding(self, address: int, values: Sequence[int]) -> None: ...

    def read_file(self, file: int, record: int, count: int) -> Sequence[int]: ...

    def identification(self) -> Mapping[int, bytes]:
        """Return the identification objects by number: 0-2 basic, 3-6 regular, 0x80-0xFF the maker's own."""


class AduStream:
    """Splits the byte stream of one connection into ADUs, which may arrive together or in parts. It stores the
    incomplete ADU at the end.
    """

    def __init__(self) -> None:
        self._rest = b""

    @property
    def partial(self) -> bool:
        """Whether an incomplete ADU is stored."""
        return bool(self._rest)

    def feed(self, data: bytes) -> list[bytes]:
        """Return the ADUs completed by ``data``, header included.

        Raises FramingError on a wrong header. If complete ADUs precede it, they are returned, and the next call raises
        the error.
        """
        data = self._rest + data
        adus: list[bytes] = []
        start, available = 0, len(data)
        while available - start >= _HEADER.size:
            _, protocol, length, _ = _HEADER.unpack_from(data, start)
            if protocol or not 2 <= length <= PDU_MAX + 1:
                if adus:
                    break
                what = (
                    f"protocol = {protocol} is not 0 (Modbus)"
                    if protocol
                    else (f"length = {length} is not that of a Modbus request (2 to {PDU_MAX + 1} bytes)")
                )
                raise FramingError(f"the client sent a wrong MBAP header: {what}")
            end = start + 6 + length
            if end > available:
                break
            adus.append(data[start:end])
            start = end
        self._rest = data[start:]
        return adus


def answer(adu: bytes, bank: Bank, units: Collection[int] = OWN_UNITS) -> bytes:
    """Return the response ADU of ``bank`` to one request ADU (from ``AduStream``). A request to a unit that is not in
    ``units`` is refused.

    Every refusal becomes an exception response. Other errors of the bank are not caught.
    """
    unit, function = adu[6], adu[7]
    try:
        if unit not in units:
            raise ModbusError(NO_SUCH_UNIT)
        handler = _HANDLERS.get(function)
        if handler is None:
            raise ModbusError(ILLEGAL_FUNCTION)
        body = handler(adu[8:], bank)
    except ModbusError as refusal:
        return refuse(adu, refusal.code)
    return adu[:4] + (len(body) + 2).to_bytes(2, "big") + adu[6:8] + body


def is_write(adu: bytes) -> bool:
    """Return whether a request ADU would write."""
    return adu[7] in _WRITING


def refuse(adu: bytes, code: int) -> bytes:
    """Return the exception response with ``code`` to a request ADU."""
    return adu[:4] + b"\0\3" + bytes((adu[6], adu[7] | 0x80, code))


def pack_bits(bits: Sequence[bool]) -> bytes:
    """Return bits as Modbus packs them: the first in the lowest bit of the first byte, the last byte padded with 0."""
    number = 0
    for position, bit in enumerate(bits):
        if bit:
            number |= 1 << position
    return number.to_bytes((len(bits) + 7) // 8, "little")


def unpack_bits(data: bytes, count: int) -> list[bool]:
    """Return the first ``count`` bits of ``data``, the inverse of ``pack_bits``."""
    number = int.from_bytes(data, "little")
    return [bool(number >> position & 1) for position in range(count)]


def _range(body: bytes, count_max: int) -> tuple[int, int]:
    """Return the address and count in ``body``."""
    if len(body) != 4:
        raise ModbusError(ILLEGAL_VALUE)
    address, count = _TWO.unpack(body)
    if not 1 <= count <= count_max:
        raise ModbusError(ILLEGAL_VALUE)
    if address + count > _ADDRESSES:
        raise ModbusError(ILLEGAL_ADDRESS)
    return address, count


def _bits_body(bits: Sequence[bool]) -> bytes:
    packed = pack_bits(bits)
    return bytes((len(packed),)) + packed


def _registers_body(values: Sequence[int]) -> bytes:
    return struct.pack(f">B{len(values)}H", 2 * len(values), *values)


def _read_coils(body: bytes, bank: Bank) -> bytes:
    return _bits_body(bank.read_coils(*_range(body, BITS_READ_MAX)))


def _read_discrete(body: bytes, bank: Bank) -> bytes:
    return _bits_body(bank.read_discrete(*_range(body, BITS_READ_MAX)))


def _read_holding(body: bytes, bank: Bank) -> bytes:
    return _registers_body(bank.read_holding(*_range(body, REGISTERS_READ_MAX)))


def _read_input(body: bytes, bank: Bank) -> bytes:
    return _registers_body(bank.read_input(*_range(body, REGISTERS_READ_MAX)))


def _write_coil(body: bytes, bank: Bank) -> bytes:
    if len(body) != 4:
        raise ModbusError(ILLEGAL_VALUE)
    address, value = _TWO.unpack(body)
    if value not in (_COIL_ON, _COIL_OFF):
        raise ModbusError(ILLEGAL_VALUE)
    bank.write_coils(address, [value == _COIL_ON])
    return body


def _write_register(body: bytes, bank: Bank) -> bytes:
    if len(body) != 4:
        raise ModbusError(ILLEGAL_VALUE)
    address, value = _TWO.unpack(body)
    bank.write_holding(address, [value])
    return body


def _write_coils(body: bytes, bank: Bank) -> bytes:
    if len(body) < 5:
        raise ModbusError(ILLEGAL_VALUE)
    address, count = _range(body[:4], BITS_WRITE_MAX)
    if body[4] != (count + 7) // 8 or len(body) != 5 + body[4]:
        raise ModbusError(ILLEGAL_VALUE)
    bank.write_coils(address, unpack_bits(body[5:], count))
    return body[:4]


def _write_registers(body: bytes, bank: Bank) -> bytes:
    if len(body) < 5:
        raise ModbusError(ILLEGAL_VALUE)
    address, count = _range(body[:4], REGISTERS_WRITE_MAX)
    bank.write_holding(address, _values(body, 4, count))
    return body[:4]


def _mask_write_register(body: bytes, bank: Bank) -> bytes:
    """Write ``(register and AND_MASK) or (OR_MASK and not AND_MASK)`` (section 6.16)."""
    if len(body) != 6:
        raise ModbusError(ILLEGAL_VALUE)
    address, keep, new = struct.unpack(">HHH", body)
    (present,) = bank.read_holding(address, 1)
    bank.write_holding(address, [(present & keep) | (new & ~keep & 0xFFFF)])
    return body


def _read_write_registers(body: bytes, bank: Bank) -> bytes:
    """Write, then read (section 6.17); a trial read first ensures that a refused request writes nothing."""
    if len(body) < 9:
        raise ModbusError(ILLEGAL_VALUE)
    read = _range(body[:4], REGISTERS_READ_MAX)
    address, count = _range(body[4:8], REGISTERS_READ_WRITE_MAX)
    values = _values(body, 8, count)
    bank.read_holding(*read)
    bank.write_holding(address, values)
    return _registers_body(bank.read_holding(*read))


def _values(body: bytes, at: int, count: int) -> tuple[int, ...]:
    """Return the ``count`` registers behind the byte count at ``body[at]``."""
    if body[at] != 2 * count or len(body) != at + 1 + 2 * count:
        raise ModbusError(ILLEGAL_VALUE)
    return struct.unpack_from(f">{count}H", body, at + 1)


def _read_file(body: bytes, bank: Bank) -> bytes:
    """Read file records (section 6.14): several parts of several files in one request."""
    if not body or not 7 <= body[0] <= 245 or body[0] % 7 or len(body) != 1 + body[0]:
        raise ModbusError(ILLEGAL_VALUE)
    records = b""
    for at in range(1, len(body), 7):
        reference, file, record, count = struct.unpack_from(">BHHH", body, at)
        if reference != _FILE_REFERENCE or file == 0 or record + count > _FILE_RECORDS:
            raise ModbusError(ILLEGAL_ADDRESS)
        if not 1 <= count <= FILE_READ_MAX or len(records) + 2 + 2 * count > _FILE_BYTES_MAX:
            raise ModbusError(ILLEGAL_VALUE)
        records += struct.pack(
            f">BB{count}H", 1 + 2 * count, _FILE_REFERENCE, *bank.read_file(file, record, count)
        )
    return bytes((len(records),)) + records


def _identification(body: bytes, bank: Bank) -> bytes:
    """Read device identification (section 6.21): as many objects as fit into one answer, and the number of the next
    one.
    """
    if not body or body[0] != _MEI_IDENTIFICATION:
        raise ModbusError(ILLEGAL_FUNCTION)
    if len(body) != 3:
        raise ModbusError(ILLEGAL_VALUE)
    access, first = body[1], body[2]
    objects = bank.identification()
    if access == _INDIVIDUAL:
        if first not in objects:
            raise ModbusError(ILLEGAL_ADDRESS)
        numbers = [first]
    elif access in _LAST_OBJECT:
        known = sorted(number for number in objects if number <= _LAST_OBJECT[access])
        # A stream that starts at an object the device lacks starts at the beginning.
        numbers = [number for number in known if number >= (first if first in known else 0)]
    else:
        raise ModbusError(ILLEGAL_VALUE)
    listed, sent = b"", 0
    for number in numbers:
        # Function, MEI type, access, conformity, more follows, next object, number of objects: 7 bytes of the PDU.
        value = objects[number][: PDU_MAX - 7 - 2]
        entry = bytes((number, len(value))) + value
        if 7 + len(listed) + len(entry) > PDU_MAX:
            break
        listed += entry
        sent += 1
    more = sent < len(numbers)
    head = (_MEI_IDENTIFICATION, access, _CONFORMITY, 0xFF * more, numbers[sent] if more else 0, sent)
    return bytes(head) + listed


_HANDLERS: Final[Mapping[int, Callable[[bytes, Bank], bytes]]] = {
    1: _read_coils,
    2: _read_discrete,
    3: _read_holding,
    4: _read_input,
    5: _write_coil,
    6: _write_register,
    15: _write_coils,
    16: _write_registers,
    20: _read_file,
    22: _mask_write_register,
    23: _read_write_registers,
    43: _identification,
}
