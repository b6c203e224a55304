"""The model description of an FMU by FMI 2.0 or 3.0."""

from collections.abc import Iterable, Sequence
from math import isfinite
from typing import Final
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from astb.fmu.unit import Kind, Unit, Variable
from bench_protocol.rates import TICK
from bench_protocol.unit_names import base_exponents
from bench_protocol.units import WRITTEN_UNITS

#: Display unit of a quantity.
_SHOWN: Final = {"m": "mm", "Pa": "bar", "N": "kN", "m3": "litre", "rad": "mrad"}


def model_description(unit: Unit, *, fmi: int, token: str, version: str) -> bytes:
    """Return ``modelDescription.xml``; ``token`` is its GUID."""
    every = unit.variables
    root = Element("fmiModelDescription")
    root.attrib.update(
        {
            "fmiVersion": f"{fmi}.0",
            "modelName": unit.name,
            "guid" if fmi == 2 else "instantiationToken": token,
            "description": unit.said,
            "version": version,
            "generationTool": f"astb {version}",
            "license": "Apache-2.0",
            "variableNamingConvention": "structured",
        }
    )
    state = "FMUstate" if fmi == 2 else "FMUState"
    able = {
        "modelIdentifier": unit.code.name,
        "canHandleVariableCommunicationStepSize": "true",
        f"canGetAndSet{state}": "true",
        f"canSerialize{state}": "true",
    }
    if fmi == 3:
        able["fixedInternalStepSize"] = repr(TICK)
    SubElement(root, "CoSimulation", able)
    _units(SubElement(root, "UnitDefinitions"), {one.unit for one in every}, fmi)
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", name="logStatusError", description="Refused calls and reasons")
    SubElement(root, "DefaultExperiment", startTime="0", stopTime="10", stepSize=repr(TICK))
    listed = SubElement(root, "ModelVariables")
    for reference, one in enumerate(every):
        _variable(listed, reference, one, fmi)
    if fmi == 3:
        SubElement(
            listed,
            "Float64",
            {
                "name": "time",
                "valueReference": str(len(every)),
                "causality": "independent",
                "variability": "continuous",
                "description": "Simulated time",
                "unit": "s",
            },
        )
    _structure(SubElement(root, "ModelStructure"), every, fmi)
    indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="utf-8") + b"\n"


def _units(units: Element, needed: Iterable[str], fmi: int) -> None:
    for unit in sorted({*needed, "s"}):
        one = SubElement(units, "Unit", name=unit)
        exponents = {base: str(power) for base, power in base_exponents(unit).items()}
        SubElement(one, "BaseUnit", exponents)
        if unit in _SHOWN:
            shown = _SHOWN[unit]
            SubElement(one, "DisplayUnit", name=shown, factor=repr(1.0 / WRITTEN_UNITS[shown].factor))


def _variable(listed: Element, reference: int, one: Variable, fmi: int) -> None:
    about = {"name": one.name, "valueReference": str(reference), "description": one.description}
    if one.kind in (Kind.MOTION, Kind.INPUT):
        about |= {"causality": "input", "variability": "continuous"}
    elif one.kind in (Kind.BEGIN, Kind.FIXED, Kind.TUNABLE):
        varies = "tunable" if one.kind is Kind.TUNABLE else "fixed"
        about |= {"causality": "parameter", "variability": varies, "initial": "exact"}
    else:
        about |= {"causality": "output", "variability": "continuous", "initial": "calculated"}
    number = {"unit": one.unit}
    if one.unit in _SHOWN:
        number["displayUnit"] = _SHOWN[one.unit]
    number |= {key: repr(bound) for key, bound in (("min", one.low), ("max", one.high)) if isfinite(bound)}
    if one.start is not None:
        number["start"] = repr(one.start)
    if fmi == 3:
        SubElement(listed, "Float64", about | number)
    else:
        SubElement(SubElement(listed, "ScalarVariable", about), "Real", number)


def _structure(structure: Element, every: Sequence[Variable], fmi: int) -> None:
    # Outputs change only within a step. So connected FMUs have no algebraic loops.
    none = {"dependencies": ""}
    outputs = [place for place, one in enumerate(every) if one.kind is Kind.OUTPUT]
    if fmi == 3:
        for place in outputs:
            SubElement(structure, "Output", none, valueReference=str(place))
        for place in outputs:
            SubElement(structure, "InitialUnknown", valueReference=str(place))
        return
    for title, dependencies in (("Outputs", none), ("InitialUnknowns", {})):
        unknowns = SubElement(structure, title)
        for place in outputs:
            SubElement(unknowns, "Unknown", dependencies, index=str(place + 1))
