"""Parameter sets of the paper's model and of its crosswind, read and refused like those of the plant."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from bench_sim.model.paper.parameters import PaperParameters
from bench_sim.model.quantities import Quantity
from bench_sim.model.wind import Crosswind
from bench_sim.parameters import Entry, ParameterError, _check_range, _entry, _require, _unknown


def _quantities(kind: type) -> dict[str, Quantity]:
    """The fields of a dataclass whose types are annotated with their units."""
    hints = get_type_hints(kind, include_extras=True)
    return {one.name: Quantity(one.name, hints[one.name].__metadata__[0]) for one in fields(kind)}


_SPRING: Final = _quantities(PaperParameters)
_WIND: Final = _quantities(Crosswind)
_LOAD: Final = "nominal_preload"


@dataclass(frozen=True, eq=False)
class PaperSet:
    """A complete set under one load case; immutable, changed copies come from `with_values` and `under`."""

    name: str
    entries: Mapping[str, Entry]
    load_cases: Mapping[str, Entry]
    load_case: str

    @property
    def spring(self) -> PaperParameters:
        """The spring, for `bench_sim.model.paper`."""
        return PaperParameters(**{name: _plain(self.entries[name]) for name in _SPRING})

    @property
    def wind(self) -> Crosswind:
        """The train in the wind, for `bench_sim.model.wind`."""
        return Crosswind(**{name: float(self.entries[name].value) for name in _WIND})

    def with_values(self, **changes: ArrayLike) -> "PaperSet":
        """Return a copy with some values changed (SI); a parameter of the spring may be an array of any shape.

        Raises `ParameterError` for an unknown name, an array in the wind, or a value outside its range.
        """
        entries = dict(self.entries)
        for name, change in changes.items():
            if name not in entries:
                raise ParameterError(_unknown(name, tuple(entries)))
            old, value = entries[name], np.array(change, dtype=np.float64)
            if name in _WIND and value.ndim:
                raise ParameterError(f"{name} has shape {value.shape}; the wind takes one number")
            low, high = (np.broadcast_to(bound.flat[0], value.shape) for bound in (old.low, old.high))
            entries[name] = Entry(value, low, high, old.unit, old.scale, old.provenance, old.source)
            _check_range(name, value, entries[name])
        return PaperSet(self.name, entries, self.load_cases, self.load_case)

    def under(self, load_case: str) -> "PaperSet":
        """Return the same set under another load case, e.g. ``AW3``."""
        if load_case not in self.load_cases:
            raise ParameterError(_unknown(load_case, tuple(self.load_cases), "load case"))
        return PaperSet(
            self.name, {**self.entries, _LOAD: self.load_cases[load_case]}, self.load_cases, load_case
        )


def load_paper(name: str | Path = "paper", load_case: str | None = None) -> PaperSet:
    """Read a parameter set: a name stands for a file beside this module, anything else is a path.

    Without ``load_case`` the first one of the file applies. Raises `ParameterError`, which names the file.
    """
    path = Path(name)
    if path.suffix != ".toml":
        path = Path(__file__).parent / f"{name}.toml"
    try:
        return _parse(path.stem, tomllib.loads(path.read_text(encoding="utf-8")), load_case)
    except OSError as error:
        raise ParameterError(f"no parameter set {str(name)!r}: {path} cannot be read") from error
    except (ParameterError, tomllib.TOMLDecodeError) as error:
        raise ParameterError(f"{path.name}: {error}") from error


def _parse(name: str, tables: dict[str, Any], load_case: str | None) -> PaperSet:
    known = _SPRING | _WIND
    preload = known.pop(_LOAD)
    cases = tables.pop("load_case", {})
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
    if not cases:
        raise ParameterError(f"no load case: one [load_case.NAME] with {_LOAD} is needed")
    loads = {}
    for case, table in cases.items():
        if set(table) != {_LOAD}:
            raise ParameterError(f"load case {case} has {', '.join(table) or 'nothing'}; it needs {_LOAD}")
        loads[case] = _entry(f"{case}.{_LOAD}", table[_LOAD], preload)
    chosen = load_case if load_case is not None else next(iter(loads))
    if chosen not in loads:
        raise ParameterError(_unknown(chosen, tuple(loads), "load case"))
    return PaperSet(name, entries | {_LOAD: loads[chosen]}, loads, chosen)


def _plain(entry: Entry) -> Any:
    return float(entry.value) if entry.value.ndim == 0 else entry.value
