"""Everything settable that a rig's wires show: settings, coils, contacts, states, and the CANopen objects."""

import math
import struct
from typing import Final

from bench_protocol.object_dictionary import ERROR_HISTORY, PDO_OBJECTS, READING_OBJECTS, SETTING_OBJECTS
from bench_protocol.sdo import SdoAbort
from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_sim.rig.node_objects import ENTRIES
from bench_sim.rig.rig import Rig

#: Counters, past values and present values, which are not settings.
_PAST: Final = (
    "rig.tick",
    "rig.reason",  # of a bench that was disabled: by whom; a reset clears it
    "rig.lease",
    "rig.holder",
    "rig.strangers",
    "rig.stranger",
    "rig.stranger_identifier",
    "rig.rejected_commands",
    "rig.refused_setpoints",
    "lease.nonce",
    "lease.token",
    "control.token",
)
_MESSAGES: Final = {PDO_OBJECTS + message.identifier: message for message in TABLE.messages}


def facts(rig: Rig) -> dict[str, float | bytes]:
    """Return all of it by name."""
    told: dict[str, float | bytes] = {}
    bank = rig.registers.seen_by("modbus:nobody")
    rig.answer(b"\0\1\0\0\0\6\1\4\0\0\0\1", "modbus:nobody")  # the shown value is that of a request
    for register in TABLE.registers:
        signal = register.signal
        if signal in TABLE.index and TABLE[signal].kind in (Kind.MEASUREMENT, Kind.SETPOINT):
            continue
        if signal in _PAST or signal.startswith("modbus.lease") or signal == "modbus.sequence":
            continue
        place = f"{signal} ({register.space} {register.address})"
        match register.space:
            case "holding":
                told[place] = _number(bank.read_holding(register.address, register.words))
            case "input":
                told[place] = _number(bank.read_input(register.address, register.words))
            case "coil":
                told[place] = float(bank.read_coils(register.address, 1)[0])
            case "discrete":
                told[place] = float(bank.read_discrete(register.address, 1)[0])
    told |= _objects(rig)
    told |= {f"commands: {name}": float(rig._controls[name]) for name in ("bits", "late", "lost", "program")}
    return told


def _objects(rig: Rig) -> dict[str, float | bytes]:
    told: dict[str, float | bytes] = {}
    for (index, sub), entry in ENTRIES.items():
        if not entry.readable or index == ERROR_HISTORY or "refused" in entry.name.lower():
            continue
        if READING_OBJECTS <= index < SETTING_OBJECTS or (
            (message := _MESSAGES.get(index)) and message.from_rig
        ):
            continue
        if (message := _MESSAGES.get(index)) and message.name in ("Control", "LeaseRequest"):
            continue  # of the present commander
        try:
            told[f"object {index:04x}/{sub} {entry.name}"] = rig.node.objects.read(index, sub)
        except SdoAbort as abort:
            told[f"object {index:04x}/{sub} {entry.name}"] = float(abort.code)
    return told


def differences(here: dict[str, float | bytes], there: dict[str, float | bytes]) -> list[str]:
    """Return in words what differs."""
    assert here.keys() == there.keys()
    return [f"{name}: {here[name]!r}, not {there[name]!r}" for name in here if here[name] != there[name]]


def _number(words: list[int]) -> float:
    if len(words) == 1:
        return float(words[0])
    number = float(struct.unpack(">f", struct.pack(">2H", *words))[0])
    return -1e9 if math.isnan(number) else number
