"""Numbers, units and symbols as a report prints them: thin spaces, minus signs, powers of ten, kN·s/m, K″."""

from __future__ import annotations

import math
import re
from typing import Any

FIGURE_SPACE, PUNCTUATION_SPACE, THIN_SPACE, MINUS = "\u2007", "\u2008", "\u2009", "\u2212"
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


#: Units that are written differently than they are typed.
_UNITS = {"1": "", "deg": "°", "degC": "°C", "us": "µs"}


def unit(name: str) -> str:
    """Return the printed form of a unit, such as kN·s/m for ``kN*s/m`` and m² for ``m2``. It is "" for a
    pure number.
    """
    if name in _UNITS:
        return _UNITS[name]
    powers = re.sub(r"(?<=[A-Za-z])-?[23]\b", lambda m: m[0].translate(SUPERSCRIPT), name)
    return powers.replace("*", "·")


def primed(text: str) -> str:
    """Return a text with typographic primes after capital letters: ' becomes ′, and '' becomes ″."""
    return re.sub(r"\b([A-Z])(\'{1,2})(?![\w\'])", lambda m: m[1] + ("′" if len(m[2]) == 1 else "″"), text)


def seconds(value: float) -> str:
    """Return a time in s as text with its unit and one decimal."""
    return f"{value:.1f}{THIN_SPACE}s"


def fixed(value: float, decimals: int) -> str:
    """Return a number as text with ``decimals`` decimals, or a dash for NaN or ∞."""
    if not math.isfinite(value):
        return "\u2013"
    whole, _, fraction = f"{value:,.{decimals}f}".partition(".")
    text = whole.replace(",", THIN_SPACE) + (f".{fraction}" if fraction else "")
    return text.replace("-", MINUS)


def aligned(text: str, most: int) -> str:
    """Return the number ``text`` with spaces at its end, as wide as with ``most`` decimals. In a right-aligned column
    the decimal points are then aligned.
    """
    _, point, fraction = text.partition(".")
    return text + ("" if point or not most else PUNCTUATION_SPACE) + FIGURE_SPACE * (most - len(fraction))


def is_scientific(text: str) -> bool:
    """Return whether a printed number has a power of ten."""
    return "\u00b7" in text


def scientific(value: float, decimals: int) -> str:
    """Return a number as text with mantissa and power of ten, or a dash for NaN or ∞."""
    if not math.isfinite(value):
        return "\u2013"
    mantissa, _, exponent = f"{value:.{decimals}e}".partition("e")
    return mantissa.replace("-", MINUS) + "\u00b710" + str(int(exponent)).translate(SUPERSCRIPT)


def plain(value: Any) -> str:
    """Return a value of the meta data as text. Floats have six significant digits; commas separate list elements."""
    if isinstance(value, float):
        return f"{value:.6g}".replace("-", MINUS)
    if isinstance(value, list):
        return ", ".join(plain(one) for one in value)
    return str(value)


def with_uncertainty(value: float, half: float) -> tuple[str, str]:
    """Return a value and its uncertainty as texts with the same last digit.

    The uncertainty ``half`` has one digit, or two if they are below 35. Very large or small numbers have a common
    power of ten. Without a known ``half`` the value has four digits.
    """
    if not math.isfinite(half) or half <= 0.0 or not math.isfinite(value):
        return significant(value, 4), "\u2013"
    place = math.floor(math.log10(half))
    last = place - (half / 10.0**place < 3.5)
    if last >= (-6 if abs(value) < 0.1 else -9) and max(abs(value), half) < 1e7:
        return fixed(value, max(0, -last)), fixed(half, max(0, -last))
    power = math.floor(math.log10(max(abs(value), half)))
    mantissas = (fixed(number / 10.0**power, max(0, power - last)) for number in (value, half))
    first, second = (f"{mantissa}·10{str(power).translate(SUPERSCRIPT)}" for mantissa in mantissas)
    return first, second


def significant(value: float, digits: int) -> str:
    """Return a number as text with ``digits`` significant digits, or a dash for NaN or ∞. Very large or small numbers
    have a power of ten.
    """
    if not math.isfinite(value):
        return "\u2013"
    if value == 0.0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    return fixed(value, max(digits - 1 - exponent, 0)) if -4 < exponent < 6 else scientific(value, digits - 1)
