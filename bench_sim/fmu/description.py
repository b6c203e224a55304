"""Reads an FMU: its variables with their units in SI, its capabilities, its identity and its files.

The library of the FMU is not loaded in this process. A separate process does that (`bench_sim.fmu.process`).
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isfinite
from pathlib import Path
from typing import Any, Final
from xml.etree.ElementTree import iterparse
from zipfile import BadZipFile

from bench_protocol.extras import lacking
from bench_protocol.input_limits import open_archive
from bench_protocol.os_errors import file_errors
from bench_protocol.suggestion import did_you_mean
from bench_protocol.unit_names import BASES, base_exponents, written
from bench_protocol.units import UNITS, Unit

#: Types of real numbers and of whole numbers in FMI 2 and 3.
REALS: Final = frozenset({"Real", "Float64", "Float32"})
WHOLE: Final = frozenset(
    {"Integer", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Enumeration"}
)
#: The size of a unit: exponents of base units.
_Size = frozenset[tuple[str, int]]
_DESCRIPTION: Final = "modelDescription.xml"
_NUMBERS: Final = REALS | WHOLE | {"Boolean"}


class FmuError(ValueError):
    """An FMU cannot be read, mapped or run. The text states the fault, its place and the remedy."""


@dataclass(frozen=True, slots=True)
class FmuUnit:
    """The unit of a variable. A value in SI units is ``factor`` · number + ``zero``. Without a unit, ``name`` and
    ``si`` are "". For a difference of two values ``zero`` is 0, even if the unit has an ``offset``.
    """

    name: str = ""
    si: str = ""
    factor: float = 1.0
    zero: float = 0.0
    offset: float = 0.0
    exponents: Mapping[str, int] = field(default_factory=dict)

    def to_si(self, number: float) -> float:
        """Return a number of this unit in SI."""
        return self.factor * number + self.zero

    def from_si(self, value: float) -> float:
        """Return an SI value as a number of this unit."""
        return (value - self.zero) / self.factor


@dataclass(frozen=True, slots=True)
class Variable:
    """One scalar variable of an FMU. ``low``, ``high`` and ``start`` are in the unit of the variable."""

    name: str
    reference: int
    type: str
    causality: str
    variability: str
    initial: str
    unit: FmuUnit
    low: float = -inf
    high: float = inf
    start: float | None = None
    description: str = ""
    relative: bool = False  #: a difference, to which the unit's offset does not apply (``relativeQuantity``)

    @property
    def settable(self) -> bool:
        """Whether a value can be set before the simulation begins."""
        return self.causality in {"input", "parameter", "structuralParameter"} or (
            self.initial in {"exact", "approx"} and self.variability != "constant"
        )


@dataclass(frozen=True, slots=True)
class Fmu:
    """The description of an FMU. ``token`` is its GUID (FMI 2) or instantiationToken (FMI 3)."""

    path: Path
    digest: str  #: sha256 of the file
    version: int  #: of FMI: 2 or 3
    name: str
    token: str
    identifier: str  #: of its library
    tool: str
    variables: Mapping[str, Variable]
    units: Mapping[str, Unit]  #: that it defines, by the names that a map may use
    variable_steps: bool
    keeps_state: bool
    once_per_process: bool
    step: float | None  #: s; communication steps that may not vary are whole multiples of it

    @property
    def identity(self) -> str:
        """Return file name, version, token and hash as one text."""
        return f"{self.path.name}, FMI {self.version}.0, {self.token}, sha256 {self.digest}"

    def variable(self, name: str, where: str) -> Variable:
        """Return a variable by name. Raises FmuError, which suggests similar names, if there is none."""
        if name in self.variables:
            return self.variables[name]
        public = {"input", "output", "parameter"}
        names = [one.name for one in self.variables.values() if one.causality in public]
        right = did_you_mean(name, self.variables, did_you_mean(name, names))
        raise FmuError(f"{where}: {self.path.name} has no variable {name}; {right}")


def read_fmu(path: Path) -> Fmu:
    """Return the description of the FMU in a file.

    Raises FmuError if the file is not an FMU, has another FMI version or kind, or has no library for this system.
    """
    fmpy = require_fmpy()
    with file_errors(f"the FMU {path}", FmuError):
        with open_archive(path, parsed={_DESCRIPTION}) as archive:
            files = archive.namelist()
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
    try:
        model = fmpy.read_model_description(str(path), validate=False)
        differences = _differences(path)
    except Exception as error:  # FMPy raises several types
        raise FmuError(f"{path} is not a readable FMU: {error}; export the model again") from None
    major = str(model.fmiVersion).partition(".")[0]
    if major not in {"2", "3"}:
        raise FmuError(f"{path} has FMI version {model.fmiVersion}; export the model as FMI 2.0 or 3.0")
    able = model.coSimulation
    if able is None:
        kind = "model exchange" if model.modelExchange is not None else "scheduled execution"
        raise FmuError(f"{path} is for {kind} only and has no solver; export the model for co-simulation")
    _check_platform(path, int(major), able.modelIdentifier, files)
    units = {unit.name: unit for unit in model.unitDefinitions}
    si = _si_units(path, model.unitDefinitions)
    variable_steps = bool(able.canHandleVariableCommunicationStepSize)
    step = able.fixedInternalStepSize
    if step is None and not variable_steps and model.defaultExperiment is not None:
        step = model.defaultExperiment.stepSize
    return Fmu(
        path,
        digest,
        int(major),
        model.modelName or path.stem,
        model.guid,
        able.modelIdentifier,
        model.generationTool or "",
        {
            one.name: _variable(path, one, units, si, differences.get(one.name))
            for one in model.modelVariables
            if one.type in _NUMBERS and not one.dimensions
        },
        _own_units(model.unitDefinitions, si),
        variable_steps,
        bool(able.canGetAndSetFMUstate),
        bool(able.canBeInstantiatedOnlyOncePerProcess),
        None if step is None else float(step),
    )


def unpack_fmu(path: Path, folder: Path) -> None:
    """Unpack the FMU in a file into a folder. Raises FmuError if that fails."""
    try:
        with open_archive(path) as archive:
            archive.extractall(folder)
    except (OSError, ValueError, BadZipFile, RuntimeError, EOFError, zlib.error) as error:
        raise FmuError(f"{path} cannot be unpacked: {error}; export the model again") from None


def require_fmpy() -> Any:
    """Return the module FMPy. If it is not installed, FmuError states the command that installs it."""
    try:
        import fmpy
    except ImportError:
        raise FmuError(lacking("fmu", "FMUs")) from None
    return fmpy


def library_of(version: int, identifier: str) -> str:
    """Return the path, inside an FMU, of the library for this operating system and processor."""
    fmpy = require_fmpy()
    folder = fmpy.platform if version == 2 else fmpy.platform_tuple
    return f"binaries/{folder}/{identifier}{fmpy.sharedLibraryExtension}"


def _check_platform(path: Path, version: int, identifier: str, files: Collection[str]) -> None:
    library = library_of(version, identifier)
    if library in files:
        return
    parts = [Path(name).parts for name in files]
    platforms = sorted({one[1] for one in parts if len(one) > 2 and one[0] == "binaries"})
    source = any(one[0] == "sources" and one[-1].endswith(".c") for one in parts if one)
    raise FmuError(
        f"{path} has no library for this system, {library}; it has {', '.join(platforms) or 'none'}. Export the "
        "model on a system like this one"
        + (f", or run `fmpy compile {path.name}`: the FMU contains its sources" if source else "")
    )


def _differences(path: Path) -> dict[str, bool]:
    """Return the attribute ``relativeQuantity`` of each variable that states it, by name of the variable. FMPy
    (0.3.32) reads this attribute only where a type definition states it.
    """
    found = {}
    with open_archive(path) as archive, archive.open(_DESCRIPTION) as file:
        for _, one in iterparse(file):
            real = one.find("Real") if one.tag == "ScalarVariable" else one if one.tag in REALS else None
            if real is not None and (text := real.get("relativeQuantity")):
                found[one.get("name", "")] = text in {"true", "1"}
    return found


def _variable(
    path: Path, one: Any, units: Mapping[str, Any], si: Mapping[_Size, str], relative: bool | None
) -> Variable:
    declared = one.declaredType

    def attribute(name: str) -> Any:
        value = getattr(one, name, None)
        return value if value is not None or declared is None else getattr(declared, name, None)

    unit = attribute("unit") if one.type in REALS else None
    causality = one.causality or "local"
    exact = causality == "parameter" or (causality == "output" and one.initial == "exact")
    difference = one.type in REALS and bool(attribute("relativeQuantity") if relative is None else relative)
    measured_in = _unit(path, one.name, unit, units.get(unit), si) if unit else FmuUnit()
    return Variable(
        one.name,
        one.valueReference,
        one.type,
        causality,
        one.variability or "",
        one.initial or ("exact" if exact else ""),
        replace(measured_in, zero=0.0) if difference else measured_in,
        _number(attribute("min"), -inf),
        _number(attribute("max"), inf),
        _number(one.start, None),
        one.description or "",
        difference,
    )


def _number(text: Any, otherwise: Any) -> Any:
    if text is None or isinstance(text, list):
        return otherwise
    if str(text) in {"true", "false"}:
        return float(str(text) == "true")
    try:
        value = float(text)
    except ValueError:
        return otherwise
    return value if isfinite(value) else otherwise


def _exponents(base: Any) -> dict[str, int]:
    return {one: int(getattr(base, one)) for one in BASES if int(getattr(base, one))}


def _size(base: Any) -> _Size:
    return frozenset(_exponents(base).items())


def _plain(name: str) -> str:
    """Return the name of a unit as this project writes it: ``N.m/rad`` is ``N*m/rad``."""
    return name.replace(".", "*").replace("·", "*").replace("^", "")


def _si_units(path: Path, definitions: Sequence[Any]) -> dict[_Size, str]:
    """Return the name of the SI unit for each combination of base units. The name is from the unit table of this
    project, otherwise from the FMU, otherwise composed of the base units. Raises FmuError for a unit with a factor
    of 0 or a factor or offset that is not finite.
    """
    found: dict[_Size, str] = {}
    for one in UNITS.values():
        found.setdefault(frozenset(base_exponents(one.si).items()), one.si)
    defined = [unit for unit in definitions if unit.baseUnit is not None]
    for unit in defined:
        factor, offset = float(unit.baseUnit.factor), float(unit.baseUnit.offset)
        if not (isfinite(factor) and isfinite(offset)) or factor == 0.0:
            raise FmuError(
                f'{path}: unit "{unit.name}" has the factor {factor:g} and the offset {offset:g}; define it with a '
                "finite factor other than 0 and a finite offset"
            )
        if factor == 1.0 and offset == 0.0:
            found.setdefault(_size(unit.baseUnit), _plain(unit.name))
    for unit in defined:
        found.setdefault(_size(unit.baseUnit), written(_exponents(unit.baseUnit)))
    return found


def _own_units(definitions: Sequence[Any], si: Mapping[_Size, str]) -> dict[str, Unit]:
    """Return the units that an FMU defines, by name. For each unit, its SI unit is added under the name of its base
    units.
    """
    own = {}
    for unit in definitions:
        if unit.baseUnit is not None:
            named = si[_size(unit.baseUnit)]
            one = Unit(named, float(unit.baseUnit.factor), float(unit.baseUnit.offset))
            own[written(_exponents(unit.baseUnit))] = Unit(named, 1.0)
            own |= {unit.name: one, _plain(unit.name): one}
    return own


def _unit(path: Path, variable: str, name: str, definition: Any, si: Mapping[_Size, str]) -> FmuUnit:
    """Return the unit of a variable. Raises FmuError if the FMU defines a known unit with another factor, offset or
    base units. Some tools define angles as plain numbers, others with the base unit rad; both are accepted.
    """
    plain = _plain(name)
    base = None if definition is None else definition.baseUnit
    known = UNITS.get(plain)
    if base is None:
        if known is None:
            return FmuUnit(name, plain)
        return FmuUnit(name, known.si, known.factor, known.zero, known.zero, base_exponents(known.si))
    exponents = _exponents(base)
    factor, zero = float(base.factor), float(base.offset)
    if known is None:
        return FmuUnit(name, si[_size(base)], factor, zero, zero, exponents)
    right = base_exponents(known.si)
    same = abs(factor / known.factor - 1.0) < 1e-4 and abs(zero - known.zero) < 1e-3
    if without_angles(exponents) == without_angles(right) and same:
        return FmuUnit(name, known.si, factor, zero, zero, exponents)
    raise FmuError(
        f'{path}: {variable} is in "{name}", which the FMU defines as {factor:g} {written(exponents)}'
        f"{f' + {zero:g}' if zero else ''}, but it is {known.factor:g} {known.si}"
        f"{f' + {known.zero:g}' if known.zero else ''}; correct the definition in the model"
    )


def without_angles(exponents: Mapping[str, int]) -> dict[str, int]:
    """Return the exponents of base units without rad. Some tools leave rad out, so it is not compared."""
    return {base: power for base, power in exponents.items() if base != "rad"}
