"""Load cases of a spring, and the limits under each load, by the names in the specimen's file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, TypeVar

import numpy as np

from bench_protocol.units import UNITS
from test_plans.analysis.geometry import bolster_weight

#: Load cases of the plans: the empty and the full car.
AW0: Final = "AW0"
AW3: Final = "AW3"
#: Name of the car by load case.
CARS: Final = {AW0: "empty", AW3: "full"}

T = TypeVar("T")


class SpecimenError(ValueError):
    """Raised if a specimen's file lacks an entry or has an invalid one."""


@dataclass(frozen=True, slots=True)
class Band:
    """The limits of a check (SI). None means no limit on this side."""

    low: float | None = None
    high: float | None = None

    def __contains__(self, value: float) -> bool:
        return (self.low is None or self.low <= value) and (self.high is None or value <= self.high)

    def wider(self, by: float) -> Band:
        """Return this band with both limits moved outward by the fraction ``by`` of their magnitudes."""
        low = None if self.low is None else self.low - by * abs(self.low)
        return Band(low, None if self.high is None else self.high + by * abs(self.high))

    def times(self, factor: float) -> Band:
        """Return this band with both limits multiplied by a positive ``factor``."""
        return Band(*(None if end is None else factor * end for end in (self.low, self.high)))

    def text(self, unit: str) -> str:
        """Return the limits as text in ``unit``."""
        factor = UNITS[unit].factor
        ends = (("at least", self.low), ("at most", self.high))
        return ", ".join(f"{which} {end / factor:g} {unit}" for which, end in ends if end is not None)

    told = text  # the old name, for one release


def within(expected: float, tolerance: float) -> Band:
    """Return the band from ``expected`` − ``tolerance``·``expected`` to ``expected`` + ``tolerance``·``expected``."""
    return Band(expected * (1 - tolerance), expected * (1 + tolerance))


@dataclass(frozen=True, slots=True)
class Limits:
    """The limits in one table of a specimen's file, by name; ``where`` states file and table.

    Limits in a table with the name of a plan are called ``plan.name`` here. Only the plan knows the quantity of such a
    limit, so it passes the expected ``unit``.
    """

    where: str
    bands: Mapping[str, Band]
    curves: Mapping[
        str, Mapping[float, Band]
    ]  #: over frequency (Hz), amplitude, offset or plate (m), roll (rad)
    units: Mapping[str, str] = field(default_factory=dict)  #: SI unit of each limit in the table of a plan

    def band(self, name: str, unit: str = "") -> Band:
        """Return the limits of one value. Raises SpecimenError if the file lacks them, or states them for another
        quantity.
        """
        return self._stated(name, unit, self.bands, "low, high or expected with tolerance")

    def curve(self, name: str, unit: str = "") -> Mapping[float, Band]:
        """Return the limits at each place (SI) of a curve. Raises SpecimenError if the file lacks them, or states them
        for another quantity.
        """
        return self._stated(name, unit, self.curves, "a list of places, expected and tolerance")

    def curve_at(self, name: str, place: float, unit: str = "") -> tuple[float, float]:
        """Return the lower and upper limit at a ``place`` (SI) on a curve, interpolated linearly.

        Raises SpecimenError if the file has no such curve, or if the ``place`` is outside of it.
        """
        curve = self.curve(name, unit)
        if not min(curve) <= place <= max(curve):
            raise SpecimenError(
                f"{self.where} has no limit of {name} at {place:g} (in Hz, m or rad); extend its range, "
                f"which is now {min(curve):g} to {max(curve):g}"
            )
        ends = ([band.low for band in curve.values()], [band.high for band in curve.values()])
        low, high = (float(np.interp(place, list(curve), np.array(end, float))) for end in ends)
        return low, high

    def _stated(self, name: str, unit: str, known: Mapping[str, T], parts: str) -> T:
        if name not in known:
            raise SpecimenError(f"{self.where} has no limit of {name}; add {parts}")
        if name in self.units and (unit not in UNITS or UNITS[unit].si != self.units[name]):
            raise SpecimenError(
                f"{self.where}.{name} has the unit {self.units[name]}, but the plan needs "
                f"{unit or 'no unit'}; correct the unit"
            )
        return known[name]


@dataclass(frozen=True, slots=True)
class Load:
    """One load case with its limits (SI). Vertical stiffness is per spring; lateral and roll stiffness are those of the
    pair.
    """

    name: str
    preload: float  #: N on each spring, the bolster's half weight included
    fill_pressure: float  #: Pa gauge that carries the preload at design height: P / A_e
    roll_load: float  #: N more on one side and less on the other
    limits: Limits

    def actuator_force(self, rig: Mapping[str, float]) -> float:
        """Return the force (N) that each vertical actuator must add to half of the bolster's weight."""
        return self.preload - bolster_weight(rig) / 2

    def sweep(self, direction: str) -> Iterator[tuple[float, Band, Band]]:
        """Yield each frequency (Hz) with the limits of K' and of c, in ``direction``: vertical or lateral."""
        damping = self.limits.curve(f"{direction}_damping")
        for frequency, storage in self.limits.curve(f"{direction}_stiffness").items():
            if frequency in damping:
                yield frequency, storage, damping[frequency]
