"""Parameter sets of the paper's model and of its crosswind, read and checked like those of the plant."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from astb_studies.paper.closed_form.parameters import PaperParameters
from astb_studies.paper.wind import Crosswind
from bench_sim.model.quantities import Quantity
from bench_sim.parameters.loading import (
    LOAD,
    Entry,
    ParameterError,
    check_range,
    chosen_load,
    read_load_cases,
    read_sections,
    read_toml,
    unknown,
)


def _quantities(kind: type) -> dict[str, Quantity]:
    """The fields of a dataclass whose types are annotated with their units."""
    hints = get_type_hints(kind, include_extras=True)
    return {one.name: Quantity(one.name, hints[one.name].__metadata__[0]) for one in fields(kind)}


_SPRING: Final = _quantities(PaperParameters)
_WIND: Final = _quantities(Crosswind)


@dataclass(frozen=True, eq=False)
class PaperSet:
    """A complete set under one load case; immutable, changed copies come from `with_values` and `under`."""

    name: str
    entries: Mapping[str, Entry]
    load_cases: Mapping[str, Entry]
    load_case: str

    @property
    def spring(self) -> PaperParameters:
        """The spring, for `astb_studies.paper.closed_form`."""
        return PaperParameters(**{name: _plain(self.entries[name]) for name in _SPRING})

    @property
    def wind(self) -> Crosswind:
        """The train in the wind, for `astb_studies.paper.wind`."""
        return Crosswind(**{name: float(self.entries[name].value) for name in _WIND})

    def with_values(self, **changes: ArrayLike) -> "PaperSet":
        """Return a copy with some values changed (SI); a parameter of the spring may be an array of any shape.

        Raises `ParameterError` for an unknown name, an array in the wind, or a value outside its range.
        """
        entries = dict(self.entries)
        for name, change in changes.items():
            if name not in entries:
                raise ParameterError(unknown(name, tuple(entries)))
            old, value = entries[name], np.array(change, dtype=np.float64)
            if name in _WIND and value.ndim:
                raise ParameterError(f"{name} has shape {value.shape}; the wind needs a single number")
            low, high = (np.broadcast_to(bound.flat[0], value.shape) for bound in (old.low, old.high))
            entries[name] = replace(old, value=value, low=low, high=high)
            check_range(name, entries[name])
        return replace(self, entries=entries)

    def under(self, load_case: str) -> "PaperSet":
        """Return the same set under another load case, e.g. ``AW3``."""
        chosen_load(self.load_cases, load_case)
        entries = {**self.entries, LOAD: self.load_cases[load_case]}
        return replace(self, entries=entries, load_case=load_case)


def load_paper(name: str | Path = "paper", load_case: str | None = None) -> PaperSet:
    """Read a parameter set from a file next to this module, by its name, or from a path.

    Without ``load_case`` the first one of the file applies. Raises `ParameterError`, which names the file.
    """
    path, tables = read_toml(name, ("paper",), folder=Path(__file__).parent)
    try:
        return _parse(path.stem, tables, load_case)
    except ParameterError as error:
        raise ParameterError(f"{path.name}: {error}") from error


def _parse(name: str, tables: dict[str, Any], load_case: str | None) -> PaperSet:
    known = _SPRING | _WIND
    preload = known.pop(LOAD)
    cases = tables.pop("load_case", {})
    entries = read_sections(tables, known)
    loads = read_load_cases(cases, preload)
    chosen = chosen_load(loads, load_case)
    return PaperSet(name, entries | {LOAD: loads[chosen]}, loads, chosen)


def _plain(entry: Entry) -> Any:
    return float(entry.value) if entry.value.ndim == 0 else entry.value
