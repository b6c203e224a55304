"""The dimensions of a rig: masses, distances, heights, frames and lags, from a TOML file, with their uncertainty.

A dimension that is missing in the file is unknown. Quantities that need it cannot be measured on that rig.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from math import hypot
from pathlib import Path
from typing import Any, Final

from bench_protocol.entries import EntryError, Span, as_table, read_plausible, refuse_unknown
from bench_protocol.named_files import ORDINARY_RIG, label, read_named
from bench_protocol.signals import Group
from bench_protocol.suggestion import did_you_mean
from bench_protocol.table_signals import BY_GROUP, FURTHER
from bench_protocol.words import SIDES

#: Package of the named files of dimensions.
PACKAGE: Final = "dimensions"


#: Table ``dimension``: scalars of the rig, each with its plausible range for a railway bench. Heights above a point may
#: be negative. Gravity is that of the Earth.
SPANS: Final = {
    "bolster_mass": Span("kg", 10.0, 50e3),
    "gravity": Span("m/s2", 9.76, 9.84),
    "spring_half_spacing": Span("m", 0.2, 3.0),
    "centre_height": Span("m", -2.0, 3.0),
    "lateral_actuator_height": Span("m", -3.0, 3.0),
    "accelerometer_height": Span("m", -3.0, 3.0),
    "column_height": Span("m", 0.01, 1.5),
    "stop_gap": Span("m", 1e-3, 0.3),
    "vertical_frame_stiffness": Span("N/m", 1e5, 1e11),
    "vertical_frame_damping": Span("N*s/m", 1.0, 1e8),
    "lateral_frame_stiffness": Span("N/m", 1e5, 1e11),
    "lateral_frame_damping": Span("N*s/m", 1.0, 1e8),
    "actuator_frequency": Span("Hz", 0.5, 500.0),
    "actuator_damping": Span("1", 0.01, 10.0),
    "actuator_speed": Span("m/s", 1e-3, 10.0),
    "vertical_force_max": Span("N", 100.0, 1e7),
    "lateral_force_max": Span("N", 100.0, 1e7),
}
DIMENSIONS: Final = {name: one.si for name, one in SPANS.items()}
_ACROSS: Final = Span("m", -3.0, 3.0)
_PLACE: Final = Span("m", -5.0, 5.0)
_DIRECTION: Final = Span("1", -1e6, 1e6)
#: Long lags occur with thermometers.
_LAG: Final = Span("s", 0.0, 60.0)
#: Table ``across``: distance of a laser or an actuator to the left of the middle (m).
ACROSS: Final = (*(f"{side}.height" for side in SIDES), *(f"vertical_{side}" for side in SIDES))
#: Table ``load_cell``: the place of each cell, and the direction of the force on the bolster that reads positive.
LOAD_CELLS: Final = (
    *BY_GROUP[Group.VERTICAL_LOAD_CELL],
    *BY_GROUP[Group.LATERAL_LOAD_CELL],
    *(signal.name for signal in FURTHER),
)
#: Components of a place or direction: ahead, to the left and up. Places are relative to the middle of the platform top.
WAYS: Final = ("ahead", "across", "up")
#: Table ``lag``: first-order lag of the readings of a transducer (s).
LAGS: Final = (
    *(
        signal
        for group in (
            Group.HEIGHT,
            Group.TEMPERATURE,
            Group.VERTICAL_FORCE,
            Group.LATERAL_FORCE,
            Group.DISPLACEMENT,
            Group.ACCELERATION,
        )
        for signal in BY_GROUP[group]
    ),
    *LOAD_CELLS,
)
_SHAPES: Final = (("value",), ("value", "uncertainty"))


class DimensionsError(ValueError):
    """A file of dimensions lacks a needed value, or has an invalid one."""


@dataclass(frozen=True, slots=True)
class Dimension:
    """A value (SI) and its uncertainty: the half-width of a uniform distribution."""

    value: float
    uncertainty: float
    provenance: str
    source: str


@dataclass(frozen=True, slots=True)
class Dimensions:
    """The known dimensions of a rig by name: ``bolster_mass`` and others, and the names that `across`, `place`,
    `direction` and `lag` return.
    """

    file: str = ""
    sha256: str = ""
    known: Mapping[str, Dimension] = field(default_factory=dict)

    def built(self, values: Mapping[str, float]) -> Dimensions:
        """Return dimensions with other ``values`` (SI) of the rig and the uncertainties of the file."""
        known = dict(self.known)
        changed = {
            name: value
            for name, value in values.items()
            if name not in known or abs(known[name].value - value) > 1e-12 * abs(value)
        }
        for name, value in changed.items():
            before = known.get(name)
            known[name] = Dimension(
                value, before.uncertainty if before else 0.0, "assumed", "as the simulated rig is built"
            )
        return replace(self, known=known)

    @property
    def facts(self) -> dict[str, Any]:
        """The data for a record: the file, and each dimension with its uncertainty (SI) and source."""
        if not self.known:
            return {}
        return {
            "file": self.file,
            "sha256": self.sha256,
            "known": {
                name: {"value": one.value, "uncertainty": one.uncertainty, "provenance": one.provenance}
                for name, one in self.known.items()
            },
        }


def across(what: str) -> str:
    """Return the name of a dimension: the distance (m) of a transducer or actuator from the middle, positive to the
    left.
    """
    return f"{what} across"


@cache
def place(cell: str) -> tuple[str, str, str]:
    """Return the names of the three coordinates of a load cell (m): ahead, to the left and up."""
    ahead, left, up = (f"{cell} {way}" for way in WAYS)
    return ahead, left, up


@cache
def direction(cell: str) -> tuple[str, str, str]:
    """Return the names of the three components of the unit vector along which a load cell pushes the bolster when it
    reads positive.
    """
    ahead, left, up = (f"{cell} pushes {way}" for way in WAYS)
    return ahead, left, up


def lag(signal: str) -> str:
    """Return the name of the lag of the readings of a ``signal`` (s)."""
    return f"{signal} lag"


#: The table of the load cells, and the values of each: names and SI unit.
CELLS: Final = "load_cell"
_OF_A_CELL: Final = {"place": (place, _PLACE), "direction": (direction, _DIRECTION)}
#: All names that a file can have, with the SI unit.
NAMES: Final[Mapping[str, str]] = {
    **DIMENSIONS,
    **{across(one): "m" for one in ACROSS},
    **{name: "m" for cell in LOAD_CELLS for name in place(cell)},
    **{name: "1" for cell in LOAD_CELLS for name in direction(cell)},
    **{lag(signal): "s" for signal in LAGS},
}
#: Dimensions of a rig without a file.
UNKNOWN: Final = Dimensions()


@cache
def ordinary() -> Dimensions:
    """Return the dimensions of the virtual bench."""
    return read_dimensions(ORDINARY_RIG)


def read_dimensions(name: str | Path, home: Path = Path()) -> Dimensions:
    """Return the dimensions of a TOML file, relative to ``home``, or the supplied dimensions with this name.

    Raises DimensionsError, with file, key, value and unit, if the file cannot be read or has an invalid value.
    """
    path, sha256, content = read_named(PACKAGE, name, home, DimensionsError)
    wrong: list[str] = []
    known = _read_dimensions(content, wrong)
    if wrong:
        raise DimensionsError(f"dimensions {path}: {'; '.join(wrong)}")
    return Dimensions(label(path), sha256, known)


def _read_dimensions(content: Mapping[str, Any], wrong: list[str]) -> dict[str, Dimension]:
    """Return the dimensions of a file by name; ``wrong`` gets all errors, not only the first one."""
    tables = {
        "dimension": {name: (name, span) for name, span in SPANS.items()},
        "across": {one: (across(one), _ACROSS) for one in ACROSS},
        "lag": {signal: (lag(signal), _LAG) for signal in LAGS},
    }
    known: dict[str, Dimension] = {}
    with _gather(wrong):
        refuse_unknown("", content, (*tables, CELLS), "a dimensions file")
    _known_cells(content.get(CELLS, {}), known, wrong)
    for name, names in tables.items():
        with _gather(wrong):
            for key, raw in as_table(name, content.get(name, {})).items():
                where = f"{name}.{key}" if "." not in key else f'{name}."{key}"'
                with _gather(wrong):
                    if key not in names:
                        raise EntryError(f"{where} is not a dimension of a rig; {did_you_mean(key, names)}")
                    known[names[key][0]] = _dimension(where, raw, names[key][1])
    for side, what in zip(SIDES * 2, ACROSS, strict=True):
        if (one := known.get(across(what))) and (one.value > 0.0) is not (side == "left"):
            wrong.append(
                f"across.{what} = {one.value:g} m is not on the {side} side; write positive values for "
                "the left and negative values for the right"
            )
    return known


def _known_cells(cells: Any, known: dict[str, Dimension], wrong: list[str]) -> None:
    """Add positions and directions of the load cells of a file to the ``known`` dimensions."""
    with _gather(wrong):
        for key, raw in as_table(CELLS, cells).items():
            with _gather(wrong):
                cell = f"{CELLS}.{key}"
                if cell not in LOAD_CELLS:
                    raise EntryError(f"{cell} is not a load cell; {did_you_mean(cell, LOAD_CELLS)}")
                refuse_unknown(f"{cell}.", as_table(cell, raw), _OF_A_CELL, "a load cell")
                for what, entry in raw.items():
                    names, span = _OF_A_CELL[what]
                    known |= zip(names(cell), _three(f"{cell}.{what}", entry, span), strict=True)


@contextmanager
def _gather(wrong: list[str]) -> Iterator[None]:
    try:
        yield
    except EntryError as error:
        wrong.append(str(error))


def _three(where: str, raw: Any, span: Span) -> list[Dimension]:
    """Return the three dimensions of one entry; a direction becomes a unit vector."""
    values = as_table(where, raw).get("value")
    if not isinstance(values, list) or len(values) != len(WAYS):
        raise EntryError(f"{where}.value = {values!r} is not three numbers; write [ahead, left, up]")
    three = [_dimension(where, {**raw, "value": value}, span) for value in values]
    if span is not _DIRECTION:
        return three
    size = hypot(*(one.value for one in three))
    if not size:
        raise EntryError(f"{where} = {values} has no direction; write at least one number that is not 0")
    return [replace(one, value=one.value / size, uncertainty=one.uncertainty / size) for one in three]


def _dimension(where: str, raw: Any, span: Span) -> Dimension:
    entry = read_plausible(where, raw, span, _SHAPES)
    off = entry.si("uncertainty") if "uncertainty" in entry.parts else 0.0
    if not 0.0 <= off <= 0.5 * (span.high - span.low):
        raise EntryError(
            f"{where}.uncertainty = {entry.parts['uncertainty']:g} {entry.unit} is not plausible; use "
            f"0 to {0.5 * (span.high - span.low):g} {span.si}"
        )
    return Dimension(entry.si(), off, entry.provenance, entry.source)
