"""The CAN messages as a DBC file, made by cantools from the table of signals."""

from collections import OrderedDict
from typing import Final

from cantools.database import Database
from cantools.database.can import Message as DbcMessage
from cantools.database.can import Node
from cantools.database.can import Signal as DbcSignal
from cantools.database.can.formats.dbc import DbcAttribute, DbcAttributeDefinition, DbcSpecifics
from cantools.database.conversion import BaseConversion
from cantools.database.namedsignalvalue import NamedSignalValue

from bench_protocol.messages import Field, Message, Protection
from bench_protocol.table import TABLE
from bench_protocol.units import in_unit

_CYCLE: Final = DbcAttributeDefinition[int]("GenMsgCycleTime", 0, "BO_", "INT", 0, 65535)
_PROFILE: Final = DbcAttributeDefinition[str]("E2EProfile", "none", "BO_", "STRING")
_DATA_ID: Final = DbcAttributeDefinition[int]("E2EDataID", 0, "BO_", "INT", 0, 65535)
_TOKEN: Final = DbcAttributeDefinition[str]("E2EToken", "none", "BO_", "STRING")
_HASH: Final = DbcAttributeDefinition[str]("MapHash", "", None, "STRING")


def dbc() -> str:
    """Return the text of the DBC file."""
    specifics = DbcSpecifics(
        attributes=OrderedDict(MapHash=DbcAttribute(f"{TABLE.map_hash:08x}", _HASH)),
        attribute_definitions=OrderedDict((d.name, d) for d in (_CYCLE, _PROFILE, _DATA_ID, _TOKEN, _HASH)),
    )
    database = Database(
        messages=[_message(row) for row in TABLE.messages],
        nodes=[Node("rig", "The air spring test bench"), Node("commander", "Whoever runs a plan")],
        version=f"map {TABLE.map_hash:08x}",
        dbc_specifics=specifics,
    )
    return database.as_dbc_string().replace("\r\n", "\n")


def _message(row: Message) -> DbcMessage:
    cycle = round(1000 / row.rate) if row.rate else 0
    attributes: OrderedDict[str, DbcAttribute[str] | DbcAttribute[int] | DbcAttribute[float]] = OrderedDict(
        GenMsgCycleTime=DbcAttribute(cycle, _CYCLE)
    )
    if row.protection is Protection.E2E:
        attributes["E2EProfile"] = DbcAttribute("01", _PROFILE)
        attributes["E2EDataID"] = DbcAttribute(row.data_id, _DATA_ID)
        if row.bound or row.token_bit >= 0:
            attributes["E2EToken"] = DbcAttribute("data id" if row.bound else "field", _TOKEN)
    return DbcMessage(
        frame_id=row.identifier,
        name=row.name,
        length=8,
        signals=[_signal(row, field, bit) for field, bit in row.placed()] + _protection(row),
        comment=row.description,
        senders=["rig" if row.from_rig else "commander"],
        cycle_time=cycle or None,
        dbc_specifics=DbcSpecifics(attributes=attributes),
        strict=True,
    )


def _signal(message: Message, field: Field, first_bit: int) -> DbcSignal:
    row = TABLE[field.signal]
    choices: OrderedDict[int, str | NamedSignalValue] = OrderedDict(enumerate(row.choices))
    if field.nullable:
        choices[field.raw_null] = "not available"
    conversion = BaseConversion.factory(
        scale=_short(in_unit(field.step or row.step, row.unit)),
        offset=0,
        choices=choices or None,
        is_float=False,
    )
    return DbcSignal(
        row.name.replace(".", "_"),
        first_bit,
        field.bits,
        "little_endian",
        field.signed,
        conversion=conversion,
        minimum=_short(in_unit(row.low, row.unit)),
        maximum=_short(in_unit(row.high, row.unit)),
        unit=None if row.unit == "1" else row.unit,
        comment=row.description,
        receivers=["commander" if message.from_rig else "rig"],
    )


def _protection(row: Message) -> list[DbcSignal]:
    if row.protection is Protection.COUNTER:
        return [DbcSignal("sample_counter", row.counter_bit, 8, "little_endian")]
    if row.protection is Protection.E2E:
        return [
            DbcSignal("e2e_crc", 0, 8, "little_endian"),
            DbcSignal("e2e_counter", row.counter_bit, 4, "little_endian"),
        ]
    return []


def _short(value: float) -> float | int:
    """Return ``value`` without the rounding error of a division; an integer if it has no fraction."""
    rounded = float(f"{value:.10g}")
    return int(rounded) if rounded == int(rounded) else rounded
