"""Parameter sets of the plant: values with unit, range, provenance and source. Invalid values raise an error."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from bench_protocol.words import PROVENANCES
from bench_sim.model.layout import Sensor
from bench_sim.model.quantities import PARAMETERS, PLANT_QUANTITIES
from bench_sim.parameters.effects import Effects, apply_effects
from bench_sim.parameters.loading import (
    LOAD,
    Entry,
    ParameterError,
    changed,
    chosen_load,
    read_load_cases,
    read_sections,
    read_toml,
    unknown,
)
from bench_sim.parameters.model_file import extended, is_model, read_model
from bench_sim.parameters.sensors import SENSOR_KINDS, read_sensors

__all__ = ["PROVENANCES", "SENSOR_KINDS", "Entry", "ParameterError", "Parameters", "load"]

#: The sets that are next to this module.
SETS: Final = ("astb", "kuzyshyn_2024")


@dataclass(frozen=True, eq=False)
class Parameters:
    """A complete, immutable parameter set under one load case. `with_values` returns changed copies.

    ``entries`` describe the bench without its ``effects``. ``record`` contains the values with the effects.
    """

    name: str
    entries: Mapping[str, Entry]
    load_cases: Mapping[str, Entry]
    load_case: str
    effects: Effects = field(default_factory=dict)
    record: Any = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        array = np.zeros(1, PARAMETERS)
        for name in PARAMETERS.names or ():
            array[name][0] = self.entries[name].value
        records = array.view(np.recarray)
        apply_effects(records[0], self.entries, self.effects)
        _check_order(records[0])
        records.flags.writeable = False  # several may hold this very set
        object.__setattr__(self, "record", records[0])

    def with_values(self, **changes: ArrayLike | Mapping[Sensor, float]) -> "Parameters":
        """Return a copy with some values changed (SI).

        One number applies to every element of an array. A sensor property also accepts ``{Sensor.X: value}``. Raises
        `ParameterError` for an unknown name, a wrong shape or a value outside its range.
        """
        entries = dict(self.entries)
        for name, change in changes.items():
            if name not in entries:
                raise ParameterError(unknown(name, tuple(entries)))
            value: Any = change
            if isinstance(change, Mapping):
                value = entries[name].value.copy()
                for sensor, number in change.items():
                    value[int(sensor)] = number
            entries[name] = changed(name, entries[name], value)
        return replace(self, entries=entries)

    def under(self, load_case: str) -> "Parameters":
        """Return this set under another load case, such as ``AW3``."""
        chosen_load(self.load_cases, load_case)
        entries = {**self.entries, LOAD: self.load_cases[load_case]}
        return replace(self, entries=entries, load_case=load_case)

    def as_built(self, seed: int) -> "Parameters":
        """Return the parameters of one manufactured rig: the bias of each sensor is random, uniform within its
        accuracy. ``seed`` selects the random numbers.

        A bias other than 0 in the set does not change.
        """
        accuracy, bias = (self.entries[f"sensor_{name}"].value for name in ("accuracy", "bias"))
        draw = accuracy * np.random.default_rng(seed).uniform(-1.0, 1.0, accuracy.shape)
        return self.with_values(sensor_bias=np.where(bias == 0.0, draw, bias))

    def digest(self) -> str:
        """Return the SHA-256 of all parameter values, in hexadecimal. Records of runs contain it."""
        return hashlib.sha256(np.asarray(self.record).tobytes()).hexdigest()


def load(name: str | Path = "astb", load_case: str | None = None) -> Parameters:
    """Return a parameter set, by name (sets of this package) or by the path of a parameter set or model file.

    Without ``load_case`` the first one of the file applies. Raises `ParameterError`, whose text names the file.
    """
    return _load(name, load_case, ())


def _load(name: str | Path, load_case: str | None, above: tuple[Path, ...]) -> Parameters:
    own = name == SETS[0]
    path, tables = (Path(f"{name}.toml"), {}) if own else read_toml(name, SETS)
    try:
        if own:
            return _built_in_set(str(name), load_case)
        if not is_model(tables):
            return _parse(path.stem, tables, load_case)
        if path.resolve() in above:
            raise ParameterError("the model is based on itself; change based_on")
        model = read_model(tables)
        named = model.based_on if Path(model.based_on).suffix != ".toml" else path.parent / model.based_on
        return extended(_load(named, load_case, (*above, path.resolve())), model, path.stem)
    except ParameterError as error:
        raise ParameterError(f"{path.name}: {error}") from error


@cache
def _built_in_set(name: str, load_case: str | None) -> Parameters:
    """Return a set of this package. Its file is read once per process."""
    read = _parse(name, read_toml(name, SETS)[1], load_case)
    for entry in (*read.entries.values(), *read.load_cases.values()):
        if entry.value.ndim:
            entry.value.flags.writeable = False
    return read


def _parse(name: str, tables: dict[str, Any], load_case: str | None) -> Parameters:
    sensors = tables.pop("sensor", {})
    cases = tables.pop("load_case", {})
    known = {quantity.name: quantity for quantity in PLANT_QUANTITIES}
    preload = known.pop(LOAD)
    entries = read_sections(tables, known) | read_sensors(sensors)
    loads = read_load_cases(cases, preload)
    chosen = chosen_load(loads, load_case)
    return Parameters(name, entries | {LOAD: loads[chosen]}, loads, chosen)


def _check_order(record: Any) -> None:
    """Raise ParameterError for values that contradict each other, such as a lower limit above its upper limit."""
    for low, high in (
        ("dpv_reclosing", "dpv_opening"),
        ("leveling_hysteresis", "leveling_deadband"),
        ("sawtooth_low", "sawtooth_high"),
        ("sensor_low", "sensor_high"),
    ):
        if np.any(record[low] > record[high]):
            raise ParameterError(
                f"{low} = {record[low]} exceeds {high} = {record[high]} (SI); decrease {low}"
            )
    for length, diameter in zip(record.pipe_length, record.pipe_diameter, strict=True):
        # a shorter one has so little inertia that no step follows its surge
        if 0.0 < length < diameter:
            raise ParameterError(
                f"pipe_length = {length:g} m is less than pipe_diameter = {diameter:g} m; use a longer "
                "pipe, or 0 m for none"
            )
    if np.any(np.diff(record.bump_stop_travel) <= 0.0):
        raise ParameterError(
            f"bump_stop_travel = {record.bump_stop_travel} m does not increase; write rising values"
        )
