"""Numbers as a report prints them: three significant digits, thin spaces, true minus signs."""

from __future__ import annotations

import math
import re

from bench_records.typography import MINUS, SUPERSCRIPT, THIN_SPACE

DASH = "\u2013"


def shown(value: float | None, digits: int = 3) -> str:
    """A number in so many significant digits; far from 1 as a power of ten."""
    if value is None or not math.isfinite(value):
        return DASH
    if value == 0.0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if not -4 < exponent < 6:
        mantissa = f"{value / 10.0**exponent:.{digits - 1}f}"
        return f"{mantissa}·10{str(exponent).translate(SUPERSCRIPT)}".replace("-", MINUS)
    text = f"{value:,.{max(digits - 1 - exponent, 0)}f}"
    return text.replace(",", THIN_SPACE).replace("-", MINUS)


def percent(value: float | None) -> str:
    """A part of 1 as a percentage."""
    return DASH if value is None else f"{100.0 * value:.3g}{THIN_SPACE}%".replace("-", MINUS)


def chance(p: float | None) -> str:
    """A p-value: no finer than anybody believes it."""
    if p is None:
        return DASH
    return "<\u200910⁻⁹" if p < 1e-9 else shown(p, 2)


def unit(name: str) -> str:
    """A unit as it is printed: nothing for a pure number."""
    return "" if name == "1" else _raised(name)


def _raised(text: str) -> str:
    """A text with the powers of its units set: mm², g/(min·bar²)."""
    powers = re.sub(r"\b(m|mm|bar)([23])\b", lambda m: m[1] + m[2].translate(SUPERSCRIPT), text)
    return powers.replace("min*bar", "min·bar")


def typeset(text: str) -> str:
    """A text of the finding with its powers of ten and minus signs set."""
    powers = re.sub(
        r"(\d)e([+-]?)0*(\d+)\b",
        lambda m: f"{m[1]}·10{(m[2].strip('+') + m[3]).translate(SUPERSCRIPT)}",
        text,
    )
    return _raised(re.sub(r"(?<![\w.])-(?=\d)", MINUS, powers))


def prose(sentence: str) -> str:
    """A sentence of the finding, typeset, with a capital unless it begins with the name of a channel."""
    text = typeset(sentence)
    named = "." in text.split(" ", 1)[0].rstrip(".,:")
    return text if named else text[:1].upper() + text[1:]
