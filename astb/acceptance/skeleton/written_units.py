"""Units in the notation of lists of registers and DBCs, and the same units in the notation of ASTB."""

from __future__ import annotations

import re
from collections import Counter
from typing import Final, NamedTuple

from bench_protocol.units import UNITS


class WrittenUnit(NamedTuple):
    """A unit from a file: the same unit in ASTB, if there is one, and the other facts in its text."""

    name: str
    absolute: bool = False  #: for a pressure: absolute
    factor: float = 1.0  #: of "0.01 mm": the size of one count


_NAMES: Final = {
    **dict.fromkeys(("°c", "c", "deg c", "grad c", "celsius", "° c"), "degC"),
    **dict.fromkeys(("°f", "f", "deg f", "fahrenheit", "° f"), "degF"),
    **dict.fromkeys(("kelvin", "°k"), "K"),
    **dict.fromkeys(("µm", "μm", "micron", "microns", "mikrometer"), "um"),
    **dict.fromkeys(("µrad", "μrad", "microrad"), "urad"),
    **dict.fromkeys(("inch", "inches", "in.", '"'), "in"),
    **dict.fromkeys(("lbs", "lb f", "lbs.", "pound-force"), "lbf"),
    **dict.fromkeys(("°", "deg.", "grad", "degree", "degrees"), "deg"),
    **dict.fromkeys(("-", "none", "n/a"), ""),
}
_SPELLED: Final = Counter(name.lower() for name in UNITS)
_BY_LOWER: Final = {name.lower(): name for name in UNITS if _SPELLED[name.lower()] == 1}  # mN and MN differ
#: A unit of pressure with its reference: psia, barg, kPa abs, bar(a), mbar (absolute).
_OVER: Final = re.compile(
    r"(?P<unit>psi|m?bar|[kM]?Pa)[ _.]*(?P<over>\(?(a|g|abs|absolute?|gauge|ü)\.?\)?)", re.IGNORECASE
)
#: A number before a unit: 0.01 mm, x0,1 bar, 1/100 mm.
_COUNT: Final = re.compile(r"[x×*]?\s*(\d+(?:[.,]\d+)?)(?:/(\d+))?\s*[x×*]?\s*(°?[^\W\d_].*)")


def unit_of(text: str) -> WrittenUnit:
    """Return the ASTB unit for a unit in a list or a DBC; an unknown unit is returned unchanged."""
    text = text.strip().removeprefix("[").removesuffix("]").strip()
    factor = 1.0
    if counted := _COUNT.fullmatch(text):
        number, divisor = float(counted[1].replace(",", ".")), float(counted[2] or 1)
        if number > 0.0 and divisor > 0.0:
            factor, text = number / divisor, counted[3].strip()
    absolute = False
    if over := _OVER.fullmatch(text):
        text = over["unit"]
        absolute = over["over"].lower().strip("(").startswith("a")
    plain = text.lower()
    name = text if text in UNITS else _NAMES.get(plain, _BY_LOWER.get(plain, text))
    return WrittenUnit(name, absolute, factor)
