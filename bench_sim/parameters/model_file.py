"""A model file: the name of a parameter set, changes to it, its effects, and the source of each value.

For example (lists have the shape of the parameter, a property of the sensors is a table by sensor):

    based_on = "astb"                 # or the path of a file, from this one
    [change]
    discharge_coefficient = "0.63"
    bellows_volume = ["30.1 litre", "29.8 litre"]
    sensor_bias = { left_height = "0.02 mm" }
    [effect."leak.left"]              # see `bench_sim.model.effects`
    area = "0.2 mm2"
    [surface.force]                   # a term without a name: the parameters force_surface and force_surface_…
    coefficients = [["1.5 N", "0.2 N"]]
    displacement = ["-20 mm", "20 mm"]
    [finding]                         # provenance: kept, and never acted upon
    verdict = "named"

Reading a written file gives the same numbers to the last digit, unless they were rounded.
"""

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from bench_protocol.written_values import fitting_unit, write_value
from bench_sim.model.layout import Sensor
from bench_sim.model.quantities import QUANTITIES, SENSOR_QUANTITIES
from bench_sim.parameters.effects import Effects, Set, find_effect, read_effect, with_effects
from bench_sim.parameters.loading import ParameterError, read_toml, read_value, unknown
from bench_sim.parameters.sensors import sensor_units

#: Notes on the keys of a table, by its parameter, effect or surface.
Notes = Mapping[str, Mapping[str, str]]

_TABLES: Final = ("based_on", "change", "effect", "surface", "finding")
_UNITS: Final = {quantity.name: quantity.unit for quantity in QUANTITIES}
_BY_SENSOR: Final = {quantity.name: quantity for quantity in SENSOR_QUANTITIES}
_SURFACES: Final = sorted(name.removesuffix("_surface") for name in _UNITS if name.endswith("_surface"))


@dataclass(frozen=True, slots=True)
class Model:
    """The content of a model file, in SI.

    ``changes`` has a value for each changed parameter: a number, or a list of numbers in the parameter's shape. For a
    property of the sensors the value is a number for each sensor (``{"left_height": 2e-5}``). The coefficients and
    ranges of surfaces are also in ``changes``.
    """

    based_on: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    effects: Effects = field(default_factory=dict)
    finding: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "changes", {name: _plain(value) for name, value in self.changes.items()})


def is_model(tables: Mapping[str, Any]) -> bool:
    """Return whether a file with this content is a model file. Otherwise it is a complete parameter set."""
    return "based_on" in tables


def load_model(path: Path) -> Model:
    """Return the content of a model file. `bench_sim.parameters.load` returns the resulting parameters instead.

    Raises `ParameterError`, whose text names the file.
    """
    _, tables = read_toml(path, (), "model file")
    try:
        return read_model(tables)
    except ParameterError as error:
        raise ParameterError(f"{path.name}: {error}") from error


def load_effects(path: Path) -> Effects:
    """Return the effects (SI) of a file that contains only ``[effect.NAME]`` tables.

    Raises `ParameterError`, whose text names the file.
    """
    _, tables = read_toml(path, (), "file of effects")
    try:
        if set(tables) != {"effect"}:
            raise ParameterError(
                f"the file has {', '.join(tables) or 'nothing'}; use [effect.NAME] tables only"
            )
        return _effects(_table(tables, "effect"))
    except ParameterError as error:
        raise ParameterError(f"{path.name}: {error}") from error


def read_model(tables: Mapping[str, Any]) -> Model:
    """Return the model from the content of a TOML file. Raises `ParameterError` for an unknown key or an invalid
    value.
    """
    for key in tables:
        if key not in _TABLES:
            raise ParameterError(unknown(key, _TABLES, "part of a model file"))
    based_on = tables.get("based_on")
    if not isinstance(based_on, str):
        raise ParameterError(
            f'based_on = {based_on!r} is not the name or the path of a parameter set; write one, such as "astb"'
        )
    change, effect, surface, finding = (_table(tables, key) for key in _TABLES[1:])
    changes = read_changes(change)
    for name in surface:
        if name not in _SURFACES:
            raise ParameterError(unknown(name, tuple(_SURFACES), "surface"))
        inside = _table(surface, name)
        changes |= read_changes({_surface_quantity(name, key): value for key, value in inside.items()})
    return Model(based_on, changes, _effects(effect), finding)


