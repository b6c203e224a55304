"""Numbers as a report prints them: three significant digits, thin spaces, true minus signs."""

from __future__ import annotations

import math
import re

from bench_records.typography import MINUS, SUPERSCRIPT, significant, with_uncertainty

DASH = "\u2013"
#: TOML in a sentence, to be copied: a list or a text of any key, and any value of a key of a map.
_TOML = re.compile(
    r"""(\b\w+ = (?:\[[^]]*\]|"[^"]*")|\b(?:columns|runs|file)\.[\w.]+ = -?[\d.]+(?:e[+-]?\d+)?)"""
)


def shown(value: float | None, digits: int = 3) -> str:
    """Return a number with ``digits`` significant digits; as a power of ten if it is far from 1."""
    return DASH if value is None else significant(value, digits)


def pair(value: float | None, half: float | None) -> tuple[str, str]:
    """Return a number and its uncertainty, rounded to the same digit."""
    if value is None:
        return DASH, DASH
    return with_uncertainty(value, math.nan if half is None else half)


def unit(name: str) -> str:
    """Return a unit as printed; "" for a pure number."""
    return "" if name == "1" else _raised(name)


def _raised(text: str) -> str:
    """Return a text with typeset units: powers in superscript and products with a dot (mm², g/(min·bar²))."""
    powers = re.sub(r"\b(m|cm|mm|bar)([23])\b", lambda m: m[1] + m[2].translate(SUPERSCRIPT), text)
    return re.sub(r"(?<=[a-zA-Z])\*(?=[a-z])", "·", powers)


def typeset(text: str) -> str:
    """Return a text of the finding with typeset powers of ten and minus signs, except in its TOML parts."""
    parts = _TOML.split(text)
    parts[::2] = map(_set, parts[::2])
    return "".join(parts)


def _set(text: str) -> str:
    powers = re.sub(
        r"(\d)e([+-]?)0*(\d+)\b",
        lambda m: f"{m[1]}·10{(m[2].strip('+') + m[3]).translate(SUPERSCRIPT)}",
        text,
    )
    return _raised(re.sub(r"(?<![\w.])-(?=\d)", MINUS, powers))


def prose(sentence: str) -> str:
    """Return a typeset sentence of the finding. It begins with a capital unless the first word is the name of a
    channel.
    """
    text = typeset(sentence)
    named = "." in text.split(" ", 1)[0].rstrip(".,:")
    return text if named else text[:1].upper() + text[1:]
