"""The rig's object dictionary as an electronic data sheet (EDS, CiA 306), for CANopen tools."""

from collections.abc import Iterable, Iterator
from typing import Final

from bench_protocol import canopen
from bench_protocol.object_dictionary import (
    DEVICE_NAME,
    DEVICE_TYPE,
    ERROR_REGISTER,
    IDENTITY,
    OBJECT_DICTIONARY,
    DictionaryObject,
    Entry,
    ObjectCode,
)
from bench_protocol.table import TABLE

_MANDATORY: Final = (DEVICE_TYPE, ERROR_REGISTER, IDENTITY)
_MANUFACTURER: Final = range(0x2000, 0x6000)
_BIT_RATES: Final = (10, 20, 50, 125, 250, 500, 800, 1000)
_BIT_RATE: Final = 500
#: The data types 1 to 7. RPDOs of other devices map them where they ignore bits.
_DUMMIES: Final = range(1, 8)


def eds() -> str:
    """Return the text of the EDS file."""
    sections = [
        _section("FileInfo", _file_info()),
        _section("DeviceInfo", _device_info()),
        _section("DummyUsage", ((f"Dummy{number:04}", 0) for number in _DUMMIES)),
        _section("Comments", _comments()),
    ]
    indices = [one.index for one in OBJECT_DICTIONARY]
    kinds = {
        "MandatoryObjects": [index for index in indices if index in _MANDATORY],
        "OptionalObjects": [i for i in indices if i not in _MANDATORY and i not in _MANUFACTURER],
        "ManufacturerObjects": [index for index in indices if index in _MANUFACTURER],
    }
    for title, listed in kinds.items():
        rows = [("SupportedObjects", len(listed)), *((str(k), f"0x{i:04X}") for k, i in enumerate(listed, 1))]
        sections.append(_section(title, rows))
        of_kind = [one for one in OBJECT_DICTIONARY if one.index in listed]
        sections += [text for one in of_kind for text in _object(one)]
    return "\n".join(sections)


def _section(title: str, rows: Iterable[tuple[str, object]]) -> str:
    return "".join((f"[{title}]\n", *(f"{key}={value}\n" for key, value in rows)))


def _file_info() -> Iterator[tuple[str, object]]:
    yield "FileName", "astb.eds"
    yield "FileVersion", 1
    yield "FileRevision", 0
    yield "EDSVersion", "4.0"
    yield "Description", f"Air spring test bench, map {TABLE.map_hash:08x}"
    # A date would make the same table give another file tomorrow.
    for event in ("Creation", "Modification"):
        yield f"{event}Time", "12:00AM"
        yield f"{event}Date", "01-01-2026"
    yield "CreatedBy", "ASTB"
    yield "ModifiedBy", "ASTB"


def _device_info() -> Iterator[tuple[str, object]]:
    own = {one.index: one for one in OBJECT_DICTIONARY}
    _, vendor, product, revision = (entry.default for entry in own[IDENTITY].entries)
    pdos = [message for message in TABLE.messages if canopen.is_pdo(message)]
    yield "VendorName", "ASTB"
    yield "VendorNumber", f"0x{vendor:08X}"
    yield "ProductName", own[DEVICE_NAME].entries[0].default
    yield "ProductNumber", f"0x{product:08X}"
    yield "RevisionNumber", f"0x{revision:08X}"
    yield "OrderCode", "ASTB"
    for rate in _BIT_RATES:
        yield f"BaudRate_{rate}", int(rate == _BIT_RATE)
    yield "SimpleBootUpMaster", 0
    yield "SimpleBootUpSlave", 1
    yield "Granularity", 0  # the mapping is fixed
    yield "DynamicChannelsSupported", 0
    yield "CompactPDO", 0
    yield "GroupMessaging", 0
    yield "NrOfRXPDO", sum(not message.from_rig for message in pdos)
    yield "NrOfTXPDO", sum(message.from_rig for message in pdos)
    yield "LSS_Supported", 0


def _comments() -> Iterator[tuple[str, object]]:
    lines = (
        f"The rig is node {canopen.NODE}, and has PDOs with the COB-IDs of other nodes:",
        "tools that guess nodes from identifiers see more of them than there are.",
        "What it receives needs the CRC and counter of AUTOSAR E2E profile 1; see the DBC file.",
    )
    yield "Lines", len(lines)
    yield from ((f"Line{number}", line) for number, line in enumerate(lines, 1))


def _object(one: DictionaryObject) -> Iterator[str]:
    title = f"{one.index:04X}"
    if one.code is ObjectCode.VAR:
        yield _section(title, _entry(one.entries[0]))
        return
    head = (("ParameterName", one.name), ("ObjectType", f"0x{one.code:X}"), ("SubNumber", len(one.entries)))
    yield _section(title, head)
    for entry in one.entries:
        yield _section(f"{title}sub{entry.sub:X}", _entry(entry))


def _entry(entry: Entry) -> Iterator[tuple[str, object]]:
    """Yield the keys and values of an entry that CiA 306 requires, and those that Python's canopen also reads."""
    yield "ParameterName", entry.name
    yield "ObjectType", f"0x{ObjectCode.VAR:X}"
    yield "DataType", f"0x{entry.type:04X}"
    yield "AccessType", entry.access
    if entry.default is not None:
        yield "DefaultValue", entry.default
    if entry.low is not None and entry.high is not None:
        yield "LowLimit", entry.low
        yield "HighLimit", entry.high
    yield "PDOMapping", int(entry.mappable)
    if entry.factor != 1.0:
        yield "Factor", f"{entry.factor:.10g}"
    if entry.unit:
        yield "Unit", entry.unit
    if entry.description:
        yield "Description", entry.description.replace(";", ",")
