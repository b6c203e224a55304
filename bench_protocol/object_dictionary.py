"""The object dictionary of the rig as a CANopen node, made from the table of signals.

Indices never change, because they follow from an identifier or an address::

    1000h to 1FFFh   objects of CiA 301
    2000h + COB-ID   a PDO: one sub-index per field of the message, in the codes of the wire
    3000h + address  a reading, by its input register: REAL32 in SI, NaN where not available
    4000h + address  a setting in force, by its holding register: REAL32 in SI
    5000h + address  an interlock, by its discrete input
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from itertools import pairwise
from string import ascii_uppercase
from typing import Final

from bench_protocol import canopen
from bench_protocol.messages import FRAME_BITS, Field, Message, Protection
from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.units import in_unit
from bench_protocol.wires import Table

PDO_OBJECTS: Final = 0x2000
READING_OBJECTS: Final = 0x3000
SETTING_OBJECTS: Final = 0x4000
INTERLOCK_OBJECTS: Final = 0x5000

DEVICE_TYPE, ERROR_REGISTER, ERROR_HISTORY = 0x1000, 0x1001, 0x1003
SYNC_COB_ID, SYNC_PERIOD = 0x1005, 0x1006
DEVICE_NAME, HARDWARE_VERSION, SOFTWARE_VERSION = 0x1008, 0x1009, 0x100A
EMERGENCY_COB_ID, HEARTBEAT_CONSUMER, HEARTBEAT_PRODUCER = 0x1014, 0x1016, 0x1017
IDENTITY, ERROR_BEHAVIOUR, SDO_SERVER, NMT_STARTUP = 0x1018, 0x1029, 0x1200, 0x1F80
RPDO_PARAMETERS, RPDO_MAPPING, TPDO_PARAMETERS, TPDO_MAPPING = 0x1400, 0x1600, 0x1800, 0x1A00
REFUSED, TOKEN_OBJECT = 0x2000, 0x2001

ERRORS_KEPT: Final = 8
#: Sub-indices of a PDO's communication parameters.
PDO_COB_ID, TRANSMISSION_TYPE = 1, 2
#: Sub-indices of the bits of a PDO that are not fields. They are high, so that fields can be added.
SPARE_SUB, CRC_SUB, COUNTER_SUB = 0xFC, 0xFD, 0xFE
_BASES: Final = {
    Kind.MEASUREMENT: READING_OBJECTS,
    Kind.STATUS: READING_OBJECTS,
    Kind.SETTING: SETTING_OBJECTS,
    Kind.INTERLOCK: INTERLOCK_OBJECTS,
}
_PRODUCT: Final = int.from_bytes(b"ASTB", "big")


class DataType(IntEnum):
    """Data types of CiA 301, by their number."""

    BOOLEAN = 0x01
    INTEGER8 = 0x02
    INTEGER16 = 0x03
    INTEGER32 = 0x04
    UNSIGNED8 = 0x05
    UNSIGNED16 = 0x06
    UNSIGNED32 = 0x07
    REAL32 = 0x08
    VISIBLE_STRING = 0x09
    INTEGER24 = 0x10
    INTEGER40 = 0x12
    INTEGER48 = 0x13
    INTEGER56 = 0x14
    INTEGER64 = 0x15
    UNSIGNED24 = 0x16
    UNSIGNED40 = 0x18
    UNSIGNED48 = 0x19
    UNSIGNED56 = 0x1A
    UNSIGNED64 = 0x1B

    @property
    def signed(self) -> bool:
        """Whether its numbers may be negative."""
        return self.name.startswith("INTEGER")

    @property
    def size(self) -> int:
        """Bytes of a value; 0 for a string of any length."""
        bits = self.name.lstrip(ascii_uppercase)
        return int(bits) // 8 if bits.isdigit() else int(self is DataType.BOOLEAN)


class ObjectCode(IntEnum):
    """Kinds of object, by their number in an EDS."""

    VAR = 7
    ARRAY = 8
    RECORD = 9


@dataclass(frozen=True, slots=True)
class Entry:
    """One value of the dictionary.

    ``low``, ``high`` and ``factor`` are for the number on the wire; the displayed value is ``factor`` times that
    number, in ``unit``. ``signal`` is the table row of the value, if any.
    """

    sub: int
    name: str
    type: DataType
    access: str = "ro"  #: ro, wo, rw, const, or rww: mapped to a frame that the node receives
    default: int | float | str | None = None
    low: int | None = None
    high: int | None = None
    unit: str = ""
    factor: float = 1.0
    mappable: bool = False
    description: str = ""
    signal: str = ""

    @property
    def readable(self) -> bool:
        """Whether an SDO may read it."""
        return self.access != "wo"

    @property
    def writable(self) -> bool:
        """Whether it may be written at all."""
        return self.access in ("rw", "wo", "rww")


@dataclass(frozen=True, slots=True)
class DictionaryObject:
    """An index of the dictionary with its entries; a VAR has one, with sub-index 0."""

    index: int
    name: str
    code: ObjectCode
    entries: tuple[Entry, ...]


def object_dictionary(table: Table) -> tuple[DictionaryObject, ...]:
    """Return all objects by index. Raises ValueError for two with one index, or for a message without a PDO."""
    pdos = [message for message in table.messages if canopen.is_pdo(message)]
    objects = [*_of_the_node(table), *_counters()]
    for message in pdos:
        objects += [_parameters(message), _mapping(message), _pdo(table, message)]
    for signal in table.of_kind(*_BASES):
        contact = signal.kind is Kind.INTERLOCK
        index = _BASES[signal.kind] + (signal.address or 0)
        entry = Entry(
            0,
            signal.name,
            DataType.BOOLEAN if contact else DataType.REAL32,
            unit=signal.si if signal.si != "1" else "",
            description=signal.description,
            signal=signal.name,
        )
        objects.append(DictionaryObject(index, signal.name, ObjectCode.VAR, (entry,)))
    objects.sort(key=lambda one: one.index)
    for one, other in pairwise(objects):
        if one.index == other.index:
            raise ValueError(
                f"{one.name} and {other.name} are both object {one.index:04X}h; change one of them"
            )
    return tuple(objects)


def _var(
    index: int, name: str, type_: DataType, default: int | str, access: str = "ro", text: str = ""
) -> DictionaryObject:
    entry = Entry(0, name, type_, access, default, description=text)
    return DictionaryObject(index, name, ObjectCode.VAR, (entry,))


def _several(index: int, name: str, code: ObjectCode, *entries: Entry, count: str = "ro") -> DictionaryObject:
    """Return an ARRAY or RECORD; its sub-index 0 has the highest sub-index."""
    last = max(entry.sub for entry in entries)
    head = Entry(0, "Highest sub-index supported", DataType.UNSIGNED8, count, 0 if count == "rw" else last)
    return DictionaryObject(index, name, code, (head, *entries))


def _of_the_node(table: Table) -> Iterator[DictionaryObject]:
    """Yield the objects that CiA 301 defines for every node."""
    word, long, text = DataType.UNSIGNED16, DataType.UNSIGNED32, DataType.VISIBLE_STRING
    yield _var(DEVICE_TYPE, "Device type", long, 0, text="No device profile")
    yield _var(ERROR_REGISTER, "Error register", DataType.UNSIGNED8, 0)
    kept = "Code in bits 0 to 15, reason from bit 16, number of the reading whose limit tripped from bit 24"
    errors = (
        Entry(k, f"Standard error field {k}", long, default=0, description=kept)
        for k in range(1, ERRORS_KEPT + 1)
    )
    yield _several(ERROR_HISTORY, "Pre-defined error field", ObjectCode.ARRAY, *errors, count="rw")
    yield _var(SYNC_COB_ID, "COB-ID SYNC message", long, canopen.SYNC_IDENTIFIER, "rw")
    yield _var(
        SYNC_PERIOD, "Communication cycle period", long, 0, "rw", "In us, whole milliseconds; 0: no SYNC"
    )
    yield _var(DEVICE_NAME, "Manufacturer device name", text, "ASTB virtual air spring test bench", "const")
    yield _var(HARDWARE_VERSION, "Manufacturer hardware version", text, "virtual", "const")
    yield _var(SOFTWARE_VERSION, "Manufacturer software version", text, f"map {table.map_hash:08x}", "const")
    yield _var(EMERGENCY_COB_ID, "COB-ID EMCY", long, canopen.EMERGENCY_IDENTIFIER)
    yield _several(
        HEARTBEAT_CONSUMER,
        "Consumer heartbeat time",
        ObjectCode.ARRAY,
        Entry(
            1,
            "Commander",
            long,
            "rw",
            0,
            description="Node-ID in bits 16 to 22, ms in bits 0 to 15; 0: nobody",
        ),
    )
    yield _var(
        HEARTBEAT_PRODUCER, "Producer heartbeat time", word, canopen.HEARTBEAT_MS, "rw", "In ms; 0: none"
    )
    yield _several(
        IDENTITY,
        "Identity object",
        ObjectCode.RECORD,
        Entry(1, "Vendor-ID", long, default=0),
        Entry(2, "Product code", long, default=_PRODUCT),
        Entry(3, "Revision number", long, default=table.map_hash, description="The map hash of the table"),
    )
    yield _several(
        ERROR_BEHAVIOUR,
        "Error behaviour object",
        ObjectCode.ARRAY,
        Entry(
            1, "Communication error", DataType.UNSIGNED8, "rw", int(canopen.ErrorBehaviour.NO_CHANGE), 0, 2
        ),
    )
    yield _several(
        SDO_SERVER,
        "SDO server parameter",
        ObjectCode.RECORD,
        Entry(1, "COB-ID client to server", long, default=canopen.SDO_REQUEST_IDENTIFIER),
        Entry(2, "COB-ID server to client", long, default=canopen.SDO_RESPONSE_IDENTIFIER),
    )
    yield _var(NMT_STARTUP, "NMT startup", long, 0, text="The node enters OPERATIONAL by itself")


def _counters() -> Iterator[DictionaryObject]:
    """Yield the objects of the node that are not signals."""
    names = (
        "NMT commands while somebody holds the bench",
        "SDO downloads without the holder's token",
        "Frames beyond what the node takes at once",
        "Commands while the node was not operational",
    )
    refused = (Entry(k, name, DataType.UNSIGNED32, default=0) for k, name in enumerate(names, 1))
    yield _several(REFUSED, "Refused", ObjectCode.RECORD, *refused)
    yield _var(
        TOKEN_OBJECT,
        "Token",
        DataType.UNSIGNED16,
        0,
        "wo",
        "That of the holder opens the one download that follows",
    )


def _parameters(message: Message) -> DictionaryObject:
    """Return the communication parameters of a PDO."""
    byte, word, long = DataType.UNSIGNED8, DataType.UNSIGNED16, DataType.UNSIGNED32
    number, sent = canopen.pdo_number(message), message.from_rig
    access = "rw" if sent else "ro"
    cob_id = message.identifier | (canopen.NO_REMOTE if sent else 0)
    entries = [
        Entry(PDO_COB_ID, "COB-ID", long, access, cob_id),
        Entry(TRANSMISSION_TYPE, "Transmission type", byte, access, canopen.EVENT_DRIVEN[-1]),
    ]
    if sent:
        period = round(1000 / message.rate) if message.rate else 0
        entries += [
            Entry(3, "Inhibit time", word, default=0),
            Entry(5, "Event timer", word, default=period, description="In ms"),
        ]
    base, kind = (TPDO_PARAMETERS, "TPDO") if sent else (RPDO_PARAMETERS, "RPDO")
    name = f"{kind} {number} communication parameter: {message.name}"
    return _several(base + number - 1, name, ObjectCode.RECORD, *entries)


def _mapping(message: Message) -> DictionaryObject:
    """Return the mapping parameters of a PDO: entry by entry from bit 0 on, without a gap."""
    index, number = PDO_OBJECTS + message.identifier, canopen.pdo_number(message)
    entries = (
        Entry(k, f"Mapped object {k}", DataType.UNSIGNED32, default=index << 16 | sub << 8 | bits)
        for k, (sub, _, bits) in enumerate(mapped(message), 1)
    )
    base, kind = (TPDO_MAPPING, "TPDO") if message.from_rig else (RPDO_MAPPING, "RPDO")
    name = f"{kind} {number} mapping parameter: {message.name}"
    return _several(base + number - 1, name, ObjectCode.RECORD, *entries)


def mapped(message: Message) -> Iterator[tuple[int, int, int]]:
    """Yield sub-index, first bit and number of bits of all parts of the frame, including spare bits."""
    known = [(sub, bit, field.bits) for sub, (field, bit) in enumerate(message.placed(), 1)]
    if message.protection is Protection.E2E:
        known += [(CRC_SUB, 0, 8), (COUNTER_SUB, message.counter_bit, 4)]
    else:
        known += [(COUNTER_SUB, message.counter_bit, 8)]
    end = 0
    for sub, bit, bits in sorted(known, key=lambda place: place[1]):
        if bit > end:
            yield SPARE_SUB, end, bit - end
        yield sub, bit, bits
        end = bit + bits
    if end < FRAME_BITS:
        yield SPARE_SUB, end, FRAME_BITS - end


def _pdo(table: Table, message: Message) -> DictionaryObject:
    """Return the object with the fields of a message; those that the rig receives can be written by frames only."""
    fields = dict(enumerate(message.placed(), 1))
    own = {SPARE_SUB: "Spare bits", CRC_SUB: "CRC", COUNTER_SUB: "Counter"}
    entries = []
    for sub, bit, bits in sorted(mapped(message)):
        if sub in own:
            access = "ro" if message.from_rig else "wo"
            entries.append(Entry(sub, own[sub], _type(bit, bits), access, 0, mappable=True))
        else:
            entries.append(_field(table, message, sub, *fields[sub]))
    index = PDO_OBJECTS + message.identifier
    return _several(index, message.name, ObjectCode.RECORD, *entries)


def _field(table: Table, message: Message, sub: int, field: Field, bit: int) -> Entry:
    row = table[field.signal]
    step = field.step or row.step
    null = f"; {field.raw_null} on the wire: not available" if field.nullable else ""
    return Entry(
        sub,
        row.name,
        _type(bit, field.bits, signed=field.signed),
        "ro" if message.from_rig else "rww",
        field.raw_null if field.nullable else 0,
        round(row.low / step),
        round(row.high / step),
        row.unit if row.unit != "1" else "",
        float(f"{in_unit(step, row.unit):.10g}"),
        True,
        row.description + null,
        row.name,
    )


def _type(bit: int, bits: int, *, signed: bool = False) -> DataType:
    """Return the smallest type whose bytes contain ``bits`` from ``bit`` on, as tools extract them from the frame."""
    if bits == 1:
        return DataType.BOOLEAN
    size = -(-(bit % 8 + bits) // 8)
    return DataType[f"{'INTEGER' if signed else 'UNSIGNED'}{8 * size}"]


OBJECT_DICTIONARY: Final = object_dictionary(TABLE)
