"""A point in the space of models: which effects are in the model, and the value of every free number."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.contracts import Array, DiagnosisError, Hypothesis, Nuisance, Parameter, Surface
from diagnosis.estimates import in_words


@dataclass(frozen=True, slots=True)
class Coordinate:
    """One free number: a nuisance, or a parameter of an effect or a surface (``owner``). If ``record`` is set, it is
    for this record only.

    The engine counts the number from its nominal value in units of its prior spread, so that all numbers have a similar
    size. ``penalised``: the prior counts as an observation. ``held``: the number is fixed and has no columns.
    """

    parameter: Parameter
    owner: str = ""
    record: str = ""
    penalised: bool = True
    held: bool = False

    @property
    def label(self) -> str:
        """The display name: ``effect.parameter`` or ``parameter [record]``."""
        name = f"{self.owner}.{self.parameter.name}" if self.owner else self.parameter.name
        return f"{name} [{self.record}]" if self.record else name

    def in_words(self, catalogue: Mapping[str, Hypothesis]) -> str:
        """Return the name of the coordinate for people, with the title of its effect from the catalogue."""
        effect = catalogue.get(self.owner)
        name = in_words(self.parameter.name, f'"{effect.title}"' if effect else self.owner)
        return f"{name} in {self.record}" if self.record else name

    @property
    def scale(self) -> float:
        """The parameter's own units per engine unit: the prior spread, or a hundred difference steps if that is
        infinite.
        """
        spread = self.parameter.spread
        scale = spread if 0.0 < spread < math.inf else 100.0 * self.parameter.step
        if not 0.0 < scale < math.inf:
            raise DiagnosisError(
                f"{self.label}: spread is {spread:g} {self.parameter.unit} and step is {self.parameter.step:g}; at "
                "least one of them must be positive and finite"
            )
        if self.parameter.logarithmic:
            scale /= self.parameter.nominal
        return scale

    @property
    def difference(self) -> float:
        """The step of a finite difference, in engine units."""
        parameter = self.parameter
        return (
            parameter.step / parameter.spread
            if parameter.step > 0.0 and parameter.spread < math.inf
            else 0.01
        )

    @property
    def weight(self) -> float:
        """1 if the prior counts as an observation, else 0."""
        return float(self.penalised and self.parameter.spread < math.inf)

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest value, in engine units."""
        return self.to_number(self.parameter.low), self.to_number(self.parameter.high)

    def to_number(self, value: float) -> float:
        """Convert a value in the parameter's own unit to engine units."""
        nominal = self.parameter.nominal
        if not self.parameter.logarithmic:
            return (value - nominal) / self.scale
        return math.log(value / nominal) / self.scale if value > 0.0 else -math.inf

    def to_value(self, number: float) -> float:
        """Convert a number in engine units to the parameter's own unit."""
        nominal = self.parameter.nominal
        if not self.parameter.logarithmic:
            return nominal + number * self.scale
        return nominal * math.exp(number * self.scale)


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """Free numbers (k,) in engine units, each with its coordinate."""

    coordinates: tuple[Coordinate, ...]
    numbers: Array

    @property
    def owners(self) -> tuple[str, ...]:
        """Effects and surfaces of the model, in the order of entry."""
        return tuple(dict.fromkeys(c.owner for c in self.coordinates if c.owner))

    def values(self) -> Array:
        """Return the values (k,) in their own units."""
        return np.array([c.to_value(u) for c, u in zip(self.coordinates, self.numbers, strict=True)])

    def parameters(self, record: str) -> dict[str, float]:
        """Return the value of each nuisance of one record, by name, in its own unit."""
        pairs = zip(self.coordinates, self.numbers, strict=True)
        return {c.parameter.name: c.to_value(u) for c, u in pairs if not c.owner and c.record in {"", record}}

    def effects(self) -> dict[str, dict[str, float]]:
        """Return the values of every effect and surface, by the name of the effect and of the parameter."""
        effects: dict[str, dict[str, float]] = {}
        for coordinate, number in zip(self.coordinates, self.numbers, strict=True):
            if coordinate.owner:
                effects.setdefault(coordinate.owner, {})[coordinate.parameter.name] = coordinate.to_value(
                    number
                )
        return effects

    def places_of(self, record: str) -> list[int]:
        """Return the indices of the free coordinates that the runs of one record depend on."""
        return [i for i, c in enumerate(self.coordinates) if c.record in {"", record} and not c.held]

    def place(self, coordinate: Coordinate) -> int:
        """Return the index of a coordinate."""
        return self.coordinates.index(coordinate)

    def place_of_amplitude(self, effect: str) -> int:
        """Return the index of an effect's amplitude, which is before its shapes."""
        return next(i for i, c in enumerate(self.coordinates) if c.owner == effect)

    def at(self, numbers: Array) -> Point:
        """Return the point with other numbers (k,) in engine units, limited to their ranges."""
        low, high = np.array([c.range for c in self.coordinates]).reshape(-1, 2).T
        return replace(self, numbers=np.clip(numbers, low, high))

    def extended(self, coordinates: Iterable[Coordinate], values: Iterable[float]) -> Point:
        """Return the point with further coordinates at the given values (in their own units)."""
        further = tuple(coordinates)
        numbers = [c.to_number(v) for c, v in zip(further, values, strict=True)]
        return Point((*self.coordinates, *further), np.concatenate((self.numbers, numbers)))

    def with_records(self, records: Iterable[str]) -> Point:
        """Return the point with the nuisances of further records, at their nominal values."""
        known = {c.record for c in self.coordinates}
        fresh = [
            Coordinate(parameter, record=record)
            for parameter in dict.fromkeys(c.parameter for c in self.coordinates if c.record)
            for record in dict.fromkeys(records)
            if record not in known
        ]
        return self.extended(fresh, [c.parameter.nominal for c in fresh])

    def replaced(self, old: str, effect: Hypothesis, source: Point) -> Point:
        """Return the point with ``effect`` in place of the effect ``old``. The new effect has the values of
        ``source``.
        """
        values = source.effects()[effect.name]
        coordinates = effect_coordinates(effect)
        return self.without(old).extended(coordinates, [values[c.parameter.name] for c in coordinates])

    def without(self, owner: str) -> Point:
        """Return the point without an effect or surface."""
        keep = [i for i, c in enumerate(self.coordinates) if c.owner != owner]
        return Point(tuple(self.coordinates[i] for i in keep), self.numbers[keep])