def read_changes(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return changes of parameters in SI from texts with units. The form is that of `Model.changes`.

    Raises `ParameterError` for an unknown name, and for a text that is not a number with a suitable unit.
    """
    changes = {}
    for name, given in table.items():
        if name not in _UNITS:
            raise ParameterError(unknown(name, tuple(_UNITS)))
        changes[name] = _map_numbers(name, given, lambda text, what, unit: read_value(what, text, unit))
    return changes


def extended(base: Set, model: Model, name: str) -> Set:
    """Return ``base`` with the changes and effects of ``model``, under the new ``name``. Raises `ParameterError` for an
    invalid change or effect.
    """
    return with_effects(replace(with_changes(base, model.changes), name=name), model.effects)


def with_changes(base: Set, changes: Mapping[str, Any]) -> Set:
    """Return a copy of ``base`` with the changes of a model (`Model.changes`). Raises `ParameterError` for an invalid
    change.
    """
    return base.with_values(
        **{
            name: {Sensor[key.upper()]: number for key, number in value.items()}
            if isinstance(value, dict)
            else value
            for name, value in changes.items()
        }
    )


def write_model(path: Path, model: Model, notes: Notes | None = None, digits: int | None = None) -> None:
    """Write a model file. `load_model` reads exactly ``model`` from it, or its numbers rounded to ``digits``.

    ``notes`` become comments. Those of changed parameters are in the table ``change``; sensor properties, effects and
    surfaces have their own table. Raises OSError if the file cannot be written.
    """
    path.write_text("\n".join(_lines(model, notes or {}, digits)) + "\n", encoding="utf-8", newline="\n")


def _lines(model: Model, notes: Notes, digits: int | None) -> Iterator[str]:
    def written(changes: Mapping[str, Any]) -> dict[str, Any]:
        return {name: _written(name, value, digits) for name, value in changes.items()}

    yield f"based_on = {_toml(model.based_on)}"
    plain = {name: value for name, value in model.changes.items() if not _surface_of(name)}
    sensors = {name: value for name, value in plain.items() if isinstance(value, dict)}
    yield from _section(
        "change", written({k: v for k, v in plain.items() if k not in sensors}), notes.get("change", {})
    )
    for name, table in written(sensors).items():
        yield from _section(f"change.{name}", table, notes.get(name, {}))
    for name, values in model.effects.items():
        parameters = find_effect(name)[0].parameters
        texts = {
            one.name: write_value(values[one.name], one.unit, one.display, digits)
            for one in parameters
            if one.name in values
        }
        yield from _section(f"effect.{_toml(name)}", texts, notes.get(name, {}))
    for surface in _SURFACES:
        inside = {
            name.removeprefix(f"{surface}_surface").removeprefix("_") or "coefficients": value
            for name, value in written(model.changes).items()
            if _surface_of(name) == surface
        }
        yield from _section(f"surface.{surface}", inside, notes.get(f"{surface}_surface", {}))
    yield from _section("finding", model.finding, {})


def _section(title: str, table: Mapping[str, Any], notes: Mapping[str, str]) -> Iterator[str]:
    if table:
        yield f"\n[{title}]"
        for key, value in table.items():
            if key in notes:
                yield f"# {' '.join(notes[key].split())}"
            yield f"{_key(key)} = {_rows(value)}"


def _rows(value: Any) -> str:
    """Return ``value`` as TOML, with each row of a matrix on a line."""
    if isinstance(value, list) and value and isinstance(value[0], list):
        return "[\n" + "".join(f"    {_toml(row)},\n" for row in value) + "]"
    return _toml(value)


def _written(name: str, value: Any, digits: int | None) -> Any:
    """Return the numbers of a changed value as texts with units. All elements have the same unit, but sensors each have
    their own.
    """
    largest = 0.0 if name in _BY_SENSOR else float(np.abs(value).max())

    def written(number: float, _: str, unit: str) -> str:
        return write_value(number, unit, fitting_unit(largest or number, unit), digits)

    return _map_numbers(name, value, written)


def _map_numbers(name: str, value: Any, change: Callable[[Any, str, str], Any]) -> Any:
    """Return ``value``, the changed value of parameter ``name``, with every number replaced by ``change(number, name
    for messages, SI unit)``.
    """
    if name not in _BY_SENSOR:
        return _nested(value, lambda element: change(element, name, _UNITS[name]))
    units = sensor_units(_BY_SENSOR[name])
    if not isinstance(value, dict):
        raise ParameterError(f'{name} = {value!r} is not a table by sensor, such as {{ left_height = "…" }}')
    for key in value:
        if key not in units:
            raise ParameterError(unknown(key, tuple(units), "sensor"))
    return {key: change(element, f"{name}.{key}", units[key]) for key, element in value.items()}


def _nested(value: Any, change: Callable[[Any], Any]) -> Any:
    return [_nested(one, change) for one in value] if isinstance(value, list) else change(value)


def _effects(table: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    return {name: read_effect(name, _table(table, name)) for name in table}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: float(number) for key, number in value.items()}
    return np.asarray(value, dtype=np.float64).tolist()


def _table(tables: Mapping[str, Any], key: str) -> dict[str, Any]:
    table = tables.get(key, {})
    if not isinstance(table, dict):
        raise ParameterError(f"{key} = {table!r} is not a table; write its keys as [{key}]")
    return table


def _surface_of(name: str) -> str:
    kind, found, _ = name.partition("_surface")
    return kind if found else ""


def _surface_quantity(surface: str, key: str) -> str:
    return f"{surface}_surface" + ("" if key == "coefficients" else f"_{key}")


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _toml(key)


def _toml(value: Any) -> str:
    """Return ``value`` as TOML text. Tables are written on one line."""
    match value:
        case str():
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case bool():
            return str(value).lower()
        case int() | float() if math.isfinite(value):
            return repr(value)
        case Mapping():
            return f"{{ {', '.join(f'{_key(key)} = {_toml(one)}' for key, one in value.items())} }}"
        case list() | tuple():
            return f"[{', '.join(map(_toml, value))}]"
    raise TypeError(
        f"a model file cannot hold {value!r}; use text, finite numbers, truth values, lists and tables"
    )
