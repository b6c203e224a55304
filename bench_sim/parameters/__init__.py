"""Parameter sets of the plant: values with unit, range, provenance and source, refused when they do not fit."""

import hashlib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bench_sim.model.layout import Sensor
from bench_sim.model.quantities import PARAMETERS, PLANT_QUANTITIES, SENSOR_QUANTITIES, Quantity
from bench_sim.parameters.units import UNITS

#: Where a value may come from.
PROVENANCES: Final = ("measured", "data sheet", "assumed")

_PARTS: Final = {"value", "unit", "source", "provenance", "min", "max"}

#: kind of sensor in a parameter file -> (SI unit of its signal, the sensors of that kind)
SENSOR_KINDS: Final[Mapping[str, tuple[str, tuple[Sensor, ...]]]] = MappingProxyType(
    {
        "height": ("m", (Sensor.LEFT_HEIGHT, Sensor.RIGHT_HEIGHT)),
        "pressure": (
            "Pa",
            (
                Sensor.LEFT_BELLOWS_PRESSURE,
                Sensor.RIGHT_BELLOWS_PRESSURE,
                Sensor.LEFT_AUXILIARY_PRESSURE,
                Sensor.RIGHT_AUXILIARY_PRESSURE,
            ),
        ),
        "supply_pressure": ("Pa", (Sensor.SUPPLY_PRESSURE,)),
        "temperature": (
            "K",
            (
                Sensor.LEFT_BELLOWS_TEMPERATURE,
                Sensor.RIGHT_BELLOWS_TEMPERATURE,
                Sensor.LEFT_AUXILIARY_TEMPERATURE,
                Sensor.RIGHT_AUXILIARY_TEMPERATURE,
            ),
        ),
        "vertical_force": ("N", (Sensor.VERTICAL_LEFT_FORCE, Sensor.VERTICAL_RIGHT_FORCE)),
        "lateral_force": ("N", (Sensor.LATERAL_FORCE,)),
        "displacement": (
            "m",
            (
                Sensor.VERTICAL_LEFT_DISPLACEMENT,
                Sensor.VERTICAL_RIGHT_DISPLACEMENT,
                Sensor.LATERAL_DISPLACEMENT,
            ),
        ),
        "vertical_load_cell": (
            "N",
            (Sensor.LOAD_CELL_1, Sensor.LOAD_CELL_2, Sensor.LOAD_CELL_3, Sensor.LOAD_CELL_4),
        ),
        "lateral_load_cell": ("N", (Sensor.LOAD_CELL_5, Sensor.LOAD_CELL_6)),
        "acceleration": ("m/s2", (Sensor.LATERAL_ACCELERATION,)),
        "platform_displacement": ("m", (Sensor.PLATFORM_VERTICAL, Sensor.PLATFORM_LATERAL)),
        "platform_roll": ("rad", (Sensor.PLATFORM_ROLL,)),
    }
)

_RATES: Final = {"m": "m/s", "Pa": "Pa/s", "K": "K/s", "N": "N/s", "m/s2": "m/s3", "rad": "rad/s"}


#: Stands for the unit of an entry whose elements have different ones, each the SI unit of its sensor.
_PER_SENSOR: Final = "per sensor"


class ParameterError(ValueError):
    """A parameter set, or a change to one, that does not fit; the message says what would."""


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """One parameter in SI; ``low`` and ``high`` bound every element, ``unit`` and ``scale`` are as in the file."""

    value: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    unit: str
    scale: float
    provenance: str
    source: str


