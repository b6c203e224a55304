"""What an FMU says of itself: its variables with their units in SI, what it can do, and who it is.

Its library is not loaded here: that is left to a process of its own (`diagnosis.systems.fmu.lane`).
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from math import inf, isfinite
from pathlib import Path
from typing import Any, Final
from xml.etree.ElementTree import iterparse
from zipfile import BadZipFile

from bench_protocol.base_units import BASES, base_exponents, written
from bench_protocol.extras import lacking
from bench_protocol.input_limits import Unfit, open_archive
from bench_protocol.units import UNITS, Unit
from diagnosis.contracts import DiagnosisError

#: Types of numbers, as FMI 2 and 3 call them.
REALS: Final = frozenset({"Real", "Float64", "Float32"})
WHOLE: Final = frozenset(
    {"Integer", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Enumeration"}
)
#: The size of a unit: exponents of base units.
_Size = frozenset[tuple[str, int]]
_DESCRIPTION: Final = "modelDescription.xml"
_NUMBERS: Final = REALS | WHOLE | {"Boolean"}


@dataclass(frozen=True, slots=True)
class FmuUnit:
    """The unit of a variable: SI = ``factor`` · number + ``zero``. Of one without a unit ``name`` and ``si`` are "".

    The ``zero`` of a difference is 0, whatever the ``offset`` of its unit is.
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
    """One scalar of an FMU; ``low``, ``high`` and ``start`` are in its own unit."""

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
    said: str = ""
    relative: bool = False  #: a difference, of which a unit's offset does not count (``relativeQuantity``)

    @property
    def settable(self) -> bool:
        """Whether a value may be given before the simulation begins."""
        return self.causality in {"input", "parameter", "structuralParameter"} or (
            self.initial in {"exact", "approx"} and self.variability != "constant"
        )


@dataclass(frozen=True, slots=True)
class Fmu:
    """An FMU as it describes itself. ``token`` is its GUID (FMI 2) or instantiationToken (FMI 3)."""

    path: Path
    digest: str  #: sha256 of the file
    version: int  #: of FMI: 2 or 3
    name: str
    token: str
    identifier: str  #: of its library
    tool: str
    variables: Mapping[str, Variable]
    units: Mapping[str, Unit]  #: that it defines, by the names that people may write
    variable_steps: bool
    keeps_state: bool
    once_per_process: bool
    step: float | None  #: s; of which communication steps are whole multiples where they may not vary

    @property
    def identity(self) -> str:
        """Which FMU this is, beyond doubt."""
        return f"{self.path.name}, FMI {self.version}.0, {self.token}, sha256 {self.digest}"

    def variable(self, name: str, where: str) -> Variable:
        """Return a variable by name. DiagnosisError says which would be near."""
        if name in self.variables:
            return self.variables[name]
        near = get_close_matches(name, self.variables, n=3)
        right = ", ".join(near) if near else f"{self._some()}"
        raise DiagnosisError(
            f"{where}: {self.path.name} has no variable {name}; right would be such as {right}"
        )

    def _some(self) -> str:
        told = [
            one.name for one in self.variables.values() if one.causality in {"input", "output", "parameter"}
        ]
        return ", ".join(told[:12]) + (", …" if len(told) > 12 else "")


def read_fmu(path: Path) -> Fmu:
    """Return what the FMU in a file says of itself.

    DiagnosisError for what is no FMU, for one of another version or kind, and for one that does not run on this system.
    """
    fmpy = fmpy_or_refuse()
    try:
        with open_archive(path, parsed={_DESCRIPTION}) as archive:
            files = archive.namelist()
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise DiagnosisError(f"{path}: cannot be read: {error.strerror}") from None
    except Unfit as error:
        raise DiagnosisError(
            f"{path} is no FMU that can be read: it {error}; export the model once more"
        ) from None
    try:
        said = fmpy.read_model_description(str(path), validate=False)
        differences = _differences(path)
    except Exception as error:  # whatever the reader stumbles over
        raise DiagnosisError(f"{path} is no FMU that can be read: {error}") from None
    major = str(said.fmiVersion).partition(".")[0]
    if major not in {"2", "3"}:
        raise DiagnosisError(
            f"{path} is of FMI {said.fmiVersion}; right would be an export as FMI 2.0 or 3.0"
        )
    able = said.coSimulation
    if able is None:
        kind = "model exchange" if said.modelExchange is not None else "scheduled execution"
        raise DiagnosisError(
            f"{path} is for {kind} only: it has no solver of its own; right would be an export for co-simulation"
        )
    _refuse_platform(path, int(major), able.modelIdentifier, files)
    units = {unit.name: unit for unit in said.unitDefinitions}
    si = _si_units(path, said.unitDefinitions)
    return Fmu(
        path,
        digest,
        int(major),
        said.modelName or path.stem,
        said.guid,
        able.modelIdentifier,
        said.generationTool or "",
        {
            one.name: _variable(path, one, units, si, differences.get(one.name))
            for one in said.modelVariables
            if _is_number(one)
        },
        _own_units(said.unitDefinitions, si),
        bool(able.canHandleVariableCommunicationStepSize),
        bool(able.canGetAndSetFMUstate),
        bool(able.canBeInstantiatedOnlyOncePerProcess),
        _step(said),
    )


