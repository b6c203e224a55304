"""A rig file: the TOML that says where a rig is, and, if it is a simulated one, what it simulates."""

import tomllib
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

Port = Annotated[int, Meta(ge=0, le=65535)]


class RigFileError(ValueError):
    """The rig file does not say what is needed, or says what nobody understands."""


class Can(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The CAN door."""

    bus: str = "auto"  #: auto | tcp | the name of a SocketCAN interface
    host: str = "127.0.0.1"
    port: Port = 29536  #: of the hub, for tcp


class Modbus(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The Modbus/TCP door."""

    host: str = "127.0.0.1"
    port: Port = 15020
    unit: Annotated[int, Meta(ge=0, le=255)] = 1


class Simulation(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """What a simulated rig simulates. A rig file without this table is never simulated and never started."""

    parameters: str = "astb"  #: name of a parameter set, or the path of its TOML file
    seed: Annotated[int, Meta(ge=0)] = 0
    late_ticks: Literal["catch_up", "skip", "fault"] = "catch_up"
    change: dict[
        str, str
    ] = {}  #: parameters over those of the set, each with its unit: orifice_diameter = "18 mm"


class RigFile(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """One rig."""

    name: str
    description: str = ""
    time: Literal["real", "virtual"] = "real"
    can: Can = Can()
    modbus: Modbus = Modbus()
    simulation: Simulation | None = None


def read(path: Path) -> RigFile:
    """Return the rig described in ``path``.

    Raises RigFileError, naming the file, the key and what would be right.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise RigFileError(f"rig file {path} cannot be read: {error.strerror}") from None
    try:
        rig = msgspec.convert(tomllib.loads(text), RigFile)
    except tomllib.TOMLDecodeError as error:
        raise RigFileError(f"rig file {path} is not TOML: {error}") from None
    except msgspec.ValidationError as error:
        raise RigFileError(f"rig file {path}: {error}") from None
    if rig.time == "virtual" and rig.simulation is None:
        raise RigFileError(
            f"rig file {path}: time = virtual needs a [simulation] table, a real rig has real time"
        )
    return rig
