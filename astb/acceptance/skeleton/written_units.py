"""Units as lists of registers and DBCs write them, and which of ours they are."""

from __future__ import annotations

import re
from collections import Counter
from typing import Final, NamedTuple

from bench_protocol.units import UNITS


class WrittenUnit(NamedTuple):
    """A unit that a user wrote: ours, if there is one, and what else the words say."""

    name: str
    absolute: bool = False  #: of a pressure over nothing
    factor: float = 1.0  #: of "0.01 mm": what one count is


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
_BY_LOWER: Final = {name.lower(): name for name in UNITS if _SPELLED[name.lower()] == 1}  # mN and MN are two
#: A unit of pressure with what it is over: psia, barg, kPa abs, bar(a), mbar (absolute).
_OVER: Final = re.compile(
    r"(?P<unit>psi|m?bar|[kM]?Pa)[ _.]*(?P<over>\(?(a|g|abs|absolute?|gauge|ü)\.?\)?)", re.IGNORECASE
)
#: A number before a unit: 0.01 mm, x0,1 bar, 1/100 mm.
_COUNT: Final = re.compile(r"[x×*]?\s*(\d+(?:[.,]\d+)?)(?:/(\d+))?\s*[x×*]?\s*(°?[^\W\d_].*)")


def unit_of(text: str) -> WrittenUnit:
    """Return a unit as we write it, of one as lists and DBCs write it; as it stands, if it is none of ours."""
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
