"""Units in common spellings, such as KN, µm, msec or N·m/°, and their factors to SI.

Common libraries for units reject KN, read F/kN as a farad, and PSI as a peta-siemens-inch. A spelling is accepted if it
has one meaning. If only the case of letters decides (mn: millinewton or meganewton), the unit is rejected.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from functools import cache, lru_cache
from math import pi
from typing import Final, NamedTuple

from bench_protocol.units import UNITS, Unit

BASES: Final = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
_EXPONENTS: Final[dict[str, dict[str, int]]] = {
    "1": {},
    **{base: {base: 1} for base in BASES},
    "Hz": {"s": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "C": {"A": 1, "s": 1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
}


def base_exponents(unit: str) -> dict[str, int]:
    """Return the exponents of an SI unit in the notation of this project, such as ``N*m/(rad*Pa)``.

    Raises ValueError for other notations.
    """
    above, _, below = unit.partition("/")
    total = dict.fromkeys(BASES, 0)
    for text, sign in ((above, 1), (below.strip("()"), -1)):
        for part in filter(None, text.split("*")):
            found = re.fullmatch(r"([A-Za-z]+|1)(\d*)", part)
            if found is None or found[1] not in _EXPONENTS:
                raise ValueError(f"unit {unit!r} has the unknown part {part!r}; use {', '.join(_EXPONENTS)}")
            for base, power in _EXPONENTS[found[1]].items():
                total[base] += sign * power * int(found[2] or 1)
    return {base: power for base, power in total.items() if power}


def written(exponents: Mapping[str, int]) -> str:
    """Return the unit of these exponents in base units, such as ``m3/s``."""

    def product(sign: int) -> list[str]:
        powers = {base: sign * exponents.get(base, 0) for base in BASES}
        return [base + (str(power) if power > 1 else "") for base, power in powers.items() if power > 0]

    above, below = product(1), product(-1)
    over = f"/({'*'.join(below)})" if len(below) > 1 else "".join(f"/{one}" for one in below)
    return ("*".join(above) or "1") + over


class UnknownUnit(ValueError):
    """An unknown or ambiguous unit. The message names it."""


class ReadUnit(NamedTuple):
    """The unit in a text, and for pressures their reference ("": not stated)."""

    unit: Unit
    reading: str = ""  #: "gauge" or "absolute"

    def measures(self, si: str) -> bool:
        """Whether this is a unit of the quantity that has the SI unit ``si``."""
        try:
            return base_exponents(self.unit.si) == base_exponents(si)
        except ValueError:  # a third-party simulator may use any unit
            return False

    def same(self, other: ReadUnit) -> bool:
        """Whether numbers in both units mean the same."""
        one, two = self.unit, other.unit
        return (
            self.measures(two.si)
            and abs(one.factor / two.factor - 1.0) < 1e-9
            and abs(one.zero - two.zero) < 1e-9
            and (not self.reading or not other.reading or self.reading == other.reading)
        )


_PREFIXES: Final = {
    **{"": 1.0, "M": 1e6, "k": 1e3, "h": 1e2, "da": 10.0},
    **{"d": 0.1, "c": 0.01, "m": 1e-3, "u": 1e-6, "n": 1e-9},
}
_G0: Final = 9.80665
#: Spellings, the prefixes that they may have ("-": none), the SI unit, the factor and the zero. Only prefixes in use
#: are listed: with megametres MM would be ambiguous.
SPELLINGS: Final[tuple[tuple[str, str, str, float, float], ...]] = (
    ("m meter metre meters metres Meter", "- k d c m u n", "m", 1.0, 0.0),
    ("micron microns micrometer micrometre mikrometer", "-", "m", 1e-6, 0.0),
    ('in inch inches in. zoll "', "-", "m", 25.4e-3, 0.0),
    ("ft foot feet", "-", "m", 0.3048, 0.0),
    ("s sec secs second seconds sek sekunde sekunden", "- m u n", "s", 1.0, 0.0),
    ("min mins minute minutes minuten", "-", "s", 60.0, 0.0),
    ("h hr hrs hour hours std stunde stunden", "-", "s", 3600.0, 0.0),
    ("d day days tag tage", "-", "s", 86_400.0, 0.0),
    ("Hz hertz", "- M k m", "Hz", 1.0, 0.0),
    ("rpm U/min", "-", "rad/s", pi / 30.0, 0.0),
    ("g gram gramm", "- k m", "kg", 1e-3, 0.0),
    ("lb lbs", "-", "kg", 0.45359237, 0.0),
    ("N newton newtons", "- M k da m", "N", 1.0, 0.0),
    ("kgf kp", "-", "N", _G0, 0.0),
    ("gf", "-", "N", 1e-3 * _G0, 0.0),
    ("lbf pound-force", "-", "N", 4.4482216152605, 0.0),
    ("kip", "-", "N", 4448.2216152605, 0.0),
    ("Pa pascal pascals", "- M k h m", "Pa", 1.0, 0.0),
    ("bar bars", "- m", "Pa", 1e5, 0.0),
    ("psi", "- k", "Pa", 6894.757293168361, 0.0),
    ("atm", "-", "Pa", 101_325.0, 0.0),
    ("at", "-", "Pa", 1e4 * _G0, 0.0),
    ("mmHg torr", "-", "Pa", 101_325.0 / 760.0, 0.0),
    ("inHg", "-", "Pa", 3386.389, 0.0),
    ("mmH2O mmWS mmWC", "-", "Pa", _G0, 0.0),
    ("inH2O inWC", "-", "Pa", 25.4 * _G0, 0.0),
    ("K kelvin °K degK", "- m", "K", 1.0, 0.0),
    ("degC °C C celsius", "-", "K", 1.0, 273.15),
    ("degF °F F fahrenheit", "-", "K", 5 / 9, 459.67 * 5 / 9),
    ("l litre liter litres liters ltr", "- m", "m3", 1e-3, 0.0),
    ("rad radian radians", "- m u", "rad", 1.0, 0.0),
    ("deg ° degree degrees deg. grad", "-", "rad", pi / 180.0, 0.0),
    ("J joule", "- k M m", "J", 1.0, 0.0),
    ("Nm", "- k M m", "N*m", 1.0, 0.0),
    ("W watt", "- k M m", "W", 1.0, 0.0),
    ("V volt volts", "- k m u", "V", 1.0, 0.0),
    ("A amp ampere amps", "- k m u", "A", 1.0, 0.0),
    ("Ohm", "- k M m", "Ohm", 1.0, 0.0),
    ("% percent prozent pct", "-", "1", 0.01, 0.0),
    ("ppm", "-", "1", 1e-6, 0.0),
    ("1 -", "-", "1", 1.0, 0.0),
)
#: Other characters for the same, and other words for the same unit.
_ALIKE: Final = {"·": "*", "⋅": "*", "×": "*", "**": "", "^": "", "−": "-", "º": "°", "μ": "u"}
_WORDS: Final = dict.fromkeys(("deg c", "grad c", "° c"), "degC") | dict.fromkeys(("deg f", "° f"), "degF")
#: Reference of a pressure, after its unit.
_OVER: Final = re.compile(
    r"(?P<unit>psi|m?bar|[kM]?Pa)[ _.]*\(?(?P<over>a|g|abs|absolute?|gauge|ü)\.?\)?", re.I
)
_PART: Final = re.compile(r"([^\d*/()]+?)(-?\d)?|1")
_IN_NAME: Final = re.compile(r"(?P<name>.*?)\s*(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>[^()]*)\))")
_BEHIND: Final = re.compile(r"(?P<name>.+?)(?:\s*/\s*|\s+in\s+|,\s+)(?P<unit>\S+)")


@lru_cache(maxsize=1024)
def read_unit(text: str) -> ReadUnit:
    """Return the unit of a text. Raises UnknownUnit for an unknown or ambiguous one."""
    given = text.strip()
    if given.startswith(("[", "(")) and given.endswith(("]", ")")):
        given = given[1:-1].strip()
    if given in UNITS:
        return ReadUnit(UNITS[given])
    if over := _OVER.fullmatch(given):
        what = "absolute" if over["over"].lower().startswith("a") else "gauge"
        return ReadUnit(read_unit(over["unit"]).unit, what)
    plain = unicodedata.normalize("NFKC", given)
    for one, other in _ALIKE.items():
        plain = plain.replace(one, other)
    plain = _WORDS.get(plain.casefold(), plain)
    try:
        return ReadUnit(_single_unit(plain) or _product(plain))
    except UnknownUnit as error:
        raise UnknownUnit(f'"{text}" is not a known unit{error}') from None


def is_unit(text: str) -> bool:
    """Whether a text is a unit that `read_unit` knows."""
    try:
        read_unit(text)
    except UnknownUnit:
        return False
    return True


def unit_in_name(name: str) -> str:
    """Return the unit in the name of a column, such as "F [kN]", "F (N)" or "F/kN", known or not; "" if there is none.

    In round brackets, and without brackets, only a known unit counts: other words there belong to the name.
    """
    if found := _IN_NAME.fullmatch(name):
        if found["square"] is not None:
            return found["square"].strip()
        unit = found["round"].strip()
        return unit if is_unit(unit) and unit.casefold() not in ("a", "g") else ""  # absolute, gauge
    *_, last = name.split() or [""]
    if "/" in last and is_unit(last):
        return "" if last == name else last
    found = _BEHIND.fullmatch(name)
    return found["unit"] if found and is_unit(found["unit"]) else ""


@cache
def _names() -> dict[str, Unit]:
    found: dict[str, Unit] = {}
    for names, prefixes, si, factor, zero in SPELLINGS:
        for prefix in prefixes.split():
            for name in names.split():
                size = _PREFIXES["" if prefix == "-" else prefix]
                found[("" if prefix == "-" else prefix) + name] = Unit(si, size * factor, zero)
    return found | {name: unit for name, unit in UNITS.items() if "/" not in name and "*" not in name}


@cache
def _by_lower() -> dict[str, dict[tuple[str, float], str]]:
    found: dict[str, dict[tuple[str, float], str]] = {}
    for name, unit in _names().items():
        found.setdefault(name.casefold(), {}).setdefault((unit.si, unit.factor), name)
    return found


def _single_unit(text: str) -> Unit | None:
    """Return the unit of a single word; None for others."""
    return _names().get(text) or _by_any_case(text)


def _by_any_case(text: str) -> Unit | None:
    able = _by_lower().get(text.casefold(), {})
    if len(able) > 1:
        raise UnknownUnit(f": it may be {' or '.join(able.values())}")
    return next((_names()[name] for name in able.values()), None)


def _product(text: str) -> Unit:
    """Return a compound unit, such as N*m/(rad*Pa), m/s2, kg m-2 or 1/min.

    If one part has the wrong case, as in mN/M, parts that depend on their case are rejected.
    """
    above, *below = re.sub(r"\s+per\s+", "/", text).split("/")
    parts = [
        (*_power(part), sign)
        for side, sign in ((above, 1), *((one, -1) for one in below))
        for part in re.split(r"[*\s.]+", side.strip().removeprefix("(").removesuffix(")"))
    ]
    read = _single_unit if all(name in _names() for name, *_ in parts) else _by_any_case
    exponents, factor = dict.fromkeys(BASES, 0), 1.0
    for name, power, sign in parts:
        unit = read(name)
        if unit is None or unit.zero:
            raise UnknownUnit("")
        for base, count in base_exponents(unit.si).items():
            exponents[base] += sign * power * count
        factor *= unit.factor ** (sign * power)
    used = {base: power for base, power in exponents.items() if power}
    same = (one.si for one in UNITS.values() if base_exponents(one.si) == used)
    return Unit(next(same, written(used)), factor)


def _power(part: str) -> tuple[str, int]:
    """Return the unit and the power of a part such as m-2."""
    found = _PART.fullmatch(part)
    if found is None:
        raise UnknownUnit("")
    return found[1] or "1", int(found[2] or 1)
