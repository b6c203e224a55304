"""The unknown terms that can be fitted to the bench: surfaces over two states, with their ranges and prior sizes."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from bench_protocol.units import K, bar, mm, mrad
from bench_sim.model.layout import SURFACE
from diagnosis.contracts import Array, Parameter, Surface

#: Speed at which the force over displacement and speed changes from linear to logarithmic.
_UNIT_SPEED: Final = 10 * mm


@dataclass(frozen=True, slots=True)
class Span:
    """One coordinate of a surface: its field in the parameter record, its range, its title and unit."""

    field: str
    low: float
    high: float
    title: str
    scale: float  #: SI per unit in the title
    compressed: bool = False  #: even in asinh(v/v₀) instead of v

    def centres(self, count: int) -> Array:
        """Return where the quadratic B-splines have their maxima (count,), in the unit of the title."""
        ends = np.array([self.low, self.high])
        if self.compressed:
            ends = np.arcsinh(ends / _UNIT_SPEED)
        cell = (ends[1] - ends[0]) / (count - 2)
        places = np.clip(ends[0] + cell * (np.arange(count) - 0.5), *ends)
        return (_UNIT_SPEED * np.sinh(places) if self.compressed else places) / self.scale


@dataclass(frozen=True, slots=True)
class Term:
    """One possible surface of the model. ``spread`` is the prior standard deviation of every coefficient, in
    ``unit``.
    """

    name: str
    title: str
    unit: str
    spread: float
    first: Span
    second: Span
    touches: frozenset[str]

    @property
    def surface(self) -> Surface:
        """The term as a surface of the engine."""
        return Surface(
            self.name,
            self.title,
            (self.first.title, self.second.title),
            tuple(
                Parameter(f"c_{i}_{j}", self.unit, 0.0, self.spread, step=0.1 * self.spread)
                for i, j in product(*(range(count) for count in SURFACE))
            ),
            self.touches,
            tuple(
                (float(a), float(b))
                for a, b in product(self.first.centres(SURFACE[0]), self.second.centres(SURFACE[1]))
            ),
        )

    def over(self, record: Any) -> "Term":
        """Return the term with the ranges of the surface in a parameter record; unchanged if the record has no such
        surface.
        """
        if not record[self.name].any():
            return self
        first, second = (
            replace(span, low=float(low), high=float(high))
            for span in (self.first, self.second)
            for low, high in (record[span.field],)
        )
        return replace(self, first=first, second=second)

    def changes(self, record: Any, coefficients: Mapping[str, float]) -> dict[str, Array]:
        """Return parameters that add the surface to a parameter record; missing ``coefficients`` are 0."""
        added = np.array([coefficients.get(one.name, 0.0) for one in self.surface.coefficients])
        spans = {span.field: np.array([span.low, span.high]) for span in (self.first, self.second)}
        return {self.name: record[self.name] + added.reshape(SURFACE), **spans}

    def write(self, record: Any, coefficients: Mapping[str, float]) -> None:
        """Add the surface to a parameter record, in place."""
        for name, value in self.changes(record, coefficients).items():
            record[name][:] = value


_TERMS: Final = (
    Term(
        "force_surface",
        "unknown force over displacement and speed",
        "N",
        50.0,
        Span("force_surface_displacement", -20 * mm, 20 * mm, "displacement in mm", mm),
        Span("force_surface_speed", -200 * mm, 200 * mm, "speed in mm/s", mm, True),
        frozenset({"force"}),
    ),
    Term(
        "shear_surface",
        "unknown lateral force over shear and speed",
        "N",
        50.0,
        Span("shear_surface_shear", -20 * mm, 20 * mm, "shear in mm", mm),
        Span("shear_surface_speed", -200 * mm, 200 * mm, "lateral speed in mm/s", mm, True),
        frozenset({"force"}),
    ),
    Term(
        "roll_surface",
        "unknown lateral force over roll and shear",
        "N",
        50.0,
        Span("roll_surface_roll", -16 * mrad, 16 * mrad, "roll in mrad", mrad),
        Span("roll_surface_shear", -20 * mm, 20 * mm, "shear in mm", mm),
        frozenset({"force"}),
    ),
    Term(
        "moment_surface",
        "unknown roll moment over roll and shear",
        "N*m",
        10.0,
        Span("moment_surface_roll", -16 * mrad, 16 * mrad, "roll in mrad", mrad),
        Span("moment_surface_shear", -20 * mm, 20 * mm, "shear in mm", mm),
        frozenset({"force"}),
    ),
    Term(
        "flow_surface",
        "unknown flow over pressure difference and pressure",
        "kg/s",
        5e-4,
        Span("flow_surface_difference", -0.3 * bar, 0.3 * bar, "pressure difference in bar", bar),
        Span("flow_surface_pressure", 2 * bar, 8 * bar, "absolute pressure in bar", bar),
        frozenset({"gas", "flow"}),
    ),
    Term(
        "heat_surface",
        "unknown heat over pressure and temperature difference",
        "W",
        5.0,
        Span("heat_surface_pressure", 2 * bar, 8 * bar, "absolute pressure in bar", bar),
        Span("heat_surface_temperature", -15 * K, 15 * K, "gas over hall temperature in K", K),
        frozenset({"gas"}),
    ),
)
#: Every term by its name, which is also the name of its coefficients in the parameter record.
TERMS: Final[Mapping[str, Term]] = MappingProxyType({term.name: term for term in _TERMS})
