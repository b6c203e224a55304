"""The specimen on the bench: type, serial number, drawing and limits, read from a TOML file.

Every value has a unit, a source and a provenance (measured, data sheet or assumed). Unknown keys are an error when the
file is read. Missing limits are an error when a plan needs them.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cache
from math import sqrt
from pathlib import Path
from typing import Any, Final

from bench_protocol.dimensions import SPANS
from bench_protocol.entries import (
    EntryError,
    FileEntry,
    Span,
    as_table,
    number,
    read_entry,
    read_plausible,
    refuse_unknown,
)
from bench_protocol.input_limits import Unfit, parse_toml, read_bounded
from bench_protocol.named_files import named_files, place_of
from bench_protocol.os_errors import named_file_error
from bench_protocol.units import UNITS, bar, kN, mm, mrad
from test_plans.check_names import CheckName
from test_plans.loads import Band, Limits, Load, SpecimenError, within

#: The kind of its named files.
PACKAGE: Final = "specimens"
#: Name of the default specimen.
ORDINARY: Final = "astb"

#: Properties in a drawing, each with its SI unit and its plausible range.
DRAWING: Final = {
    "bellows_volume": Span("m3", 1e-5, 10.0),
    "auxiliary_volume": Span("m3", 0.0, 10.0),
    "effective_area": Span("m2", 1e-4, 10.0),
    "effective_area_slope": Span("m", -100.0, 100.0),
    "emergency_stiffness_vertical": Span("N/m", 1e3, 1e11),
    "emergency_stiffness_lateral": Span("N/m", 1e3, 1e11),
}
#: Optional properties in a drawing.
GROWTH: Final = {
    "effective_area_growth": Span("m2/Pa", 0.0, 1e-6),
    "area_reference_pressure": Span("Pa", 0.0, 1e6),
}
#: Largest difference between preload and pressure times area, as a fraction of the preload; shell and rubber carry it.
BORNE_OTHERWISE: Final = 0.05
#: Properties of the bench for which the limits of roll, track and gust hold, each with its SI unit and range.
BENCH: Final = {name: SPANS[name] for name in ("spring_half_spacing", "bolster_mass")}
LOAD: Final = {
    "preload": Span("N", 1.0, 1e7),
    "fill_pressure": Span("Pa", 1.0, 1e8),
    "roll_load": Span("N", 0.0, 1e7),
}
#: Quantities with limits that hold under any load, each with its SI unit. Limits that only one plan needs are in a
#: table with the name of that plan.
LIMITS: Final = {
    "rest_height": "m",
    "air_loss_per_minute": "1",
    "track_transmissibility": "1",
    "track_peak": "m",
    "roll_pressure_difference": "Pa",
    "lateral_softening": "1",
    "area_lost": "1",
    "volume_lost": "1",
    "damping_next_plate": "1",
    "damping_beside_peak": "1",
    "damping_peak_frequency": "Hz",
    "high_frequency_damping": "1",
    "surge_dip": "1",
    "surge_peak": "1",
    "coupling_rise": "1",
    "coupling_saturated": "1",
    "dpv_opening": "Pa",
    "dpv_reclosing": "Pa",
    "leveling_opening": "m",
    "leveling_delay": "s",
    "leveling_fill_time": "s",
    "leveling_exhaust_time": "s",
}
#: Quantities with limits that hold under one load, each with its SI unit.
LOAD_LIMITS: Final = {
    "carried": "N",
    "pressure": "Pa",
    "vertical_secant": "N/m",
    "vertical_loss_angle": "rad",
    "vertical_stiffness_by_amplitude": "N/m",
    "vertical_damping_by_amplitude": "N*s/m",
    "vertical_secant_closed": "N/m",
    "vertical_isobaric": "N/m",
    "vertical_stiffness": "N/m",
    "vertical_damping": "N*s/m",
    "lateral_secant": "N/m",
    "lateral_stiffness_by_amplitude": "N/m",
    "lateral_damping_by_amplitude": "N*s/m",
    "lateral_stiffness": "N/m",
    "lateral_damping": "N*s/m",
    "lateral_left_at_offset": "1",
    "roll_stiffness": "N*m/rad",
    "lateral_stiffness_by_pressure": "m",
    "tangent_left": "1",
    "coupling_force": "N",
    "plate_damping": "N*s/m",
}
_NAMES: Final = ("type", "serial_number", "drawing")
MODEL: Final = "model"
#: Abscissas of a limit curve, each with the SI value of its unit.
OVER: Final = {"frequency": 1.0, "amplitude_mm": mm, "offset_mm": mm, "plate_mm": mm, "roll_mrad": mrad}
_ENDS: Final = ("low", "high")
_EXPECTED: Final = ("expected", "tolerance")
_BANDS: Final = (_ENDS, ("low",), ("high",), _EXPECTED, *((over, *_EXPECTED) for over in OVER))
#: Name of the file in errors.
_FILE: Final = "a specimen"


@dataclass(frozen=True, slots=True)
class Specimen:
    """One type of spring with its limits, all values in SI. Both springs on the bench are of this type."""

    file: str
    sha256: str
    type: str
    serial_number: str
    drawing: str
    bellows_volume: float  #: m³ at design height
    auxiliary_volume: float  #: m³
    effective_area: float  #: m² at design height
    effective_area_slope: float  #: m, by height
    emergency_stiffness_vertical: float  #: N/m
    emergency_stiffness_lateral: float  #: N/m
    limits: Limits
    loads: Mapping[str, Load]
    bench: Mapping[str, float] = field(
        default_factory=dict
    )  #: bench for which the limits of roll, track and gust hold; may be empty
    effective_area_growth: float = 0.0  #: m²/Pa, by pressure
    area_reference_pressure: float = 0.0  #: Pa gauge, at which the area is ``effective_area``
    model: str = (
        ""  #: parameter set of a simulation of it: a name, or the path of a file; "" if none is known
    )
    requirements: Mapping[str, str] = field(default_factory=dict)  #: by name of a check, or pattern of names

    def load(self, name: str) -> Load:
        """Return a load case by name. Raises SpecimenError if the file does not have it."""
        if name not in self.loads:
            raise SpecimenError(
                f"specimen {self.file} has no load case {name}; it has {', '.join(self.loads)}"
            )
        return self.loads[name]

    def load_of(self, name: str, preload: float) -> Load:
        """Return a copy of the load case ``name`` with another ``preload`` (N), the pressure that belongs to it, and no
        limits.
        """
        load = self.load(name)
        limits = Limits(f"{load.limits.where} at {preload / 1e3:g} kN", {}, {})
        return replace(load, preload=preload, fill_pressure=self.pressure_for(preload), limits=limits)

    def area_at(self, pressure: float) -> float:
        """Return the effective area (m²) at design height under a gauge pressure (Pa)."""
        return self.effective_area + self.effective_area_growth * (pressure - self.area_reference_pressure)

    def pressure_for(self, preload: float) -> float:
        """Return the gauge pressure (Pa) that carries a preload (N) at design height."""
        bare = self.area_at(0.0)
        return 2.0 * preload / (bare + sqrt(bare * bare + 4.0 * self.effective_area_growth * preload))

    def requirement(self, check: str) -> str:
        """Return the requirement that a check verifies: from this file, otherwise from the plan; "" if there is
        none.
        """
        stated = (text for pattern, text in self.requirements.items() if fnmatchcase(check, pattern))
        return next(stated, check.requirement if isinstance(check, CheckName) else "")

    @property
    def facts(self) -> dict[str, str]:
        """Entries for record and report."""
        return {
            "type": self.type,
            "serial_number": self.serial_number,
            "drawing": self.drawing,
            "file": self.file,
            "sha256": self.sha256,
        }


@cache
def ordinary() -> Specimen:
    """Return the default specimen."""
    return read_specimen(ORDINARY)


def packaged() -> list[str]:
    """Return the names of the specimen files that are supplied with the program."""
    return list(named_files(PACKAGE))


def read_specimen(name: str | Path) -> Specimen:
    """Read a specimen from a TOML file, or from the supplied file with this name.

    Raises SpecimenError, with file, key, value and unit, if the file cannot be read or has an invalid entry.
    """
    path = place_of(PACKAGE, name)
    try:
        text = read_bounded(path)
        content = parse_toml(text)
    except OSError as error:
        raise SpecimenError(
            f"specimen {name} cannot be read: {named_file_error(error, name, packaged())}"
        ) from None
    except Unfit as error:
        raise SpecimenError(f"specimen {path} {error}") from None
    try:
        return _specimen(path, hashlib.sha256(text).hexdigest(), content)
    except EntryError as error:
        raise SpecimenError(f"specimen {path}: {error}") from None


def _specimen(path: Path, sha256: str, content: Mapping[str, Any]) -> Specimen:
    file = path.name
    refuse_unknown(
        "", content, (*_NAMES, MODEL, "requirements", "properties", "bench", "limits", "load_case"), _FILE
    )
    cases = as_table("load_case", content.get("load_case", {}))
    if not cases:
        raise EntryError(f"there is no load case; add [load_case.NAME] with {', '.join(LOAD)}")
    specimen = Specimen(
        file,
        sha256,
        _name("type", content),
        _name("serial_number", content),
        _name("drawing", content),
        **_drawing(content.get("properties", {})),
        limits=_limits(file, "limits", content.get("limits", {}), LIMITS),
        loads={name: _load(file, name, case) for name, case in cases.items()},
        bench=_values("bench", content["bench"], BENCH) if "bench" in content else {},
        model=_model(path, content),
        requirements={
            check: _text(f"requirements.{check}", text)
            for check, text in as_table("requirements", content.get("requirements", {})).items()
        },
    )
    if found := list(_contradictions(specimen)):
        raise EntryError("; ".join(found))
    return specimen


def _drawing(table: Any) -> dict[str, float]:
    """Return the properties of a drawing in SI. The properties in `GROWTH` are optional, but a file must state all or
    none of them.
    """
    known = DRAWING | (GROWTH if GROWTH.keys() & as_table("properties", table) else {})
    return _values("properties", table, known)


def _name(key: str, content: Mapping[str, Any]) -> str:
    return _text(key, _needed("", content, key))


def _text(key: str, text: Any) -> str:
    if not isinstance(text, str) or not text.strip():
        raise EntryError(f"{key} = {text!r} is not a text, or an empty one; write a text in quotes")
    return text


def _model(path: Path, content: Mapping[str, Any]) -> str:
    """Return the name or path of the parameter set in the file; "" if there is none. A path is relative to the folder
    of the file.
    """
    if MODEL not in content:
        return ""
    name = _name(MODEL, content)
    return str(path.parent / name) if name.endswith(".toml") else name


def _load(file: str, name: str, case: Any) -> Load:
    where = f"load_case.{name}"
    values = dict(as_table(where, case))
    limits = _limits(file, f"{where}.limits", values.pop("limits", {}), LOAD_LIMITS)
    return Load(name, **_values(where, values, LOAD), limits=limits)


def _contradictions(specimen: Specimen) -> Iterator[str]:
    """Yield a text for each pair of entries that contradict each other."""
    for load in specimen.loads.values():
        where, preload = f"load_case.{load.name}", f"preload = {load.preload / kN:g} kN"
        area = specimen.area_at(load.fill_pressure)
        borne = load.fill_pressure * area
        right = specimen.pressure_for(load.preload)
        if abs(borne / load.preload - 1.0) > BORNE_OTHERWISE:
            yield (
                f"{where}.{preload}, but fill_pressure = {load.fill_pressure / bar:g} bar on effective_area = "
                f"{area:g} m2 bears {borne / kN:.4g} kN; {right / bar:.4g} bar would bear it"
            )
        if load.roll_load >= load.preload:
            yield (
                f"{where}.roll_load = {load.roll_load / kN:g} kN would lift a spring off; it must be below {preload}"
            )
        carried = load.limits.bands.get("carried", Band())
        if load.preload not in carried:
            yield f"{where}.{preload} lies outside of limits.carried ({carried.text('kN')}); no spring could pass"
        pressure = load.limits.bands.get("pressure", Band())
        if load.fill_pressure not in pressure.wider(BORNE_OTHERWISE):
            yield (
                f"{where}.fill_pressure = {load.fill_pressure / bar:g} bar is far outside of limits.pressure "
                f"({pressure.text('bar')}); no spring could pass"
            )
    loads = specimen.loads
    if "AW0" in loads and "AW3" in loads and loads["AW0"].preload >= loads["AW3"].preload:
        empty, full = (loads[name].preload / kN for name in ("AW0", "AW3"))
        yield f"the empty car (AW0, {empty:g} kN) must be lighter than the full one (AW3, {full:g} kN)"


def _values(where: str, table: Any, known: Mapping[str, Span]) -> dict[str, float]:
    refuse_unknown(f"{where}.", as_table(where, table), known, _FILE)
    return {
        name: read_plausible(f"{where}.{name}", _needed(f"{where}.", table, name), span).si()
        for name, span in known.items()
    }


def _limits(file: str, where: str, raw_limits: Any, known: Mapping[str, str]) -> Limits:
    bands: dict[str, Band] = {}
    curves: dict[str, dict[float, Band]] = {}
    units: dict[str, str] = {}

    def keep(name: str, raw: Any, si: str | None) -> None:
        limit, stated = _limit(f"{where}.{name}", raw, si)
        if si is None:
            units[name] = stated
        if isinstance(limit, Band):
            bands[name] = limit
        else:
            curves[name] = limit

    own = dict(as_table(where, raw_limits))
    for plan in [name for name, raw in own.items() if name not in known and _is_group(raw)]:
        for name, raw in own.pop(plan).items():
            keep(f"{plan}.{name}", raw, None)
    refuse_unknown(f"{where}.", own, known, _FILE)
    for name, raw in own.items():
        keep(name, raw, known[name])
    return Limits(f"specimen {file}: {where}", bands, curves, units)


def _is_group(raw: Any) -> bool:
    """Return whether ``raw`` is a table of limits, and not one limit."""
    return isinstance(raw, dict) and bool(raw) and all(isinstance(one, dict) for one in raw.values())


def _limit(key: str, raw: Any, si: str | None) -> tuple[Band | dict[float, Band], str]:
    """Return a limit, and the SI unit of its quantity. Without ``si`` any unit is accepted."""
    entry = read_entry(key, raw, si, _BANDS)
    stated = UNITS[entry.unit].si
    if over := next((over for over in OVER if over in entry.parts), ""):
        return _curve(entry, over), stated
    if "expected" in entry.parts:
        return _around(entry, entry.parts["expected"]), stated
    low, high = (entry.si(end) if end in entry.parts else None for end in _ENDS)
    if low is not None and high is not None and low > high:
        below, above = (f"{entry.parts[end]:g} {entry.unit}" for end in _ENDS)
        raise EntryError(f"{key}.low = {below} is above high = {above}, so nothing could pass; swap them")
    return Band(low, high), stated


def _curve(entry: FileEntry, over: str) -> dict[float, Band]:
    key, places, expected = entry.key, entry.parts[over], entry.parts["expected"]
    if not (isinstance(places, list) and isinstance(expected, list) and len(places) == len(expected)):
        raise EntryError(
            f"{key}.{over} and {key}.expected are not lists of the same length; write one expected "
            f"value for each {over}"
        )
    at = [number(f"{key}.{over}", place) for place in places]
    if not at or at != sorted(set(at)):
        raise EntryError(f"{key}.{over} = {places} does not rise; sort it")
    return {place * OVER[over]: _around(entry, one) for place, one in zip(at, expected, strict=True)}


def _around(entry: FileEntry, expected: Any) -> Band:
    key, tolerance = entry.key, number(f"{entry.key}.tolerance", entry.parts["tolerance"])
    if not 0.0 < tolerance < 1.0:
        raise EntryError(
            f"{key}.tolerance = {tolerance:g} is not a fraction of the expected value; write 0.08 for 8 %"
        )
    middle = number(f"{key}.expected", expected) * entry.factor
    if middle <= 0.0:
        raise EntryError(
            f"{key}.expected = {expected:g} {entry.unit} is not above 0, so a relative tolerance is "
            "not possible; use low and high"
        )
    return within(middle, tolerance)


def _needed(where: str, table: Mapping[str, Any], key: str) -> Any:
    if key not in table:
        raise EntryError(f"the key {where}{key} is missing; add it")
    return table[key]
