"""Units for input and display: ``5 * bar`` is SI, ``p / bar`` a number of bar. `UNITS` holds them by name."""

from math import pi
from typing import Final, NamedTuple

s: Final = 1.0
ms: Final = 1e-3
us: Final = 1e-6
minutes: Final = 60.0
hours: Final = 3600.0

m: Final = 1.0
mm: Final = 1e-3
um: Final = 1e-6

rad: Final = 1.0
mrad: Final = 1e-3

kg: Final = 1.0
N: Final = 1.0
kN: Final = 1e3
MN: Final = 1e6

Pa: Final = 1.0
kPa: Final = 1e3
mbar: Final = 1e2
bar: Final = 1e5

K: Final = 1.0
Hz: Final = 1.0
litre: Final = 1e-3

#: Standard atmosphere in Pa; gauge pressures on the wires are relative to it.
ATMOSPHERE: Final = 101_325.0

#: Nanoseconds in one second: all time stamps are whole nanoseconds.
NS: Final = 1_000_000_000


class Unit(NamedTuple):
    """A unit for input and display: SI = ``factor`` · number + ``zero``."""

    si: str  #: the SI unit of the same quantity, in base units
    factor: float
    zero: float = 0.0  #: SI value of 0 in this unit; nonzero only for temperatures


#: The units of parameter files, from which the project also chooses when it writes a value.
WRITTEN_UNITS: Final[dict[str, Unit]] = {
    "1": Unit("1", 1.0),
    "%": Unit("1", 0.01),
    "ppm": Unit("1", 1e-6),
    "m": Unit("m", 1.0),
    "mm": Unit("m", 1e-3),
    "m2": Unit("m2", 1.0),
    "mm2": Unit("m2", 1e-6),
    "cm2": Unit("m2", 1e-4),
    "1/m": Unit("1/m", 1.0),
    "1/m2": Unit("1/m2", 1.0),
    "m3": Unit("m3", 1.0),
    "litre": Unit("m3", 1e-3),
    "rad": Unit("rad", 1.0),
    "mrad": Unit("rad", 1e-3),
    "deg": Unit("rad", pi / 180.0),
    "s": Unit("s", 1.0),
    "ms": Unit("s", 1e-3),
    "min": Unit("s", 60.0),
    "h": Unit("s", 3600.0),
    "Hz": Unit("Hz", 1.0),
    "kg": Unit("kg", 1.0),
    "kg*m2": Unit("kg*m2", 1.0),
    "kg/m3": Unit("kg/m3", 1.0),
    "K": Unit("K", 1.0),
    "N": Unit("N", 1.0),
    "kN": Unit("N", 1e3),
    "N/s": Unit("N/s", 1.0),
    "kN/s": Unit("N/s", 1e3),
    "m/s": Unit("m/s", 1.0),
    "mm/s": Unit("m/s", 1e-3),
    "km/h": Unit("m/s", 1.0 / 3.6),
    "m/s2": Unit("m/s2", 1.0),
    "Pa": Unit("Pa", 1.0),
    "mbar": Unit("Pa", 1e2),
    "bar": Unit("Pa", 1e5),
    "m/N": Unit("m/N", 1.0),
    "mm/kN": Unit("m/N", 1e-6),
    "m/(N*s)": Unit("m/(N*s)", 1.0),
    "mm/(kN*s)": Unit("m/(N*s)", 1e-6),
    "N/m": Unit("N/m", 1.0),
    "kN/m": Unit("N/m", 1e3),
    "MN/m": Unit("N/m", 1e6),
    "N*s/m": Unit("N*s/m", 1.0),
    "kN*s/m": Unit("N*s/m", 1e3),
    "s/m": Unit("s/m", 1.0),
    "N/Pa": Unit("N/Pa", 1.0),
    "N*m/rad": Unit("N*m/rad", 1.0),
    "kN*m/rad": Unit("N*m/rad", 1e3),
    "N*m/(rad*Pa)": Unit("N*m/(rad*Pa)", 1.0),
    "J/(kg*K)": Unit("J/(kg*K)", 1.0),
    "J/K": Unit("J/K", 1.0),
    "W": Unit("W", 1.0),
    "W/K": Unit("W/K", 1.0),
    "kg/s": Unit("kg/s", 1.0),
    "g/s": Unit("kg/s", 1e-3),
    "m3/Pa": Unit("m3/Pa", 1.0),
    "litre/bar": Unit("m3/Pa", 1e-8),
    "m2/Pa": Unit("m2/Pa", 1.0),
    "cm2/bar": Unit("m2/Pa", 1e-9),
    "m3/(s*Pa)": Unit("m3/(s*Pa)", 1.0),
    "kg/(s*Pa2)": Unit("kg/(s*Pa2)", 1.0),
    "g/(min*bar2)": Unit("kg/(s*Pa2)", 1e-3 / 60.0 / 1e10),
    "bar/s": Unit("Pa/s", 1e5),
    "mbar/h": Unit("Pa/s", 1e2 / 3600.0),
    "Pa/s": Unit("Pa/s", 1.0),
    "K/s": Unit("K/s", 1.0),
    "rad/s": Unit("rad/s", 1.0),
    "m/s3": Unit("m/s3", 1.0),
}
#: Every unit that signals, checks and measured files may name.
UNITS: Final[dict[str, Unit]] = WRITTEN_UNITS | {
    "um": Unit("m", 1e-6),
    "cm": Unit("m", 1e-2),
    "us": Unit("s", 1e-6),
    "ns": Unit("s", 1e-9),
    "d": Unit("s", 86_400.0),
    "cm3": Unit("m3", 1e-6),
    "MN": Unit("N", 1e6),
    "mN": Unit("N", 1e-3),
    "kPa": Unit("Pa", 1e3),
    "MPa": Unit("Pa", 1e6),
    "psi": Unit("Pa", 6894.757293168361),
    "daN": Unit("N", 10.0),
    "lbf": Unit("N", 4.4482216152605),
    "in": Unit("m", 25.4e-3),
    "urad": Unit("rad", 1e-6),
    "J": Unit("J", 1.0),
    "degC": Unit("K", 1.0, 273.15),
    "degF": Unit("K", 5 / 9, 459.67 * 5 / 9),
}
#: Units without a zero offset: values are only multiplied by the factor.
FACTORS: Final = {name: unit.factor for name, unit in UNITS.items() if unit.zero == 0.0}


def in_unit(value: float, unit: str) -> float:
    """Return an SI ``value`` as a number of ``unit``. Raises KeyError for an undeclared unit."""
    return value / FACTORS[unit]
