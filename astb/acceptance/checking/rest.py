"""Expected readings of a sound bench at rest, disarmed and without air, and likely causes of wrong readings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from bench_protocol.signals import Kind, Signal
from bench_protocol.table_groups import Group
from bench_protocol.table_signals import BY_GROUP
from bench_protocol.units import ATMOSPHERE, K, kN, mbar, mm
from bench_protocol.words import SIDES

_CELSIUS: Final = 273.15 * K
_GRAVITY: Final = 9.81


#: Readings of an absolute gauge at atmospheric pressure, with the spread of the weather and the transducer.
_WEATHER: Final = 80 * mbar
#: Permitted difference between the sides, and between a laser and the actuator on its side.
_UNEVEN: Final = 30 * mm
_APART: Final = 10 * mm
_HEIGHTS: Final = BY_GROUP[Group.HEIGHT]
_CELLS: Final = BY_GROUP[Group.VERTICAL_LOAD_CELL]


def doubts(means: Mapping[str, float], signals: Mapping[str, Signal], *, at_rest: bool) -> dict[str, str]:
    """Return a text on each wrong reading of ``means`` (SI), by signal.

    If the bench is not ``at_rest``, only impossible values count.
    """
    found = {}
    for name, value in means.items():
        signal = signals[name]
        if math.isnan(value):
            found[name] = "the rig has no value"
        elif not (signal.choices or _unset(signal, value) or _in_range(signal, value)):
            found[name] = f"out of its range, {signal.range_text()}{_guess(signal, value)}"
        elif at_rest and signal.group is not None and not _fits(signal.group, value):
            low, high = signal.group.row.at_rest
            found[name] = (
                f"at rest, {signal.show(low)} to {signal.show(high)} is expected{_guess(signal, value)}"
            )
    if at_rest:
        for name, doubt in _together(means, signals).items():
            found.setdefault(name, doubt)
    return found


def _in_range(signal: Signal, value: float) -> bool:
    """Whether a value is in the range of its signal, within the rounding of the rig."""
    return signal.low - signal.step <= value <= signal.high + signal.step


def _unset(signal: Signal, value: float) -> bool:
    """Whether an absolute set pressure reads 0, because it was not set since power-on."""
    return signal.kind is Kind.SETTING and signal.si == "Pa" and abs(value + ATMOSPHERE) <= signal.step


def _fits(group: Group, value: float) -> bool:
    low, high = group.row.at_rest
    return low <= value <= high


def _guess(signal: Signal, value: float) -> str:
    """Return a likely cause of a wrong value, as the end of a sentence; "" if none is known."""
    if signal.group in (Group.PRESSURE, Group.SUPPLY_PRESSURE):
        if abs(value - ATMOSPHERE) < _WEATHER:
            return ': an absolute pressure? then calibration = { offset = "-1.01325 bar" }'
        if abs(value + ATMOSPHERE) < _WEATHER:
            return ": a gauge pressure, reduced by the atmospheric pressure again? then remove the offset"
    if signal.group is Group.TEMPERATURE and abs(value) < 60:
        return ': degrees Celsius? then unit = "degC"'
    if signal.group is Group.TEMPERATURE and abs(value - 2 * _CELSIUS) < 60:
        return ': are the values in kelvins already? then unit = "K"'
    if signal.group is Group.ACCELERATION and abs(abs(value) - _GRAVITY) < 1:
        return ": is this gravity? then the accelerometer has another direction"
    if signal.group is Group.VERTICAL_LOAD_CELL and value < 0:
        return ": the cell carries weight, so its force must be positive; sign = -1?"
    if signal.group:
        low, high = signal.group.row.at_rest
        for factor in (10, 100, 1000):
            if low <= value / factor <= high and abs(value) > 2 * max(high, -low):
                return f": check scale and offset; 1/{factor} of this value is {signal.show(value / factor)}"
    return ""


def _together(means: Mapping[str, float], signals: Mapping[str, Signal]) -> dict[str, str]:
    """Return a text on each reading that contradicts another one, by signal."""
    found = {}
    cells = [name for name in _CELLS if name in means]
    for name in cells:
        if means[name] < -0.2 * kN:
            found[name] = "the cell carries weight, so its force must be positive; sign = -1?"
        elif len(cells) > 1 and means[name] > 4 * _median([means[one] for one in cells]) + 0.5 * kN:
            found[name] = "more than four times the force of the other cells; check the scale"
    heights = [means[name] for name in _HEIGHTS if name in means]
    if len(heights) == 2 and abs(heights[0] - heights[1]) > _UNEVEN:
        for name in _HEIGHTS:
            found[name] = (
                f"the sides differ by {signals[name].show(abs(heights[0] - heights[1]))}; check sign and offset"
            )
    for side in SIDES:
        piston, laser = f"vertical_{side}.displacement", f"{side}.height"
        if piston in means and laser in means and abs(means[piston] - means[laser]) > _APART:
            shown = signals[piston].show(means[piston])
            found.setdefault(
                laser, f"the actuator at the same place reads {shown}; check sign, scale and offset of both"
            )
    return found


def _median(values: list[float]) -> float:
    ordered = sorted(values)
    return ordered[(len(ordered) - 1) // 2]
