"""Writes a first wiring file: certain entries are filled in, possible ones are comments."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from astb.acceptance.checking.consequences import plans_by_need
from astb.acceptance.skeleton.matching import Match, match
from astb.acceptance.skeleton.points import DescribedPoint, dbc_points
from astb.acceptance.skeleton.register_list import Counting, read_register_list
from bench_protocol.signals import Kind, Signal
from bench_protocol.table import TABLE
from bench_protocol.units import UNITS
from bench_protocol.words import SWITCH

_SAID: Final = ("rig.state", "rig.reason", "rig.nominal_preload", "rig.orifice_diameter", "rig.pipe")
#: Signals that drivers and plans need, in the order of the file; the others are optional.
GROUPS: Final = {
    "Measurements": [one.name for one in TABLE.of_kind(Kind.MEASUREMENT)],
    "State and reason": ["rig.state", "rig.reason", "interlock.estop"],
    "Set-points": [
        one.name
        for one in TABLE.of_kind(Kind.SETPOINT)
        if one.name.endswith("_setpoint") and not one.name.startswith("car.")
    ],
    "Settings": [
        one.name
        for one in TABLE.of_kind(Kind.SETTING)
        if one.name in _SAID or not one.name.startswith(("rig.", "generator.", "car."))
    ],
}
#: Maximum length of the description after a candidate.
_TOLD_MAX: Final = 80
_READINGS: Final = ("Measurements", "State and reason")
_POLLED: Final = 'group = "fast"'
WANTED: Final = [name for names in GROUPS.values() for name in names]
_PLC: Final = """\
[transports.plc]
kind = "modbus"
host = "127.0.0.1"
port = 502
unit = 1
word_order = "high"
# From the manual of the device, if stated: a life sign (a counter or a coil that is toggled while commands are sent),
# functions 5 and 6 only ("single") or 15 and 16 only ("multiple"), and the largest number of registers in a request.
# alive = { point = "…", every = "100 ms" }
# writes = "multiple"
# request_max = 125

[transports.plc.groups.fast]
every = "50 ms"

