"""Export of an FMU: object code of the model, the functions of FMI, a description, a page, a licence."""

import hashlib
import json
import platform
import shutil
import subprocess
import zipfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from html import escape
from importlib.metadata import distribution, version
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from astb.fmu.description import model_description
from astb.fmu.unit import Code, Kind, Unit
from bench_protocol.rates import TICK
from bench_protocol.runtime import LINUX
from bench_protocol.runtime.sources import digest_of

#: Instructions that every processor of the architecture has.
_BASELINE: Final = {"x86_64": "x86-64", "aarch64": "generic"}


@dataclass(frozen=True, slots=True)
class Platform:
    """An operating system with a processor, for which an FMU contains a library.

    ``name`` and ``fmi2`` are its names in FMI 3.0 and 2.0. ``triple`` is its name in LLVM.
    """

    name: str
    fmi2: str
    triple: str
    compilers: tuple[str, ...]
    ending: str
    flags: tuple[str, ...] = ()


_MACHINE: Final = platform.machine()
_LINUX: Final = Platform(
    f"{_MACHINE}-linux",
    "linux64" if _MACHINE == "x86_64" else f"{_MACHINE}-linux",
    f"{_MACHINE}-unknown-linux-gnu",
    ("cc", "gcc", "clang"),
    ".so",
    ("-fPIC", "-fvisibility=hidden"),
)
#: Statically linked, because Windows has no library of the compiler.
WINDOWS: Final = Platform(
    "x86_64-windows",
    "win64",
    "x86_64-w64-windows-gnu",
    ("x86_64-w64-mingw32-gcc",),
    ".dll",
    ("-static",),
)


