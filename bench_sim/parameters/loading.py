"""Common parts of parameter files: entries with unit, range, provenance and source. Invalid entries raise an error."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bench_protocol import entries, input_limits
from bench_protocol.os_errors import named_file_error, reason
from bench_protocol.suggestion import did_you_mean
from bench_protocol.units import WRITTEN_UNITS
from bench_protocol.written_values import NotAValue, read_written
from bench_sim.model.quantities import Quantity

LOAD: Final = "nominal_preload"
CROSSTALK: Final = "load_cell_crosstalk"
_PARTS: Final = ("value", "min", "max")


class ParameterError(ValueError):
    """An invalid parameter set or an invalid change. The message states the correct form."""


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """One parameter: ``value``, ``low`` and ``high`` in SI, and ``unit`` and ``scale`` of the file. Limits apply to
    each element.

    ``elements`` has a name and an SI unit for each element if these differ, as for the sensors.
    """

    value: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    unit: str
    scale: float
    provenance: str
    source: str
    elements: tuple[tuple[str, str], ...] = ()


def read_toml(
    name: str | Path,
    sets: tuple[str, ...],
    what: str = "parameter set",
    folder: Path = Path(__file__).parent,
) -> tuple[Path, dict[str, Any]]:
    """Return path and content of a TOML file. With ``sets``, a name that does not end in ``.toml`` means a file in
    ``folder``; ``sets`` and ``what`` are for the error message.

    Raises `ParameterError` if the file cannot be read.
    """
    path = Path(name)
    if sets and path.suffix != ".toml":
        path = folder / f"{name}.toml"
    try:
        return path, input_limits.read_toml(path)
    except OSError as error:
        text = named_file_error(error, name, sets) if sets else reason(error)
        raise ParameterError(f"no {what} {str(name)!r}: {text}") from error
    except input_limits.Unfit as error:
        raise ParameterError(f"{path.name} {error}") from error


def read_sections(tables: Mapping[str, Any], known: Mapping[str, Quantity]) -> dict[str, Entry]:
    """Return the entries of all sections by name. Each of the ``known`` may occur once, and missing ones get their
    default.

    Raises `ParameterError` for unknown, repeated or invalid entries, and for missing ones without a default.
    """
    entries: dict[str, Entry] = {}
    for section, table in tables.items():
        if not isinstance(table, dict):
            raise ParameterError(f"{section} is outside a section; move it into a [section]")
        for key, raw in table.items():
            if key not in known:
                raise ParameterError(unknown(key, tuple(known)))
            if key in entries:
                raise ParameterError(f"{key} occurs twice; keep one")
            entries[key] = read_entry(key, raw, known[key])
    for name, quantity in known.items():
        if name not in entries and quantity.default is not None:
            entries[name] = default_entry(quantity)
    require(known, entries, "parameter")
    return entries


def read_load_cases(cases: Mapping[str, Any], preload: Quantity) -> dict[str, Entry]:
    """Return the preload of every load case. Raises `ParameterError` if there is none."""
    if not cases:
        raise ParameterError(f"there is no load case; add [load_case.NAME] with {LOAD}")
    loads = {}
    for case, table in cases.items():
        if set(table) != {LOAD}:
            raise ParameterError(f"load case {case} has {', '.join(table) or 'nothing'}; it needs {LOAD}")
        loads[case] = read_entry(f"{case}.{LOAD}", table[LOAD], preload)
    return loads


def chosen_load(loads: Mapping[str, Entry], load_case: str | None) -> str:
    """Return ``load_case``, or the first load case of the file if it is None. Raises `ParameterError` for an unknown
    one.
    """
    chosen = next(iter(loads)) if load_case is None else load_case
    if chosen not in loads:
        raise ParameterError(unknown(chosen, tuple(loads), "load case"))
    return chosen


def read_entry(name: str, raw: Any, quantity: Quantity) -> Entry:
    """Return one parameter of a file as an entry in SI. Raises `ParameterError` for an invalid entry."""
    try:
        given = entries.read_entry(name, raw, quantity.unit, (_PARTS,), WRITTEN_UNITS)
        low, high = (np.full(quantity.shape, given.si(part)) for part in ("min", "max"))
    except entries.EntryError as error:
        raise ParameterError(str(error)) from None
    with np.errstate(over="ignore"):  # what is too large for SI becomes infinite, which no range contains
        value = shaped(quantity.name, raw["value"], quantity.shape, shown=name) * given.factor
    entry = Entry(value, low, high, given.unit, given.factor, given.provenance, given.source)
    check_range(name, entry)
    return entry


def default_entry(quantity: Quantity) -> Entry:
    """Return the entry of a parameter that is missing in the file: its default, with which its effect is off."""
    value, low, high = (
        np.full(quantity.shape, number) for number in (quantity.default, quantity.low, quantity.high)
    )
    return Entry(value, low, high, quantity.unit, 1.0, "assumed", "off")


def changed(name: str, entry: Entry, value: Any) -> Entry:
    """Return a copy of the entry with another value (SI). A single number applies to every element. Raises
    `ParameterError` for a wrong shape or a value out of range.
    """
    new = replace(entry, value=shaped(name, value, entry.value.shape))
    check_range(name, new)
    return new


def shaped(name: str, value: Any, shape: tuple[int, ...], *, shown: str = "") -> NDArray[np.float64]:
    """Return ``value`` as an array of ``shape``. A single number fills it; for crosstalk the diagonal stays 0."""
    shown = shown or name
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ParameterError(
            f"{shown} = {value!r} is not a number or an array of numbers; write one"
        ) from error
    if array.ndim != 0 and array.shape != shape:
        raise ParameterError(f"{shown} has shape {array.shape}; use one number, or an array of shape {shape}")
    if name == CROSSTALK and array.ndim == 0:
        return array * (1.0 - np.eye(shape[0]))
    return np.broadcast_to(array, shape).copy()


def check_range(name: str, entry: Entry) -> None:
    """Raise `ParameterError` if an element is outside its range, infinite or NaN."""
    fits = np.isfinite(entry.value) & (entry.value >= entry.low) & (entry.value <= entry.high)
    if fits.all():
        return
    place = tuple(int(i) for i in np.argwhere(~fits)[0])
    where, unit = f"[{', '.join(map(str, place))}]" if place else "", entry.unit
    if entry.elements:
        element, unit = entry.elements[place[0]]
        where = f"[{element}]"
    number, low, high = (float(a[place]) / entry.scale for a in (entry.value, entry.low, entry.high))
    raise ParameterError(f"{name}{where} = {number:g} {unit} is outside {low:g} to {high:g} {unit}")


def require(known: Mapping[str, Any], given: Mapping[str, Any], what: str) -> None:
    """Raise `ParameterError` if a name of ``known`` is missing in ``given``."""
    missing = [name for name in known if name not in given]
    if missing:
        raise ParameterError(f"{what} {', '.join(missing)} is missing; add it")


def unknown(name: str, known: tuple[str, ...], what: str = "parameter") -> str:
    """Return the error message for an unknown name, with a suggestion."""
    return f"{name} is not a {what}; {did_you_mean(name, known)}"


def read_value(what: str, text: Any, si: str) -> float:
    """Return the number in ``text``, such as ``0.2 mm2``, in the SI unit ``si``. The message of a `ParameterError`
    begins with ``what``.
    """
    try:
        return read_written(what, text, si)
    except NotAValue as error:
        raise ParameterError(str(error)) from None