def _step(said: Any) -> float | None:
    """Return the communication step (s) that the FMU prescribes; None if it takes any."""
    able = said.coSimulation
    step = able.fixedInternalStepSize
    if (
        step is None
        and not able.canHandleVariableCommunicationStepSize
        and said.defaultExperiment is not None
    ):
        step = said.defaultExperiment.stepSize
    return None if step is None else float(step)


def unpack_fmu(path: Path, folder: Path) -> None:
    """Unpack the FMU in a file into a folder. DiagnosisError where that cannot be done."""
    try:
        with open_archive(path) as archive:
            archive.extractall(folder)
    except (OSError, ValueError, BadZipFile, RuntimeError, EOFError, zlib.error) as error:
        raise DiagnosisError(f"{path} cannot be unpacked: {error}; export the model once more") from None


def fmpy_or_refuse() -> Any:
    """Return FMPy. DiagnosisError with what to install where it is missing."""
    try:
        import fmpy
    except ImportError:
        raise DiagnosisError(lacking("fmu", "FMUs")) from None
    return fmpy


def library_of(version: int, identifier: str) -> str:
    """Return where in an FMU of a version of FMI its library for this system lies."""
    fmpy = fmpy_or_refuse()
    folder = fmpy.platform if version == 2 else fmpy.platform_tuple
    return f"binaries/{folder}/{identifier}{fmpy.sharedLibraryExtension}"


def _refuse_platform(path: Path, version: int, identifier: str, files: Collection[str]) -> None:
    right = library_of(version, identifier)
    if right in files:
        return
    parts = [Path(name).parts for name in files]
    there = sorted({one[1] for one in parts if len(one) > 2 and one[0] == "binaries"})
    source = any(one[0] == "sources" and one[-1].endswith(".c") for one in parts if one)
    raise DiagnosisError(
        f"{path} has no {right}, its library for this system; it has {', '.join(there) or 'none at all'}. Right would "
        "be an export on a system like this one"
        + (f", or `fmpy compile {path.name}`: the FMU brings its sources" if source else "")
    )


def _is_number(one: Any) -> bool:
    return one.type in _NUMBERS and not one.dimensions


def _differences(path: Path) -> dict[str, bool]:
    """Return ``relativeQuantity`` of the variables that have it: FMPy (0.3.32) reads that of types alone."""
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

    def told(name: str) -> Any:
        value = getattr(one, name, None)
        return value if value is not None or declared is None else getattr(declared, name, None)

    unit = told("unit") if one.type in REALS else None
    causality = one.causality or "local"
    settled = causality == "parameter" or (causality == "output" and one.initial == "exact")
    difference = one.type in REALS and bool(told("relativeQuantity") if relative is None else relative)
    measured_in = _unit(path, one.name, unit, units.get(unit), si) if unit else FmuUnit()
    return Variable(
        one.name,
        one.valueReference,
        one.type,
        causality,
        one.variability or "",
        one.initial or ("exact" if settled else ""),
        replace(measured_in, zero=0.0) if difference else measured_in,
        _number(told("min"), -inf),
        _number(told("max"), inf),
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
    """Return the name of the SI unit of each size: of this project, else as the FMU calls it, else in base units.

    DiagnosisError for a unit of which 1 is nothing.
    """
    found: dict[_Size, str] = {}
    for one in UNITS.values():
        found.setdefault(frozenset(base_exponents(one.si).items()), one.si)
    defined = [unit for unit in definitions if unit.baseUnit is not None]
    for unit in defined:
        factor, offset = float(unit.baseUnit.factor), float(unit.baseUnit.offset)
        if not (isfinite(factor) and isfinite(offset)) or factor == 0.0:
            raise DiagnosisError(
                f'{path}: unit "{unit.name}" has the factor {factor:g} and the offset {offset:g}; right would be a '
                "finite factor other than 0, and a finite offset"
            )
        if factor == 1.0 and offset == 0.0:
            found.setdefault(_size(unit.baseUnit), _plain(unit.name))
    for unit in defined:
        found.setdefault(_size(unit.baseUnit), written(_exponents(unit.baseUnit)))
    return found


def _own_units(definitions: Sequence[Any], si: Mapping[_Size, str]) -> dict[str, Unit]:
    """Return the units that an FMU defines, under their own names and, of SI, in base units."""
    own = {}
    for unit in definitions:
        if unit.baseUnit is not None:
            named = si[_size(unit.baseUnit)]
            one = Unit(named, float(unit.baseUnit.factor), float(unit.baseUnit.offset))
            own[written(_exponents(unit.baseUnit))] = Unit(named, 1.0)
            own |= {unit.name: one, _plain(unit.name): one}
    return own


def _unit(path: Path, variable: str, name: str, definition: Any, si: Mapping[_Size, str]) -> FmuUnit:
    """Return a unit that an FMU names and perhaps defines. DiagnosisError where its definition is not that of its name.

    Angles count as numbers in some tools and as angles in others.
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
    if _without_angles(exponents) == _without_angles(right) and same:
        return FmuUnit(name, known.si, factor, zero, zero, exponents)
    raise DiagnosisError(
        f'{path}: {variable} is in "{name}", which the FMU defines as {factor:g} {written(exponents)}'
        f"{f' + {zero:g}' if zero else ''}, and which is {known.factor:g} {known.si}"
        f"{f' + {known.zero:g}' if known.zero else ''}; right would be a definition that agrees with the name"
    )


def _without_angles(exponents: Mapping[str, int]) -> dict[str, int]:
    return {base: power for base, power in exponents.items() if base != "rad"}
