"""Commands for the fault panel of a running rig: each is one line of JSON, and so is its answer.

    {"do": "list"}
    {"do": "on", "name": "leak", "values": {"side": "left", "area": "2 mm2"}, "for": "3 s"}
    {"do": "off", "name": "leak.left"}

If a command is invalid or not allowed, the answer has the key ``error``, and nothing changes.
"""

from contextlib import AbstractContextManager
from typing import Any, Final, Literal

import msgspec

from bench_protocol.table_signals import MEASUREMENTS
from bench_sim.parameters.loading import ParameterError, read_value
from bench_sim.rig.faults.catalogue import FAULTS
from bench_sim.rig.faults.fault import Fault, FaultChoice, FaultError, FaultNumber
from bench_sim.rig.faults.panel import FaultPanel


class FaultOrder(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A command for the fault panel."""

    do: Literal["list", "on", "off"]
    name: str = ""
    values: dict[str, str | int | float] = {}
    lasting: str | None = msgspec.field(default=None, name="for")


def read_time(name: str, text: str | None) -> float | None:
    """Return a time such as ``3 s`` in s, or None for None. Raises FaultError for an invalid text."""
    try:
        return None if text is None else read_value(name, text, "s")
    except ParameterError as error:
        raise FaultError(str(error)) from None


def execute_order(panel: FaultPanel, line: bytes, lock: AbstractContextManager[object]) -> bytes:
    """Execute the command in ``line`` while holding the rig's ``lock``. Return the answer as a line of JSON. Errors
    are in the answer.
    """
    try:
        order = msgspec.json.decode(line, type=FaultOrder)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        return _line({"error": f"the order cannot be read: {error}"})
    try:
        with lock:
            answer = _carry_out(panel, order)
    except FaultError as error:
        answer = {"error": str(error)}
    return _line(answer)


def as_json(fault: Fault) -> dict[str, Any]:
    """Return the description of a kind of fault, for JSON."""
    return {
        "name": fault.name,
        "place": fault.place.value,
        "title": fault.title,
        "seen": fault.seen,
        "parameters": [_parameter_facts(one) for one in fault.parameters],
    }


def _parameter_facts(one: FaultNumber | FaultChoice) -> dict[str, Any]:
    """Return the description of a parameter. It includes the choices, or the range for each sensor if the range depends
    on the sensor.
    """
    found = {"name": one.name, "span": one.span.replace("`", ""), "usual": one.usual, "text": one.text}
    if isinstance(one, FaultChoice):
        return found | {"choices": one.choices}
    if one.of_sensor:
        return found | {"spans": {signal.name: one.span_for(signal.name) for signal in MEASUREMENTS}}
    return found


_CATALOGUE: Final = [as_json(fault) for fault in FAULTS.values()]


def _carry_out(panel: FaultPanel, order: FaultOrder) -> dict[str, Any]:
    if order.do == "on":
        active = panel.on(order.name, order.values, read_time("for", order.lasting))
        return {"time": panel.time, "on": [active.as_json()]}
    if order.values or order.lasting is not None:
        raise FaultError(f"the order {order.do!r} takes no values and no time; remove them")
    if order.do == "off":
        return {"time": panel.time, "off": panel.off(order.name)}
    if order.name:
        raise FaultError("the order 'list' takes no name; remove the key name")
    return {
        "time": panel.time,
        "faults": _CATALOGUE,
        "on": [active.as_json() for active in panel.active],
    }


def _line(answer: dict[str, Any]) -> bytes:
    return msgspec.json.encode(answer) + b"\n"
