"""Names and numbers that both ends of the wires use: states, reasons, modes, axes, waves, sides.

Names with numbers on the wires are enums. The tuples have the names by number. Assigned numbers never change.
"""

import math
from enum import IntEnum
from typing import Final, Literal, get_args

from bench_protocol.units import m

SIDES: Final = ("left", "right")
#: Sources of a value of a parameter or specimen file.
PROVENANCES: Final = ("measured", "data sheet", "assumed", "derived")
ACTUATORS: Final = ("vertical_left", "vertical_right", "lateral")
#: Axes of the vibration platform.
PLATFORM_AXES: Final = ("vertical", "lateral", "roll")


class BenchState(IntEnum):
    """States of the bench."""

    OFF = 0
    BOOT = 1
    INIT = 2
    DISABLED = 3
    AIR_LOW = 4
    AIR_HIGH = 5
    HOLD = 6
    ACTIVE = 7
    FAULT_REACTION = 8
    FAULT_HOLD = 9
    FAULT_DISABLED = 10
    ESTOP = 11


class Program(IntEnum):
    """States of the function generator."""

    IDLE = 0
    RUN = 1
    HOLD = 2
    STOPPED = 3


class Reason(IntEnum):
    """The cause for which the bench left ACTIVE."""

    NONE = 0
    COMMAND_LATE = 1
    COMMAND_LOST = 2
    DISCONNECTED = 3
    ESTOP = 4
    LIMIT = 5
    TICK_LOST = 6
    BY_COMMANDER = 7
    HEARTBEAT_LOST = 8
    SPRING_LOST = 9


class LimitKind(IntEnum):
    """The property of a reading that a limit checks."""

    NONE = 0
    LOWER = 1
    UPPER = 2
    ERROR = 3
    RATE = 4
    TIMEOUT = 5
    COUNT = 6


#: States in which the air is under the bench's control and a commander must be alive.
LIVE: Final = (BenchState.AIR_LOW, BenchState.AIR_HIGH, BenchState.HOLD, BenchState.ACTIVE)
FAULTS: Final = (
    BenchState.FAULT_REACTION,
    BenchState.FAULT_HOLD,
    BenchState.FAULT_DISABLED,
    BenchState.ESTOP,
)

#: States in which the bench takes its safe position: hold while there is pressure, vent, lower, release.
SAFE: Final = (
    BenchState.OFF,
    BenchState.BOOT,
    BenchState.INIT,
    BenchState.DISABLED,
    BenchState.FAULT_DISABLED,
    BenchState.ESTOP,
)
#: The action for the safe position: the actuators hold, the air is vented, then the suspended mass is lowered.
TO_SAFE: Final = "action.disable"

STATES: Final = tuple(state.name for state in BenchState)
LIVE_STATES: Final = tuple(state.name for state in LIVE)
SAFE_STATES: Final = tuple(state.name for state in SAFE)
FAULT_STATES: Final = tuple(state.name for state in FAULTS)
PROGRAM_STATES: Final = tuple(state.name for state in Program)
LIMIT_KINDS: Final = tuple(kind.name.lower() for kind in LimitKind)
REASONS: Final = (
    "none",
    "command late",
    "command lost",
    "commander disconnected",
    "emergency stop",
    "limit tripped",
    "tick lost",
    "disabled by the commander",
    "heartbeat lost",
    "spring lost",
)
assert len(REASONS) == len(Reason), "every reason has one text"
#: Reasons that concern the wires and the commander, not the bench.
REASONS_OF_THE_LINK: Final = tuple(
    REASONS[reason]
    for reason in (Reason.COMMAND_LATE, Reason.COMMAND_LOST, Reason.DISCONNECTED, Reason.HEARTBEAT_LOST)
)

#: State of the air in the springs: let off or shut in by the rig, or as the commander orders.
AirFate = Literal["let off", "shut in", "as ordered"]
#: By state: in a safe position both springs are open to the atmosphere, in a holding fault all valves stay shut.
AIR_BY_STATE: Final[dict[str, AirFate]] = {
    state.name: "as ordered"
    if state in LIVE
    else "shut in"
    if state in (BenchState.FAULT_REACTION, BenchState.FAULT_HOLD)
    else "let off"
    for state in BenchState
}

AirMode = Literal["hold", "level", "fill", "vent"]
ControlMode = Literal["off", "force", "displacement"]
GeneratorAxis = Literal[
    "vertical", "roll", "lateral", "platform_vertical", "platform_lateral", "platform_roll"
]
GeneratorWave = Literal["sine", "unilateral_cosine", "triangle", "plateau"]

AIR_MODES: Final[tuple[AirMode, ...]] = get_args(AirMode)
CONTROL_MODES: Final[tuple[ControlMode, ...]] = get_args(ControlMode)
AXES: Final[tuple[GeneratorAxis, ...]] = get_args(GeneratorAxis)
WAVES: Final[tuple[GeneratorWave, ...]] = get_args(GeneratorWave)
SWITCH: Final = ("off", "on")
#: Peak speed of a wave with amplitude 1 and frequency 1 Hz.
STEEPEST: Final[dict[str, float]] = {
    "sine": math.tau,
    "unilateral_cosine": math.pi,
    "triangle": 4.0,
    "plateau": 0.5 * math.pi,
}
assert tuple(STEEPEST) == WAVES
#: Largest number of waves in one program of the function generator.
WAVES_AT_ONCE: Final = 8

#: Length of the connecting pipes that belong to the bench and that ``rig.pipe`` fits.
PIPE_LENGTH: Final = 1.5 * m
