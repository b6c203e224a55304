"""Conversion of a rig's numbers to SI and back: unit, sign, calibration and choices of one signal of a wiring."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Final, Literal, Protocol

import msgspec

from bench_protocol.signals import Signal
from bench_protocol.suggestion import did_you_mean
from bench_protocol.units import UNITS, Unit
from bench_protocol.words import SWITCH
from drivers.errors import WiringError

Number = int | float


class Calibration(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The key ``calibration`` of a signal: a straight line, or a table with linear interpolation."""

    gain: Number | str = 1.0  #: a number, or "9.80665 N/kg" to convert into another quantity
    offset: Number | str = 0.0  #: added after the gain: a number in the unit, or "0.01 bar"
    table: list[tuple[Number, Number]] = []  #: rows [rig's number, value], rising; replaces gain and offset
    unit: str = ""  #: unit of the values in the table, if it is not that of the signal


class Conversion(Protocol):
    """A mapping between a rig's number and its SI value, or the number of a choice."""

    def si(self, number: float) -> float:
        """Return the SI value; NaN for NaN, and for a number that is not a choice."""

    def number(self, value: float) -> float:
        """Return the rig's number for an SI value; NaN for NaN, and for a choice that the rig does not have."""


@dataclass(frozen=True, slots=True)
class Linear:
    """SI = gain · number + offset."""

    gain: float
    offset: float

    def si(self, number: float) -> float:
        return self.gain * number + self.offset

    def number(self, value: float) -> float:
        return (value - self.offset) / self.gain


@dataclass(frozen=True, slots=True)
class Curve:
    """Linear interpolation between points, and extrapolation beyond them; then a second linear conversion."""

    numbers: tuple[float, ...]  #: rising
    meanings: tuple[float, ...]  #: rising or falling
    line: Linear

    def si(self, number: float) -> float:
        return self.line.si(_between(self.numbers, self.meanings, number))

    def number(self, value: float) -> float:
        meaning = self.line.number(value)
        if self.meanings[0] < self.meanings[-1]:
            return _between(self.meanings, self.numbers, meaning)
        return _between(self.meanings[::-1], self.numbers[::-1], meaning)


@dataclass(frozen=True, slots=True)
class Choices:
    """The rig's numbers for each choice. All of them are read as this choice, the first one is written."""

    numbers: Mapping[int, tuple[float, ...]]

    def si(self, number: float) -> float:
        return next((float(choice) for choice, ours in self.numbers.items() if number in ours), math.nan)

    def number(self, value: float) -> float:
        numbers = () if math.isnan(value) else self.numbers.get(round(value), ())
        return numbers[0] if numbers else math.nan


def _between(xs: Sequence[float], ys: Sequence[float], x: float) -> float:
    if math.isnan(x):
        return math.nan
    k = min(max(bisect_right(xs, x), 1), len(xs) - 1)
    share = (x - xs[k - 1]) / (xs[k] - xs[k - 1])
    return ys[k - 1] * (1.0 - share) + ys[k] * share


# -- from the keys of a description ------------------------------------------------------------------------------

ChoiceNumbers = Number | list[Number]
Sign = Annotated[Literal[1, -1], msgspec.Meta(description="1 or -1")]
_IDENTITY: Final = Linear(1.0, 0.0)


def conversion(
    where: str,
    signal: Signal,
    *,
    unit: str,
    sign: int,
    calibration: Calibration | None,
    choices: Mapping[str, ChoiceNumbers],
) -> Conversion:
    """Return the conversion of the rig's numbers for ``signal``. Raises WiringError, which begins with ``where``."""
    if signal.choices:
        for key, given in (("unit", unit), ("calibration", calibration), ("sign", sign != 1)):
            if given:
                raise WiringError(
                    f"{where}.{key}: {signal.name} is a choice ({signal.range_text()}); use choices instead"
                )
        return _choices(where, signal, choices)
    if choices:
        raise WiringError(
            f"{where}.choices: {signal.name} is a number in {signal.unit}; use unit instead of choices"
        )
    if calibration is not None and calibration.table:
        return _curve(where, signal, unit, sign, calibration)
    return _line(where, signal, unit, sign, calibration or Calibration())


def quantity(where: str, text: str, si: str, *, difference: bool = False) -> float:
    """Return a text such as "25 mm" in SI; for a ``difference``, 1 degC is 1 K.

    Raises WiringError, which begins with ``where``.
    """
    number, _, unit = text.strip().partition(" ")
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise WiringError(
            f'{where} = {text!r} does not begin with a number; write it like "12.5 {_example(si)}"'
        )
    found = unit_of(f"{where} = {text!r}", unit.strip() or "1", si)
    return found.factor * value + (0.0 if difference else found.zero)


