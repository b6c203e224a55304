"""An independent FMU of an air spring: a C file and a description with other units."""

import platform
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

HERE = Path(__file__).parent

_VARIABLES = (
    ("travel", "input", "mm"),
    ("sideways", "input", "mm"),
    ("speed", "input", "mm/s"),
    ("air", "input", "g/s"),
    ("F", "output", "kN"),
    ("shear", "output", "kN"),
    ("p_bag", "output", "bar"),
    ("landed", "output", ""),
    ("area", "parameter", "mm2"),
)
_UNITS = {
    "mm": '<BaseUnit m="1" factor="0.001"/>',
    "mm/s": '<BaseUnit m="1" s="-1" factor="0.001"/>',
    "g/s": '<BaseUnit kg="1" s="-1" factor="0.001"/>',
    "kN": '<BaseUnit kg="1" m="1" s="-2" factor="1000"/>',
    "bar": '<BaseUnit kg="1" m="-1" s="-2" factor="100000"/>',
    "mm2": '<BaseUnit m="2" factor="1e-6"/>',
}
_STARTS = {"input": ' start="0"', "parameter": ' start="260000"', "output": ""}

#: The map of such an FMU: an instance a side, whose air the bench's own valves let in.
MAP = """
[simulation.spring_map.inputs]
height = "travel"
lateral = "sideways"
height_speed = "speed"
air_flow = "air"

[simulation.spring_map.outputs]
vertical_force = "F"
lateral_force = "shear"
bellows_pressure = "p_bag"
"""


def strange_spring(to: Path, bad: int = 0, fmi: int = 2, **units: str) -> Path:
    """Write the FMU to a file and return its path; variables named in ``units`` have other ones.

    ``bad``: what it does at 2 s: 1 returns an error, 2 gives NaN, 3 crashes, 4 hangs.
    """
    return build_c(
        HERE / "c" / _SOURCES[fmi], _description(units, fmi), to, fmi, *([f"-DBAD={bad}"] if bad else [])
    )


def build_c(source: Path, description: str, to: Path, fmi: int = 2, *flags: str) -> Path:
    """Write an FMU of a file in C and a description to a file, and return its path."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler here, and an FMU in C is to be made")
    library = to.with_suffix(".so")
    usual = ["-O2", "-shared", "-fPIC", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([compiler, *usual, *flags, "-o", str(library), str(source), "-lm"], check=True)
    (identifier,) = re.findall(r'modelIdentifier="(\w+)"', description)
    with zipfile.ZipFile(to, "w") as archive:
        archive.writestr("modelDescription.xml", description)
        archive.write(library, f"binaries/{_PLATFORMS[fmi]}/{identifier}.so")
    return to


_PLATFORMS = {2: "linux64" if sys.maxsize > 2**32 else "linux32", 3: f"{platform.machine()}-linux"}
_SOURCES = {2: "strange.c", 3: "strange3.c"}
_TOKENS = {2: "guid", 3: "instantiationToken"}


def _description(units: dict[str, str], fmi: int) -> str:
    rows, outputs = [], []
    for reference, (name, causality, usual) in enumerate(_VARIABLES):
        unit = units.get(name, usual)
        varies = "fixed" if causality == "parameter" else "continuous"
        named = f'name="{name}" valueReference="{reference}" causality="{causality}" variability="{varies}"'
        said = f' unit="{unit}"' if unit else ""
        valued = f"{said}{_STARTS[causality]}/>"
        rows.append(
            f"<ScalarVariable {named}><Real{valued}</ScalarVariable>"
            if fmi == 2
            else f"<Float64 {named}{valued}"
        )
        if causality == "output":
            outputs.append(
                f'<Unknown index="{reference + 1}"/>'
                if fmi == 2
                else f'<Output valueReference="{reference}"/>'
            )
    defined = "".join(f'<Unit name="{name}">{base}</Unit>' for name, base in _UNITS.items())
    text = "".join(outputs)
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="{fmi}.0" modelName="strange" {_TOKENS[fmi]}="{{strange}}">
<CoSimulation modelIdentifier="strange" canHandleVariableCommunicationStepSize="true"/>
<UnitDefinitions>{defined}</UnitDefinitions>
<ModelVariables>{"".join(rows)}</ModelVariables>
<ModelStructure>{f"<Outputs>{text}</Outputs>" if fmi == 2 else text}</ModelStructure>
</fmiModelDescription>
"""
