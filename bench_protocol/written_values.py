"""Numbers with units in text form: reading to SI, and writing so that reading gives the same number again."""

import re
from math import isfinite, isinf, log10
from typing import Any, Final

import numpy as np

from bench_protocol.units import FACTORS, UNITS, WRITTEN_UNITS

_NUMBER: Final = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf))\s*(\S*)\s*")


class NotAValue(ValueError):
    """A text is not a number with a unit of the quantity; the message states a valid text."""


def read_written(what: str, text: Any, si: str) -> float:
    """Return ``text``, such as ``0.2 mm2`` or ``0.2mm2``, in the SI unit ``si``; only a pure number needs no unit.

    Raises `NotAValue`, which begins with ``what``.
    """
    fitting = " or ".join(unit for unit, (base, *_) in WRITTEN_UNITS.items() if base == si)
    match = _NUMBER.fullmatch(str(text))
    if match is None or isinstance(text, bool):
        raise NotAValue(f"{what} = {text!r} is not a number with its unit; use a number in {fitting}")
    unit = match[2] or "1"
    base, factor, _ = UNITS.get(unit, ("", 0.0, 0.0))
    if base != si or unit not in FACTORS:
        raise NotAValue(f"{what} = {text!r} has a missing or wrong unit; use {fitting}")
    number = float(match[1]) * factor
    if isinf(number):
        raise NotAValue(f"{what} = {text!r} is not finite; use a smaller number in {fitting}")
    return number


def fitting_unit(number: float, si: str) -> str:
    """Return the first unit of ``si`` in which ``number`` is between 0.1 and 1000, or closest to that."""
    if not (number and isfinite(number)):
        return si

    def misfit(unit: str) -> float:
        magnitude = log10(abs(number)) - log10(WRITTEN_UNITS[unit].factor)
        return max(-1.0 - magnitude, magnitude - 3.0, 0.0)

    return min((unit for unit, (base, *_) in WRITTEN_UNITS.items() if base == si), key=misfit)


def write_value(number: float, si: str, unit: str, digits: int | None = None) -> str:
    """Return ``number`` (SI) in ``unit`` as text, with ``digits`` significant digits.

    Without ``digits`` the text has enough digits for `read_written` to return exactly ``number``; it is in SI if
    ``unit`` cannot represent that.
    """
    factor = WRITTEN_UNITS[unit].factor
    quotient = number / factor
    if digits:
        return f"{float(f'{quotient:.{digits}g}')!r} {unit}".removesuffix(" 1")
    for shown in (
        float(f"{quotient:.12g}"),
        quotient,
        np.nextafter(quotient, np.inf),
        np.nextafter(quotient, -np.inf),
    ):
        if float(shown) * factor == number:
            return f"{float(shown)!r} {unit}".removesuffix(" 1")
    return f"{number!r} {si}".removesuffix(" 1")