@dataclass(frozen=True, eq=False)
class Parameters:
    """A complete parameter set under one load case; immutable, changed copies come from `with_values`."""

    name: str
    entries: Mapping[str, Entry]
    load_cases: Mapping[str, Entry]
    load_case: str
    record: Any = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        array = np.zeros(1, PARAMETERS)
        for name in PARAMETERS.names or ():
            array[name][0] = self.entries[name].value
        _check_order(self.entries)
        object.__setattr__(self, "record", array.view(np.recarray)[0])

    def with_values(self, **changes: ArrayLike | Mapping[Sensor, float]) -> "Parameters":
        """Return a copy with some values changed (SI).

        One number serves every element of an array; a sensor property also takes ``{Sensor.X: value}``. Raises
        `ParameterError` for an unknown name, a wrong shape or a value outside its range.
        """
        entries = dict(self.entries)
        for name, change in changes.items():
            if name not in entries:
                raise ParameterError(_unknown(name, tuple(entries)))
            old = entries[name]
            value = old.value.copy()
            if isinstance(change, Mapping):
                for sensor, number in change.items():
                    value[int(sensor)] = number
            elif name == "load_cell_crosstalk" and np.ndim(change) == 0:
                value = _off_diagonal(float(np.asarray(change)))
            else:
                value = _shaped(name, change, value.shape)
            _check_range(name, value, old)
            entries[name] = Entry(value, old.low, old.high, old.unit, old.scale, old.provenance, old.source)
        return Parameters(self.name, entries, self.load_cases, self.load_case)

    def under(self, load_case: str) -> "Parameters":
        """Return the same set under another load case, e.g. ``AW3``."""
        if load_case not in self.load_cases:
            raise ParameterError(_unknown(load_case, tuple(self.load_cases), "load case"))
        entries = {**self.entries, "nominal_preload": self.load_cases[load_case]}
        return Parameters(self.name, entries, self.load_cases, load_case)

    def as_built(self, seed: int) -> "Parameters":
        """Return the set of one rig as built: each sensor's bias drawn evenly within its accuracy, from ``seed``."""
        accuracy = self.entries["sensor_accuracy"].value
        draw = np.random.default_rng(seed).uniform(-1.0, 1.0, accuracy.shape)
        return self.with_values(sensor_bias=accuracy * draw)

    def digest(self) -> str:
        """SHA-256 over every value of the record, for the head of a measurement record."""
        return hashlib.sha256(np.asarray(self.record).tobytes()).hexdigest()


def load(name: str | Path = "astb", load_case: str | None = None) -> Parameters:
    """Read a parameter set: a name stands for a file beside this module, anything else is a path.

    Without ``load_case`` the first one of the file applies. Raises `ParameterError`, which names the file.
    """
    path = Path(name)
    if path.suffix != ".toml":
        path = Path(__file__).parent / f"{name}.toml"
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        known = ", ".join(sorted(file.stem for file in Path(__file__).parent.glob("*.toml")))
        raise ParameterError(
            f"no parameter set {str(name)!r}: {path} cannot be read; there is {known}"
        ) from error
    try:
        return _parse(path.stem, tomllib.loads(text), load_case)
    except (ParameterError, tomllib.TOMLDecodeError) as error:
        raise ParameterError(f"{path.name}: {error}") from error


def _parse(name: str, tables: dict[str, Any], load_case: str | None) -> Parameters:
    sensors = tables.pop("sensor", {})
    cases = tables.pop("load_case", {})
    known = {quantity.name: quantity for quantity in PLANT_QUANTITIES}
    preload = known.pop("nominal_preload")
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
    entries |= _sensor_entries(sensors)
    if not cases:
        raise ParameterError("no load case: one [load_case.NAME] with nominal_preload is needed")
    loads = {}
    for case, table in cases.items():
        if set(table) != {"nominal_preload"}:
            raise ParameterError(
                f"load case {case} has {', '.join(table) or 'nothing'}; it needs nominal_preload"
            )
        loads[case] = _entry(f"{case}.nominal_preload", table["nominal_preload"], preload)
    chosen = load_case if load_case is not None else next(iter(loads))
    if chosen not in loads:
        raise ParameterError(_unknown(chosen, tuple(loads), "load case"))
    entries["nominal_preload"] = loads[chosen]
    return Parameters(name, entries, loads, chosen)


def _sensor_entries(tables: dict[str, Any]) -> dict[str, Entry]:
    """Gather the kinds of sensor into one entry per property, each with an element per sensor."""
    for kind in tables:
        if kind not in SENSOR_KINDS:
            raise ParameterError(_unknown(kind, tuple(SENSOR_KINDS), "kind of sensor"))
    _require(SENSOR_KINDS, tables, "kind of sensor")
    entries = {}
    for quantity in SENSOR_QUANTITIES:
        key = quantity.name.removeprefix("sensor_")
        value, low, high = (np.zeros(quantity.shape) for _ in range(3))
        for kind, (signal, members) in SENSOR_KINDS.items():
            if key not in tables[kind]:
                raise ParameterError(f"sensor {kind} lacks {key}")
            unit = _sensor_unit(quantity.name, signal)
            one = _entry(f"sensor.{kind}.{key}", tables[kind][key], Quantity(key, unit))
            places = list(members)
            value[places], low[places], high[places] = one.value, one.low, one.high
        entries[quantity.name] = Entry(
            value, low, high, _PER_SENSOR, 1.0, "assumed", "one entry per kind of sensor"
        )
    properties = {quantity.name.removeprefix("sensor_") for quantity in SENSOR_QUANTITIES}
    for kind, table in tables.items():
        for key in table:
            if key not in properties:
                raise ParameterError(_unknown(f"sensor.{kind}.{key}", tuple(sorted(properties))))
    return entries


