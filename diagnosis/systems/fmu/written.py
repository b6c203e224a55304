"""Writes the result for an FMU: parameters with intervals (TOML), and a parameter set (SSV) for other tools.

SSV is the format System Structure Parameter Values 1.0 (Modelica Association, SSP), which simulation tools read. It
contains variables of the FMU. Errors of sensors and unknown terms are only in the TOML file.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final
from xml.etree.ElementTree import Element, SubElement, indent, register_namespace, tostring

import msgspec

from bench_sim.fmu.description import REALS, Fmu, require_fmpy
from diagnosis.contracts import DiagnosisError, Simulator
from diagnosis.engine.identify import Identification
from diagnosis.estimates import Z95
from diagnosis.finding import Finding
from diagnosis.systems.fmu.simulator import FmuSimulator

PARAMETERS: Final = "parameters.toml"
VALUES: Final = "parameters.ssv"
_SSV: Final = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
_SSC: Final = "http://ssp-standard.org/SSP1/SystemStructureCommon"
_DIGITS: Final = 9


def write_found(folder: Path, finding: Finding, simulator: FmuSimulator) -> None:
    """Write the TOML file and the parameter set of a finding into a folder. Raises OSError if this fails."""
    values = simulator.starts(None, finding.models.after, finding.models.effects)
    per_run = {one.name for one in simulator.nuisances if one.per_run}
    values = {name: value for name, value in values.items() if name not in per_run}
    (folder / VALUES).write_bytes(_ssv(simulator.fmu, values))
    (folder / PARAMETERS).write_text("\n".join(_lines(finding, simulator, values)) + "\n", "utf-8")


def write_identified(path: Path, found: Identification, simulator: Simulator, digest: str) -> None:
    """Write the identified parameters of a simulator as TOML. For an FMU also write a parameter set (SSV). Raises
    OSError if a file cannot be written.
    """
    identity = simulator.identity if isinstance(simulator, FmuSimulator) else simulator.name
    rows = [
        f"# {identity}",
        f"# data: {digest}",
        "",
        "[parameters]  # in SI",
    ]
    for one in found.parameters:
        low, high = (one.value + sign * Z95 * one.deviation for sign in (-1.0, 1.0))
        note = f"95 %: {low:.6g} to {high:.6g} {one.parameter.unit}"
        note += "" if one.determined else ", hardly determined by the records"
        name, value = _text(one.parameter.name), _text(f"{one.value:.{_DIGITS}g} {one.parameter.unit}")
        rows.append(f"{name} = {value}  # {note}")
    path.write_text("\n".join(rows) + "\n", "utf-8")
    if isinstance(simulator, FmuSimulator):
        per_run = {one.name for one in simulator.nuisances if one.per_run}
        values = simulator.starts(None, {one.parameter.name: one.value for one in found.parameters}, {})
        values = {name: value for name, value in values.items() if name not in per_run}
        path.with_suffix(".ssv").write_bytes(_ssv(simulator.fmu, values))


def _lines(finding: Finding, simulator: FmuSimulator, values: Mapping[str, float]) -> Iterator[str]:
    variables = simulator.fmu.variables
    yield f"# {simulator.identity}"
    yield f"# {finding.sentence}"
    yield ""
    yield "[parameters]  # variables of the FMU, in SI"
    intervals = dict(_intervals(finding))
    for name, value in values.items():
        row = f"{_text(name)} = {_text(f'{value:.{_DIGITS}g} {variables[name].unit.si}')}"
        yield f"{row}  # {intervals[name]}" if name in intervals else row
    beside = {name: one for name, one in finding.models.effects.items() if name not in simulator.effects}
    beside |= {
        name: {"": value} for name, value in finding.models.after.items() if name not in variables and value
    }
    if beside:
        yield ""
        yield "[beside]  # parameters outside of the FMU: sensors and unnamed terms, in SI"
        for name, found in beside.items():
            inside = ", ".join(f"{_text(key)} = {value:.{_DIGITS}g}" for key, value in found.items() if key)
            yield f"{_text(name)} = {{ {inside} }}" if inside else f"{_text(name)} = {found['']:.{_DIGITS}g}"


def _intervals(finding: Finding) -> Iterator[tuple[str, str]]:
    for cause in finding.causes:
        for one in cause.parameters:
            if one.low is not None and one.high is not None:
                yield one.name, f"{cause.effect}; 95 %: {one.low:.6g} to {one.high:.6g} {one.unit}"
    for shift in finding.shifts:
        if not shift.run and shift.sd_after is not None:
            yield shift.name, f"± {shift.sd_after:.3g} {shift.unit} (one standard deviation)"


def _text(text: str) -> str:
    return msgspec.json.encode(text).decode()


def _ssv(fmu: Fmu, values: Mapping[str, float]) -> bytes:
    register_namespace("ssv", _SSV)
    register_namespace("ssc", _SSC)
    root = Element(f"{{{_SSV}}}ParameterSet", version="1.0", name=fmu.name, description=fmu.identity)
    listed = SubElement(root, f"{{{_SSV}}}Parameters")
    units = {}
    for name, value in values.items():
        one = fmu.variables[name]
        parameter = SubElement(listed, f"{{{_SSV}}}Parameter", name=name)
        number = one.unit.from_si(value)
        if one.type not in REALS:
            kind = "Boolean" if one.type == "Boolean" else "Integer"
            text = str(bool(number)).lower() if kind == "Boolean" else str(round(number))
            SubElement(parameter, f"{{{_SSV}}}{kind}", value=text)
            continue
        real = SubElement(parameter, f"{{{_SSV}}}Real", value=repr(float(number)))
        if one.unit.name:
            real.set("unit", one.unit.name)
            units[one.unit.name] = one.unit
    if units:
        defined = SubElement(root, f"{{{_SSV}}}Units")
        for name, unit in units.items():
            attributes = {base: str(power) for base, power in unit.exponents.items()}
            attributes |= {"factor": repr(unit.factor)} if unit.factor != 1.0 else {}
            attributes |= {"offset": repr(unit.offset)} if unit.offset else {}
            SubElement(SubElement(defined, f"{{{_SSC}}}Unit", name=name), f"{{{_SSC}}}BaseUnit", attributes)
    indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="utf-8") + b"\n"


def read_values(path: Path, fmu: Fmu, where: str) -> dict[str, float]:
    """Return the values (SI) of FMU variables in a parameter set (SSV).

    Raises DiagnosisError for another file format and for units that differ from those of the FMU. Raises FmuError for
    unknown variables.
    """
    require_fmpy()
    from fmpy.ssp.ssd import read_ssv

    try:
        found: Any = read_ssv(str(path))
    except Exception as error:  # whatever the reader stumbles over
        raise DiagnosisError(
            f"{where}: {path} cannot be read as a parameter set (SSV): {error}; export the file again"
        ) from None
    values = {}
    for parameter in found.parameters:
        one = fmu.variable(parameter.name, f"{where}: {path.name}")
        unit = getattr(parameter, "unit", None)
        if unit and one.unit.name and unit != one.unit.name:
            raise DiagnosisError(
                f'{where}: {path.name} has {parameter.name} in "{unit}", but the FMU in "{one.unit.name}"; write '
                "the value in the unit of the FMU"
            )
        text = str(parameter.value)
        values[parameter.name] = one.unit.to_si(
            float(text == "true") if text in {"true", "false"} else float(text)
        )
    return values
