"""An FMU of the springs: object code of the model, the functions of FMI around it, a description, a page, a licence."""

import hashlib
import json
import platform
import shutil
import subprocess
import zipfile
from collections.abc import Sequence
from contextlib import suppress
from html import escape
from importlib.metadata import distribution, version
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from bench_fmu.description import IDENTIFIER, model_description
from bench_fmu.variables import MOTIONS, Kind, Variable, variables
from bench_protocol.rates import TICK
from bench_protocol.system import LINUX
from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.layout import EXTRA_BRANCHES, EXTRA_DASHPOTS, INPUTS, STATES, State
from bench_sim.model.quantities import MEMORY, PARAMETERS
from bench_sim.parameters import Parameters

#: Versions of FMI that there are.
VERSIONS: Final = (2, 3)
_FLAGS: Final = ("-O2", "-std=c99", "-fPIC", "-fvisibility=hidden", "-Wall", "-Wextra", "-Werror")
_COMPILED: Final = ("advance", "start")
#: Pairs of parameters that only make sense in one order.
_ORDERS: Final = (
    ("dpv_reclosing", "dpv_opening"),
    ("sawtooth_low", "sawtooth_high"),
    ("left.leveling_hysteresis", "left.leveling_deadband"),
    ("right.leveling_hysteresis", "right.leveling_deadband"),
)


class ExportError(Exception):
    """An FMU cannot be made here; the message says what is missing."""


