"""The keys of a wiring file, table by table; their comments make docs/reference/wiring.md."""

from __future__ import annotations

from typing import Any

import msgspec

from drivers.wiring.conversion import Calibration, ChoiceNumbers, Number, Sign


class SignalEntry(
    msgspec.Struct, forbid_unknown_fields=True, frozen=True, rename={"source": "from", "target": "to"}
):
    """One line under ``[signals]``."""

    source: str | list[str] = []  #: key ``from``: the point or points of a reading
    target: str = ""  #: key ``to``: the point of a set-point, setting or action
    read: str = ""  #: the point with the setting in force
    unit: str = ""  #: unit of the rig's number
    sign: Sign = 1  #: -1 if the rig has the opposite sign
    calibration: Calibration | None = None  #: applied before unit and sign
    value: str | Number | list[Number] = ""  #: expression over the points; numbers that an action writes
    function: str = ""  #: function of the file ``functions`` over the points
    choices: dict[str, ChoiceNumbers] = {}  #: the rig's number or numbers of each choice
    fixed: str | Number = ""  #: constant value of a setting on this rig
    initial: str | Number = ""  #: value of a setting without ``read`` before the first write
    within: str = "2 s"  #: longest time until ``read`` returns the new setting
    tolerance: str = ""  #: allowed difference of ``read``; default one step, or 0.1 % of the range
    given: str = ""  #: the point with a constant set-point, such as a token; read when the bench connects
    absent: str = ""  #: the reason why the rig does not have the signal


class CapabilitiesTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The table ``[capabilities]``."""

    generator: bool = False  #: the rig has a function generator; otherwise the bench generates the waves
    notes: dict[str, str] = {}  #: other properties of the rig, with any names


class PlayerTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The table ``[player]``: limits for the waves that the bench streams."""

    lever: str = "1 m"  #: distance from the middle to a vertical actuator
    speed: str = "0.6 m/s"  #: highest rate of a displacement wave
    roll_rate: str = "0.2 rad/s"  #: highest rate of a roll of the platform
    force_rate: str = "50 kN/s"  #: highest rate of a force


class StepTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """One ``[[sequences.up]]`` or ``[[sequences.reset]]``."""

    start: list[str]  #: states in which the step starts
    end: list[str]  #: states at its end
    orders: list[dict[str, Any]] = []  #: orders of the step, one after the other
    prepare: list[dict[str, Any]] = []  #: orders before the set-points are copied
    bumpless: bool = False  #: first set all set-points to the measured values
    afterwards: list[dict[str, Any]] = []  #: orders after the end state is reached
    within: str = ""  #: longest time of the step, if shorter than that of the whole sequence


class SequencesTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The table ``[sequences]``."""

    up: list[dict[str, Any]] = []  #: steps to ACTIVE
    reset: list[dict[str, Any]] = []  #: steps out of a fault
    rest: list[dict[str, Any]] = []  #: orders that bring the rig to rest from any state
    at_rest: list[str] = []  #: states of the rig at rest
    air: dict[str, str] = {}  #: the air in each state of the rig: "let off", "shut in" or "as ordered"
    open: list[dict[str, Any]] = []  #: orders after the bench connected: points and actions
    close: list[dict[str, Any]] = []  #: orders before it disconnects
    apply: list[dict[str, Any]] = []  #: orders after settings were written, for a rig that stages them


class WiringFile(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The whole file."""

    transports: dict[str, dict[str, Any]]  #: the connections to the rig, with your names
    signals: dict[str, Any]  #: source and target of each signal of the bench
    description: str = ""  #: free text
    latency: str = ""  #: time from an order to its effect in the readings, without sample periods
    functions: str = ""  #: a Python file in the same folder
    identity: dict[str, Any] = {}  #: points that identify the rig, with their numbers
    capabilities: CapabilitiesTable = CapabilitiesTable()  #: functions of the rig itself
    player: PlayerTable = PlayerTable()  #: limits of the waves of the bench
    sequences: SequencesTable = SequencesTable()  #: orders from state to state: start-up, reset, shutdown
