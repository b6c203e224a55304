"""Check whether the rig resets the settings of a commander to their rest values when the command ends."""

import math
import struct
from collections.abc import Mapping
from typing import Final

from astb.acceptance.conformance.raw_access import ModbusConnection, RawAccess
from astb.acceptance.conformance.report import Notebook
from bench_protocol.registers import LEASE_ADDRESS
from bench_protocol.rest import REST
from bench_protocol.table import TABLE
from bench_protocol.units import bar, mm, s

#: Settings that the test leaves: parameters of a program that is not started, and targets of valves that hold.
PROGRAM: Final[Mapping[str, float]] = {
    "generator.cycles": 7.0,
    "generator.frequency": 0.5,
    "generator.amplitude": 3 * mm,
}
TARGETS: Final[Mapping[str, float]] = {"air.left_target": 0.4 * bar, "air.right_target": 0.4 * bar}
_MODES: Final = ("air.left_mode", "air.right_mode")
#: Longest time of a rig to return to rest.
REST_WITHIN: Final = 1 * s
_IN_FORCE: Final = {r.signal: r.address for r in TABLE.registers if r.space == "input" and r.signal in REST}


def take(line: ModbusConnection) -> int:
    """Take the lease on ``line``. Return its token, or 0 if another user has the lease."""
    if line.write(LEASE_ADDRESS, struct.pack(">H", 1)):
        return 0
    return line.words(LEASE_ADDRESS, 1, function=3)[0]


def give_back(line: ModbusConnection) -> None:
    """Return the lease. Nothing changes if ``line`` has lost it already."""
    line.write(LEASE_ADDRESS, b"\0\0")


def leave(line: ModbusConnection, *, targets: bool) -> bool:
    """Apply settings that move nothing and differ from their rest values. Return whether they are in force.

    With ``targets``, the target pressures are also set, if the modes of the air valves are at rest.
    """
    values = dict(PROGRAM)
    if targets and all(_in_force(line)[mode] == REST[mode] for mode in _MODES):
        values |= TARGETS
    _apply(line, values)
    found = _in_force(line)
    return all(_equal_in_single_precision(found[name], value) for name, value in values.items())


def note_rest(access: RawAccess, book: Notebook, end: str) -> None:
    """Record whether all settings have their rest values after the event ``end``, and reset those that do not."""
    line = access.modbus()
    access.wait_for(lambda: not _changed_settings(line), REST_WITHIN)
    left = _changed_settings(line)
    found = ", ".join(f"{name} = {TABLE[name].show(value)}" for name, value in left.items())
    book.note(
        f"settings after: {end}", not left, found or "rest values", "rest values, except parts fitted by hand"
    )
    if left and take(line):
        _apply(line, {name: REST[name] for name in left})
        give_back(line)
    line.close()


def _apply(line: ModbusConnection, values: Mapping[str, float]) -> None:
    for name, value in values.items():
        line.write(TABLE[name].address or 0, struct.pack(">f", value))
    line.press(TABLE["action.apply"].address or 0)


def _changed_settings(line: ModbusConnection) -> dict[str, float]:
    """Return the settings in force that differ from their rest values (SI), by name."""
    return {
        name: value
        for name, value in _in_force(line).items()
        if not _equal_in_single_precision(value, REST[name])
    }


def _in_force(line: ModbusConnection) -> dict[str, float]:
    return {name: line.number(address) for name, address in _IN_FORCE.items()}


def _equal_in_single_precision(value: float, other: float) -> bool:
    return math.isclose(value, other, rel_tol=1e-6)  # registers and messages carry single-precision floats
