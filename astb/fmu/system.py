"""Connected FMUs as one file by System Structure and Parameterization (SSP 1.0)."""

import zipfile
from collections.abc import Iterator, Mapping, Sequence
from itertools import permutations
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final
from xml.etree.ElementTree import Element, SubElement, indent, register_namespace, tostring

from astb.fmu.export import write_unit
from astb.fmu.unit import Kind, Unit, Variable
from bench_protocol.unit_names import base_exponents

#: The latest version whose FMUs SSP 1.0 allows.
_FMI: Final = 2
_SSD: Final = "http://ssp-standard.org/SSP1/SystemStructureDescription"
_SSC: Final = "http://ssp-standard.org/SSP1/SystemStructureCommon"
#: A variable from one component to another; an empty name is the system around them.
_Connection = tuple[str, str, Variable]


def write_system(name: str, units: Mapping[str, Unit], to: Path, *, native: bool) -> None:
    """Write ``units`` as FMUs into an SSP file, with outputs connected to inputs of the same name.

    The keys of ``units`` are the names of the components. Raises the errors of `write_unit`.
    """
    with TemporaryDirectory() as folder:
        fmus = {component: Path(folder) / f"{component}.fmu" for component in units}
        for component, fmu in fmus.items():
            write_unit(units[component], fmu, fmi=_FMI, native=native)
        with zipfile.ZipFile(to, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("SystemStructure.ssd", _structure(name, units))
            for fmu in fmus.values():
                archive.write(fmu, f"resources/{fmu.name}")


def _structure(name: str, units: Mapping[str, Unit]) -> bytes:
    register_namespace("ssd", _SSD)
    register_namespace("ssc", _SSC)
    connections = [*_connections(units)]
    root = Element(f"{{{_SSD}}}SystemStructureDescription", version="1.0", name=name)
    system = SubElement(root, f"{{{_SSD}}}System", name=name)
    _connectors(system, "", connections)
    elements = SubElement(system, f"{{{_SSD}}}Elements")
    for component in units:
        about = {"name": component, "source": f"resources/{component}.fmu"}
        one = SubElement(elements, f"{{{_SSD}}}Component", about, type="application/x-fmu-sharedlibrary")
        _connectors(one, component, connections)
    listed = SubElement(system, f"{{{_SSD}}}Connections")
    for source, sink, variable in connections:
        ends = {"startElement": source, "endElement": sink}
        ends = {end: component for end, component in ends.items() if component}
        ends |= {
            "startConnector": _connector_name(source, variable),
            "endConnector": _connector_name(sink, variable),
        }
        SubElement(listed, f"{{{_SSD}}}Connection", ends)
    defined = SubElement(root, f"{{{_SSD}}}Units")
    for unit in sorted({variable.unit for *_, variable in connections}):
        exponents = {base: str(power) for base, power in base_exponents(unit).items()}
        SubElement(SubElement(defined, f"{{{_SSC}}}Unit", name=unit), f"{{{_SSC}}}BaseUnit", exponents)
    SubElement(root, f"{{{_SSD}}}DefaultExperiment", startTime="0", stopTime="10")
    indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="utf-8") + b"\n"


def _connections(units: Mapping[str, Unit]) -> Iterator[_Connection]:
    """Yield the connections between components, then those between other variables and the system.

    Some tools set an input of a system to 0. So an input with another start value stays inside its component.
    """
    fed = set()
    for source, sink in permutations(units, 2):
        inputs = {one.name for one in units[sink].variables if one.kind in (Kind.MOTION, Kind.INPUT)}
        for one in units[source].variables:
            if one.kind is Kind.OUTPUT and one.name in inputs:
                fed.add(one.name)
                yield source, sink, one
    for component, unit in units.items():
        for one in unit.variables:
            if one.name in fed:
                continue
            if one.kind is Kind.OUTPUT:
                yield component, "", one
            elif one.kind in (Kind.MOTION, Kind.INPUT) and one.start == 0.0:
                yield "", component, one


def _connector_name(component: str, variable: Variable) -> str:
    """Return the name of a connector.

    At the system it has no dots, because ``car.wind`` could also mean ``wind`` of the component ``car``.
    """
    return variable.name if component else variable.name.replace(".", "_")


def _connectors(element: Element, component: str, connections: Sequence[_Connection]) -> None:
    listed = SubElement(element, f"{{{_SSD}}}Connectors")
    for source, sink, variable in connections:
        if component in (source, sink):
            # An input of the system is the source of a connection.
            inward = (component == sink) if component else (component == source)
            one = SubElement(
                listed,
                f"{{{_SSD}}}Connector",
                name=_connector_name(component, variable),
                kind="input" if inward else "output",
            )
            SubElement(one, f"{{{_SSC}}}Real", unit=variable.unit)