def write_springs(
    parameters: Parameters, to: Path, *, fmi: int, native: bool = False, compiled: Path | None = None
) -> str:
    """Write an FMU of both springs with their valves, and return its token (GUID).

    It runs on every processor of this architecture unless it is ``native``. ``compiled`` is a folder in which
    `compile_springs` was: several FMUs may have what it made. Raises `ExportError` or OSError.
    """
    compiler = _compiler()
    machine = platform.machine()
    every = variables(parameters)
    token = _token(parameters, every, fmi)
    description = model_description(
        every,
        fmi=fmi,
        token=token,
        name=f"{parameters.name} {parameters.load_case}",
        said=f"Both air springs of {parameters.name} under {parameters.load_case}, with their valves and supply",
        version=version("astb"),
    )
    with TemporaryDirectory() as folder:
        place = Path(folder)
        if compiled is None:
            compile_springs(place, native=native)
        (place / "model.h").write_text(_header(parameters, every, token), encoding="utf-8")
        library = _link(compiler, place, compiled or place, fmi)
        # as FMI names platforms
        where = "linux64" if fmi == 2 and machine == "x86_64" else f"{machine}-linux"
        with zipfile.ZipFile(to, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("modelDescription.xml", description)
            archive.write(library, f"binaries/{where}/{IDENTIFIER}.so")
            archive.writestr("documentation/index.html", _page(parameters, every))
            archive.writestr("documentation/licenses/license.txt", _licence())
    return token


def _compiler() -> str:
    if not LINUX:
        raise ExportError(f"FMUs are made on Linux only so far; this is {platform.system()}")
    for name in ("cc", "gcc", "clang"):
        if found := shutil.which(name):
            return found
    raise ExportError(
        "no C compiler is here (cc, gcc or clang), and what FMI calls is written in C: install one, such as with "
        "`apt-get install gcc libc6-dev`; where the FMU runs none is needed"
    )


def _licence() -> str:
    with suppress(OSError):
        for file in distribution("astb").files or ():
            if file.name == "LICENSE":
                return str(file.read_text())
    return "Apache-2.0: https://www.apache.org/licenses/LICENSE-2.0\n"


def _token(parameters: Parameters, every: Sequence[Variable], fmi: int) -> str:
    """Return a GUID that is another one for other values, variables, laws or functions of FMI."""
    from bench_sim.model.compiled import digest_of

    digest = hashlib.sha256(digest_of([*files("bench_fmu").iterdir()]).encode())
    for source in sorted(files("bench_fmu").joinpath("c").iterdir(), key=lambda one: one.name):
        digest.update(source.read_bytes())
    digest.update(json.dumps([parameters.digest(), fmi, [one.name for one in every]]).encode())
    text = digest.hexdigest()
    return f"{{{text[:8]}-{text[8:12]}-{text[12:16]}-{text[16:20]}-{text[20:32]}}}"


def _header(parameters: Parameters, every: Sequence[Variable], token: str) -> str:
    """Return ``model.h``: sizes, places, and the table of variables with their bounds and starts."""
    fields: Any = PARAMETERS.fields
    references = {one.name: one.place for one in every if one.kind in (Kind.FIXED, Kind.TUNABLE)}
    places = {
        "ATMOSPHERE": fields["atmospheric_pressure"][1] // 8,
        "MEMBRANE": fields["membrane_length"][1] // 8,
        "MEMBRANE_SLOPE": fields["membrane_length_slope"][1] // 8,
        "PRELOAD": fields["nominal_preload"][1] // 8,
        "EMERGENCY": fields["emergency_spring"][1] // 8,
        "EMERGENCY_STIFFNESS": fields["emergency_stiffness_vertical"][1] // 8,
        "LEVER": int(State.LEVER),
        "PIPE_LENGTH": fields["pipe_length"][1] // 8,
        "PIPE_DIAMETER": fields["pipe_diameter"][1] // 8,
        "BELLOWS_VERTICAL": int(Algebraic.BELLOWS_VERTICAL),
        "PRESSURE": int(Algebraic.PRESSURE),
        "AUXILIARY_PRESSURE": int(Algebraic.AUXILIARY_PRESSURE),
        "STATES": STATES,
        "INPUTS": INPUTS,
        "MOTIONS": len(MOTIONS),
        "ALGEBRAICS": ALGEBRAICS,
        "PARAMETERS": PARAMETERS.itemsize // 8,
        "MEMORY_RECORD": MEMORY.itemsize,
        # The springs' part of the memory stands before that of actuators and sensors.
        "MEMORY_DOUBLES": _springs_memory() // 8,
        "EXTRA_BRANCHES": EXTRA_BRANCHES,
        "EXTRA_DASHPOTS": EXTRA_DASHPOTS,
        "VARIABLES": len(every),
        "ORDERS": len(_ORDERS),
    }
    kinds = ", ".join(kind.name for kind in Kind)
    defaults = np.frombuffer(np.asarray(parameters.record).tobytes(), dtype=np.float64)
    rows = ",\n".join(
        f"    {{{one.kind.name}, {one.place}, {_number(one.start or 0.0)}, {_number(one.low)}, {_number(one.high)}, "
        f"{json.dumps(one.name)}, {json.dumps(one.unit)}}}"
        for one in every
    )
    orders = ",\n".join(
        f"    {{{references[low]}, {references[high]}, {json.dumps(low)}, {json.dumps(high)}}}"
        for low, high in _ORDERS
    )
    return "\n".join(
        (
            "/* Written when the FMU was made. */",
            "#include <math.h>",
            f"#define TOKEN {json.dumps(token)}",
            f"#define TICK {_number(TICK)}",
            f"enum {{ {', '.join(f'{name} = {value}' for name, value in places.items())} }};",
            f"enum {{ {kinds} }};",
            "typedef struct { int kind, place; double start, low, high; const char *name, *unit; } Variable;",
            "typedef struct { int low, high; const char *name, *than; } Order;",
            f"static const Variable VARIABLE[] __attribute__((unused)) = {{\n{rows}\n}};",
            f"static const Order ORDER[] __attribute__((unused)) = {{\n{orders}\n}};",
            "static const double DEFAULTS[] __attribute__((unused)) = {",
            ", ".join(map(_number, map(float, defaults))),
            "};\n",
        )
    )


def _springs_memory() -> int:
    """Bytes of `MEMORY` before the first field that no spring has."""
    fields: Any = MEMORY.fields
    return int(fields["mode"][1])


def _number(value: float) -> str:
    """Return a number as C reads exactly that one."""
    if np.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return value.hex()


def compile_springs(place: Path, *, native: bool = False) -> None:
    """Compile the springs into two object files in the folder ``place``: no number of theirs is in them yet."""
    import numba
    from numba import types

    from bench_fmu.kernel import advance, start
    from bench_fmu.object_code import write_object

    number, row, rows = types.float64, types.Array(types.float64, 1, "C"), types.Array(types.float64, 2, "C")
    memory, record = (types.Array(numba.from_dtype(kind), 1, "C") for kind in (MEMORY, PARAMETERS))
    given = row, memory, row, record, row
    for function, symbol, further in (
        (advance, "spring_advance", (number, number, types.int64, rows, row)),
        (start, "spring_start", (number, rows, row, rows, rows, row)),
    ):
        path = place / f"{symbol}.o"
        write_object(function, (*given, *further), symbol, path, native=native)


def _link(compiler: str, place: Path, compiled: Path, fmi: int) -> Path:
    sources = files("bench_fmu").joinpath("c")
    for name in ("springs.h", "springs.c", f"fmi{fmi}.c"):
        (place / name).write_bytes(sources.joinpath(name).read_bytes())
    library = place / f"{IDENTIFIER}.so"
    objects = (
        "springs.c",
        f"fmi{fmi}.c",
        *(str(compiled.resolve() / f"spring_{one}.o") for one in _COMPILED),
    )
    command = [compiler, *_FLAGS, "-shared", "-Wl,--no-undefined", "-o", library.name, *objects, "-lm"]
    done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise ExportError(
            f"{compiler} could not make the library (status {done.returncode}):\n{done.stderr.strip()}"
        )
    return library


def _page(parameters: Parameters, every: Sequence[Variable]) -> str:
    rows = "\n".join(
        f"<tr><td>{escape(one.name)}</td><td>{one.kind.name.lower()}</td><td>{escape(one.unit)}</td>"
        f"<td>{'' if one.start is None else f'{one.start:g}'}</td><td>{escape(one.description)}</td></tr>"
        for one in every
    )
    return f"""<!DOCTYPE html>
<html lang="en"><meta charset="utf-8"><title>Air springs</title>
<h1>Both air springs of {escape(parameters.name)} under {escape(parameters.load_case)}</h1>
<p>Two air springs with auxiliary chambers, orifices, leveling and service valves, differential pressure valve and
supply. They are driven by how far they are stretched, and say what they do to what stands on them. Units are SI;
pressures are over the atmosphere, heights over design height, lateral positions to the left.</p>
<p>It begins at rest, with relaxed rubber and the pressure that carries its preload. Within a communication step the
displacements go on with the speeds that were given with them. Inside, steps are {TICK * 1e3:g} ms long: what is left
of one at the end of a communication step belongs to the next.</p>
<table><tr><th>name</th><th>kind</th><th>unit</th><th>start</th><th></th></tr>
{rows}
</table></html>
"""