def unit_of(where: str, unit: str, si: str) -> Unit:
    """Return a unit by its name. Raises WiringError, which begins with ``where``, unless it is a unit of ``si``."""
    found = UNITS.get(unit)
    right = ", ".join(name for name, one in UNITS.items() if one.si == si)
    if found is None:
        raise WiringError(f"{where}: {unit!r} is not a known unit; use one of {right}")
    if found.si != si:
        raise WiringError(f"{where}: {unit!r} is a unit of another quantity ({found.si}); use one of {right}")
    return found


def _example(si: str) -> str:
    return {"m": "mm", "Pa": "bar", "N": "kN", "s": "ms"}.get(si, si)


def _line(where: str, signal: Signal, unit: str, sign: int, calibration: Calibration) -> Linear:
    """Return unit, calibration and sign as one straight line."""
    gain, of, into = _gain(where, calibration.gain)
    if not unit and signal.unit != "1":
        raise WiringError(
            f"{where}.unit is missing: state the unit in which the rig reports {signal.name}, "
            f"such as {signal.unit!r}"
        )
    if into:
        after = unit_of(f"{where}.calibration.gain = {calibration.gain!r}", into, signal.si)
        if of != unit:
            raise WiringError(
                f"{where}.calibration.gain = {calibration.gain!r} is per {of}, but unit = {unit!r}; "
                "use the same unit in both"
            )
    else:
        after = _unit(where, signal, unit)
    offset = calibration.offset
    if isinstance(offset, str):
        added = quantity(f"{where}.calibration.offset", offset, signal.si, difference=True)
    else:
        added = offset * after.factor
    if not math.isfinite(added):
        raise WiringError(f"{where}.calibration.offset = {offset!r} is not finite; use a finite number")
    return Linear(sign * gain * after.factor, sign * (added + after.zero))


def _unit(where: str, signal: Signal, unit: str) -> Unit:
    found = UNITS.get(unit or "1")
    if found is not None and found.si == "kg" and signal.si == "N":
        raise WiringError(
            f"{where}.unit = {unit!r} is a mass and {signal.name} a force: add calibration = "
            f'{{ gain = "9.80665 N/{unit}" }}, the acceleration of gravity'
        )
    return unit_of(f"{where}.unit", unit or "1", signal.si)


def _gain(where: str, gain: Number | str) -> tuple[float, str, str]:
    """Return the number of a gain, and the units from and to which it converts; "" for missing units.

    "9.80665 N/kg" gives 9.80665, "kg" and "N".
    """
    number, _, units = gain.strip().partition(" ") if isinstance(gain, str) else (str(gain), "", "")
    into, _, of = units.strip().rpartition("/")
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or value == 0.0 or bool(units) != bool(into):
        raise WiringError(
            f"{where}.calibration.gain = {gain!r} is not a gain; use a number, such as 1.002 or "
            '"9.80665 N/kg"'
        )
    return value, of, into


def _curve(where: str, signal: Signal, unit: str, sign: int, calibration: Calibration) -> Curve:
    if calibration.gain != 1.0 or calibration.offset != 0.0:
        raise WiringError(f"{where}.calibration: a table replaces gain and offset; remove them")
    numbers, meanings = zip(*((float(a), float(b)) for a, b in calibration.table), strict=True)
    if not all(map(math.isfinite, (*numbers, *meanings))):
        raise WiringError(f"{where}.calibration.table: inf and nan are not allowed; use finite numbers")
    if len(numbers) < 2 or any(b <= a for a, b in pairwise(numbers)):
        raise WiringError(
            f"{where}.calibration.table: the first column (numbers of the rig) must rise from row to "
            "row, with two or more rows"
        )
    steps = [b - a for a, b in pairwise(meanings)]
    if not (all(step > 0 for step in steps) or all(step < 0 for step in steps)):
        raise WiringError(f"{where}.calibration.table: the second column must rise, or fall, from row to row")
    found = unit_of(f"{where}.calibration.unit", calibration.unit or unit or "1", signal.si)
    return Curve(numbers, meanings, Linear(sign * found.factor, sign * found.zero))


def _choices(where: str, signal: Signal, choices: Mapping[str, ChoiceNumbers]) -> Conversion:
    if not choices:
        if signal.choices == SWITCH:
            return _IDENTITY
        raise WiringError(
            f"{where}.choices is missing; state the number that the rig uses for each of {' | '.join(signal.choices)}"
        )
    numbers: dict[int, tuple[float, ...]] = {}
    taken: dict[float, str] = {}
    for name, given in choices.items():
        if name not in signal.choices:
            raise WiringError(
                f"{where}.choices: {name!r} is not a choice of {signal.name}; "
                f"{did_you_mean(name, signal.choices)}"
            )
        all_given = tuple(float(one) for one in (given if isinstance(given, list) else [given]))
        if not all_given:
            raise WiringError(
                f"{where}.choices.{name} has no number; write one or several numbers, or remove the line"
            )
        for one in all_given:
            other = taken.setdefault(one, name)
            if other != name:
                raise WiringError(
                    f"{where}.choices: the number {one:g} means {other} and {name}; use it for one of "
                    "them only"
                )
        numbers[signal.choices.index(name)] = all_given
    return Choices(numbers)
