"""A rig file: the TOML that states the addresses of a rig, and the simulation of a simulated one."""

from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec
from msgspec import Meta
from msgspec.structs import replace

from bench_protocol.input_limits import read_toml
from bench_protocol.misfit import misfit
from bench_protocol.named_files import OF_A_RIG, ORDINARY_RIG, earlier, named_files, place_of
from bench_protocol.os_errors import file_errors
from bench_protocol.suggestion import did_you_mean
from bench_sim.rig.spring_fmu.keys import SpringMap
from drivers.wiring.astb.keys import Can, Modbus

#: The kind of the named rig files, and the folder of a user's own rigs.
PACKAGE: Final = "rigs"
#: The default rig of commands, which is simulated in real time.
ORDINARY: Final = ORDINARY_RIG
#: The name of a rig file in the folder of a rig.
RIG: Final = OF_A_RIG[PACKAGE]
#: The other files of a rig, by the keys of `RigFile` that hold their paths.
_PARTS: Final = {"wiring": "wirings", "dimensions": "dimensions", "instruments": "instruments"}
#: Range of a seed for every generator of random numbers.
SEED_MAX: Final = 2**32 - 1


class RigFileError(ValueError):
    """A rig file that lacks a required key, or has an invalid one."""


class SimulatedCan(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The properties of a simulated CAN bus: without a bit rate frames take no time and never fail."""

    bit_rate: str = ""  #: 500k, 1M or bit/s
    stuffing: Literal["exact", "worst"] = "exact"  #: stuff bits of the content, or every possible one
    error_rate: Annotated[float, Meta(ge=0, lt=1)] = 0.0  #: fraction of the frames that fail and are repeated
    restart: Annotated[float, Meta(ge=0)] = (
        0.0  #: s that a node stays off the bus before it begins to recover
    )


class FaultEntry(msgspec.Struct, forbid_unknown_fields=True, frozen=True, rename={"lasting": "for"}):
    """A fault of a simulated rig. It begins at a time and lasts for a time, by default from the start to the end."""

    name: str
    at: str = "0 s"  #: of the rig's time, which begins when it starts
    lasting: str | None = None
    values: dict[str, str | int | float] = {}  #: for its parameters, each with its unit

    def __str__(self) -> str:
        values = [f"{name} = {value}" for name, value in self.values.items()]
        return ", ".join(
            [self.name, *values, f"from {self.at}", *([f"for {self.lasting}"] if self.lasting else [])]
        )


class Simulation(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The properties of a simulated rig. A rig file without this table is never simulated and never started."""

    parameters: str = "astb"  #: name of a parameter set, or the path of its TOML file or of a model file
    seed: Annotated[int, Meta(ge=0, le=SEED_MAX)] = 0
    late_ticks: Literal["catch_up", "skip", "fault"] = "catch_up"
    change: dict[str, Any] = {}  #: override those of the set, each with its unit: orifice_diameter = "18 mm"
    effects: dict[str, Any] = {}  #: additional effects of the bench: "leak.left" = "0.2 mm2"
    limits: tuple[dict[str, Any], ...] = ()  #: override the assumed ones: `astb rig limits`
    sealed: str = ""  #: path of a file with sealed effects, which are not shown
    spring: str = ""  #: path of an FMU that computes the springs
    spring_map: SpringMap = SpringMap()  #: the map of its variables
    can: SimulatedCan = SimulatedCan()
    faults: tuple[FaultEntry, ...] = ()  #: faults and their times: `astb rig fault list`


class RigFile(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The content of a rig file: addresses and simulation of one rig, and the paths of its other files."""

    name: str
    description: str = ""
    time: Literal["real", "virtual"] = "real"
    can: Can = Can()
    modbus: Modbus = Modbus()
    simulation: Simulation | None = None
    amplitude_control: bool = (
        False  #: repeat waves and tracks with a corrected command until they are reached
    )
    like: str = ""  #: name or path of the rig from which this rig inherits the files that its folder lacks
    # Paths of the other files of the rig, which `read` finds. As keys of the rig file, they are a form of version 0.1.
    instruments: str = ""
    dimensions: str = ""
    wiring: str | dict[str, Any] = (
        ""  #: of a rig with its own messages or registers: a path, or the keys themselves
    )
    limits: tuple[dict[str, Any], ...] = ()  #: of a real rig, as far as they are known: for rehearsals


def rigs() -> dict[str, Path]:
    """Return the named rigs: those of the software, overridden by those in ``rigs`` in the current directory."""
    single = {path.stem: path for path in sorted(Path(PACKAGE).glob("*.toml"))}
    here = {path.parent.name: path for path in sorted(Path(PACKAGE).glob(f"*/{RIG}"))}
    return named_files(PACKAGE) | single | here


def find_rig(rig: str | Path = ORDINARY) -> tuple[RigFile, Path]:
    """Return a rig and the path of its file, by the path of the file or of its folder, or by a name of `rigs`.

    Raises RigFileError if there is none, or if the file is wrong.
    """
    path = _rig_path(str(rig), Path())
    return read(path), path


def _rig_path(rig: str, home: Path, where: str = "") -> Path:
    """Return the path of the rig file of a name, or of a path relative to ``home``. Raises RigFileError for an unknown
    name.

    The error begins with ``where``.
    """
    path = home / rig
    if path.suffix == ".toml":
        return place_of(PACKAGE, path)
    if (path / RIG).is_file():
        return path / RIG
    if Path(rig).parent != Path() or path.is_file():
        return path / RIG if path.is_dir() else path
    if rig in (known := rigs()):
        return known[rig]
    raise RigFileError(
        f"{where}there is no rig {rig!r}; {did_you_mean(rig, known)} (or give the path of its file or folder)"
    )


def read(path: Path) -> RigFile:
    """Return the rig described in ``path``; paths of simulation files in it are relative to this file.

    Raises RigFileError with the file, the key and the correct form.
    """
    content = _content(path)
    try:
        rig = msgspec.convert(content, RigFile)
    except msgspec.ValidationError as error:
        raise RigFileError(f"rig file {path}: {misfit(error, content, RigFile)}") from None
    if rig.time == "virtual" and rig.simulation is None:
        raise RigFileError(
            f"rig file {path}: time = virtual needs a [simulation] table; a real rig has only real time"
        )
    if rig.limits and rig.simulation is not None:
        raise RigFileError(
            f"rig file {path}: limits is only for a real rig; use simulation.limits for a simulated rig"
        )
    for key in _PARTS:
        if isinstance(content.get(key), str):
            earlier(
                f"rig file {path}: {key} = {content[key]!r}",
                f'name the rig file {RIG}, and put {OF_A_RIG[_PARTS[key]]} there, or inherit: like = "{ORDINARY}"',
            )
    beside = [key for key in ("can", "modbus", "simulation") if key in content]
    own, inherited = _files_of_rig(path, rig.like)
    if not beside:
        own = inherited | own
    elif rig.wiring or "wiring" in own:
        raise RigFileError(
            f"rig file {path}: a rig with a wiring is real and has its addresses in the wiring; remove "
            f"{' and '.join(beside)}, or the wiring"
        )
    parts = {key: str(place) for key, place in (inherited | own).items() if key != "wiring" or key in own}
    given = {key: getattr(rig, key) for key in _PARTS if getattr(rig, key)}
    rig = replace(rig, **{**parts, **given})
    return rig if rig.simulation is None else replace(rig, simulation=_placed(rig.simulation, path.parent))


def _files_of_rig(
    path: Path, like: str, above: tuple[Path, ...] = ()
) -> tuple[dict[str, Path], dict[str, Path]]:
    """Return the other files of the rig at ``path`` by their keys: its own, and those inherited from the rig ``like``.

    A copy of the virtual bench's wiring counts as no wiring: a rig without a wiring has our messages and registers.
    """
    found = {key: path.with_name(OF_A_RIG[kind]) for key, kind in _PARTS.items()} if path.name == RIG else {}
    own = {key: place.resolve() for key, place in found.items() if place.is_file()}
    if "wiring" in own and own["wiring"].read_bytes() == named_files("wirings")[ORDINARY].read_bytes():
        del own["wiring"]
    if not like:
        return own, {}
    other = _rig_path(like, path.parent, f"rig file {path}: like: ").resolve()
    above = (*above, path.resolve())
    if other in above:
        raise RigFileError(
            f"rig file {path}: like = {like!r} leads back to this rig; name another rig, or omit like"
        )
    theirs, inherited = _files_of_rig(other, str(_content(other).get("like", "")), above)
    return own, inherited | theirs


def _content(path: Path) -> dict[str, Any]:
    with file_errors(f"rig file {path}", RigFileError):
        return read_toml(path)


def _placed(simulation: Simulation, home: Path) -> Simulation:
    """Return the simulation with absolute paths, for a start from another directory; names do not change."""
    parameters, sealed, spring = simulation.parameters, simulation.sealed, simulation.spring
    if Path(parameters).suffix == ".toml":
        parameters = str((home / parameters).resolve())
    sealed, spring = (text and str((home / text).resolve()) for text in (sealed, spring))
    return replace(simulation, parameters=parameters, sealed=sealed, spring=spring)
