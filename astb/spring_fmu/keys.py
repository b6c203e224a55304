"""``[simulation.spring_map]``: which variables of an FMU are what of a spring, and how it is driven."""

from typing import Final, Literal

import msgspec


class SpringFmuError(ValueError):
    """An FMU that cannot stand in for the springs; the text says what is wrong and what would be right."""


class VariableKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A variable of the FMU. ``unit`` is needed where the FMU gives none that is not SI."""

    variable: str
    unit: str = ""
    factor: float = 1.0  #: its number is ours times this: -1 turns its sign


class SpringMap(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The map. Names on the left are the bench's, those on the right the FMU's.

    With names of both sides (``"left.height"``) one instance is both springs; with names of one spring (``height``)
    there is an instance a side. Without inputs and outputs the FMU has to use the bench's own names.
    """

    inputs: dict[str, str | VariableKeys] = {}
    outputs: dict[str, str | VariableKeys] = {}
    parameters: dict[str, str | int | float] = {}  #: values at the start, such as ``p_0 = "1 bar"``
    gauge: tuple[str, ...] = ()  #: pressures of the FMU that are over the atmosphere; else they are absolute
    step: str = ""  #: of communication; else one tick
    hold: Literal["begin", "middle", "end"] = "middle"  #: which place of a step its displacements are
    process: Literal["own", "rig"] = "own"  #: a crash in the rig's own process takes the rig along
    patience: str = "1 s"  #: an FMU that needs longer for a step hangs


#: Seconds that an FMU may at most be waited for.
PATIENCE_MAX: Final = 3600.0