def base_point(nuisances: Iterable[Nuisance], records: Iterable[str]) -> Point:
    """Return the base model at its nominal values; a nuisance ``per_run`` has a coordinate in each record."""
    names = tuple(dict.fromkeys(records))
    coordinates = tuple(
        Coordinate(nuisance, record=record)
        for nuisance in nuisances
        for record in (names if nuisance.per_run else ("",))
    )
    return Point(coordinates, np.zeros(len(coordinates)))


def effect_coordinates(effect: Hypothesis) -> tuple[Coordinate, ...]:
    """Return the coordinates of amplitude and shapes of an effect. The amplitude has no prior, so that only the data
    determine it.
    """
    return (
        Coordinate(effect.amplitude, effect.name, penalised=False),
        *(Coordinate(shape, effect.name) for shape in effect.shapes),
    )


def surface_coordinates(surface: Surface) -> tuple[Coordinate, ...]:
    """Return the coordinates of the coefficients of a surface. Their priors limit their size (ridge regression)."""
    return tuple(Coordinate(coefficient, surface.name) for coefficient in surface.coefficients)


def neighbour(point: Point, place: int) -> tuple[Point, float]:
    """Return the point one difference step away along a coordinate, inside its range, and the signed distance."""
    coordinate, number = point.coordinates[place], float(point.numbers[place])
    low, high = coordinate.range
    distance = coordinate.difference
    if number + distance > high:
        distance = -distance if number - distance >= low else max(high - number, low - number, key=abs)
    numbers = point.numbers.copy()
    numbers[place] += distance
    return replace(point, numbers=numbers), distance


def opposite(point: Point, to: Point, distance: float) -> tuple[Point, float]:
    """Return the neighbour on the other side and its signed distance; the same neighbour ``to`` if the other one is out
    of range.
    """
    numbers = 2.0 * point.numbers - to.numbers
    low, high = np.array([c.range for c in point.coordinates]).reshape(-1, 2).T
    if ((numbers < low) | (numbers > high)).any():
        return to, distance
    return replace(point, numbers=numbers), -distance


def halved(point: Point, to: Point, distance: float) -> tuple[Point, float]:
    """Return the point half-way to the neighbour ``to``, and its signed distance."""
    return replace(point, numbers=0.5 * (point.numbers + to.numbers)), 0.5 * distance
