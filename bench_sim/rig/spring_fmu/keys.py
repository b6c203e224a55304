"""The keys in ``[simulation.spring_map]``: which variables of an FMU are the quantities of a spring, and its steps."""

from typing import Final, Literal

import msgspec


class VariableKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A variable of the FMU. ``unit`` is needed if the FMU states no unit and the variable is not in SI."""

    variable: str
    unit: str = ""
    factor: float = 1.0  #: FMU's number = factor · bench's number; -1 changes the sign


class SpringMap(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The map from names of the bench (left) to names of variables in the FMU (right).

    With names that contain the side (``"left.height"``) one instance computes both springs. With names of one spring
    (``height``) each side has its own instance. Without inputs and outputs the FMU must use the names of the bench.
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
