"""Texts on air that may be left in the springs: the pressures, what the bench does with the air, and the instruction
for a person.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from math import isnan, nan
from typing import TYPE_CHECKING, Final

from bench_protocol.units import bar, s
from bench_protocol.words import SIDES
from drivers.air import PRESSURE_FALLS
from drivers.errors import BenchError
from test_plans.analysis import CHAMBERS

if TYPE_CHECKING:
    from drivers.bench import Bench

#: Springs below this pressure count as depressurised.
RESIDUAL_PRESSURE: Final = 0.2 * bar
#: Pressure that lifts the bolster; springs with less cannot move it.
LIFTS: Final = 0.23 * bar
#: Largest difference of two intact transducers of one pressure.
ZEROS_APART: Final = 0.1 * bar
#: If air flows through open valves, a pressure changes by more than `PRESSURE_FALLS` in this time (s).
WATCHED: Final = 5 * s
#: Begin of a warning to a person.
KEEP_AWAY: Final = "keep away from the springs until their gauges read zero: "
#: Sentence on the air, by the reaction of the bench in its present state.
_BECOMES: Final = {
    "let off": "the bench, in {state}, vents the springs by itself",
    "shut in": "the bench, in {state}, keeps its valves shut, and vents the springs once it is disabled",
    "as ordered": "the bench, in {state}, keeps the air as last commanded",
    None: "it is not known what this rig does with the air in {state}",
}
#: Addition for a bench that keeps the air as commanded, after the connection for commands is lost.
_ALONE: Final = ", until it detects the loss of its commander: then it vents the springs by itself"


@dataclass(frozen=True, slots=True)
class _AirState:
    """What is known at present: pressures (Pa) by side and name, reasons for missing pressures, and the state of the
    bench.
    """

    pressures: dict[str, dict[str, float]]
    silent: list[str]
    state: str  #: "" if it is unknown
    reason: str  #: why the state is unknown


def springs_are_empty(bench: Bench) -> bool:
    """Return whether every pressure of the springs is below `LIFTS`; False if one is missing or stale."""
    return _empty(_read_state(bench))


def zeros_off(bench: Bench) -> str:
    """Return a text on pressure transducers with a zero error: of two joined chambers only one reads a pressure; "" if
    there are none.

    Joined chambers have the same pressure only at rest. So if two readings differ, the function waits for `WATCHED`,
    and returns "" if air flows.
    """
    before = _read_state(bench)
    if not _contradictions(before):
        return ""
    bench.wait(WATCHED)
    after = _read_state(bench)
    for side, of_side in after.pressures.items():
        was = before.pressures[side]
        if any(abs(pressure - was.get(name, nan)) > PRESSURE_FALLS for name, pressure in of_side.items()):
            return ""
    return _contradictions(after)


def _contradictions(known: _AirState) -> str:
    """Return a text on pressures of joined chambers that differ by more than two intact transducers can; "" if there
    are none.
    """
    found = []
    for of_side in known.pressures.values():
        lowest = min(of_side, key=lambda name: of_side[name], default="")
        for name, pressure in of_side.items():
            if pressure < max(LIFTS, of_side[lowest] + ZEROS_APART):
                continue
            if of_side[lowest] >= RESIDUAL_PRESSURE:
                return ""
            found.append(
                f"{name} reads {pressure / bar:.2f} bar, but {of_side[lowest] / bar:.2f} bar of {lowest}, which is "
                "connected to it: the zero of one of them is wrong; correct it before you trust them"
            )
    return "" if known.silent else "; ".join(found)


def air_left(bench: Bench) -> str:
    """Return a text on the pressure of the springs, with an instruction and the next steps if they may hold air."""
    known = _read_state(bench)
    if _empty(known):
        return f"the springs are without pressure ({_sides(known)})"
    if any(one >= LIFTS for of_side in known.pressures.values() for one in of_side.values()):
        found = f"they hold pressure ({_sides(known)})"
    else:
        found = "it is not known whether they hold pressure"
    return "; ".join([f"{KEEP_AWAY}{found}", *known.silent, _becomes(bench, known)])


def air_at_risk(bench: Bench) -> str:
    """Return the text of `air_left` if a pressure of the springs is measured and not known to be zero; otherwise ""."""
    measured = any(_names(bench).values())
    return air_left(bench) if measured and not springs_are_empty(bench) else ""


def _empty(known: _AirState) -> bool:
    pressures = [one for of_side in known.pressures.values() for one in of_side.values()]
    return not known.silent and bool(pressures) and all(one < LIFTS for one in pressures)


def _becomes(bench: Bench, known: _AirState) -> str:
    """Return a text on what the bench does with the air of the springs in its present state."""
    if not known.state:
        return f"it is not known what the bench does with the air: {known.reason}"
    fate = bench.wiring.sequences.air.get(known.state)
    alone = _ALONE if bench.lost and fate == "as ordered" else ""
    return _BECOMES[fate].format(state=known.state) + alone


def _sides(known: _AirState) -> str:
    of_side = {side: max(values.values()) for side, values in known.pressures.items() if values}
    return " and ".join(f"{pressure / bar:.2f} bar on the {side}" for side, pressure in of_side.items())


def _names(bench: Bench) -> dict[str, list[str]]:
    """Return for each side the names of the pressure signals that this rig measures."""
    names = {side: [f"{side}.{chamber}_pressure" for chamber in CHAMBERS] for side in SIDES}
    return {side: [name for name in of_side if not bench.lacks(name)] for side, of_side in names.items()}


def _read_state(bench: Bench) -> _AirState:
    """Return the received readings that are not stale. If the connection that brings them is lost, query the rig
    instead.
    """
    names = _names(bench)
    values, reasons = _polled(bench, names) if bench.lost else _received(bench, names)
    pressures = {
        side: {name: values[name] for name in of_side if not isnan(values[name])}
        for side, of_side in names.items()
    }
    silent = [f"nothing measures the pressure of the {side} spring" for side in SIDES if not names[side]]
    silent += [reasons[name] for of_side in names.values() for name in of_side if isnan(values[name])]
    code = values["rig.state"]
    state = "" if isnan(code) else bench.table["rig.state"].choices[int(code)]
    return _AirState(pressures, silent, state, reasons["rig.state"])


def _received(bench: Bench, names: dict[str, list[str]]) -> tuple[dict[str, float], dict[str, str]]:
    every = ["rig.state", *(name for of_side in names.values() for name in of_side)]
    return {name: bench.readings.value_or_nan(name) for name in every}, {
        name: bench.readings.show(name) for name in every
    }


def _polled(bench: Bench, names: dict[str, list[str]]) -> tuple[dict[str, float], dict[str, str]]:
    every = ["rig.state", *(name for of_side in names.values() for name in of_side)]
    values = dict.fromkeys(every, nan)
    with suppress(BenchError):
        values |= bench.settings.readings(*every)
    return values, {name: f"{name} cannot be read, for a connection is lost" for name in every}
