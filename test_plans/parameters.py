"""Parameters of a plan: the keyword arguments of its function, with units and ranges, and their conversion from
text.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from bench_protocol.suggestion import did_you_mean
from bench_protocol.units import WRITTEN_UNITS
from bench_protocol.written_values import NotAValue, read_written

Value = float | int | str


class ParameterRefused(ValueError):
    """Raised if a value is not allowed for a parameter of a plan. The text has name, value, unit and range."""


@dataclass(frozen=True, slots=True)
class Range:
    """The range of a number (SI), including both ends, and the unit used in texts: ``Range(1 * mm, 50 * mm, "mm")``."""

    low: float
    high: float
    unit: str = "1"

    def __post_init__(self) -> None:
        if self.unit not in WRITTEN_UNITS:
            raise ValueError(f"Range: unit {self.unit!r} is unknown; use one of {', '.join(WRITTEN_UNITS)}")
        if not self.low < self.high:
            raise ValueError(f"Range: {self.low:g} is not below {self.high:g}; write the lower value first")

    @property
    def factor(self) -> float:
        """The value of one unit in SI."""
        return WRITTEN_UNITS[self.unit].factor

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high

    def __str__(self) -> str:
        low, high = (f"{end / self.factor:.6g}" for end in (self.low, self.high))
        return f"{low} to {high} {'' if self.unit == '1' else self.unit}".rstrip()


@dataclass(frozen=True, slots=True)
class File:
    """The kind of a parameter that names a file. ``names`` are values that are allowed instead of a file: ``File("a
    table of …", ("none",))``.
    """

    about: str
    names: tuple[str, ...]

    def __contains__(self, text: object) -> bool:
        return text in self.names

    def __str__(self) -> str:
        return f"{', '.join(self.names)}, or a file: {self.about}"


@dataclass(frozen=True, slots=True)
class Parameter:
    """One keyword parameter of a plan: a number within a ``range``, one of some ``choices``, or a ``file``."""

    name: str
    default: Value
    range: Range | None = None
    choices: tuple[str, ...] = ()
    file: File | None = None
    whole: bool = False  #: a number without fraction

    def read(self, text: Any) -> Value:
        """Convert ``text``, such as ``20 mm`` or ``AW3``, to a value in SI. Raises ParameterRefused if it is not
        allowed.
        """
        if self.file is not None:
            if text not in self.file and not Path(text).is_file():
                raise ParameterRefused(f"{self.name} = {text} is not a file; use {self.file}")
            return str(text)
        if self.range is None:
            if text not in self.choices:
                raise ParameterRefused(
                    f"{self.name} = {text!r} is unknown; use one of {', '.join(self.choices)}"
                )
            return str(text)
        try:
            value = read_written(self.name, text, WRITTEN_UNITS[self.range.unit].si)
        except NotAValue as error:
            raise ParameterRefused(f"{error}; the range is {self.range}") from None
        if value not in self.range:
            raise ParameterRefused(f"{self.name} = {self.show(value)} is outside {self.range}")
        if self.whole and value != round(value):
            raise ParameterRefused(
                f"{self.name} = {self.show(value)} is not a whole number; use one from {self.range}"
            )
        return round(value) if self.whole else value

    def show(self, value: Value) -> str:
        """Return ``value`` (SI) as text with unit."""
        if self.range is None or isinstance(value, str):
            return str(value)
        unit = "" if self.range.unit == "1" else self.range.unit
        return f"{value / self.range.factor:.12g} {unit}".rstrip()

    @property
    def allowed(self) -> str:
        """The allowed values as text."""
        return str(self.range or self.file or ", ".join(self.choices))


def declared_parameters(function: Callable[..., None]) -> tuple[Parameter, ...]:
    """Return the parameters of a plan's function: all of its parameters except the first, which is the run.

    Raises TypeError for a parameter without a default, without range or choices, or with a default outside of them.
    """
    names = list(inspect.signature(function).parameters.values())[1:]
    if not names:
        return ()
    hints = get_type_hints(function, include_extras=True)
    return tuple(_declared(one.name, hints.get(one.name), one.default) for one in names)


def _declared(name: str, hint: Any, default: Any) -> Parameter:
    if default is inspect.Parameter.empty:
        raise TypeError(f"parameter {name} has no default; a plan must run without arguments")
    kind, *rest = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    if get_origin(kind) is Literal:
        one = Parameter(name, default, choices=get_args(kind))
    elif kind is str and rest and isinstance(rest[0], File):
        one = Parameter(name, default, file=rest[0])
    elif kind in {float, int} and rest and isinstance(rest[0], Range):
        one = Parameter(name, default, rest[0], whole=kind is int)
    else:
        raise TypeError(
            f"parameter {name} is declared {hint}; use Annotated[float, Range(1 * mm, 50 * mm, 'mm')] or "
            "Literal['AW0', 'AW3']"
        )
    if default not in (one.range or one.file or one.choices):
        raise TypeError(
            f"parameter {name} has the default {one.show(default)}, which is not allowed; use {one.allowed}"
        )
    return one


def read_all(plan: str, known: tuple[Parameter, ...], given: Mapping[str, Any]) -> dict[str, Value]:
    """Return the values of all ``known`` parameters of a plan, from the texts in ``given``, otherwise by default.

    Raises ParameterRefused for an unknown name or an invalid value.
    """
    by_name = {one.name: one for one in known}
    for name in given:
        if name not in by_name:
            right = did_you_mean(name, by_name) if by_name else "this plan has no parameters, so omit it"
            raise ParameterRefused(f"{plan} has no parameter {name}; {right}")
    try:
        return {one.name: one.read(given[one.name]) if one.name in given else one.default for one in known}
    except ParameterRefused as error:
        raise ParameterRefused(f"{plan}: {error}") from None
