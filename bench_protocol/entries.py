"""Entries of the files of rigs, specimens and models: a value with its unit, provenance and source."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, Final, NamedTuple

from bench_protocol.suggestion import did_you_mean
from bench_protocol.units import UNITS, Unit
from bench_protocol.words import PROVENANCES

_ORIGIN: Final = ("unit", "provenance", "source")
VALUE: Final = ("value",)


class EntryError(ValueError):
    """An entry is invalid. The message has its key, its value with the unit, and the remedy, but not the file."""


class Span(NamedTuple):
    """The SI unit of a quantity, and its plausible range."""

    si: str
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class FileEntry:
    """One entry as it is in the file; ``factor`` converts its numbers to SI."""

    key: str
    parts: Mapping[str, Any]
    unit: str
    factor: float
    provenance: str
    source: str

    def si(self, part: str = "value") -> float:
        """Return a part that must be a number, in SI."""
        return number(f"{self.key}.{part}", self.parts[part]) * self.factor


def read_entry(
    key: str,
    raw: Any,
    si: str | None,
    shapes: Collection[Sequence[str]] = (VALUE,),
    units: Mapping[str, Unit] = UNITS,
) -> FileEntry:
    """Return the entry ``raw``, whose unit must be one of ``si``.

    It must have the keys unit, provenance and source, and the keys of one of the ``shapes``.

    Without ``si`` any unit is accepted. Raises EntryError for any other entry.
    """
    parts = as_table(key, raw)
    _check_keys(key, parts, shapes)
    unit = units.get(str(parts["unit"]))
    if unit is None or unit.si != (si or unit.si):
        value = next(one for part, one in parts.items() if part not in _ORIGIN)
        if si is None:
            raise EntryError(
                f"{key} is in {parts['unit']!r}, which is not a known unit; "
                f"{did_you_mean(parts['unit'], units)}"
            )
        fitting = " or ".join(name for name, known in units.items() if known.si == si)
        raise EntryError(f"{key} = {value} {parts['unit']} has the wrong unit; use {fitting}")
    if parts["provenance"] not in PROVENANCES:
        raise EntryError(f"{key}.provenance = {parts['provenance']!r}; use one of {', '.join(PROVENANCES)}")
    if not str(parts["source"]).strip():
        raise EntryError(f"{key}.source is empty; state where the value comes from")
    return FileEntry(key, parts, str(parts["unit"]), unit.factor, parts["provenance"], str(parts["source"]))


def read_plausible(key: str, raw: Any, span: Span, shapes: Collection[Sequence[str]] = (VALUE,)) -> FileEntry:
    """Return the entry ``raw``, as `read_entry` does. Raises EntryError for a value outside its range, too."""
    entry = read_entry(key, raw, span.si, shapes)
    value, unit = entry.parts["value"], entry.unit
    if not span.low <= entry.si() <= span.high:
        fitting = [
            name
            for name, one in UNITS.items()
            if one.si == span.si and span.low <= value * one.factor <= span.high
        ]
        hint = f"; {value:g} {fitting[0]} is plausible: check the unit" if fitting else ""
        raise EntryError(
            f"{key} = {value:g} {unit} is not plausible; use {span.low:g} to {span.high:g} {span.si}{hint}"
        )
    return entry


def number(key: str, value: Any) -> float:
    """Return ``value`` if it is a finite number. Raises EntryError for any other value."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise EntryError(f"{key} = {value!r} is not a number; write a number without a unit")
    return float(value)


def _check_keys(key: str, parts: Mapping[str, Any], shapes: Collection[Sequence[str]]) -> None:
    """Raise EntryError if an entry does not have the keys of `_ORIGIN` and of exactly one of the ``shapes``."""
    own = set(parts) - {*_ORIGIN}
    if own in [set(shape) for shape in shapes] and set(_ORIGIN) <= set(parts):
        return
    if unknown := [part for part in parts if part in own and not any(part in shape for shape in shapes)]:
        why = f"{key}.{unknown[0]} is not a key of this entry"
    elif missing := [part for part in _ORIGIN if part not in parts]:
        why = f"{key} has no {' and no '.join(missing)}"
    elif own:
        why = f"{key}: {' and '.join(part for part in parts if part in own)} are not a complete value"
    else:
        why = f"{key} has no value"
    right = " or ".join(f"({', '.join(shape)})" if len(shape) > 1 else shape[0] for shape in shapes)
    raise EntryError(f"{why}; use {right}, with {', '.join(_ORIGIN)}")


def as_table(key: str, value: Any) -> Mapping[str, Any]:
    """Return ``value`` if it is a table. Raises EntryError for any other value."""
    if not isinstance(value, dict):
        raise EntryError(f"{key} = {value!r} is not a table; write its keys as [{key}] or in {{ }}")
    return value


def refuse_unknown(where: str, keys: Mapping[str, Any], known: Collection[str], what: str) -> None:
    """Raise EntryError for a key of the table ``where`` that is not ``known``; ``what`` is the kind of file."""
    for key in keys:
        if key not in known:
            raise EntryError(f"{where}{key} is not a key of {what}; {did_you_mean(key, known)}")