"""
_SEQUENCES: Final = """\
# If several bits form the state, each bit has a weight, and each possible combination gets a number:
# "rig.state" = { from = ["plc.ready", "plc.runs", "plc.fault"], value = "ready + 2 * runs + 4 * fault",
#     choices = { DISABLED = 0, HOLD = 1, ACTIVE = 3, FAULT_DISABLED = [4, 5, 7] } }    (in one line)
#
# Orders that change the state, once "rig.state" is known:
# [[sequences.up]]
# start = ["DISABLED"]
# orders = [{ "TRANSPORT.POINT" = 1 }]
# end = ["HOLD"]
#
# [[sequences.up]]
# start = ["HOLD"]
# bumpless = true
# orders = [{ "TRANSPORT.POINT" = 2 }]
# end = ["ACTIVE"]
#
# [[sequences.reset]]
# start = ["FAULT_HOLD", "FAULT_DISABLED", "ESTOP"]
# orders = [{ "TRANSPORT.POINT" = 3 }]
# end = ["DISABLED"]
#
# [sequences]
# rest = [{ "TRANSPORT.POINT" = 0 }]
# at_rest = ["DISABLED", "FAULT_DISABLED", "ESTOP"]
"""


def skeleton(
    dbc: Path | None,
    registers: Path | None,
    beside: Path,
    charset: str | None = None,
    counting: Counting | None = None,
) -> str:
    """Return the text of a wiring file, with paths relative to the directory ``beside``. Raises WiringError for an
    unreadable DBC or list.
    """
    points: list[DescribedPoint] = []
    text = (
        'description = "Incomplete description of a rig: fill in the missing entries"\nlatency = "100 ms"\n\n'
    )
    if dbc is not None:
        points += dbc_points(dbc, charset=charset)
        path = json.dumps(os.path.relpath(dbc, beside))
        text += f'[transports.bus]\nkind = "can"\nbus = "can0"\ndbc = {path}\n'
        text += f"charset = {json.dumps(charset)}\n" if charset else ""
        if unsaid := sum(one.written and one.read for one in points):
            text += f"# The DBC does not name the sender of {unsaid} signals: direction is derived from their names.\n"
            text += "# If senders are added, node = NAME prevents that signals of the rig are sent.\n"
        text += "# Messages that ASTB sends: rate, counter and checksum; see docs/reference/wiring.md.\n"
        text += '# [transports.bus.messages.SETPOINTS]\n# every = "10 ms"\n\n'
        text += _nulls(points)
    rows: list[DescribedPoint] = []
    if registers is not None:
        listed = read_register_list(registers, counting=counting)
        rows = listed.points
        points += rows
        text += "".join(f"# {note}\n" for note in listed.notes)
        text += _PLC
    written, readable = matches(points)
    if rows:
        text += "[transports.plc.points]\n" + "".join(f"{_line(row, written)}\n" for row in rows) + "\n"
    needed = _needed_by()
    text += "[signals]\n"
    for group, names in GROUPS.items():
        text += f"# -- {group}\n"
        for name in names:
            text += _entry(TABLE[name], written[name], readable.get(name), needed.get(name, ""))
    return text + "\n" + _SEQUENCES


def _nulls(points: Sequence[DescribedPoint]) -> str:
    """Return the lines of the wiring for raw values that mean "no measurement" in the DBC; "" if there are none."""
    lines = [
        f'"{one.name.partition(".")[2]}" = {{ null = {sorted(one.nulls)} }}  # {", ".join(one.nulls.values())}\n'
        for one in points
        if one.nulls and one.read
    ]
    head = "# Raw values that mean a missing measurement, by the DBC.\n[transports.bus.points]\n"
    return f"{head}{''.join(lines)}\n" if lines else ""


def _line(row: DescribedPoint, written: Mapping[str, Match]) -> str:
    """Return the line of a point in the wiring.

    A point that is the source of a reading is polled, even if it is also written.
    """
    if _POLLED in row.line or all(
        written[name].clear != row for group in _READINGS for name in GROUPS[group]
    ):
        return row.line
    return f"{row.line.removesuffix(' }')}, {_POLLED} }}"


def matches(points: Sequence[DescribedPoint]) -> tuple[dict[str, Match], dict[str, Match]]:
    """Return the match of each wanted signal, and for each setting the match of a point that reports it."""
    signals = [TABLE[name] for name in WANTED]
    settings = [one for one in signals if one.kind is Kind.SETTING]
    return match(signals, points), match(settings, points, read_back=True)


def _needed_by() -> dict[str, str]:
    """Return the number of plans that need a signal, as text by signal."""
    found = plans_by_need().items()
    return {name: f"plans that need it: {len(needing)}" for name, needing in found if name in TABLE.index}


def _entry(signal: Signal, one: Match, back: Match | None, needed: str) -> str:
    """Return the entry of a signal in the wiring: a description, the possible points if none is certain, and the
    line.
    """
    head = f"# {signal.description} ({signal.range_text()})" + (f"; {needed}" if needed else "") + "\n"
    if one.clear is not None and (keys := _keys(signal, one.clear, back.clear if back else None)):
        return f'{head}"{signal.name}" = {{ {keys} }}\n'
    others = "".join(
        f"#   {value:.2f} {point.name}{_unit(point)}{_numbers(point)}\n" for value, point in one.candidates
    )
    why = (
        "not found; see the candidates above, with their similarity (0 to 1)"
        if others
        else "not found; no point has such a name and unit"
    )
    return f'{head}{others}"{signal.name}" = {{ absent = "{why}" }}\n'


def _keys(signal: Signal, point: DescribedPoint, back: DescribedPoint | None) -> str:
    """Return the keys in the line of a signal; "" if its unit or the numbers of its choices are unknown."""
    goes = signal.kind in (Kind.SETPOINT, Kind.SETTING)
    parts = [f'{"to" if goes else "from"} = "{point.name}"']
    if signal.kind is Kind.SETTING and back is not None:
        parts.append(f'read = "{back.name}"')
    if signal.choices and signal.choices != SWITCH:
        numbers = {text.lower(): number for text, number in point.choices.items()}
        ours = {choice: numbers[choice.lower()] for choice in signal.choices if choice.lower() in numbers}
        if len(ours) < 2:
            return ""
        parts.append(f"choices = {{ {', '.join(f'{json.dumps(name)} = {n}' for name, n in ours.items())} }}")
    elif signal.unit != "1":
        if point.unit not in UNITS:
            return ""
        parts.append(f'unit = "{point.unit}"')
        if UNITS[point.unit].si == "kg":
            parts.append('calibration = { gain = "9.80665 N/kg" }')
        if point.absolute and signal.si == "Pa":
            parts.append('calibration = { offset = "-101.325 kPa" }')
    return ", ".join(parts)


def _unit(point: DescribedPoint) -> str:
    return f", {point.unit}" if point.unit else ""


def _numbers(point: DescribedPoint) -> str:
    """Return the meaning of each number of a possible point, or its description in the list of registers; "" for
    neither.
    """
    meaning = ", ".join(f"{number} {text}" for text, number in point.choices.items())
    meaning = meaning or (" ".join(point.context.split()) if point.line else "")
    return f" ({meaning[:_TOLD_MAX]})" if meaning else ""
