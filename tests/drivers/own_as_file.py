"""Our own protocol as a wiring file would have it: registers, messages, states and orders from the table, as data."""

import json
from pathlib import Path
from typing import Any

from bench_protocol.messages import TOKEN, Protection
from bench_protocol.signals import Kind, Signal
from bench_protocol.table import TABLE
from drivers.wiring import own
from drivers.wiring.contract import Order, Step
from drivers.wiring.lines import PLAYED
from tools.generate.dbc import dbc

SETTINGS = {signal.name for signal in TABLE.of_kind(Kind.SETTING)}
#: The CRC takes the data id exclusive-or the token, which the Control message carries.
FUNCTIONS = """
from bench_protocol.e2e import crc8
import numpy as np

token = 0

def crc(identifier, data):
    global token
    if identifier == 0x201:
        token = int.from_bytes(data, "little") >> 16 & 0xFFFF
        return crc8(np.frombuffer(data, np.uint8), 0x0A00 | identifier)
    return crc8(np.frombuffer(data, np.uint8), (0x0A00 | identifier) ^ token)
"""


def own_description(directory: Path, *, generator: bool = True) -> dict[str, Any]:
    """Return the keys of a wiring of our own rig; its DBC and its functions are written to ``directory``.

    Without ``generator`` the rig's is not mentioned, and the bench plays its waves.
    """
    sequences = own.own_description().sequences
    (directory / "astb.dbc").write_text(dbc())
    (directory / "own.py").write_text(FUNCTIONS)
    bus = {
        "kind": "can",
        "dbc": "astb.dbc",
        "node": "commander",
        "messages": {message.name: _protected(message) for message in TABLE.messages if _guarded(message)},
        "points": {
            f"{message.name}.{_bus_name(field.signal)}": {"null": field.raw_null}
            for message in TABLE.messages
            for field in message.fields
            if field.nullable
        },
    }
    plc = {"kind": "modbus", "host": "127.0.0.1", "points": dict(_points())}
    return {
        "functions": "own.py",
        "transports": {"bus": bus, "plc": plc},
        "signals": {
            signal.name: _line(signal)
            for signal in TABLE.signals
            if signal.kind is not Kind.FURTHER and (generator or not signal.name.startswith(PLAYED))
        },
        "capabilities": {"generator": generator},
        "sequences": {
            "up": [_step(step) for step in sequences.up],
            "reset": [_step(step) for step in sequences.reset],
            "rest": [_order(order) for order in sequences.rest],
            "at_rest": list(sequences.at_rest),
            "air": dict(sequences.air),
            "open": [{"plc.modbus.lease": 1}],
            "close": [{"plc.modbus.lease": 0}],
            "apply": [{"action.apply": 1}],
        },
    }


def write_wiring(directory: Path, keys: dict[str, Any]) -> Path:
    """Write a wiring file with these keys; return its path."""
    path = directory / "own_wiring.toml"
    path.write_text("".join(f"{key} = {_toml(value)}\n" for key, value in keys.items()))
    return path


def _toml(value: object) -> str:
    match value:
        case dict():
            return f"{{ {', '.join(f'{json.dumps(key)} = {_toml(one)}' for key, one in value.items())} }}"
        case list():
            return f"[{', '.join(map(_toml, value))}]"
        case _:
            return json.dumps(value)


def _guarded(message) -> bool:
    return message.protection is not Protection.NONE


def _protected(message) -> dict[str, Any]:
    if message.protection is Protection.COUNTER:
        return {"counter": "sample_counter"}
    keys = {
        "counter": "e2e_counter",
        "counter_period": 15,
        "checksum": {"signal": "e2e_crc", "scheme": "function:crc"},
    }
    return keys | ({"every": f"{1000 / message.rate:g} ms"} if message.rate else {})


def _bus_name(signal: str) -> str:
    return signal.replace(".", "_")


def _points():
    for register in TABLE.registers:
        name = register.signal if register.space != "holding" or register.signal not in TABLE.index else ""
        if register.encoding == "int16" or register.signal == "modbus.sequence":
            continue
        if register.space == "discrete" and TABLE[register.signal].kind is not Kind.INTERLOCK:
            continue
        one = {"table": register.space, "address": register.address, "type": register.encoding}
        if register.space == "input" and register.signal in SETTINGS:
            name = f"{register.signal}.active"
        yield name or register.signal, one


def _line(signal: Signal) -> dict[str, Any]:
    """Return the source of a signal: on CAN where CAN has it, else in the registers."""
    place = next(
        (
            f"bus.{message.name}.{_bus_name(signal.name)}"
            for message in TABLE.messages
            for field in message.fields
            if field.signal == signal.name
        ),
        f"plc.{signal.name}",
    )
    unit = signal.unit if place.startswith("bus.") else signal.si
    number = (
        {"choices": {name: k for k, name in enumerate(signal.choices)}} if signal.choices else {"unit": unit}
    )
    match signal.kind:
        case Kind.SETPOINT if signal.name.startswith("lease."):
            return {"absent": "the lease is taken on Modbus"}
        case Kind.SETPOINT:
            return {"to": place, **number, **({"given": "plc.modbus.lease"} if signal.name == TOKEN else {})}
        case Kind.SETTING:
            return {"to": place, "read": f"{place}.active", **number}
        case Kind.ACTION:
            return {"to": place}
        case _:
            return {"from": place, **number}


def _order(order: Order) -> dict[str, float]:
    return dict(order.values)


def _step(step: Step) -> dict[str, Any]:
    return {
        "start": list(step.start),
        "end": list(step.end),
        "bumpless": step.bumpless,
        **{
            key: [_order(order) for order in getattr(step, key)]
            for key in ("orders", "prepare", "afterwards")
        },
    }
