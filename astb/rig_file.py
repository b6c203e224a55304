"""A rig file: the TOML that says where a rig is, and, if it is a simulated one, what it simulates."""

import re
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec
from msgspec import Meta
from msgspec.structs import replace

from bench_protocol.input_limits import Unfit, read_toml
from bench_protocol.misfit import misfit
from bench_protocol.named_files import named_files
from bench_sim.rig.spring_fmu.keys import SpringMap
from drivers.wiring.astb.keys import Can, Modbus

#: The package with the files of the rigs that come with the bench, and the folder with those of whoever stands there.
PACKAGE: Final = "rigs"
#: The rig that commands take without being told: it simulates in real time.
ORDINARY: Final = "local"
#: What every generator of random numbers takes.
SEED_MAX: Final = 2**32 - 1


class RigFileError(ValueError):
    """The rig file does not say what is needed, or says what nobody understands."""


class SimulatedCan(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """What a simulated CAN bus is like: without a bit rate it takes no time and makes no mistakes."""

    bit_rate: str = ""  #: 500k, 1M or bit/s
    stuffing: Literal["exact", "worst"] = "exact"  #: stuff bits of the content, or every possible one
    error_rate: Annotated[float, Meta(ge=0, lt=1)] = 0.0  #: fraction of the frames that fail and are repeated
    restart: Annotated[float, Meta(ge=0)] = (
        0.0  #: s that a node stays off the bus before it begins to recover
    )


class FaultEntry(msgspec.Struct, forbid_unknown_fields=True, frozen=True, rename={"lasting": "for"}):
    """A fault on purpose that a simulated rig has, from a time on and for a time, or from the start and for good."""

    name: str
    at: str = "0 s"  #: of the rig's time, which begins when it starts
    lasting: str | None = None
    values: dict[str, str | int | float] = {}  #: of its parameters, each with its unit


class Simulation(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """What a simulated rig simulates. A rig file without this table is never simulated and never started."""

    parameters: str = "astb"  #: name of a parameter set, or the path of its TOML file or of a model file
    seed: Annotated[int, Meta(ge=0, le=SEED_MAX)] = 0
    late_ticks: Literal["catch_up", "skip", "fault"] = "catch_up"
    change: dict[str, Any] = {}  #: over those of the set, each with its unit: orifice_diameter = "18 mm"
    effects: dict[str, Any] = {}  #: what else the bench has: "leak.left" = "0.2 mm2"
    limits: tuple[dict[str, Any], ...] = ()  #: over the assumed ones: `astb rig limits`
    sealed: str = ""  #: path of a file of effects that nobody is told
    spring: str = ""  #: path of an FMU that computes the springs
    spring_map: SpringMap = SpringMap()  #: which of its variables are what
    can: SimulatedCan = SimulatedCan()
    faults: tuple[FaultEntry, ...] = ()  #: what else breaks, and when: `astb rig fault list`


class RigFile(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """One rig."""

    name: str
    description: str = ""
    time: Literal["real", "virtual"] = "real"
    can: Can = Can()
    modbus: Modbus = Modbus()
    simulation: Simulation | None = None
    instruments: str = ""  #: path of the file of its instruments, seen from this one, or their name
    dimensions: str = ""  #: path of the file of its dimensions, seen from this one, or their name
    wiring: str | dict[str, Any] = (
        ""  #: of a rig that speaks otherwise: path of its file, its name, or its keys
    )
    limits: tuple[dict[str, Any], ...] = ()  #: of a real rig, as far as they are known: for rehearsals


def rigs() -> dict[str, Path]:
    """Return the rigs that have a name: those that come with the bench, and over them those in ``rigs/`` here."""
    here = {path.stem: path for path in sorted(Path(PACKAGE).glob("*.toml"))}
    return named_files(PACKAGE) | here


def find_rig(rig: str | Path = ORDINARY) -> tuple[RigFile, Path]:
    """Return a rig and the path of its file, by that path or by the name of one of the `rigs`.

    RigFileError where there is none, or where it is not one.
    """
    path = Path(rig)
    if path.suffix == ".toml" or path.parent != Path() or path.is_file():
        return read(path), path
    known = rigs()
    if str(rig) in known:
        return read(known[str(rig)]), known[str(rig)]
    if not path.exists():
        raise RigFileError(
            f"there is no rig {str(rig)!r}: the path of a rig file, or {' or '.join(sorted(known))}"
        )
    return read(path), path


def read(path: Path) -> RigFile:
    """Return the rig described in ``path``; the files that it simulates with lie where they do seen from there.

    Raises RigFileError, naming the file, the key and what would be right.
    """
    try:
        content = read_toml(path)
    except OSError as error:
        raise RigFileError(f"rig file {path} cannot be read: {error.strerror}; --rig names another") from None
    except Unfit as error:
        raise RigFileError(f"rig file {path} {error}") from None
    try:
        rig = msgspec.convert(content, RigFile)
    except msgspec.ValidationError as error:
        raise RigFileError(f"rig file {path}: {_in_words(error, content)}") from None
    if rig.time == "virtual" and rig.simulation is None:
        raise RigFileError(
            f"rig file {path}: time = virtual needs a [simulation] table, a real rig has real time"
        )
    if rig.limits and rig.simulation is not None:
        raise RigFileError(
            f"rig file {path}: limits beside simulation: those of a simulated rig are simulation.limits"
        )
    beside = [key for key in ("can", "modbus", "simulation") if key in content]
    if rig.wiring and beside:
        raise RigFileError(
            f"rig file {path}: {' and '.join(beside)} beside wiring: a rig with a wiring is a real one, and its "
            "addresses are the wiring's; right is one of them"
        )
    return rig if rig.simulation is None else replace(rig, simulation=_placed(rig.simulation, path.parent))


def _placed(simulation: Simulation, home: Path) -> Simulation:
    """Return the simulation with whole paths, for whoever starts it from another directory; names stay names."""
    parameters, sealed, spring = simulation.parameters, simulation.sealed, simulation.spring
    if Path(parameters).suffix == ".toml":
        parameters = str((home / parameters).resolve())
    sealed, spring = (text and str((home / text).resolve()) for text in (sealed, spring))
    return replace(simulation, parameters=parameters, sealed=sealed, spring=spring)


def _in_words(error: Exception, content: dict[str, Any]) -> str:
    """Return what msgspec says of ``content``, with the key as people write it, its value and what would be right."""
    said, _, place = str(error).partition(" - at `$")
    # Of a table with keys of the user's own msgspec says only that it is one of its values.
    keys = [key for key in place.rstrip("`").replace("[...]", "").split(".") if key]
    tables: dict[str, type[msgspec.Struct]] = {
        "can": Can,
        "modbus": Modbus,
        "simulation": Simulation,
        "simulation.can": SimulatedCan,
        "simulation.spring_map": SpringMap,
        "simulation.faults": FaultEntry,
    }
    path = re.sub(r"\[\d+\]", "", ".".join(keys)).split(".")
    table = next((tables[".".join(path[:n])] for n in (2, 1) if ".".join(path[:n]) in tables), RigFile)
    fields = {field.encode_name: field.type for field in msgspec.structs.fields(table)}
    if unknown := re.fullmatch("Object contains unknown field `(.*)`", said):
        near = get_close_matches(unknown[1], fields, n=1)
        right = f"{near[0]} would be one" if near else f"there are {', '.join(fields)}"
        return f"{'.'.join([*keys, unknown[1]])} is no key of a rig file; {right}"
    if missing := re.fullmatch("Object missing required field `(.*)`", said):
        return f"the key {'.'.join([*keys, missing[1]])} is missing"
    return misfit(error, content, RigFile)
