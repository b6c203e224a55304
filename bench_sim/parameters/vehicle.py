"""Parameters of a vehicle (`bench_sim.model.car.CAR`), read and refused like those of the plant."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from bench_sim.model.car import CAR, CAR_QUANTITIES
from bench_sim.parameters import (
    Entry,
    ParameterError,
    _check_range,
    _entry,
    _require,
    _shaped,
    _unknown,
)


@dataclass(frozen=True, eq=False)
class VehicleParameters:
    """A complete set; immutable, changed copies come from `with_values`. ``record`` is what compiled code reads."""

    name: str
    entries: Mapping[str, Entry]
    record: Any = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        array = np.zeros(1, CAR)
        for name in CAR.names or ():
            array[name][0] = self.entries[name].value
        travel = array["bump_stop_travel"][0]
        if np.any(np.diff(travel) <= 0.0):
            raise ParameterError(f"bump_stop_travel = {travel} m does not increase")
        object.__setattr__(self, "record", array.view(np.recarray)[0])

    def with_values(self, **changes: ArrayLike) -> "VehicleParameters":
        """Return a copy with some values changed (SI); raises `ParameterError` for what does not fit."""
        entries = dict(self.entries)
        for name, change in changes.items():
            if name not in entries:
                raise ParameterError(_unknown(name, tuple(entries)))
            old = entries[name]
            value = _shaped(name, change, old.value.shape)
            _check_range(name, value, old)
            entries[name] = Entry(value, old.low, old.high, old.unit, old.scale, old.provenance, old.source)
        return VehicleParameters(self.name, entries)


def load_vehicle(name: str | Path = "vehicle") -> VehicleParameters:
    """Read a vehicle: a name stands for a file beside this module, anything else is a path.

    Raises `ParameterError`, which names the file.
    """
    path = Path(name)
    if path.suffix != ".toml":
        path = Path(__file__).parent / f"{name}.toml"
    try:
        return _parse(path.stem, tomllib.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise ParameterError(f"no vehicle {str(name)!r}: {path} cannot be read") from error
    except (ParameterError, tomllib.TOMLDecodeError) as error:
        raise ParameterError(f"{path.name}: {error}") from error


def _parse(name: str, tables: dict[str, Any]) -> VehicleParameters:
    known = {quantity.name: quantity for quantity in CAR_QUANTITIES}
    entries: dict[str, Entry] = {}
    for section, table in tables.items():
        if not isinstance(table, dict):
            raise ParameterError(f"{section} stands outside a section: a parameter belongs in a [section]")
        for key, raw in table.items():
            if key not in known:
                raise ParameterError(_unknown(key, tuple(known)))
            if key in entries:
                raise ParameterError(f"{key} is given twice")
            entries[key] = _entry(key, raw, known[key])
    _require(known, entries, "parameter")
    return VehicleParameters(name, entries)
