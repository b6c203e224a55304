"""The keys of a wiring file, table by table; docs/reference/wiring.md explains each."""

from __future__ import annotations

from typing import Any

import msgspec

from drivers.wiring.conversion import Calibration, ChoiceNumbers, Number, Sign


class SignalEntry(
    msgspec.Struct, forbid_unknown_fields=True, frozen=True, rename={"source": "from", "target": "to"}
):
    """One line under ``[signals]``."""

    source: str | list[str] = []  #: key ``from``: the point or points that a reading comes from
    target: str = ""  #: key ``to``: the point that a set-point, setting or action goes to
    read: str = ""  #: the point that tells which setting is in force
    unit: str = ""  #: of the rig's number
    sign: Sign = 1
    calibration: Calibration | None = None
    value: str | Number | list[Number] = ""  #: an expression over the points; of an action, what is written
    function: str = ""  #: of the file ``functions``: what the points amount to
    choices: dict[str, ChoiceNumbers] = {}  #: numbers of the rig, by choice
    fixed: str | Number = ""  #: what a setting is on this rig, for good
    initial: str | Number = ""  #: what a setting without ``read`` is before it is first written
    within: str = "2 s"  #: how long a setting may take until ``read`` tells it
    tolerance: str = ""  #: by which ``read`` may differ from what was written
    absent: str = ""  #: why the rig does not have it


class CapabilitiesTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The table ``[capabilities]``."""

    generator: bool = (
        False  #: the rig has a function generator; else the bench streams its waves as set-points
    )
    notes: dict[str, str] = {}


class PlayerTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The table ``[player]``: what the waves that the bench streams may be."""

    lever: str = "1 m"  #: from the middle to a vertical actuator: what a roll of 1 rad lifts it by
    speed: str = "0.6 m/s"  #: of a wave's steepest place, at most
    roll_rate: str = "0.2 rad/s"
    force_rate: str = "50 kN/s"


class StepTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """One ``[[conduct.up]]`` or ``[[conduct.reset]]``."""

    start: list[str]
    end: list[str]
    orders: list[dict[str, Any]] = []
    prepare: list[dict[str, Any]] = []
    bumpless: bool = False
    afterwards: list[dict[str, Any]] = []
    within: str = ""


class ConductTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The table ``[conduct]``."""

    up: list[dict[str, Any]] = []
    reset: list[dict[str, Any]] = []
    rest: list[dict[str, Any]] = []
    at_rest: list[str] = []


class WiringFile(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The whole file."""

    transports: dict[str, dict[str, Any]]
    signals: dict[str, Any]
    description: str = ""
    latency: str = ""  #: until what was said shows in what is read, besides the rates themselves
    functions: str = ""  #: a Python file beside this one
    identity: dict[str, Any] = {}  #: points that tell that this is the rig that is meant, and what they read
    capabilities: CapabilitiesTable = CapabilitiesTable()
    player: PlayerTable = PlayerTable()
    conduct: ConductTable = ConductTable()
