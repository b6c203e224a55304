"""``[simulation.spring_map]``: the variables of an FMU for the quantities of a spring, and its steps."""

from typing import Final, Literal

import msgspec


class VariableKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A variable of the FMU. ``unit`` is needed if the FMU declares none and the variable is not in SI."""

    variable: str
    unit: str = ""
    factor: float = 1.0  #: FMU's number = factor · bench's number; -1 changes the sign


class SpringMap(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The map. Names on the left are the bench's, those on the right the FMU's.

    With names of both sides (``"left.height"``) one instance computes both springs; with names of one spring
    (``height``) there is one instance for each side. Without inputs and outputs the FMU must use the bench's names.
    """

    inputs: dict[str, str | VariableKeys] = {}
    outputs: dict[str, str | VariableKeys] = {}
    parameters: dict[str, str | int | float] = {}  #: start values, such as ``p_0 = "1 bar"``
    gauge: tuple[str, ...] = ()  #: gauge pressures of the FMU; the others are absolute
    step: str = ""  #: communication step; else one tick
    hold: Literal["begin", "middle", "end"] = "middle"  #: time within a step for which displacements hold
    process: Literal["own", "rig"] = "own"  #: in the rig's process a crash of the FMU ends the rig
    patience: str = "1 s"  #: timeout of a step


#: s
TIMEOUT_MAX: Final = 3600.0
