"""The SI factors of the units that people type and read: ``5 * bar`` goes in, ``p / bar`` comes out."""

from typing import Final

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

#: The factor from SI to each unit that the table of signals may name.
FACTORS: Final[dict[str, float]] = {
    "1": 1.0,
    "%": 0.01,
    "s": s,
    "ms": ms,
    "us": us,
    "m": m,
    "mm": mm,
    "rad": rad,
    "mrad": mrad,
    "kg": kg,
    "N": N,
    "kN": kN,
    "MN": MN,
    "N/m": 1.0,
    "kN/m": 1e3,
    "kN*s/m": 1e3,
    "kN*m/rad": 1e3,
    "kN/s": 1e3,
    "mm/s": mm,
    "Pa": Pa,
    "kPa": kPa,
    "mbar": mbar,
    "bar": bar,
    "K": K,
    "m/s2": 1.0,
    "Hz": Hz,
    "litre": litre,
    "kg/s": 1.0,
    "g/s": 1e-3,
    "J": 1.0,
}


def in_unit(value: float, unit: str) -> float:
    """Return an SI ``value`` as a number of ``unit``; KeyError for a unit that nobody declared."""
    return value / FACTORS[unit]
