"""Parameters of a vehicle (`bench_sim.model.car.CAR`), read and checked like those of the plant."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from bench_sim.model.car import CAR, CAR_QUANTITIES
from bench_sim.parameters.loading import Entry, ParameterError, changed, read_sections, read_toml, unknown

_KNOWN: Final = {quantity.name: quantity for quantity in CAR_QUANTITIES}


@dataclass(frozen=True, eq=False)
class VehicleParameters:
    """A complete, immutable parameter set of a vehicle. `with_values` returns changed copies. Compiled code reads
    ``record``.
    """

    name: str
    entries: Mapping[str, Entry]
    record: Any = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        array = np.zeros(1, CAR)
        for name in CAR.names or ():
            array[name][0] = self.entries[name].value
        travel = array["bump_stop_travel"][0]
        if np.any(np.diff(travel) <= 0.0):
            raise ParameterError(f"bump_stop_travel = {travel} m does not increase; write rising values")
        object.__setattr__(self, "record", array.view(np.recarray)[0])

    def with_values(self, **changes: ArrayLike) -> "VehicleParameters":
        """Return a copy with some values changed (SI). Raises `ParameterError` for an invalid change."""
        entries = dict(self.entries)
        for name, change in changes.items():
            if name not in entries:
                raise ParameterError(unknown(name, tuple(entries)))
            entries[name] = changed(name, entries[name], change)
        return replace(self, entries=entries)


def load_vehicle(name: str | Path = "vehicle") -> VehicleParameters:
    """Return the parameters of a vehicle, by the name of a file of this package, or by a path.

    Raises `ParameterError`, whose text names the file.
    """
    path, tables = read_toml(name, ("vehicle",), "vehicle")
    try:
        return VehicleParameters(path.stem, read_sections(tables, _KNOWN))
    except ParameterError as error:
        raise ParameterError(f"{path.name}: {error}") from error
