"""The keys of a wiring file, table by table; their comments make docs/reference/wiring.md."""

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
    sign: Sign = 1  #: -1 where the rig counts the other way round
    calibration: Calibration | None = None  #: what the number means, before its unit and sign
    value: str | Number | list[Number] = ""  #: an expression over the points; of an action, what is written
    function: str = ""  #: of the file ``functions``: what the points amount to
    choices: dict[str, ChoiceNumbers] = {}  #: numbers of the rig, by choice
    fixed: str | Number = ""  #: what a setting is on this rig, for good
    initial: str | Number = ""  #: what a setting without ``read`` is before it is first written
    within: str = "2 s"  #: how long a setting may take until ``read`` tells it
    tolerance: str = ""  #: by which ``read`` may differ; else one step, or 0.1 % of the range
    given: str = ""  #: the point that tells a set-point for good when the bench connects: a token, say
    absent: str = ""  #: why the rig does not have it


class CapabilitiesTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The table ``[capabilities]``."""

    generator: bool = False  #: the rig has a function generator; else the bench plays the waves
    notes: dict[str, str] = {}  #: what else should be known of the rig, by any name


class PlayerTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The table ``[player]``: what the waves that the bench streams may be."""

    lever: str = "1 m"  #: from the middle to a vertical actuator: what a roll of 1 rad lifts it by
    speed: str = "0.6 m/s"  #: the steepest that a wave of a displacement may be
    roll_rate: str = "0.2 rad/s"  #: the same of a roll of the platform
    force_rate: str = "50 kN/s"  #: the same of a force


class StepTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """One ``[[sequences.up]]`` or ``[[sequences.reset]]``."""

    start: list[str]  #: states in which the step is taken
    end: list[str]  #: states that it must lead to
    orders: list[dict[str, Any]] = []  #: what is said, one after the other
    prepare: list[dict[str, Any]] = []  #: what is said before the set-points are taken over
    bumpless: bool = False  #: all set-points are first what is measured
    afterwards: list[dict[str, Any]] = []  #: what is said once the end is reached
    within: str = ""  #: how long it may take, where that is less than the whole way may


class SequencesTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The table ``[sequences]``."""

    up: list[dict[str, Any]] = []  #: steps to ACTIVE
    reset: list[dict[str, Any]] = []  #: steps out of a fault
    rest: list[dict[str, Any]] = []  #: orders that bring the rig to rest from any state
    at_rest: list[str] = []  #: states in which it is at rest
    air: dict[
        str, str
    ] = {}  #: by state, where it is known: the springs' air is "let off", "shut in" or "as ordered"
    open: list[dict[str, Any]] = []  #: orders when the bench has connected: points and actions
    close: list[dict[str, Any]] = []  #: the same before it disconnects
    apply: list[dict[str, Any]] = []  #: the same after settings have been written: where a rig stages them


class WiringFile(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The whole file."""

    transports: dict[str, dict[str, Any]]  #: the connections to the rig, by names of yours
    signals: dict[str, Any]  #: where each signal of the bench comes from and goes to
    description: str = ""  #: for people
    latency: str = ""  #: until what was said shows in what is read, besides the rates themselves
    functions: str = ""  #: a Python file beside this one
    identity: dict[str, Any] = {}  #: points that tell that this is the rig that is meant, and what they read
    capabilities: CapabilitiesTable = CapabilitiesTable()  #: what the rig does by itself
    player: PlayerTable = PlayerTable()  #: what the bench may do for it
    sequences: SequencesTable = (
        SequencesTable()
    )  #: how it is led from state to state: start-up, reset, shut-down