def write_objects(
    function: Callable[..., Any],
    types: tuple[Any, ...],
    symbol: str,
    to: Mapping[Platform, Path],
    *,
    native: bool,
) -> None:
    """Compile ``function`` for arguments of these ``types``, and write it as ``symbol`` into a file for each platform.

    The code runs on any processor of this architecture; with ``native`` only on processors like this one. It has the
    calling convention of numba: a place for the result, one for the exception, then the arguments, each array as owner,
    parent, number and size of elements, address, shape, strides.
    """
    import llvmlite.binding as llvm
    import numba

    # Without numba's runtime and without wrappers for Python nothing is left that would need an interpreter.
    options: Any = {"_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    compiled: Any = numba.njit(fastmath=False, error_model="numpy", **options)(function)
    compiled.compile(types)
    made = compiled.overloads[types]
    module = llvm.parse_assembly(made.library.get_llvm_str())
    for variable in module.global_variables:
        if not variable.is_declaration:
            variable.linkage = "internal"
    entry = module.get_function(made.fndesc.llvm_func_name)
    entry.name, entry.visibility = symbol, "hidden"
    for one in module.functions:
        if not one.is_declaration and one.name != symbol:
            one.linkage = "internal"
    cpu = llvm.get_host_cpu_name() if native else _BASELINE.get(_MACHINE, "generic")
    features = llvm.get_host_cpu_features().flatten() if native else ""
    for system, file in to.items():
        target = llvm.Target.from_triple(system.triple)
        emitter = target.create_target_machine(
            cpu=cpu, features=features, opt=3, reloc="pic", codemodel="default"
        )
        # Emission changes a module.
        mine = module.clone()
        mine.triple, mine.data_layout = system.triple, str(emitter.target_data)
        file.write_bytes(emitter.emit_object(mine))


#: Supported versions of FMI.
VERSIONS: Final = (2, 3)
_FLAGS: Final = ("-O2", "-std=c99", "-Wall", "-Wextra", "-Werror", "-shared", "-Wl,--no-undefined")
_COMPILED: Final = ("advance", "start")


class ExportError(Exception):
    """An FMU cannot be built on this machine; the message states what is missing."""


def write_unit(unit: Unit, to: Path, *, fmi: int, native: bool = False, compiled: Path | None = None) -> str:
    """Write ``unit`` as an FMU for `platforms`, and return its token (GUID).

    The FMU runs on every processor of this architecture, with ``native`` only on processors like this one. ``compiled``
    is a folder with the output of `compile_code`, which several FMUs can share. Raises `ExportError` without a C
    compiler or if it fails, OSError if a file cannot be written.
    """
    found = platforms()
    token = _token(unit, fmi)
    description = model_description(unit, fmi=fmi, token=token, version=version("astb"))
    with TemporaryDirectory() as folder:
        place = Path(folder)
        if compiled is None:
            compile_code(unit.code, place, native=native)
        (place / "model.h").write_text(_header(unit, token), encoding="utf-8")
        libraries = {
            system: _link(system, compiler, place, compiled or place, unit.code, fmi)
            for system, compiler in found.items()
        }
        with zipfile.ZipFile(to, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("modelDescription.xml", description)
            for system, library in libraries.items():
                where = system.fmi2 if fmi == 2 else system.name
                archive.write(library, f"binaries/{where}/{library.name}")
            archive.writestr("documentation/index.html", _page(unit))
            archive.writestr("documentation/licenses/license.txt", _licence())
    return token


def platforms() -> Mapping[Platform, str]:
    """Return the platforms for which FMUs can be made here, with their C compilers.

    Windows is one of them if mingw-w64 is installed. Raises `ExportError` if there is none.
    """
    if not LINUX:
        raise ExportError(
            f"FMUs can be made only on Linux; this is {platform.system()}; use a Linux computer"
        )
    # numba compiles for this processor, so its code for Windows is for the same one.
    systems = (_LINUX, WINDOWS) if _MACHINE == "x86_64" else (_LINUX,)
    found = {
        one: path for one in systems if (path := next(filter(None, map(shutil.which, one.compilers)), None))
    }
    if _LINUX not in found:
        raise ExportError(
            "no C compiler (cc, gcc or clang) was found, which is necessary to make an FMU, but not to run it; install "
            "one, such as with `apt-get install gcc libc6-dev`"
        )
    return found


def _licence() -> str:
    with suppress(OSError):
        for file in distribution("astb").files or ():
            if file.name == "LICENSE":
                return str(file.read_text())
    return "Apache-2.0: https://www.apache.org/licenses/LICENSE-2.0\n"


def _token(unit: Unit, fmi: int) -> str:
    """Return a GUID that depends on values, variables, the code of the model and the C functions."""
    digest = hashlib.sha256(
        str(digest_of(__name__, unit.code.start.__module__, unit.code.advance.__module__)).encode()
    )
    for source in sorted(files("astb.fmu").joinpath("c").iterdir(), key=lambda one: one.name):
        digest.update(source.read_bytes())
    digest.update(unit.defaults.tobytes())
    lines = [unit.code.name, fmi, *(f"{one.name} {one.start}" for one in unit.variables)]
    digest.update(json.dumps(lines).encode())
    text = digest.hexdigest()
    return f"{{{text[:8]}-{text[8:12]}-{text[12:16]}-{text[16:20]}-{text[20:32]}}}"


def _header(unit: Unit, token: str) -> str:
    """Return ``model.h``: sizes, indices, and the table of variables with their bounds and start values."""
    code = unit.code
    references = {one.name: one.place for one in unit.variables if one.kind in (Kind.FIXED, Kind.TUNABLE)}
    places = {
        **unit.places,
        "STATES": code.states,
        "INPUTS": code.inputs,
        "MOTIONS": max(code.motions, 1),
        "OUTPUTS": code.outputs,
        "ROWS": code.rows,
        "PARAMETERS": code.parameters.itemsize // 8,
        "MEMORY_RECORD": code.memory.itemsize,
        "MEMORY_DOUBLES": code.remembered // 8,
        "VARIABLES": len(unit.variables),
        "ORDERS": len(unit.orders),
    }
    kinds = ", ".join(kind.name for kind in Kind)
    rows = ",\n".join(
        f"    {{{one.kind.name}, {one.place}, {int(one.whole)}, {_number(one.start or 0.0)}, {_number(one.low)}, "
        f"{_number(one.high)}, {json.dumps(one.name)}, {json.dumps(one.unit)}}}"
        for one in unit.variables
    )
    orders = ",\n".join(
        f"    {{{references[low]}, {references[high]}, {json.dumps(low)}, {json.dumps(high)}}}"
        for low, high in unit.orders
    )
    return "\n".join(
        (
            "/* Written when the FMU was made. */",
            "#include <math.h>",
            f"#define TOKEN {json.dumps(token)}",
            f"#define TICK {_number(TICK)}",
            f"enum {{ {', '.join(f'{name} = {value}' for name, value in places.items())} }};",
            f"enum {{ {kinds} }};",
            "typedef struct { int kind, place, whole; double start, low, high; const char *name, *unit; } Variable;",
            "typedef struct { int low, high; const char *name, *than; } Order;",
            f"static const Variable VARIABLE[] __attribute__((unused)) = {{\n{rows}\n}};",
            f"static const Order ORDER[] __attribute__((unused)) = {{\n{orders or '    {0, 0, 0, 0}'}\n}};",
            "static const double DEFAULTS[] __attribute__((unused)) = {",
            ", ".join(map(_number, map(float, unit.defaults))),
            "};\n",
        )
    )


def _number(value: float) -> str:
    """Return a number in C notation, exact to the last bit."""
    if np.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return value.hex()


def compile_code(code: Code, place: Path, *, native: bool = False) -> None:
    """Compile ``code`` into two object files for each of `platforms` in the folder ``place``.

    The object files do not depend on values of parameters. Raises `ExportError` without a C compiler.
    """
    import numba

    types = numba.types
    number, row, rows = types.float64, types.Array(types.float64, 1, "C"), types.Array(types.float64, 2, "C")
    memory, record = (types.Array(numba.from_dtype(kind), 1, "C") for kind in (code.memory, code.parameters))
    given = row, memory, row, record, row
    for function, name, further in (
        (code.advance, "advance", (number, number, types.int64, rows, row)),
        (code.start, "start", (number, rows, row)),
    ):
        objects = {system: place / _object(system, code, name) for system in platforms()}
        write_objects(function, (*given, *further), f"model_{name}", objects, native=native)


def _object(system: Platform, code: Code, function: str) -> str:
    return f"{code.name}_{function}.{system.name}.o"


def _link(system: Platform, compiler: str, place: Path, compiled: Path, code: Code, fmi: int) -> Path:
    sources = files("astb.fmu").joinpath("c")
    written = "unit.c", f"fmi{fmi}.c", code.checks
    for name in ("unit.h", *written):
        (place / name).write_bytes(sources.joinpath(name).read_bytes())
    library = place / f"{code.name}{system.ending}"
    objects = *written, *(str(compiled.resolve() / _object(system, code, one)) for one in _COMPILED)
    command = [compiler, *_FLAGS, *system.flags, "-o", library.name, *objects, "-lm"]
    done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise ExportError(
            f"{compiler} made no library (status {done.returncode}); use another compiler:\n{done.stderr.strip()}"
        )
    return library


def _page(unit: Unit) -> str:
    rows = "\n".join(
        f"<tr><td>{escape(one.name)}</td><td>{one.kind.name.lower()}</td><td>{escape(one.unit)}</td>"
        f"<td>{'' if one.start is None else f'{one.start:g}'}</td><td>{escape(one.description)}</td></tr>"
        for one in unit.variables
    )
    about = "\n".join(f"<p>{escape(text)}</p>" for text in unit.about)
    return f"""<!DOCTYPE html>
<html lang="en"><meta charset="utf-8"><title>{escape(unit.name)}</title>
<h1>{escape(unit.said)}</h1>
{about}
<p>The internal step is {TICK * 1e3:g} ms. The rest of a communication step that is shorter than one internal step is
added to the next.</p>
<table><tr><th>name</th><th>kind</th><th>unit</th><th>start</th><th></th></tr>
{rows}
</table></html>
"""
