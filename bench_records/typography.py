"""Numbers as a report prints them: thin spaces between thousands, a true minus sign, powers of ten."""

from __future__ import annotations

import math
from typing import Any

FIGURE_SPACE, PUNCTUATION_SPACE, THIN_SPACE, MINUS = "\u2007", "\u2008", "\u2009", "\u2212"
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def seconds(value: float) -> str:
    """A time in s with its unit, to a tenth."""
    return f"{value:.1f}{THIN_SPACE}s"


def fixed(value: float, decimals: int) -> str:
    """A number with that many decimals; a dash where there is none."""
    if not math.isfinite(value):
        return "\u2013"
    whole, _, fraction = f"{value:,.{decimals}f}".partition(".")
    text = whole.replace(",", THIN_SPACE) + (f".{fraction}" if fraction else "")
    return text.replace("-", MINUS)


def aligned(text: str, most: int) -> str:
    """Padded on the right, so that decimal points stand under each other in a right-aligned column."""
    _, point, fraction = text.partition(".")
    return text + ("" if point or not most else PUNCTUATION_SPACE) + FIGURE_SPACE * (most - len(fraction))


def is_scientific(text: str) -> bool:
    """Whether a number was printed with a power of ten."""
    return "\u00b7" in text


def scientific(value: float, decimals: int) -> str:
    """A number as mantissa and power of ten; a dash where there is none."""
    if not math.isfinite(value):
        return "\u2013"
    mantissa, _, exponent = f"{value:.{decimals}e}".partition("e")
    return mantissa.replace("-", MINUS) + "\u00b710" + str(int(exponent)).translate(SUPERSCRIPT)


def plain(value: Any) -> str:
    """A fact of the meta data: numbers with six digits, lists with commas."""
    if isinstance(value, float):
        return f"{value:.6g}".replace("-", MINUS)
    if isinstance(value, list):
        return ", ".join(plain(one) for one in value)
    return str(value)
