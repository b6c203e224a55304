"""Conversion of numbers for a finding: fitted values in display units, and floats for JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable
from types import MappingProxyType
from typing import Final

from diagnosis.contracts import Parameter
from diagnosis.finding import Estimate

#: Half the width of a 95 % interval, in standard deviations.
Z95: Final = 1.959963984540054


def decimals(low: float, high: float) -> int:
    """Return the number of decimals that shows the half width of an interval with two significant digits."""
    width = (high - low) / 2.0
    return max(1 - math.floor(math.log10(width)), 0) if width > 0.0 else 6


def number(value: float) -> float | None:
    """Return a float for JSON; None (null) if it is not finite."""
    return float(value) if math.isfinite(value) else None


#: Texts of parameters that are errors with the expected value 0, but whose names do not show this. A dot stands for a
#: place and a dot.
_ERRORS: Final = MappingProxyType(
    {
        ".initial_pressure": "initial pressure error",
        ".initial_temperature": "initial temperature error",
        ".drag": "error in proportion to the speed",
        ".seat": "rounding error",
        "pressure_zero": "pressure zero error",
        "force_zero": "force zero error",
    }
)


def in_words(name: str, owner: str = "") -> str:
    """Return the name of a parameter as text: ``left.auxiliary_volume`` becomes "auxiliary volume of left".

    ``owner`` is the title of the effect that the parameter belongs to.
    """
    place, _, what = name.rpartition(".")
    text = _ERRORS.get(f".{what}" if place else what, what.replace("_", " "))
    return " of ".join(one for one in (text, place, owner) if one)


def with_unit(value: float, unit: str, digits: int) -> str:
    """Return a number with ``digits`` significant digits and its unit. A power of ten is used only from one million on,
    and below 0.0001.
    """
    text = f"{value:.{digits}g}"
    if "e+" in text and abs(value) < 1e6:
        text = f"{float(text):.0f}"
    return text + ("" if unit == "1" else f" {unit}")


def numbers(values: Iterable[float], digits: int = 5) -> list[float | None]:
    """Return floats for a figure with ``digits`` significant digits; None (null) if not finite."""
    return [float(f"{value:.{digits}g}") if math.isfinite(value) else None for value in values]


def percent(part: float, digits: int = 2) -> str:
    """Return a fraction as a percentage with ``digits`` significant digits, never as a power of ten."""
    value = 100.0 * part
    return "less than 0.01 %" if 0.0 < value < 0.01 else f"{float(f'{value:.{digits}g}'):.12g} %"


def estimate(
    parameter: Parameter, value: float, sd: float, ends: tuple[float, float] | None = None
) -> Estimate:
    """Return a fitted parameter in display units.

    ``value`` and the ``ends`` of its 95 % interval are in SI. ``sd`` is in SI too; for a ``logarithmic`` parameter it
    is that of the logarithm. Without ``ends`` the interval follows from ``sd``; it is asymmetric for a logarithmic
    parameter. The interval is limited to the range of the parameter.
    """
    if ends is None and parameter.logarithmic:
        ends = value * math.exp(min(-Z95 * sd, 0.0)), value * math.exp(min(Z95 * sd, 700.0))
    elif ends is None:
        ends = value - Z95 * sd, value + Z95 * sd
    low, high = max(ends[0], min(parameter.low, value)), min(ends[1], max(parameter.high, value))
    spread = abs(value) * sd if parameter.logarithmic else sd
    known = math.isfinite(sd)
    return Estimate(
        name=parameter.name,
        unit=parameter.display or parameter.unit,
        value=number(value / parameter.scale),
        sd=number(spread / parameter.scale),
        low=number(low / parameter.scale) if known else None,
        high=number(high / parameter.scale) if known else None,
    )


def unresolved(parameter: Parameter, below: float) -> Estimate:
    """Return a fitted parameter of which only an upper bound ``below`` (SI) is known."""
    unit, least = parameter.display or parameter.unit, number(below / parameter.scale)
    return Estimate(name=parameter.name, unit=unit, value=None, sd=None, low=None, high=None, below=least)