def _sensor_unit(name: str, signal: str) -> str:
    """SI unit of a sensor's property, for a sensor whose signal has the SI unit ``signal``."""
    unit = next(quantity.unit for quantity in SENSOR_QUANTITIES if quantity.name == name)
    return {"signal": signal, "signal/s": _RATES[signal]}.get(unit, unit)


def _entry(name: str, raw: Any, quantity: Quantity) -> Entry:
    if not isinstance(raw, dict) or set(raw) != _PARTS:
        given = ", ".join(sorted(raw)) if isinstance(raw, dict) else repr(raw)
        raise ParameterError(f"{name} needs {', '.join(sorted(_PARTS))}; it has {given}")
    unit, factor = UNITS.get(raw["unit"], ("", 0.0))
    if unit != quantity.unit:
        fitting = ", ".join(known for known, (si, _) in UNITS.items() if si == quantity.unit)
        raise ParameterError(f"{name} = {raw['value']} {raw['unit']} has the wrong unit; {fitting} would fit")
    if raw["provenance"] not in PROVENANCES:
        raise ParameterError(
            f"{name} has provenance {raw['provenance']!r}; it is one of {', '.join(PROVENANCES)}"
        )
    if not str(raw["source"]).strip():
        raise ParameterError(f"{name} has no source")
    if quantity.name == "load_cell_crosstalk" and np.ndim(raw["value"]) == 0:
        value = _off_diagonal(float(raw["value"]))
    else:
        value = _shaped(name, raw["value"], quantity.shape) * factor
    low, high = (np.full(quantity.shape, float(raw[key])) * factor for key in ("min", "max"))
    entry = Entry(value, low, high, raw["unit"], factor, raw["provenance"], raw["source"])
    _check_range(name, value, entry)
    return entry


def _shaped(name: str, value: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ParameterError(f"{name} = {value!r} is not a number or an array of numbers") from error
    if array.ndim != 0 and array.shape != shape:
        raise ParameterError(f"{name} has shape {array.shape}; it is one number or has shape {shape}")
    return np.broadcast_to(array, shape).copy()


def _off_diagonal(value: float) -> NDArray[np.float64]:
    return value * (1.0 - np.eye(6))


def _check_range(name: str, value: NDArray[np.float64], entry: Entry) -> None:
    fits = (value >= entry.low) & (value <= entry.high)  # NaN does not fit
    if fits.all():
        return
    place = tuple(int(i) for i in np.argwhere(~fits)[0])
    where, unit = f"[{', '.join(map(str, place))}]" if place else "", entry.unit
    if unit == _PER_SENSOR:
        sensor = Sensor(place[0])
        where = f"[{sensor.name.lower()}]"
        unit = _sensor_unit(
            name, next(signal for signal, members in SENSOR_KINDS.values() if sensor in members)
        )
    number, low, high = (float(a[place]) / entry.scale for a in (value, entry.low, entry.high))
    raise ParameterError(f"{name}{where} = {number:g} {unit} is outside {low:g} to {high:g} {unit}")


def _check_order(entries: Mapping[str, Entry]) -> None:
    """Pairs that only make sense in one order."""
    for low, high in (
        ("dpv_reclosing", "dpv_opening"),
        ("leveling_hysteresis", "leveling_deadband"),
        ("sawtooth_low", "sawtooth_high"),
        ("sensor_low", "sensor_high"),
    ):
        if np.any(entries[low].value > entries[high].value):
            raise ParameterError(f"{low} = {entries[low].value} exceeds {high} = {entries[high].value} (SI)")
    for length, diameter in zip(
        entries["pipe_length"].value, entries["pipe_diameter"].value, strict=True
    ):  # a shorter one has so little inertia that no step follows its surge
        if 0.0 < length < diameter:
            raise ParameterError(
                f"pipe_length = {length:g} m is less than pipe_diameter = {diameter:g} m; 0 m means no pipe"
            )
    if np.any(np.diff(entries["bump_stop_travel"].value) <= 0.0):
        raise ParameterError(f"bump_stop_travel = {entries['bump_stop_travel'].value} m does not increase")


def _require(known: Mapping[str, Any], given: Mapping[str, Any], what: str) -> None:
    missing = [name for name in known if name not in given]
    if missing:
        raise ParameterError(f"{what} {', '.join(missing)} is missing")


def _unknown(name: str, known: tuple[str, ...], what: str = "parameter") -> str:
    from difflib import get_close_matches

    near = get_close_matches(name, known, n=1, cutoff=0.5)
    hint = f"; {near[0]} would be one" if near else f"; there is {', '.join(known[:8])}"
    return f"{name} is no {what}{hint}"
